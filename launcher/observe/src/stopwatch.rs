//! Keeps the stamps of a flight's samples, and what its processes took, for later.

use super::usage::Usage;
use crate::Observer;
use shared_types::{AppliedCommand, AppliedSetpoint, Header, LoopStats, Role, Sample, Topic};
use std::any::Any;
use std::collections::BTreeMap;

/// From one look at the processes to the next \[ns\].
const LOOK_EVERY_NS: u64 = 500_000_000;

/// Name of this process.
pub const LAUNCHER: &str = "launcher";

/// When and whence a sample was.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Stamp {
    /// Of the sample, on its topic and seat.
    pub sequence: u64,
    /// Logical instant of the step \[ns\].
    pub release_ns: u64,
    /// Logical instant of its effect \[ns\].
    pub valid_ns: u64,
    /// IMU sample that it descends from.
    pub cause_sequence: u64,
    /// Sample of the step's first input that it goes by.
    pub input_sequence: u64,
    /// What else it names: the command, or the set point, that was applied.
    pub applied_sequence: u64,
    /// Seat of the writer of the command, or of the set point, that was applied.
    pub applied_seat: u32,
    /// When the step should have begun \[ns\].
    pub release_mono_ns: u64,
    /// When the input that it goes by had arrived; 0 if it is not known \[ns\].
    pub receive_mono_ns: u64,
    /// When it began \[ns\].
    pub start_mono_ns: u64,
    /// When it was published \[ns\].
    pub publish_mono_ns: u64,
    /// Seat of its writer.
    pub seat: u32,
}

impl Stamp {
    fn of<T: Sample>(sample: &T) -> Self {
        let header: &Header = sample.header();
        let any: &dyn Any = sample;
        let command = any
            .downcast_ref::<AppliedCommand>()
            .map(|applied| (applied.command_seat, applied.command_sequence));
        let setpoint = any
            .downcast_ref::<AppliedSetpoint>()
            .map(|applied| (applied.seat, applied.setpoint_sequence));
        let (applied_seat, applied_sequence) = command.or(setpoint).unwrap_or_default();
        Self {
            sequence: header.sequence,
            release_ns: header.release_ns,
            valid_ns: header.valid_ns,
            cause_sequence: header.cause_sequence,
            input_sequence: header.input_sequence,
            applied_sequence,
            applied_seat,
            release_mono_ns: header.release_mono_ns,
            receive_mono_ns: header.receive_mono_ns,
            start_mono_ns: header.start_mono_ns,
            publish_mono_ns: header.publish_mono_ns,
            seat: header.seat,
        }
    }
}

/// A process of the flight at one look.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Seen {
    /// Name of the service.
    pub name: String,
    pub role: Role,
    pub seat: u32,
    /// Its process, this one for the pilot.
    pub pid: u32,
    /// What it has taken so far.
    pub usage: Usage,
}

/// All processes at one look.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Look {
    /// When \[ns\].
    pub mono_ns: u64,
    /// The instances that were there.
    pub seen: Vec<Seen>,
}

/// Called with the instant of logical time 0 \[ns\] while there is still time until then.
pub type OnStart = Box<dyn FnOnce(u64) + Send>;

/// Everything that was kept.
#[derive(Default)]
pub struct Stopwatch {
    /// By topic, in the order of arrival.
    pub stamps: BTreeMap<&'static str, Vec<Stamp>>,
    /// Running totals of every loop, in the order of arrival.
    pub totals: Vec<LoopStats>,
    /// Looks at the processes.
    pub looks: Vec<Look>,
    /// Host instant of logical time 0 \[ns\].
    pub start_mono_ns: u64,
    on_start: Option<OnStart>,
}

impl core::fmt::Debug for Stopwatch {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Stopwatch")
            .field("start_mono_ns", &self.start_mono_ns)
            .finish_non_exhaustive()
    }
}

impl Stopwatch {
    /// Reports the start as soon as it is known.
    #[must_use]
    pub fn notifying(on_start: OnStart) -> Self {
        Self { on_start: Some(on_start), ..Self::default() }
    }

    /// With these stamps, however they came about.
    #[must_use]
    pub fn of_stamps(stamps: BTreeMap<&'static str, Vec<Stamp>>) -> Self {
        Self { stamps, ..Self::default() }
    }

    /// Takes note of the start.
    pub fn started(&mut self, start_mono_ns: u64) {
        self.start_mono_ns = start_mono_ns;
        if let Some(notify) = self.on_start.take() {
            notify(start_mono_ns);
        }
    }

    /// Takes note of a sample.
    pub fn observe<T: Sample>(&mut self, topic: &'static Topic<T>, sample: &T) {
        let any: &dyn Any = sample;
        if let Some(stats) = any.downcast_ref::<LoopStats>() {
            self.totals.push(*stats);
        } else if topic.info.from.is_stepping() {
            self.stamps.entry(topic.info.name).or_default().push(Stamp::of(sample));
        }
    }

    /// True if it is time to look at the processes.
    #[must_use]
    pub fn wants_look(&self, now_mono_ns: u64) -> bool {
        let last = self.looks.last().map_or(0, |look| look.mono_ns);
        now_mono_ns >= last + LOOK_EVERY_NS
    }

    /// Looks at the processes: role, seat, name and process of each.
    pub fn look<'a>(
        &mut self,
        now_mono_ns: u64,
        processes: impl Iterator<Item = (Role, u32, &'a str, u32)>,
    ) {
        let seen = processes.filter_map(|(role, seat, name, pid)| {
            Some(Seen { name: name.to_owned(), role, seat, pid, usage: Usage::of_process(pid)? })
        });
        let mut seen: Vec<Seen> = seen.collect();
        // The recorder is in it, and whatever else is done for the flight.
        let (name, role, pid) = (LAUNCHER.to_owned(), Role::Supervisor, std::process::id());
        if let Some(usage) = Usage::of_process(pid) {
            seen.push(Seen { name, role, seat: 0, pid, usage });
        }
        self.looks.push(Look { mono_ns: now_mono_ns, seen });
    }
}

impl Observer for Stopwatch {
    fn observe<T: Sample>(&mut self, topic: &'static Topic<T>, sample: &T) {
        Self::observe(self, topic, sample);
    }
}
