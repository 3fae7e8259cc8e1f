//! What came out again against what was recorded, sample by sample and state by state.

use super::ReplayError;
use super::again::{Replayed, fly_again};
use super::component_topics::Topics;
use super::fields::{Named, first_difference, numbers_of_state};
use super::life_key::LifeKey;
use super::lives::{Instance, Life, Selection, Service as MadeOf, chosen, instances, service_of};
use super::pairs::{Pair, difference, pairs};
use super::tapes::{Loss, Recorded, load};
use components::build_service;
use core::convert::Infallible;
use record::read::{RecordedFlight, RecordedState};
use runtime::{Graph, Layout};
use scenario::services::Assignment;
use shared_types::{Header, Role, Sample, Topic, TopicVisitor, topics};
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

/// What the replay of one service has found.
#[derive(Debug, Clone)]
pub struct ServiceVerdict {
    /// Which instance it is.
    pub instance: Instance,
    /// Why nothing of it could be flown again, if so.
    pub left_out: Option<&'static str>,
    /// What the recorder had lost of its inputs; nothing after that is compared.
    pub loss: Option<Loss>,
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

/// What the replay of a recording has found.
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
    pub fn first(&self) -> Option<(&Instance, &Difference)> {
        let all = self.services.iter().filter_map(|s| Some((&s.instance, s.first.as_ref()?)));
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

/// Flies those that `asked` means again, or all that took part, and compares. `done` is called after
/// each.
///
/// # Errors
/// [`ReplayError`]; a difference is no error.
pub fn verify(
    flight: &RecordedFlight,
    asked: &[Selection],
    mut done: impl FnMut(&ServiceVerdict),
) -> Result<Verification, ReplayError> {
    super::refuse_branched(flight)?;
    let scenario = flight.scenario();
    let graph = scenario.graph().map_err(|error| ReplayError::Wiring(error.to_string()))?;
    if let Some(selection) = asked.iter().find(|selection| graph.node(selection.role).is_none()) {
        return Err(ReplayError::NotFlown { role: selection.role.label() });
    }
    let assignment = Assignment::of(scenario.settings());
    let mut verification = Verification { services: Vec::new(), complete: true };
    for node in graph.nodes() {
        let role = node.role;
        let of_role: Vec<&Selection> =
            asked.iter().filter(|selection| selection.role == role).collect();
        if of_role.is_empty() && !asked.is_empty() {
            continue;
        }
        let recorded = load(flight, role, &Topics::of_all(role, scenario)?)?;
        verification.complete = recorded.closing.complete;
        let mut meant = Vec::new();
        for selection in
            of_role.iter().copied().chain(asked.is_empty().then_some(&Selection::all_of(role)))
        {
            meant.extend(chosen(instances(&recorded, role, &assignment), selection)?);
        }
        for (instance, lives) in meant {
            let mut verdict = judge(flight, &graph, (&recorded, &instance, &lives))?;
            if let Some(first) = &mut verdict.first {
                first.release_index = node.rate.first_at_or_after(first.release_ns);
            }
            done(&verdict);
            verification.services.push(verdict);
        }
    }
    Ok(verification)
}

/// Flies one instance again through all of its lives, and compares.
fn judge(
    flight: &RecordedFlight,
    graph: &Graph,
    (recorded, instance, lives): (&Recorded, &Instance, &[Life]),
) -> Result<ServiceVerdict, ReplayError> {
    let (role, scenario) = (instance.role, flight.scenario());
    let left_out = |why| Ok(ServiceVerdict { left_out: Some(why), ..none(instance) });
    let service = match service_of(instance, recorded, lives) {
        MadeOf::Known(service) => service,
        MadeOf::Configured => return left_out("configured by a file of its own"),
        MadeOf::Foreign => return left_out("an executable of its own"),
    };
    let replayed = fly_again(flight, (role, service), scenario, recorded, lives)?;
    let loss = recorded.loss();
    let verdict = ServiceVerdict { loss, steps: replayed.steps, ..none(instance) };
    let component = build_service(service, scenario).map_err(ReplayError::component(role))?;
    let mut compare = Compare { graph, recorded, replayed: &replayed, lives, verdict };
    compare.samples_and_states(component.layout());
    Ok(compare.verdict)
}

/// Nothing compared yet.
fn none(instance: &Instance) -> ServiceVerdict {
    ServiceVerdict {
        instance: instance.clone(),
        left_out: None,
        loss: None,
        steps: 0,
        samples: 0,
        states: 0,
        unrecorded: 0,
        differences: 0,
        first: None,
    }
}

struct Compare<'a> {
    graph: &'a Graph,
    recorded: &'a Recorded,
    replayed: &'a Replayed,
    lives: &'a [Life],
    verdict: ServiceVerdict,
}

impl TopicVisitor for Compare<'_> {
    type Error = Infallible;
    fn visit<T: Sample>(&mut self, topic: &'static Topic<T>) -> Result<(), Infallible> {
        let recorded = self.recorded.tapes.of(topic);
        let replayed = self.replayed.tapes.of(topic);
        let name = topic.info.name;
        let lossy = self.recorded.has_gaps(name);
        // Topics that all loops write identify lives in their own way.
        let all_write = topic.info.from == Role::Supervisor;
        let asap = self.graph.is_asap(&topic.info);
        let life = if all_write { LifeKey::of_deviation } else { LifeKey::of };
        self.pairs(
            (&recorded, &replayed),
            (name, lossy),
            |sample| *sample.header(),
            life,
            |verdict, a, b| {
                verdict.samples += 1;
                let mut b = *b;
                if asap {
                    // The instant at which the machine got it out.
                    b.header_mut().valid_ns = a.header().valid_ns;
                }
                if let Some((field, was, is)) = difference(a, &b, &REPRODUCED) {
                    verdict.differ(name, a.header().release_ns, &field, was, is);
                }
            },
        );
        Ok(())
    }
}

