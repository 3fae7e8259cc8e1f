//! What came out again against what was recorded, sample by sample and state by state.

use super::ReplayError;
use super::again::{Replayed, Topics, fly_again};
use super::fields::{Named, first_difference, numbers_of_state};
use super::pairs::{Pair, difference, pairs};
use super::tapes::{Recorded, load};
use crate::components::{Component, ComponentVisitor, Crew};
use crate::record::read::{RecordedFlight, RecordedState};
use core::convert::Infallible;
use runtime::output::{Output, OutputSet as _, OutputVisitor};
use runtime::service::{Service, state_size};
use shared_types::{Header, Role, Sample, Topic, topics};
use std::collections::BTreeSet;

/// Fields that depend on the machine and are reproduced all the same.
const REPRODUCED: [&str; 1] = ["generation"];

/// One field that came out differently.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Difference {
    /// Instant of the step \[ns\].
    pub release_ns: u64,
    /// Index of the step in the loop's grid.
    pub release_index: u64,
    /// Topic, or `state/<role>`.
    pub topic: String,
    /// Field, with its place in arrays and nested structs.
    pub field: String,
    /// As recorded; doubles with their bits.
    pub recorded: String,
    /// As it came out again.
    pub replayed: String,
}

/// What the replay of one service says.
#[derive(Debug, Clone)]
pub struct ServiceVerdict {
    /// Its role.
    pub role: Role,
    /// Steps run again.
    pub steps: u64,
    /// Samples compared, all fields but those that only the machine determines.
    pub samples: u64,
    /// States compared.
    pub states: u64,
    /// Samples that came out and that the recorder had lost.
    pub unrecorded: u64,
    /// Samples and states that differ, or exist only once.
    pub differences: u64,
    /// The earliest of them.
    pub first: Option<Difference>,
}

/// What the replay of a recording says.
#[derive(Debug, Clone)]
pub struct Verification {
    /// Service by service, in data-flow order.
    pub services: Vec<ServiceVerdict>,
    /// False if the file ends early; all that it completely holds has been compared.
    pub complete: bool,
}

impl Verification {
    /// The earliest difference, with the service it comes from.
    #[must_use]
    pub fn first(&self) -> Option<(Role, &Difference)> {
        let all = self.services.iter().filter_map(|s| Some((s.role, s.first.as_ref()?)));
        // Of several at one release, what was sent comes before what it made others remember; the
        // services are in data-flow order, and the first of equals is taken.
        all.min_by_key(|(_, first)| (first.release_ns, first.topic.starts_with("state/")))
    }

    /// True if not a bit differs, of something.
    #[must_use]
    pub fn identical(&self) -> bool {
        self.compared() > 0 && self.services.iter().all(|service| service.differences == 0)
    }

    /// Samples and states compared.
    #[must_use]
    pub fn compared(&self) -> u64 {
        self.services.iter().map(|service| service.samples + service.states).sum()
    }
}

/// Flies the services of `roles` again, or all that took part, and compares. `done` is called after
/// each.
///
/// # Errors
/// [`ReplayError`]; a difference is no error.
pub fn verify(
    flight: &RecordedFlight,
    roles: &[Role],
    mut done: impl FnMut(&ServiceVerdict),
) -> Result<Verification, ReplayError> {
    super::refuse_branched(flight)?;
    let scenario = flight.scenario();
    let graph = scenario.graph().map_err(|error| ReplayError::Wiring(error.to_string()))?;
    if let Some(role) = roles.iter().find(|role| graph.node(**role).is_none()) {
        return Err(ReplayError::NotFlown { role: role.label() });
    }
    let crew = Crew::of(scenario.settings());
    let mut verification = Verification { services: Vec::new(), complete: true };
    for node in graph.nodes().iter().filter(|n| roles.is_empty() || roles.contains(&n.role)) {
        let topics = Topics::of(&crew, node.role, scenario)?;
        let recorded = load(flight, node.role, &topics)?.of_one_hand()?;
        let replayed = fly_again(flight, &crew, node.role, scenario, &recorded)?;
        verification.complete = recorded.closing.complete;
        let compare = Compare::new(&recorded, &replayed, node.role);
        let mut verdict =
            crew.build(node.role, scenario, compare).map_err(ReplayError::component(node.role))?;
        verdict.steps = replayed.steps;
        if let Some(first) = &mut verdict.first {
            first.release_index = node.rate.first_at_or_after(first.release_ns);
        }
        done(&verdict);
        verification.services.push(verdict);
    }
    Ok(verification)
}

struct Compare<'a> {
    recorded: &'a Recorded,
    replayed: &'a Replayed,
    /// The flight ended in order: nothing may be missing at its end.
    ended: bool,
    verdict: ServiceVerdict,
}

impl ComponentVisitor for Compare<'_> {
    type Output = ServiceVerdict;
    fn visit<S: Service + 'static>(mut self, _component: Component<S>) -> ServiceVerdict {
        let Ok(()) = S::Outputs::default().visit(&mut self);
        let Ok(()) = OutputVisitor::visit(&mut self, &topics::LOOP_STATS, &mut Output::default());
        let Ok(()) = OutputVisitor::visit(&mut self, &topics::DEVIATION, &mut Output::default());
        self.states::<S>();
        self.verdict
    }
}

