//! Another controller on the same inputs: where and how far its outputs depart.

use super::ReplayError;
use super::again::fly_again;
use super::compare::Difference;
use super::component_topics::Topics;
use super::fields::numbers_of;
use super::life_key::LifeKey;
use super::lives::{Life, Selection, Service as MadeOf, instances, only, service_of};
use super::other::outputs_of;
use super::tapes::{Recorded, Tapes, load};
use components::build_service;
use core::convert::Infallible;
use record::read::RecordedFlight;
use record::{Clock, Facts, RecordError, Recording};
use runtime::{Layout, Node};
use scenario::services::Assignment;
use scenario::{Override, Scenario};
use shared_types::{Sample, Topic, TopicVisitor};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// What replays.
#[derive(Debug, Clone)]
pub enum With {
    /// A service of this build.
    Service {
        /// Its name; none for the one that was flown.
        name: Option<&'static str>,
        /// Changes of its settings.
        overrides: Vec<Override>,
    },
    /// Another build of morphquad.
    Executable(PathBuf),
}

/// How far one field departs.
#[derive(Debug, Clone, PartialEq)]
pub struct FieldDeparture {
    pub topic: &'static str,
    /// Field, which names its unit.
    pub field: String,
    /// Samples with another value.
    pub differing: u64,
    /// First of them \[ns\].
    pub first_ns: u64,
    /// Largest difference, in the field's unit.
    pub max: f64,
    /// Root mean square over all samples, in the field's unit.
    pub rms: f64,
}

/// Where and how far another controller departs.
#[derive(Debug, Clone, Default)]
pub struct Departure {
    /// Samples that both have.
    pub samples: u64,
    /// Samples that only one of them has.
    pub unmatched: u64,
    /// Fields with a difference, in the order of the topics.
    pub fields: Vec<FieldDeparture>,
    /// Where it begins.
    pub first: Option<Difference>,
}

/// Replays what `selection` means with another controller and compares its outputs with those recorded.
///
/// # Errors
/// [`ReplayError`]; a departure is none.
pub fn depart(
    flight: &RecordedFlight,
    selection: &Selection,
    with: &With,
) -> Result<Departure, ReplayError> {
    super::refuse_branched(flight)?;
    let role = selection.role;
    let graph = flight.scenario().graph().map_err(|e| ReplayError::Wiring(e.to_string()))?;
    let node = *graph.node(role).ok_or(ReplayError::NotFlown { role: role.label() })?;
    let topics = Topics::of_all(role, flight.scenario())?;
    let (recorded, flown) = flown(flight, selection, &topics)?;
    let other = match with {
        With::Service { name, overrides } => {
            let service = name.unwrap_or_else(|| flown.service());
            let scenario = changed(flight, overrides)?;
            fly_again(flight, (role, service), &scenario, &recorded, &flown.lives)?.tapes
        }
        With::Executable(executable) => {
            outputs_of(executable, flight, role, &flown.label, &topics)?
        }
    };
    let lives = flown.lives.iter().map(|life| life.key).collect();
    let out = Departure::default();
    let mut compare = Compare { node, recorded: &recorded, other: &other, lives, out };
    let component = build_service(flown.service(), flight.scenario());
    let component = component.map_err(ReplayError::component(role))?;
    let Ok(()) = Layout::visit_topics(component.layout().writes(), &mut compare);
    Ok(compare.out)
}

/// The one instance that is to be compared.
struct Flown {
    lives: Vec<Life>,
    made_of: MadeOf,
    /// How it is named to another build.
    label: String,
    /// The service that began in its role.
    begins: &'static str,
}

impl Flown {
    /// A service with its ports: its own, or that of the one that began.
    fn service(&self) -> &'static str {
        if let MadeOf::Known(service) = self.made_of { service } else { self.begins }
    }
}

fn flown(
    flight: &RecordedFlight,
    selection: &Selection,
    topics: &Topics,
) -> Result<(Recorded, Flown), ReplayError> {
    let role = selection.role;
    let assignment = Assignment::of(flight.scenario().settings());
    let recorded = load(flight, role, topics)?;
    let all = instances(&recorded, role, &assignment);
    let label = if all.len() > 1 { None } else { Some(role.label().to_owned()) };
    let (instance, lives) = only(all, selection)?;
    let made_of = service_of(&instance, &recorded, &lives);
    let label = label.unwrap_or_else(|| instance.to_string());
    Ok((recorded, Flown { lives, made_of, label, begins: assignment.name(role) }))
}

/// The recorded scenario with changes.
fn changed(flight: &RecordedFlight, overrides: &[Override]) -> Result<Scenario, ReplayError> {
    let name = format!("{}: scenario.toml", flight.path().display());
    Ok(Scenario::from_text(&name, flight.scenario().to_toml(), overrides)?)
}

