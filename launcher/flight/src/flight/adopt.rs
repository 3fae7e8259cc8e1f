//! `morphquad adopt`: a flight whose launcher has died goes on under another one.

use super::described::Described;
use super::leftovers::Leftovers;
use super::start::{Prepared, graph_of, restart_policy, takes_all_memory};
use super::{Flight, LOOK_EVERY_NS, Outcome};
use crate::checkpoint::{Checkpoint, CheckpointError, CheckpointWriter, Of, pid_namespace};
use crate::conductor::Conductor;
use crate::live::Live;
use crate::supervisor::{StartedFirst, Supervisor};
use crate::tap::FREED_LIMIT_NS;
use document::ScenarioError;
use protocol::control::SOCKET;
use protocol::topic::feed::Flying;
use record::{Continued, Facts, Recorder};
use runtime::clock::{WallMap, mono_now_ns, sleep_until};
use runtime::ipc::{Bus, PortError};
use runtime::leader::{LeadError, Leader};
use runtime::namespace::{Membership, remove_incomplete_objects};
use runtime::watch::StopFlags;
use scenario::Scenario;
use shared_types::{ClockMode, Role};
use simulate::setup::{
    RunError, RunOptions, Unflown, facts, recording_path, require_descriptors, require_own_proc,
    require_tasks, stamps_of, system,
};
use simulate::{Pin, Speed, Summary};
use std::path::{Path, PathBuf};
use swap::services::HeldServices;
use swap::{SlotWatch, Slots};
use thiserror::Error;

/// How long consumers may take to report which seat they follow \[ns\].
const REPORT_LIMIT_NS: u64 = 300_000_000;

/// Which run to take over, and how.
#[derive(Debug, Clone)]
pub struct AdoptOptions {
    /// Name of the run.
    pub run: String,
    pub folder: PathBuf,
    /// Folder of the next recording; that of the first one, if there is one, if `None`.
    pub record: Option<PathBuf>,
    /// Not to record.
    pub no_record: bool,
    /// Whether to show progress on standard error.
    pub progress: bool,
}

/// Why a run cannot be taken over; it goes on as it was.
#[derive(Debug, Error)]
pub enum AdoptError {
    /// A launcher leads it.
    #[error("run {run} needs no launcher: {source}")]
    Led {
        run: String,
        /// Which process leads it, or why its folder cannot be used.
        source: LeadError,
    },
    /// Its time stands still.
    #[error(
        "run {run} flies in lockstep, and its time stood still with its launcher, which alone knew how far it may go: it cannot go on, and its processes leave within {leave_s} s; fly it again, it will be the same flight"
    )]
    Lockstep {
        run: String,
        /// When the processes leave \[s\].
        leave_s: f64,
    },
    /// Its launcher died too early.
    #[error("run {run} had not started when its launcher died: its processes leave")]
    NotStarted { run: String },
    /// Of another build.
    #[error("run {run} cannot be taken over: {reason}")]
    OtherBuild {
        run: String,
        /// What differs.
        reason: String,
    },
    /// Its processes have other numbers here, or none.
    #[error(
        "run {run} cannot be taken over from here, where its processes cannot be seen: take it over in the PID namespace in which it was started"
    )]
    OtherNamespace { run: String },
    #[error("run {run} cannot be taken over: its scenario cannot be read: {source}")]
    Scenario {
        run: String,
        /// Why.
        source: Box<ScenarioError>,
    },
    /// As when a flight starts.
    #[error(transparent)]
    Run(#[from] RunError),
}

impl From<PortError> for AdoptError {
    fn from(error: PortError) -> Self {
        Self::Run(error.into())
    }
}

