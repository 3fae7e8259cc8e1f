//! `[[timing]]`: what happens to the time of loops and samples, as [`timing::Script`] has it.

mod argument;
mod values;

use super::settings::{Clock, Settings};
use super::{Scenario, wiring};
use crate::services::{Assignment, Loop};
use ::timing::{LoopEffect, LoopEntry, SampleEffect, SampleEntry, Script, Window};
use document::{Complaint, suggestion};
use garde::Validate;
use runtime::pacing::is_timed;
use runtime::{Graph, Rate};
use schemars::JsonSchema;
use serde::Deserialize;
use shared_types::time::ns_from_s;
use shared_types::{TopicInfo, topics};
use values::{DurationSettings, RecordedSettings, seconds_schema};

/// One `[[timing]]`: a loop begins late, takes its time, is stopped or misses wake-ups; or samples of a topic arrive late,
/// twice or never. Exactly one of these.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
#[expect(clippy::struct_excessive_bools, reason = "each is a key of its own in a scenario")]
pub struct TimingSettings {
    /// Name of a loop, as `morphquad check` lists them.
    #[serde(rename = "loop")]
    #[garde(skip)]
    pub of_loop: Option<String>,
    /// Name of a topic, in place of a loop.
    #[garde(skip)]
    pub topic: Option<String>,
    /// Only the sample of a topic that is released at this time or next \[s\].
    #[garde(range(min = 0.0, max = 1e6))]
    pub at_s: Option<f64>,
    /// From when; the start if left out \[s\].
    #[garde(range(min = 0.0, max = 1e6))]
    pub from_s: Option<f64>,
    /// Until when; the end if left out \[s\].
    #[garde(range(min = 0.0, max = 1e6))]
    pub to_s: Option<f64>,
    /// How much later the loop begins than its clock or its inputs would have it begin, always or drawn at each release:
    /// `{ uniform_s = [0.0, 0.001] }`, or `{ values_s = [0.0, 0.005], weights = [99, 1] }` \[s\].
    #[serde(default)]
    #[garde(skip)]
    #[schemars(schema_with = "seconds_schema")]
    pub start_late_s: Option<DurationSettings>,
    /// How long a step of the loop takes, always or drawn at each release as `start_late_s` \[s\].
    #[serde(default)]
    #[garde(skip)]
    #[schemars(schema_with = "seconds_schema")]
    pub step_s: Option<DurationSettings>,
    /// Each step as another flight had it, by release: how long after its release it began, before it if that is negative,
    /// and how long it took. Written by `--timing RECORDING`.
    #[garde(skip)]
    pub recorded: Option<RecordedSettings>,
    /// The loop is stopped, as by a debugger.
    #[serde(default)]
    #[garde(skip)]
    pub stopped: bool,
    /// Wake-ups by the loop's inputs are lost.
    #[serde(default)]
    #[garde(skip)]
    pub wake_missed: bool,
    /// How long after their publication the samples arrive, always or drawn for each as `start_late_s` \[s\].
    #[serde(default)]
    #[garde(skip)]
    #[schemars(schema_with = "seconds_schema")]
    pub late_s: Option<DurationSettings>,
    /// The samples never arrive.
    #[serde(default)]
    #[garde(skip)]
    pub lost: bool,
    /// The samples arrive twice.
    #[serde(default)]
    #[garde(skip)]
    pub duplicated: bool,
}

/// An entry as the script has it.
enum Entry {
    Loop(LoopEntry),
    Samples(SampleEntry),
}

/// What happens, of whatever it is about.
enum Effect {
    Loop(LoopEffect),
    Samples(SampleEffect),
}

