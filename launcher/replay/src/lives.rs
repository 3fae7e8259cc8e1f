//! Which processes flew a role, one after another and side by side: each life, and how it began.

use super::ReplayError;
use super::life_key::LifeKey;
use super::tapes::Recorded;
use record::read::{RecordedState, seat_config};
use runtime::Graph;
use runtime::StateHeader;
use scenario::services::{self, Assignment};
use shared_types::{Deviation, DeviationKind, Role, Seat, Seating, topics};
use std::collections::BTreeMap;
use std::fmt;

/// What a replay is about: a role, and of its processes perhaps those of a name or on a seat.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Selection {
    pub role: Role,
    /// Name of the controller.
    pub name: Option<&'static str>,
    pub seat: Option<u32>,
}

impl Selection {
    /// All instances that filled a role.
    #[must_use]
    pub fn all_of(role: Role) -> Self {
        Self { role, name: None, seat: None }
    }

    fn means(&self, instance: &Instance) -> bool {
        self.role == instance.role
            && self.seat.is_none_or(|seat| seat == instance.seat)
            && self.name.is_none_or(|name| name == instance.name)
    }
}

/// A controller on a seat, in all of its lives.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Instance {
    pub role: Role,
    pub seat: u32,
    /// Name of the service, or of a foreign executable.
    pub name: String,
}

impl fmt::Display for Instance {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { role, seat, name } = self;
        match role.seats() {
            1 => f.write_str(role.label()),
            _ => write!(f, "{name}@{seat}"),
        }
    }
}

/// Where a life went on from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Source {
    life: LifeKey,
    release: u64,
    /// The life was that seat's last one, whatever its number.
    before: bool,
}

/// One life of a process, from its start or restart to its death or the end of the recording.
pub(super) struct Life {
    pub(super) key: LifeKey,
    /// State that it went on from.
    pub(super) source: Option<Source>,
    /// Instant at which it joined, and until which it tracked \[ns\].
    pub(super) joined: Option<(u64, u64)>,
    /// Instant at which it took a seat of a flight under way \[ns\].
    pub(super) seated_ns: Option<u64>,
    /// Last step that left a trace \[ns\].
    pub(super) last_ns: u64,
    pub(super) deviations: Vec<Deviation>,
    /// Sequence of the last totals published.
    pub(super) last_stats: u64,
    /// It left in order and reported where its inputs had got.
    pub(super) in_order: bool,
}

impl Life {
    /// Name of the scenario that configures it alone, if one does.
    pub(super) fn config(&self, role: Role) -> String {
        seat_config(Seat { role, index: self.key.seat }, self.key.generation)
    }

    /// True if it goes on with the numbers of the process that had its seat before.
    pub(super) fn goes_on(&self) -> bool {
        self.source.is_some_and(|source| source.life.seat == self.key.seat)
    }

    /// By [`Seat::number`], generation of the first process that it received from after it had begun in flight: at its
    /// first step it reported each writer that it knew and that had gone.
    pub(super) fn first_generations(&self, graph: &Graph) -> [u32; Seat::COUNT] {
        let mut generations = [0; Seat::COUNT];
        let first_ns = self.deviations.first().map(|first| first.header.release_ns);
        let at_first = |one: &&Deviation| Some(one.header.release_ns) == first_ns;
        let reported: Vec<&Deviation> = self.deviations.iter().filter(at_first).collect();
        for (index, ended) in reported.iter().enumerate() {
            let writer = |one: &Deviation| (one.input, one.writer_seat, one.writer_generation);
            let was_known = reported.iter().any(|known| {
                let is_known = known.kind == DeviationKind::Began && known.first == 0;
                is_known && writer(known) == writer(ended)
            });
            // One that was replaced before the first step is reported right before the one that follows it.
            let is_replaced = reported.get(index + 1).is_some_and(|next| {
                let on_seat = (next.input, next.writer_seat) == (ended.input, ended.writer_seat);
                next.kind == DeviationKind::Began && next.first > 0 && on_seat
            });
            if ended.kind != DeviationKind::Ended || !was_known || is_replaced {
                continue;
            }
            let topic = topics::all().into_iter().find(|topic| topic.name == ended.input_name());
            let role = topic.map(|topic| graph.producer(topic));
            let seat = role.map(|role| Seat { role, index: ended.writer_seat });
            if let Some(number) = seat.and_then(Seat::number) {
                generations[number] = ended.writer_generation.saturating_add(1);
            }
        }
        generations
    }