/// Takes over a run whose launcher has died, and leads it to its end.
///
/// # Errors
/// [`AdoptError`]: before the run waits for this launcher nothing has been done to it. What happens in flight is in the
/// summary.
pub fn adopt(options: &AdoptOptions) -> Result<Summary, AdoptError> {
    let AdoptOptions { run, folder, .. } = options;
    let run = run.clone();
    let stop = StopFlags::watch_signals().map_err(system("watch signals"))?;
    require_own_proc()?;
    require_descriptors()?;
    require_tasks()?;
    let before = Leader::of_run(folder);
    // Declared before everything that uses the transport, so that it is dropped last and wipes.
    let mut membership = Membership::take_over(folder)
        .map_err(|source| AdoptError::Led { run: run.clone(), source })?;
    let mut checkpoint = Checkpoint::read(folder).map_err(|error| match error {
        CheckpointError::Unreadable { .. } => AdoptError::NotStarted { run: run.clone() },
        other => AdoptError::OtherBuild { run: run.clone(), reason: other.to_string() },
    })?;
    if checkpoint.of.pid_namespace != pid_namespace() {
        return Err(AdoptError::OtherNamespace { run });
    }
    let scenario = Scenario::load(&folder.join("scenario.toml").to_string_lossy(), &[])
        .map_err(|source| AdoptError::Scenario { run: run.clone(), source: Box::new(source) })?;
    if checkpoint.clock.0.mode == ClockMode::Lockstep {
        let leave_s = scenario.settings().launcher.launcher_grace_s.min(host::LOCKSTEP_GRACE_S);
        return Err(AdoptError::Lockstep { run, leave_s });
    }
    if !checkpoint.clock.0.started.is_set() {
        return Err(AdoptError::NotStarted { run });
    }
    let wall = WallMap::new(&checkpoint.clock.0);
    let from_ns = wall.logical_ns(mono_now_ns());
    let options = RunOptions {
        scenario,
        speed: Speed::Times(checkpoint.clock.0.speed),
        record: options.recording_folder(&checkpoint),
        name: None,
        pin: checkpoint.posts.iter().find_map(|post| post.spec.cpu).map_or(Pin::None, Pin::Cpu),
        disorder: None,
        progress: options.progress,
        live: None,
    };
    let (path, recording) = open_recording(&options, &checkpoint, from_ns)?;
    let unflown = Unflown::of(path.as_deref());
    // From here on the processes wait for no other launcher.
    membership.announce_lead().map_err(RunError::from)?;
    let mut flight =
        Flight::find(&options, &membership, stop, &mut checkpoint, (path.as_deref(), recording))?;
    unflown.begins();
    let predecessor =
        before.map_or_else(String::new, |leader| format!(" from process {}", leader.pid));
    let outcome = match flight.take_over(&checkpoint) {
        Ok(()) => {
            let s = flight.begun.0 as f64 * 1e-9;
            flight.notice(&format!("took run {run} over at {s:.3} s{predecessor}, which had died"));
            flight.fly()
        }
        Err(error) => Outcome::Lost(error),
    };
    let (summary, _) = flight.conclude(outcome, &options, &run, path);
    Ok(summary)
}

impl AdoptOptions {
    /// Where to record: as asked for, or beside the recording before.
    fn recording_folder(&self, checkpoint: &Checkpoint) -> Option<PathBuf> {
        let beside = || Some(checkpoint.of.recording.as_deref()?.parent()?.to_path_buf());
        self.record.clone().or_else(beside).filter(|_| !self.no_record)
    }
}

/// The recording from here on, which names what it continues.
fn open_recording(
    options: &RunOptions,
    checkpoint: &Checkpoint,
    from_ns: u64,
) -> Result<(Option<PathBuf>, Option<Recorder>), RunError> {
    let Some(folder) = options.record.as_deref() else { return Ok((None, None)) };
    let Of { run, file: before, adoptions, epoch_unix_ns, .. } = &checkpoint.of;
    let mut number = adoptions + 1;
    let mut path = recording_path(folder, &format!("{run}-adopted-{number}"))?;
    while path.exists() {
        // Of a launcher that died before it led.
        number += 1;
        path = recording_path(folder, &format!("{run}-adopted-{number}"))?;
    }
    let file = before.clone().unwrap_or_else(|| "a flight without a recording".to_owned());
    let continues = Some(Continued { file, from_ns });
    let facts = Facts { epoch_unix_ns: *epoch_unix_ns, continues, ..facts(run, options) };
    let mut recording = Recorder::create(&path, &facts)?;
    recording.set_start(checkpoint.clock.0.start_mono_ns);
    Ok((Some(path), Some(recording)))
}