impl OutputVisitor for Compare<'_> {
    type Error = Infallible;
    fn visit<T: Sample>(
        &mut self,
        topic: &'static Topic<T>,
        _output: &mut Output<T>,
    ) -> Result<(), Infallible> {
        let recorded = self.recorded.tapes.of(topic);
        let replayed = self.replayed.tapes.of(topic);
        let name = topic.info.name;
        let lossy = self.recorded.has_gaps(name);
        self.pairs(
            &recorded,
            &replayed,
            (name, lossy),
            |sample| *sample.header(),
            |verdict, a, b| {
                verdict.samples += 1;
                if let Some((field, was, is)) = difference(a, b, &REPRODUCED) {
                    verdict.differ(name, a.header().release_ns, &field, was, is);
                }
            },
        );
        Ok(())
    }
}

impl<'a> Compare<'a> {
    fn new(recorded: &'a Recorded, replayed: &'a Replayed, role: Role) -> Self {
        let outcome = recorded.closing.summary.get("outcome");
        let ended = recorded.closing.complete && outcome.is_some_and(|o| o.starts_with("flown"));
        let verdict = ServiceVerdict {
            role,
            steps: 0,
            samples: 0,
            states: 0,
            unrecorded: 0,
            differences: 0,
            first: None,
        };
        Self { recorded, replayed, ended, verdict }
    }

    fn states<S: Service>(&mut self) {
        let name = format!("state/{}", self.verdict.role.label());
        let (recorded, replayed) = (&self.recorded.states, &self.replayed.states);
        let size = state_size::<S>();
        let header = |state: &RecordedState| state.header;
        self.pairs(recorded, replayed, (&name, false), header, |verdict, a, b| {
            verdict.states += 1;
            if a.bytes == b.bytes {
                return;
            }
            if a.bytes.len() != size {
                let (was, is) = (a.bytes.len().to_string(), size.to_string());
                verdict.differ(&name, a.header.release_ns, "length", was, is);
                return;
            }
            let fields = (numbers_of_state::<S>(&a.bytes), numbers_of_state::<S>(&b.bytes));
            verdict.compare_fields(&name, a.header.release_ns, &fields.0, &fields.1);
        });
    }

    /// Matches items by the life they come from and their sequence.
    fn pairs<T>(
        &mut self,
        recorded: &[T],
        replayed: &[T],
        (name, lossy): (&str, bool),
        header: impl Fn(&T) -> Header,
        mut same: impl FnMut(&mut ServiceVerdict, &T, &T),
    ) {
        let all = recorded.iter().chain(replayed);
        let lives: BTreeSet<u32> = all.map(|item| header(item).generation).collect();
        let mut known = 0;
        for life in &lives {
            let of_life = |item: &&T| header(item).generation == *life;
            let last = recorded.iter().filter(of_life).map(|item| header(item).sequence).max();
            let traced_ns = self.recorded.traces.get(life).copied();
            let end_ns = traced_ns.or(self.recorded.closing.complete.then_some(0));
            let may_be_cut = !(self.ended && Some(life) == lives.last());
            let both = (recorded.iter().filter(of_life), replayed.iter().filter(of_life));
            for pair in pairs(both.0, both.1, |item| header(item).sequence) {
                match pair {
                    Pair::Both(before, item) => same(&mut self.verdict, before, item),
                    Pair::Recorded(extra) => {
                        let at_ns = header(extra).release_ns;
                        if end_ns.is_some_and(|end_ns| at_ns <= end_ns) {
                            self.verdict.differ(
                                name,
                                at_ns,
                                "sample",
                                "recorded".into(),
                                "none".into(),
                            );
                        }
                    }
                    Pair::Again(item) => {
                        let Header { sequence, release_ns, .. } = header(item);
                        // A successor repeats its predecessor's last steps; the recorder took one.
                        let repeated = sequence <= known;
                        // Killed between two samples of a step.
                        let cut = may_be_cut && last.is_none_or(|last| sequence > last);
                        if lossy && !repeated {
                            self.verdict.unrecorded += 1;
                        } else if !repeated && !cut {
                            self.verdict.differ(
                                name,
                                release_ns,
                                "sample",
                                "none".into(),
                                "replayed".into(),
                            );
                        }
                    }
                }
            }
            known = known.max(last.unwrap_or(0));
        }
    }
}

impl ServiceVerdict {
    fn compare_fields(&mut self, topic: &str, at_ns: u64, a: &[Named], b: &[Named]) {
        if let Some((field, was, is)) = first_difference(a, b) {
            self.differ(topic, at_ns, &field, was, is);
        }
    }

    fn differ(&mut self, topic: &str, at_ns: u64, field: &str, was: String, is: String) {
        self.differences += 1;
        if self.first.as_ref().is_none_or(|first| at_ns < first.release_ns) {
            self.first = Some(Difference {
                release_ns: at_ns,
                release_index: 0,
                topic: topic.to_owned(),
                field: field.to_owned(),
                recorded: was,
                replayed: is,
            });
        }
    }
}