    /// Release of the state that it was handed, if that is not among the recorded ones.
    pub(super) fn lacks_state(&self, handed: Option<&RecordedState>) -> Option<u64> {
        self.source.filter(|_| handed.is_none()).map(|source| source.release)
    }

    /// The state that it was handed.
    pub(super) fn handed_over<'a>(&self, recorded: &'a Recorded) -> Option<&'a RecordedState> {
        let Source { life, release, before } = self.source?;
        recorded.states.iter().rev().find(|state| {
            let from = LifeKey::of(&state.header);
            let meant = if before {
                from.seat == life.seat && from.generation < life.generation
            } else {
                from == life
            };
            meant && state_header(state).release_index == release
        })
    }
}

/// The first part of a state.
pub(super) fn state_header(state: &RecordedState) -> StateHeader {
    StateHeader::of(&state.bytes).unwrap_or_default()
}

/// The processes that flew `role`, with their lives, in the order in which they began.
pub(super) fn instances(
    recorded: &Recorded,
    role: Role,
    assignment: &Assignment,
) -> Vec<(Instance, Vec<Life>)> {
    let deviations = recorded.tapes.of(&topics::DEVIATION);
    let stats = recorded.tapes.of(&topics::LOOP_STATS);
    let begins = assignment.name(role);
    let mut by_instance: Vec<(Instance, Vec<Life>)> = Vec::new();
    // By seat: what is there.
    let mut there: BTreeMap<u32, String> = BTreeMap::new();
    for (&key, &last_ns) in &recorded.traces {
        let deviations: Vec<Deviation> = deviations
            .iter()
            .filter(|one| LifeKey::of_deviation(&one.header) == key)
            .copied()
            .collect();
        let seating = recorded.seatings.get(&key);
        if let Some(seating) = seating {
            there.insert(key.seat, seating.controller_name().to_owned());
        }
        let name = there.entry(key.seat).or_insert_with(|| begins.to_owned()).clone();
        let of_life = stats
            .iter()
            .filter(|s| LifeKey::of_stats(&s.header) == key && s.header.release_ns <= last_ns);
        let life = Life {
            key,
            source: source(key, seating, &deviations),
            joined: seating.filter(|s| s.join_ns > 0).map(|s| (s.join_ns, s.track_until_ns)),
            seated_ns: seating.map(|s| s.header.release_ns),
            last_ns,
            last_stats: of_life.map(|s| s.header.sequence).max().unwrap_or(0),
            in_order: recorded.in_order.contains(&key),
            deviations,
        };
        let instance = Instance { role, seat: key.seat, name };
        match by_instance.iter_mut().find(|(known, _)| *known == instance) {
            Some((_, lives)) => lives.push(life),
            None => by_instance.push((instance, vec![life])),
        }
    }
    let begin = |life: &Life| recorded.seatings.get(&life.key).map(|s| s.header.release_ns);
    by_instance.sort_by_key(|(_, lives)| lives.first().and_then(begin));
    by_instance
}

fn source(key: LifeKey, seating: Option<&Seating>, deviations: &[Deviation]) -> Option<Source> {
    if let Some(seating) = seating {
        let life = LifeKey { seat: seating.state_seat, generation: seating.state_generation };
        let source = Source { life, release: seating.state_release, before: false };
        return seating.has_state.is_set().then_some(source);
    }
    // Started again in its place, from the last state there was.
    let resumed = deviations.iter().find(|d| d.kind == DeviationKind::Resumed)?;
    Some(Source { life: key, release: resumed.first, before: true })
}