impl Flight {
    /// Finds everything that a launcher leads, with the ports of its own.
    fn find(
        options: &RunOptions,
        membership: &Membership,
        stop: StopFlags,
        checkpoint: &mut Checkpoint,
        (path, recording): (Option<&Path>, Option<Recorder>),
    ) -> Result<Self, AdoptError> {
        let scenario = &options.scenario;
        let folder = membership.folder();
        let graph = graph_of(scenario)?;
        let described = Described::left(folder)?;
        remove_incomplete_objects(folder);
        let bus = Bus::join(&membership.ipc_config(), "launcher")?;
        bus.lead()?;
        let takes_all = takes_all_memory(scenario, bus.reservation().taken_mb());
        let policy = restart_policy(scenario, takes_all);
        let are_several = !core::mem::replace(&mut checkpoint.of.is_swept, false);
        let mut started = StartedFirst::of(checkpoint, folder, &bus, policy.room);
        let services = HeldServices::take_over(&bus)?;
        // Not before the services are held: those that nothing but the dead hold would vanish with them.
        let leftovers = Leftovers::of(&bus, are_several, takes_all);
        let of = checkpoint.of.taken_over(path);
        let give_up_ns = mono_now_ns() + FREED_LIMIT_NS;
        // Services admit only so many readers and writers: as a rule there is room beside the dead launcher's, and if
        // there is none they have to be swept away first.
        let mut supervisor = loop {
            let checkpoint_writer = CheckpointWriter::new(folder, of.clone(), &checkpoint.clock.0);
            let found = Supervisor::take_over(
                &bus,
                folder.to_path_buf(),
                (checkpoint, &mut started),
                policy,
                checkpoint_writer,
            );
            match found {
                Err(_) if mono_now_ns() < give_up_ns => {
                    bus.sweep_dead_processes(&mut || ());
                    sleep_until(mono_now_ns() + 20_000_000);
                }
                found => break found?,
            }
        };
        supervisor.start_gone(mono_now_ns());
        let startup_ns =
            shared_types::time::ns_from_s(scenario.settings().launcher.startup_timeout_s);
        let slots = Slots::none_yet(&checkpoint.posts, scenario, startup_ns);
        let end_ns = scenario.duration_ns();
        let conductor = Conductor::take_over(&bus, checkpoint.clock.0, end_ns, &graph)?;
        // The dead launcher's socket; nothing listens there.
        let _ = std::fs::remove_file(folder.join(SOCKET));
        let name = &scenario.settings().scenario.name;
        let flying = Flying::new(checkpoint.of.epoch_unix_ns, stamps_of(options));
        let live = Live::open(folder, &checkpoint.of.run, name, path, flying)?;
        let prepared = Prepared {
            graph,
            bus,
            services,
            supervisor,
            slots,
            conductor,
            recording,
            live,
            stop,
            takes_all,
            // No launcher goes on with a lockstep flight.
            timed: None,
            described,
        };
        Ok(Self { leftovers: Some(leftovers), ..Self::of(prepared, options)? })
    }

    /// Takes the lead: publishes again what the launcher before has published last, and goes on with each slot as its
    /// consumer has it.
    fn take_over(&mut self, checkpoint: &Checkpoint) -> Result<(), String> {
        let now_ns = mono_now_ns();
        self.begun = (self.conductor.wall_ns(now_ns), now_ns);
        self.progress_at = (now_ns, 0);
        self.protect();
        self.script.skip_before(self.begun.0);
        self.announcements.skip_before(self.begun.0);
        self.orders.go_on(&checkpoint.guidance.0, &checkpoint.disturbance.0);
        self.conductor.publish_again();
        let led = self.supervisor.go_on(checkpoint, &mut self.tap);
        led.map_err(|error| error.to_string())?;
        self.listen(checkpoint);
        for record in &checkpoint.owners {
            let posts = &checkpoint.posts;
            let living: Vec<_> = self.supervisor.living().collect();
            self.with_slots(mono_now_ns(), |slots, context| {
                slots.take_over(&record.0, posts, &living, context)
            })
            .map_err(|error| error.to_string())?;
        }
        Ok(())
    }

    /// Waits until the consumers have reported which seat they follow, and what was published before has been published
    /// again: what happened to a slot while no launcher led is known to its processes alone.
    fn listen(&mut self, checkpoint: &Checkpoint) {
        // What follows the position slot is in the attitude slot, if anything is alive there.
        let has_position = checkpoint.posts.iter().any(|post| post.place().role == Role::Position);
        let mut living = self.supervisor.living();
        let position_too = has_position && living.any(|(seat, ..)| seat.role == Role::Attitude);
        let give_up_ns = mono_now_ns() + REPORT_LIMIT_NS;
        while mono_now_ns() < give_up_ns {
            self.tap.drain(mono_now_ns());
            let watch = self.tap.sinks.slot_watch.as_ref();
            let have_reported =
                watch.is_none_or(|watch: &SlotWatch| watch.has_reports(position_too));
            if have_reported && self.supervisor.has_served_since(&self.tap, self.tap.opened_mono_ns)
            {
                return;
            }
            sleep_until(mono_now_ns() + LOOK_EVERY_NS);
        }
    }
}
