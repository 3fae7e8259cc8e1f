//! What happens to the time of loops and samples, from when to when.

use crate::duration::Duration;
use core::fmt;
use noise::{Noise, Source};
use serde::{Deserialize, Serialize};
use shared_types::{Header, Role};
use std::collections::BTreeMap;

/// From one instant to right before another.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Window {
    /// First instant \[ns\].
    pub from_ns: u64,
    /// First instant after it; `u64::MAX`, which no file of the run can tell, if there is none \[ns\].
    #[serde(default = "no_end", skip_serializing_if = "is_no_end")]
    pub until_ns: u64,
}

impl Window {
    /// True if an instant lies in it.
    #[must_use]
    pub fn contains(&self, at_ns: u64) -> bool {
        (self.from_ns..self.until_ns).contains(&at_ns)
    }
}

/// What happens to the time of a loop.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum LoopEffect {
    /// It begins so much later than its clock or its inputs would have it begin.
    StartLate(Duration),
    /// Its step takes so long.
    Step(Duration),
    /// It is stopped, as by a debugger: what it does goes on at the end.
    Stopped,
    /// Wake-ups by its inputs are lost, so that it looks when its wait is over.
    WakeMissed,
    /// Its steps begin when they began in another flight, by their releases \[ns\], or later if they have no reason to until
    /// then, and take as long. Of one of which nothing is known nothing is changed.
    Recorded(#[serde(with = "steps")] BTreeMap<u64, RecordedStep>),
}

/// A step of another flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RecordedStep {
    /// When it began; a source works ahead of the start \[ns\].
    pub begin_ns: i64,
    /// How long it took \[ns\].
    pub step_ns: u64,
}

/// A loop and the service that fills it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LoopName<'a> {
    /// Its role.
    pub role: Role,
    /// Name of the service.
    pub name: &'a str,
}

/// One entry about a loop.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LoopEntry {
    /// Its role.
    #[serde(with = "by_label")]
    pub role: Role,
    /// Name of the service that it is about alone; any that fills the role if none.
    pub name: Option<String>,
    /// From when to when.
    pub window: Window,
    /// What.
    pub effect: LoopEffect,
}

impl LoopEntry {
    fn is_about(&self, of: LoopName<'_>) -> bool {
        self.role == of.role && self.name.as_ref().is_none_or(|name| name == of.name)
    }
}

/// What happens to the samples of a topic.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum SampleEffect {
    /// They arrive so much later.
    Late(Duration),
    /// They never arrive.
    Lost,
    /// They arrive twice.
    Duplicated,
}

/// One entry about a topic.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SampleEntry {
    /// Its name.
    pub topic: String,
    /// Releases of the samples.
    pub window: Window,
    /// What.
    pub effect: SampleEffect,
}

impl fmt::Display for Window {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "from {:.3} s", self.from_ns as f64 / 1e9)?;
        match self.until_ns {
            u64::MAX => f.write_str(" on"),
            until_ns => write!(f, " to {:.3} s", until_ns as f64 / 1e9),
        }
    }
}

impl fmt::Display for LoopEntry {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { role, name, window, effect } = self;
        let name = name.as_deref().unwrap_or(role.label());
        match effect {
            LoopEffect::StartLate(late) => write!(f, "{name} begins {late} late"),
            LoopEffect::Step(step) => write!(f, "{name} takes {step} for a step"),
            LoopEffect::Stopped => write!(f, "{name} is stopped"),
            LoopEffect::WakeMissed => write!(f, "{name} misses wake-ups"),
            LoopEffect::Recorded(steps) => {
                return write!(
                    f,
                    "{name} begins {} steps when they were recorded, and takes as long",
                    steps.len()
                );
            }
        }?;
        write!(f, " {window}")
    }
}

impl fmt::Display for SampleEntry {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { topic, window, effect } = self;
        match effect {
            SampleEffect::Late(late) => write!(f, "samples of {topic} arrive {late} late"),
            SampleEffect::Lost => write!(f, "samples of {topic} are lost"),
            SampleEffect::Duplicated => write!(f, "samples of {topic} arrive twice"),
        }?;
        write!(f, " {window}")
    }
}

/// How a sample gets to its readers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Arrival {
    /// How long after it was published \[ns\].
    pub delay_ns: u64,
    /// How often: 0 for a sample that is lost.
    pub copies: u32,
}

/// Everything that happens to the time of a flight. Entries of one kind that overlap add up.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Script {
    seed: u64,
    loops: Vec<LoopEntry>,
    samples: Vec<SampleEntry>,
}

impl Script {
    /// Of these entries, with draws of a seed.
    #[must_use]
    pub fn new(seed: u64, loops: Vec<LoopEntry>, samples: Vec<SampleEntry>) -> Self {
        Self { seed, loops, samples }
    }