impl Compare<'_> {
    fn samples_and_states(&mut self, layout: &Layout) {
        let of_all_loops = [&topics::LOOP_STATS.info, &topics::DEVIATION.info];
        let Ok(()) = Layout::visit_topics(layout.writes().chain(of_all_loops), self);
        self.states(layout);
    }

    fn states(&mut self, layout: &Layout) {
        let name = format!("state/{}", self.verdict.instance.role.label());
        let (recorded, replayed) = (&self.recorded.states, &self.replayed.states);
        // A recording holds some of the states alone.
        let places: BTreeSet<_> = recorded.iter().map(|state| place(&state.header)).collect();
        let replayed: Vec<&RecordedState> =
            replayed.iter().filter(|state| places.contains(&place(&state.header))).collect();
        let recorded: Vec<&RecordedState> = recorded.iter().collect();
        let header = |state: &&RecordedState| state.header;
        self.pairs((&recorded, &replayed), (&name, false), header, LifeKey::of, |verdict, a, b| {
            verdict.states += 1;
            if a.bytes == b.bytes {
                return;
            }
            let numbers = |state: &RecordedState| {
                layout.parts(&state.bytes).map(|parts| numbers_of_state(layout, &parts))
            };
            let (Some(was), Some(is)) = (numbers(a), numbers(b)) else {
                let (was, is) = (a.bytes.len().to_string(), b.bytes.len().to_string());
                verdict.differ(&name, a.header.release_ns, "length", was, is);
                return;
            };
            verdict.compare_fields(&name, a.header.release_ns, &was, &is);
        });
    }

    /// Matches items by the life they come from and their sequence.
    fn pairs<T>(
        &mut self,
        (recorded, replayed): (&[T], &[T]),
        (name, lossy): (&str, bool),
        header: impl Fn(&T) -> Header,
        key: fn(&Header) -> LifeKey,
        mut same: impl FnMut(&mut ServiceVerdict, &T, &T),
    ) {
        let lives = self.lives;
        let known_until_ns = self.verdict.loss.map_or(u64::MAX, |loss| loss.after_ns);
        let is_known = |item: &&T| header(item).release_ns <= known_until_ns;
        let mut known = 0;
        for life in lives {
            if !life.goes_on() {
                known = 0;
            }
            let of_life = |item: &&T| key(&header(item)) == life.key;
            let last = recorded.iter().filter(of_life).map(|item| header(item).sequence).max();
            // What a process left behind that was killed in the middle of a step is not judged.
            let end_ns = if life.in_order { u64::MAX } else { life.last_ns };
            let judged = |item: &&T| of_life(item) && is_known(item);
            let both = (recorded.iter().filter(judged), replayed.iter().filter(judged));
            for pair in pairs(both.0, both.1, |item| header(item).sequence) {
                match pair {
                    Pair::Both(before, item) => same(&mut self.verdict, before, item),
                    Pair::Recorded(extra) => {
                        let at_ns = header(extra).release_ns;
                        if at_ns <= end_ns {
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
                        // A successor repeats its predecessor's last steps; of equal ones the recorder took one.
                        let repeated = sequence <= known;
                        // Killed between two samples of a step.
                        let cut = !life.in_order && last.is_none_or(|last| sequence > last);
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

/// A life and the number of what it has published.
fn place(header: &Header) -> (LifeKey, u64) {
    (LifeKey::of(header), header.sequence)
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