/// Those of `instances` that `selection` means.
pub(super) fn chosen(
    instances: Vec<(Instance, Vec<Life>)>,
    selection: &Selection,
) -> Result<Vec<(Instance, Vec<Life>)>, ReplayError> {
    let flew: Vec<String> = instances.iter().map(|(i, _)| i.to_string()).collect();
    let mut meant = instances;
    meant.retain(|(instance, _)| selection.means(instance));
    if meant.is_empty() && (selection.name.is_some() || selection.seat.is_some()) {
        let asked = format!(
            "{}{}",
            selection.name.unwrap_or(selection.role.label()),
            selection.seat.map_or(String::new(), |seat| format!("@{seat}"))
        );
        return Err(ReplayError::NoInstance { asked, flew: flew.join(", ") });
    }
    Ok(meant)
}

/// The only one that `selection` means.
pub(super) fn only(
    instances: Vec<(Instance, Vec<Life>)>,
    selection: &Selection,
) -> Result<(Instance, Vec<Life>), ReplayError> {
    let mut meant = chosen(instances, selection)?;
    if meant.len() > 1 {
        let flew: Vec<String> = meant.iter().map(|(i, _)| i.to_string()).collect();
        return Err(ReplayError::Several { role: selection.role.label(), flew: flew.join(", ") });
    }
    meant.pop().ok_or(ReplayError::NotFlown { role: selection.role.label() })
}

/// The service of this build that an instance is, if it is one.
pub(super) fn service_of(instance: &Instance, recorded: &Recorded, lives: &[Life]) -> Service {
    let seatings = lives.iter().filter_map(|life| recorded.seatings.get(&life.key));
    if seatings.clone().any(|seating| !seating.built_in.is_set()) {
        return Service::Foreign;
    }
    let unknown = |life: &Life| {
        let configured = recorded.seatings.get(&life.key).is_some_and(|s| s.configured.is_set());
        configured && !recorded.configs.contains_key(&life.config(instance.role))
    };
    if lives.iter().any(unknown) {
        return Service::Configured;
    }
    let known = services::names_for(instance.role).find(|name| *name == instance.name);
    known.map_or(Service::Foreign, Service::Known)
}

/// What an instance was made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Service {
    /// A service of this build, by its name.
    Known(&'static str),
    /// One with a scenario of its own, which the recording does not hold.
    Configured,
    /// A foreign executable.
    Foreign,
}

#[cfg(test)]
mod tests {
    use super::*;
    use scenario::Scenario;
    use shared_types::Header;

    fn deviation(kind: DeviationKind, seat: u32, generation: u32, sequence: u64) -> Deviation {
        Deviation {
            header: Header { release_ns: 2_560_000_000, ..Header::default() },
            kind,
            input: Deviation::input_from(topics::APPLIED_SETPOINT.info.name),
            first: sequence,
            last: sequence,
            writer_seat: seat,
            writer_generation: generation,
            ..Deviation::default()
        }
    }

    fn first_generation(deviations: Vec<Deviation>) -> u32 {
        let graph = Scenario::load("hover", &[]).unwrap().graph().unwrap();
        let life = Life {
            key: LifeKey { seat: 0, generation: 0 },
            source: None,
            joined: None,
            seated_ns: None,
            last_ns: 0,
            deviations,
            last_stats: 0,
            in_order: false,
        };
        let seat = Seat { role: Role::Attitude, index: 1 };
        life.first_generations(&graph)[seat.number().unwrap()]
    }

    #[test]
    fn a_writer_had_gone_if_that_is_reported_before_its_successor_is() {
        const BEGAN: DeviationKind = DeviationKind::Began;
        const ENDED: DeviationKind = DeviationKind::Ended;
        let gone = [deviation(BEGAN, 1, 0, 0), deviation(ENDED, 1, 0, 132)];
        assert_eq!(first_generation(gone.to_vec()), 1);
        let followed = [deviation(BEGAN, 0, 1, 48), deviation(BEGAN, 1, 1, 133)];
        assert_eq!(first_generation([gone, followed].concat()), 1);
        let replaced =
            [deviation(BEGAN, 1, 0, 0), deviation(BEGAN, 0, 1, 0), deviation(ENDED, 1, 0, 132)];
        assert_eq!(first_generation([&replaced[..], &[deviation(BEGAN, 1, 1, 133)]].concat()), 0);
        assert_eq!(
            first_generation(vec![deviation(ENDED, 1, 0, 132)]),
            0,
            "of one that it had not known"
        );
    }
}