    /// The same on a clock on which logical time 0 is at `start_ns`: windows of loops and begins of recorded steps are on
    /// it, and releases are not \[ns\].
    #[must_use]
    pub fn on_clock(mut self, start_ns: u64) -> Self {
        for LoopEntry { window, effect, .. } in &mut self.loops {
            window.from_ns = window.from_ns.saturating_add(start_ns);
            window.until_ns = window.until_ns.saturating_add(start_ns);
            if let LoopEffect::Recorded(steps) = effect {
                for step in steps.values_mut() {
                    step.begin_ns = step.begin_ns.saturating_add_unsigned(start_ns);
                }
            }
        }
        self
    }

    /// Its entries about loops.
    #[must_use]
    pub fn loops(&self) -> &[LoopEntry] {
        &self.loops
    }

    /// Its entries about topics.
    #[must_use]
    pub fn samples(&self) -> &[SampleEntry] {
        &self.samples
    }

    /// A sentence for each entry, with the window in which it holds, ordered by its beginning.
    #[must_use]
    pub fn announced(&self) -> Vec<(Window, String)> {
        let loops = self.loops.iter().map(|entry| (entry.window, entry.to_string()));
        let samples = self.samples.iter().map(|entry| (entry.window, entry.to_string()));
        let mut entries: Vec<_> = loops.chain(samples).collect();
        entries.sort_by_key(|(window, _)| window.from_ns);
        entries
    }

    /// The same sentences, to be announced when each entry begins.
    #[must_use]
    pub fn announcements(&self) -> Announcements {
        let mut entries = self.announced();
        entries.reverse();
        Announcements(entries)
    }

    /// When a loop begins that has a reason to at `at_ns`, for its next release \[ns\].
    #[must_use]
    pub fn begins_ns(&self, name: LoopName<'_>, at_ns: u64, release_ns: u64) -> u64 {
        let late_ns = self.sum(name, at_ns, release_ns, |effect| match effect {
            LoopEffect::StartLate(duration) => Some(duration),
            _ => None,
        });
        let at_ns = at_ns.saturating_add(late_ns);
        let recorded = self.recorded(name, |steps| steps.get(&release_ns));
        let recorded_ns = recorded.map(|step| u64::try_from(step.begin_ns).unwrap_or(0));
        self.goes_on_ns(name, recorded_ns.max().unwrap_or(0).max(at_ns))
    }

    /// When the step for a release that begins at `start_ns` is over \[ns\].
    #[must_use]
    pub fn ends_ns(&self, name: LoopName<'_>, start_ns: u64, release_ns: u64) -> u64 {
        let step_ns = self.sum(name, start_ns, release_ns, |effect| match effect {
            LoopEffect::Step(duration) => Some(duration),
            _ => None,
        });
        let recorded = self.recorded(name, |steps| steps.get(&release_ns));
        let recorded_ns = recorded.map(|step| step.step_ns).fold(0, u64::saturating_add);
        let (mut at_ns, mut left_ns) = (start_ns, step_ns.saturating_add(recorded_ns));
        // It computes from one stop to the next.
        while let Some(stop_ns) = self.next_stop_ns(name, at_ns) {
            let runs_ns = stop_ns.saturating_sub(at_ns);
            if runs_ns >= left_ns {
                break;
            }
            left_ns -= runs_ns;
            at_ns = self.goes_on_ns(name, stop_ns);
        }
        at_ns.saturating_add(left_ns)
    }

    /// When a loop begins that is woken at `at_ns`, for its next release; none if the wake-up is lost \[ns\].
    #[must_use]
    pub fn woken_ns(&self, name: LoopName<'_>, at_ns: u64, release_ns: u64) -> Option<u64> {
        (!self.misses_wake(name, at_ns)).then(|| self.begins_ns(name, at_ns, release_ns))
    }

    /// True if a wake-up of a loop is lost at an instant.
    #[must_use]
    pub fn misses_wake(&self, name: LoopName<'_>, at_ns: u64) -> bool {
        self.of(name, at_ns).any(|(_, entry)| entry.effect == LoopEffect::WakeMissed)
    }

    /// How a sample of a topic gets to its readers.
    #[must_use]
    pub fn arrival(&self, topic: &str, header: &Header) -> Arrival {
        let (mut delay_ns, mut copies, mut is_lost) = (0_u64, 1_u32, false);
        let meant =
            |entry: &&SampleEntry| entry.topic == topic && entry.window.contains(header.release_ns);
        for (number, entry) in (self.loops.len()..).zip(&self.samples) {
            if !meant(&entry) {
                continue;
            }
            match &entry.effect {
                SampleEffect::Late(duration) => {
                    let late_ns = duration.draw_ns(self.uniform(number, header.release_ns));
                    delay_ns = delay_ns.saturating_add(late_ns);
                }
                SampleEffect::Lost => is_lost = true,
                SampleEffect::Duplicated => copies = copies.saturating_add(1),
            }
        }
        Arrival { delay_ns, copies: if is_lost { 0 } else { copies } }
    }