/// What is wrong with a key of an entry, and what to do.
type Refusal = (&'static str, String, String);

fn refuse<T>(
    key: &'static str,
    what: impl Into<String>,
    remedy: impl Into<String>,
) -> Result<T, Refusal> {
    Err((key, what.into(), remedy.into()))
}

impl TimingSettings {
    /// The entry, in a flight of these settings and loops.
    fn entry(&self, settings: &Settings, graph: &Graph) -> Result<Entry, Refusal> {
        let effect = self.effect()?;
        match (&self.of_loop, &self.topic, effect) {
            (Some(name), None, Effect::Loop(effect)) => {
                self.of_a_loop(name, effect, settings, graph)
            }
            (None, Some(name), Effect::Samples(effect)) => {
                self.of_a_topic(name, effect, settings, graph)
            }
            (Some(_), None, Effect::Samples(_)) => refuse(
                "loop",
                "late_s, lost and duplicated are about samples",
                "name a topic in place of the loop",
            ),
            (None, Some(_), Effect::Loop(_)) => {
                let what =
                    "start_late_s, step_s, recorded, stopped and wake_missed are about a loop";
                refuse("topic", what, "name a loop in place of the topic")
            }
            (Some(_), Some(_), _) => {
                refuse("topic", "an entry is about a loop or about a topic", "write two entries")
            }
            (None, None, _) => {
                refuse("loop", "lacks a loop or a topic", "write loop = NAME or topic = NAME")
            }
        }
    }

    /// The one thing that happens.
    fn effect(&self) -> Result<Effect, Refusal> {
        let durations = [
            ("start_late_s", &self.start_late_s),
            ("step_s", &self.step_s),
            ("late_s", &self.late_s),
        ];
        let mut effects = Vec::new();
        for (key, settings) in durations {
            let Some(settings) = settings else { continue };
            let duration = settings.duration().map_err(|(what, remedy)| (key, what, remedy))?;
            effects.push(match key {
                "start_late_s" => Effect::Loop(LoopEffect::StartLate(duration)),
                "step_s" => Effect::Loop(LoopEffect::Step(duration)),
                _ => Effect::Samples(SampleEffect::Late(duration)),
            });
        }
        if let Some(recorded) = &self.recorded {
            let steps = recorded.steps().map_err(|(what, remedy)| ("recorded", what, remedy))?;
            effects.push(Effect::Loop(LoopEffect::Recorded(steps)));
        }
        let flags = [
            (self.stopped, Effect::Loop(LoopEffect::Stopped)),
            (self.wake_missed, Effect::Loop(LoopEffect::WakeMissed)),
            (self.lost, Effect::Samples(SampleEffect::Lost)),
            (self.duplicated, Effect::Samples(SampleEffect::Duplicated)),
        ];
        effects.extend(flags.into_iter().filter(|(is_set, _)| *is_set).map(|(_, effect)| effect));
        let mut effects = effects.into_iter();
        let (Some(effect), None) = (effects.next(), effects.next()) else {
            let what = "has not exactly one of start_late_s, step_s, recorded, stopped, wake_missed, late_s, lost and duplicated";
            return refuse("", what, "write one entry for each");
        };
        Ok(effect)
    }

    fn of_a_loop(
        &self,
        name: &str,
        effect: LoopEffect,
        settings: &Settings,
        graph: &Graph,
    ) -> Result<Entry, Refusal> {
        let flown = || graph.nodes().iter().filter_map(|node| Loop::of(node.role));
        let Some(known) = Loop::named(name).filter(|known| graph.node(known.role()).is_some())
        else {
            let remedy = suggestion(name, flown().map(|known| known.name));
            return refuse("loop", format!("no loop of this flight is called `{name}`"), remedy);
        };
        let role = known.role();
        // By the name of its role it is about any service that fills that.
        let own = Some(known.name).filter(|_| name.trim().replace('_', "-") != role.label());
        let assignment = Assignment::of(settings);
        let usual = assignment.name(role);
        if own.is_some_and(|own| own != usual && settings.candidates().all(|name| name != own)) {
            let what = format!("{name} does not fly in this flight");
            return refuse("loop", what, format!("name {usual}, or {} for any", role.label()));
        }
        if effect == LoopEffect::WakeMissed && is_timed(graph, role) {
            let what = format!("{name} goes by its own clock: no input wakes it");
            return refuse("wake_missed", what, "leave the entry away, or let it start late");
        }
        let rate_hz = graph.node(role).map_or(0.0, |node| node.rate.hz());
        if let Some(recorded) =
            self.recorded.as_ref().filter(|r| (r.rate_hz - rate_hz).abs() > 1e-6)
        {
            let what =
                format!("was recorded at {} Hz, and the loop is at {rate_hz} Hz", recorded.rate_hz);
            return refuse("recorded", what, "fly it at the rate at which it was recorded");
        }
        if self.at_s.is_some() {
            return refuse("at_s", "is about one sample of a topic", "write from_s and to_s");
        }
        Ok(Entry::Loop(LoopEntry {
            role,
            name: own.map(str::to_owned),
            window: self.window(settings)?,
            effect,
        }))
    }

    fn of_a_topic(
        &self,
        name: &str,
        effect: SampleEffect,
        settings: &Settings,
        graph: &Graph,
    ) -> Result<Entry, Refusal> {
        let flows = |topic: &&'static TopicInfo| {
            graph.edges().iter().any(|edge| edge.topic.name == topic.name)
        };
        let Some(topic) = topics::all().into_iter().filter(flows).find(|topic| topic.name == name)
        else {
            let known = topics::all().into_iter().filter(flows).map(|topic| topic.name);
            let remedy = suggestion(name, known);
            return refuse(
                "topic",
                format!("no loop of this flight reads a topic called `{name}`"),
                remedy,
            );
        };
        let mut window = self.window(settings)?;
        if let Some(at_s) = self.at_s {
            if self.from_s.or(self.to_s).is_some() {
                return refuse("at_s", "stands beside from_s or to_s", "write one of the two");
            }
            // A sensor's topic is published less often than the plant steps.
            let rate = wiring::sensor_rate(settings, topic);
            let rate = rate.or_else(|| Some(graph.node(graph.producer(topic))?.rate));
            let period_ns = rate.map_or(1, Rate::period_ns);
            let from_ns = ns_from_s(at_s);
            window = Window { from_ns, until_ns: from_ns.saturating_add(period_ns) };
        }
        Ok(Entry::Samples(SampleEntry { topic: topic.name.to_owned(), window, effect }))
    }

    fn window(&self, settings: &Settings) -> Result<Window, Refusal> {
        let from_ns = ns_from_s(self.from_s.unwrap_or(0.0));
        let until_ns = self.to_s.map_or(u64::MAX, ns_from_s);
        if from_ns >= until_ns {
            return refuse("to_s", "is not after from_s", "give a later time");
        }
        if from_ns.max(self.at_s.map_or(0, ns_from_s)) >= ns_from_s(settings.scenario.duration_s) {
            let key = if self.at_s.is_some() { "at_s" } else { "from_s" };
            return refuse(key, "is past the end of the flight", "give an earlier time");
        }
        Ok(Window { from_ns, until_ns })
    }
}