/// Replays what `selection` means and writes its outputs as a recording of their own.
///
/// # Errors
/// [`ReplayError`], also if the file exists.
pub fn write_outputs(
    flight: &RecordedFlight,
    selection: &Selection,
    overrides: &[Override],
    out: &Path,
) -> Result<(), ReplayError> {
    super::refuse_branched(flight)?;
    let role = selection.role;
    let topics = Topics::of_all(role, flight.scenario())?;
    let (recorded, flown) = flown(flight, selection, &topics)?;
    let (service, scenario) = (flown.service(), changed(flight, overrides)?);
    let replayed = fly_again(flight, (role, service), &scenario, &recorded, &flown.lives)?;
    // The steps are flown again without a clock: all that their samples have is logical time.
    let facts = Facts { clock: Clock::Lockstep, ..flight.to_facts() };
    let recording = Recording::create(out, &facts)?;
    let mut write = Write { tapes: &replayed.tapes, recording };
    let component =
        build_service(service, flight.scenario()).map_err(ReplayError::component(role))?;
    Layout::visit_topics(component.layout().writes(), &mut write)?;
    write.recording.finish(&BTreeMap::new())?;
    Ok(())
}

/// Writes what came out on each topic.
struct Write<'a> {
    tapes: &'a Tapes,
    recording: Recording,
}

impl TopicVisitor for Write<'_> {
    type Error = RecordError;
    fn visit<T: Sample>(&mut self, topic: &'static Topic<T>) -> Result<(), RecordError> {
        let samples = self.tapes.of(topic);
        samples.iter().try_for_each(|sample| self.recording.write(topic, sample, 0))
    }
}

struct Compare<'a> {
    node: Node,
    recorded: &'a Recorded,
    other: &'a Tapes,
    /// Those that are compared.
    lives: Vec<LifeKey>,
    out: Departure,
}

/// Sums of one field.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    differing: u64,
    first_ns: u64,
    max: f64,
    squares: f64,
}

impl TopicVisitor for Compare<'_> {
    type Error = Infallible;
    fn visit<T: Sample>(&mut self, topic: &'static Topic<T>) -> Result<(), Infallible> {
        let (recorded, other) = (self.recorded.tapes.of(topic), self.other.of(topic));
        let mut sums: Vec<(String, Sums)> = Vec::new();
        let meant = |sample: &&T| self.lives.contains(&LifeKey::of(sample.header()));
        let recorded: Vec<T> = recorded.iter().filter(meant).copied().collect();
        let mut others = other.iter().peekable();
        let mut pairs = 0_u64;
        for was in &recorded {
            let release_ns = was.header().release_ns;
            while others.next_if(|is| is.header().release_ns < release_ns).is_some() {
                self.out.unmatched += 1;
            }
            let Some(is) = others.next_if(|is| is.header().release_ns == release_ns) else {
                self.out.unmatched += 1;
                continue;
            };
            pairs += 1;
            let fields = (numbers_of(was, "", &[]), numbers_of(is, "", &[]));
            let values = fields.0.into_iter().zip(fields.1);
            let payload = values.filter(|((name, _), _)| !name.starts_with("header."));
            for (index, ((name, was), (_, is))) in payload.enumerate() {
                if sums.len() == index {
                    sums.push((name.clone(), Sums::default()));
                }
                if was.is_same(is) {
                    continue;
                }
                let sum = &mut sums[index].1;
                if sum.differing == 0 {
                    sum.first_ns = release_ns;
                    self.begins(topic.info.name, release_ns, &name, (was, is));
                }
                let difference = (is.value() - was.value()).abs();
                sum.differing += 1;
                // What is no number is the largest.
                if difference.is_nan() || difference > sum.max {
                    sum.max = difference;
                }
                sum.squares += difference * difference;
            }
        }
        self.out.samples += pairs;
        self.out.unmatched += others.count() as u64;
        let departed = sums.into_iter().filter(|(_, sum)| sum.differing > 0);
        self.out.fields.extend(departed.map(|(field, sum)| FieldDeparture {
            topic: topic.info.name,
            field,
            differing: sum.differing,
            first_ns: sum.first_ns,
            max: sum.max,
            rms: (sum.squares / pairs.max(1) as f64).sqrt(),
        }));
        Ok(())
    }
}

impl Compare<'_> {
    fn begins(
        &mut self,
        topic: &str,
        release_ns: u64,
        field: &str,
        (was, is): (super::Number, super::Number),
    ) {
        if self.out.first.as_ref().is_none_or(|first| release_ns < first.release_ns) {
            self.out.first = Some(Difference {
                release_ns,
                release_index: self.node.rate.first_at_or_after(release_ns),
                topic: topic.to_owned(),
                field: field.to_owned(),
                recorded: was.to_string(),
                replayed: is.to_string(),
            });
        }
    }
}