    /// When a loop goes on that may be stopped at an instant \[ns\].
    fn goes_on_ns(&self, name: LoopName<'_>, at_ns: u64) -> u64 {
        let mut at_ns = at_ns;
        while let Some(until_ns) =
            self.stops(name).filter(|w| w.contains(at_ns)).map(|w| w.until_ns).max()
        {
            at_ns = until_ns;
        }
        at_ns
    }

    /// When a loop that runs at an instant is stopped next \[ns\].
    fn next_stop_ns(&self, name: LoopName<'_>, at_ns: u64) -> Option<u64> {
        let to_come = self.stops(name).filter(|w| w.from_ns < w.until_ns && w.until_ns > at_ns);
        to_come.map(|w| w.from_ns.max(at_ns)).min()
    }

    /// What the recorded steps of a loop give.
    fn recorded<'a, T>(
        &'a self,
        name: LoopName<'_>,
        look_up: impl Fn(&'a BTreeMap<u64, RecordedStep>) -> Option<T>,
    ) -> impl Iterator<Item = T> {
        let entries = self.loops.iter().filter(move |entry| entry.is_about(name));
        entries.filter_map(move |entry| match &entry.effect {
            LoopEffect::Recorded(steps) => look_up(steps),
            _ => None,
        })
    }

    fn stops(&self, name: LoopName<'_>) -> impl Iterator<Item = Window> {
        let entries = self.loops.iter();
        entries
            .filter(move |entry| entry.is_about(name) && entry.effect == LoopEffect::Stopped)
            .map(|entry| entry.window)
    }

    fn of(&self, name: LoopName<'_>, at_ns: u64) -> impl Iterator<Item = (usize, &LoopEntry)> {
        let entries = self.loops.iter().enumerate();
        entries.filter(move |(_, entry)| entry.is_about(name) && entry.window.contains(at_ns))
    }

    fn sum(
        &self,
        name: LoopName<'_>,
        at_ns: u64,
        release_ns: u64,
        duration: impl Fn(&LoopEffect) -> Option<&Duration>,
    ) -> u64 {
        let drawn = self.of(name, at_ns).filter_map(|(number, entry)| {
            let duration = duration(&entry.effect)?;
            Some(duration.draw_ns(self.uniform(number, release_ns)))
        });
        drawn.fold(0, u64::saturating_add)
    }

    /// The number from [0, 1) that an entry draws for a release.
    fn uniform(&self, number: usize, release_ns: u64) -> f64 {
        let mut noise = Noise::new(self.seed, Source::TIMING, number as u64);
        noise.seek(release_ns);
        noise.uniform()
    }
}

/// Entries of a script that have not been announced yet, the earliest last.
#[derive(Debug, Clone)]
pub struct Announcements(Vec<(Window, String)>);

impl Announcements {
    /// The next entry that begins by an instant, and from when it holds \[ns\].
    pub fn next_by(&mut self, now_ns: u64) -> Option<(u64, String)> {
        let next = self.0.pop_if(|(window, _)| window.from_ns <= now_ns);
        next.map(|(window, text)| (window.from_ns, text))
    }

    /// Leaves out what is over at an instant \[ns\].
    pub fn skip_before(&mut self, now_ns: u64) {
        self.0.retain(|(window, _)| window.until_ns > now_ns);
    }
}

fn no_end() -> u64 {
    u64::MAX
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde calls it so")]
fn is_no_end(until_ns: &u64) -> bool {
    *until_ns == u64::MAX
}

/// Roles by their labels.
mod by_label {
    use serde::de::Error as _;
    use serde::{Deserialize, Deserializer, Serializer};
    use shared_types::Role;

    #[expect(clippy::trivially_copy_pass_by_ref, reason = "serde calls it so")]
    pub(super) fn serialize<S: Serializer>(role: &Role, to: S) -> Result<S::Ok, S::Error> {
        to.serialize_str(role.label())
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Role, D::Error> {
        let label = String::deserialize(from)?;
        let role = Role::STEPPING.into_iter().find(|role| role.label() == label);
        role.ok_or_else(|| D::Error::custom(format!("no loop is called {label}")))
    }
}

/// Recorded steps as `[release_ns, begin_ns, step_ns]`, because keys of a file are text.
mod steps {
    use super::RecordedStep;
    use serde::{Deserialize, Deserializer, Serializer};
    use std::collections::BTreeMap;

    pub(super) fn serialize<S: Serializer>(
        steps: &BTreeMap<u64, RecordedStep>,
        to: S,
    ) -> Result<S::Ok, S::Error> {
        to.collect_seq(
            steps.iter().map(|(release_ns, step)| (release_ns, step.begin_ns, step.step_ns)),
        )
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(
        from: D,
    ) -> Result<BTreeMap<u64, RecordedStep>, D::Error> {
        let steps = Vec::<(u64, i64, u64)>::deserialize(from)?.into_iter();
        let step =
            |(release_ns, begin_ns, step_ns)| (release_ns, RecordedStep { begin_ns, step_ns });
        Ok(steps.map(step).collect())
    }
}

#[cfg(test)]
mod tests;