/// By the wall clock a loop can be made to wait, and nothing else.
fn refuse_in_realtime(entry: &TimingSettings, read: &Entry) -> Result<(), Refusal> {
    let is_a_wait =
        |effect: &LoopEffect| matches!(effect, LoopEffect::StartLate(_) | LoopEffect::Step(_));
    if matches!(read, Entry::Loop(LoopEntry { effect, .. }) if is_a_wait(effect)) {
        return Ok(());
    }
    let key = if entry.topic.is_some() { "topic" } else { "loop" };
    let what = "by the wall clock a loop can begin late and take its time, and nothing else";
    refuse(key, what, "fly it with clock = \"lockstep\", or with start_late_s and step_s alone")
}

/// Entries that ask for nothing that can be done.
pub(super) fn check(settings: &Settings, graph: &Graph) -> Vec<Complaint> {
    let mut complaints = Vec::new();
    if settings.timing.is_empty() {
        return complaints;
    }
    let mut refuse = |key: &str, what: &str, remedy: &str| {
        complaints.push((key.to_owned(), what.to_owned(), remedy.to_owned()));
    };
    let by_the_wall = settings.scenario.clock == Clock::Realtime;
    if let Some(path) = settings.candidates().find(|name| name.contains('/') && !by_the_wall) {
        let what = format!("{path} is a process of its own, which takes no turns");
        refuse("timing", &what, "swap to a service of morphquad, or leave either of the two away");
    }
    for (index, entry) in settings.timing.iter().enumerate() {
        let read = entry
            .entry(settings, graph)
            .and_then(|read| if by_the_wall { refuse_in_realtime(entry, &read) } else { Ok(()) });
        if let Err((key, what, remedy)) = read {
            let dot = if key.is_empty() { "" } else { "." };
            complaints.push((format!("timing[{index}]{dot}{key}"), what, remedy));
        }
    }
    complaints
}

impl Scenario {
    /// What happens to the time of its loops and samples; none if all is as in lockstep.
    #[must_use]
    pub fn timing(&self) -> Option<Script> {
        let settings = self.settings();
        let graph = self.graph().ok().filter(|_| !settings.timing.is_empty())?;
        let (mut loops, mut samples) = (Vec::new(), Vec::new());
        for entry in &settings.timing {
            match entry.entry(settings, &graph) {
                Ok(Entry::Loop(entry)) => loops.push(entry),
                Ok(Entry::Samples(entry)) => samples.push(entry),
                // The scenario would not have been loaded.
                Err(_) => {}
            }
        }
        Some(Script::new(settings.scenario.seed, loops, samples))
    }

    /// From when to when `[[timing]]` stops a loop \[ns\].
    #[must_use]
    pub fn stops_ns(&self) -> Vec<(u64, u64)> {
        let script = self.timing().unwrap_or_default();
        let stops = script.loops().iter().filter(|entry| entry.effect == LoopEffect::Stopped);
        stops.map(|entry| (entry.window.from_ns, entry.window.until_ns)).collect()
    }
}
