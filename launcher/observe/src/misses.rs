//! Where a flight missed its deadlines: by edge or loop, how often, from when to when, how badly.
//!
//! All of it comes from the `deviation` topic, in which each loop reports what a step lacked.

use core::fmt;
use serde_json::{Value, json};
use shared_types::time::s_from_ns;
use shared_types::{Deviation, DeviationKind, Role, topics};
use std::collections::BTreeMap;

/// Source of misses in the recording.
pub const TIMING: &str = "timing";
/// Logical time between the first two events about one place \[ns\]; each later one waits twice as long.
const QUIET_NS: u64 = 1_000_000_000;

/// Where something was missed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Place {
    /// Samples that arrived after the step they were for.
    Late(EdgeName),
    /// Samples that never arrived.
    Lost(EdgeName),
    /// Steps that started at the edge's deadline without its final samples.
    Awaited(EdgeName),
    /// Releases that a loop left out.
    Skipped(&'static str),
}

/// An edge as text.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct EdgeName {
    /// Label of the producer.
    pub from: &'static str,
    pub topic: &'static str,
    /// Label of the consumer.
    pub to: &'static str,
}

impl fmt::Display for EdgeName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} -> {} -> {}", self.from, self.topic, self.to)
    }
}

impl Place {
    fn kind(&self) -> &'static str {
        match self {
            Self::Late(_) => "late",
            Self::Lost(_) => "lost",
            Self::Awaited(_) => "not final",
            Self::Skipped(_) => "skipped",
        }
    }

    /// Label of the loop that it happened to.
    fn affected_loop(&self) -> &'static str {
        match self {
            Self::Late(edge) | Self::Lost(edge) | Self::Awaited(edge) => edge.to,
            Self::Skipped(role) => role,
        }
    }

    fn edge(&self) -> Option<EdgeName> {
        match self {
            Self::Late(edge) | Self::Lost(edge) | Self::Awaited(edge) => Some(*edge),
            Self::Skipped(_) => None,
        }
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Skipped(role) => write!(f, "skipped releases of {role}"),
            Self::Late(edge) => write!(f, "late samples {edge}"),
            Self::Lost(edge) => write!(f, "lost samples {edge}"),
            Self::Awaited(edge) => write!(f, "steps without final {edge}"),
        }
    }
}

/// What was missed at one place, in logical time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Missed {
    /// Samples, steps or releases.
    pub count: u64,
    /// First step that it happened to \[ns\].
    pub first_ns: u64,
    /// Last step that it happened to \[ns\].
    pub last_ns: u64,
    /// Most that a sample took effect after its instant, 0 if it is not about late samples \[ns\].
    pub worst_ns: u64,
    /// Step that this happened to \[ns\].
    pub worst_at_ns: u64,
    reported: Option<Reported>,
}

/// What has been reported about a place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Reported {
    /// From when on there may be news \[ns\].
    next_ns: u64,
    quiet_ns: u64,
    count: u64,
}

impl fmt::Display for Missed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (first, last) = (s_from_ns(self.first_ns), s_from_ns(self.last_ns));
        write!(f, "{}, first at {first:.3} s, last at {last:.3} s", self.count)?;
        if self.worst_ns > 0 {
            let at = s_from_ns(self.worst_at_ns);
            write!(f, ", worst {:.3} ms at {at:.3} s", self.worst_ns as f64 * 1e-6)?;
        }
        Ok(())
    }
}

/// Everything that was missed in a flight.
#[derive(Debug, Clone, Default)]
pub struct MissLog {
    places: BTreeMap<Place, Missed>,
    /// Instant and text of what is to be reported, see [`MissLog::take_news`].
    news: Vec<(u64, String)>,
}

impl MissLog {
    /// Takes note of a deviation; `without_position` means that the pilot fills the position slot.
    pub fn observe(&mut self, deviation: &Deviation, without_position: bool) {
        let Some(place) = place_of(deviation, without_position) else { return };
        let at_ns = deviation.header.release_ns;
        let (count, late_ns) = match place {
            Place::Late(_) => (samples(deviation), at_ns.saturating_sub(deviation.due_ns)),
            Place::Lost(_) | Place::Skipped(_) => (samples(deviation), 0),
            Place::Awaited(_) => (deviation.first, 0),
        };
        let unseen = Missed {
            count: 0,
            first_ns: at_ns,
            last_ns: 0,
            worst_ns: 0,
            worst_at_ns: 0,
            reported: None,
        };
        let misses = self.places.entry(place).or_insert(unseen);
        misses.count = misses.count.saturating_add(count);
        misses.last_ns = at_ns;
        if late_ns > misses.worst_ns {
            (misses.worst_ns, misses.worst_at_ns) = (late_ns, at_ns);
        }
        let before = misses.reported;
        if before.is_none_or(|last| at_ns >= last.next_ns) {
            let quiet_ns = before.map_or(QUIET_NS, |last| last.quiet_ns.saturating_mul(2));
            let next_ns = at_ns.saturating_add(quiet_ns);
            misses.reported = Some(Reported { next_ns, quiet_ns, count: misses.count });
            let more = before.map_or(String::new(), |last| {
                format!("{} more since the last report, in all ", misses.count - last.count)
            });
            self.news.push((at_ns, format!("{place}: {more}{misses}")));
        }
    }

    /// Instant \[ns\] and text of what has happened since the last call; ever fewer of a place that goes
    /// on missing.
    pub fn take_news(&mut self) -> Vec<(u64, String)> {
        core::mem::take(&mut self.news)
    }

    /// Places and what was missed there.
    pub fn places(&self) -> impl Iterator<Item = (&Place, &Missed)> {
        self.places.iter()
    }

    /// As a JSON array, one object per place.
    #[must_use]
    pub fn to_json(&self) -> Value {
        let object = |(place, misses): (&Place, &Missed)| {
            let edge = place.edge();
            json!({
                "kind": place.kind(),
                "from": edge.map(|edge| edge.from),
                "topic": edge.map(|edge| edge.topic),
                "to": place.affected_loop(),
                "count": misses.count,
                "first_s": s_from_ns(misses.first_ns),
                "last_s": s_from_ns(misses.last_ns),
                "worst_ms": (misses.worst_ns > 0).then_some(misses.worst_ns as f64 * 1e-6),
                "worst_at_s": (misses.worst_ns > 0).then_some(s_from_ns(misses.worst_at_ns)),
            })
        };
        self.places().map(object).collect()
    }
}

fn samples(deviation: &Deviation) -> u64 {
    deviation.last.saturating_sub(deviation.first).saturating_add(1)
}

fn place_of(deviation: &Deviation, without_position: bool) -> Option<Place> {
    let to = deviation.role.label();
    if deviation.kind == DeviationKind::SkippedReleases {
        return Some(Place::Skipped(to));
    }
    let topic = topics::all().into_iter().find(|topic| topic.name == deviation.input_name())?;
    let slot_of_pilot = without_position && topic.from == Role::Position;
    let from = if slot_of_pilot { Role::Pilot } else { topic.from };
    let edge = EdgeName { from: from.label(), topic: topic.name, to };
    match deviation.kind {
        DeviationKind::LateSamples => Some(Place::Late(edge)),
        DeviationKind::LostSamples => (deviation.due_ns == 0).then_some(Place::Lost(edge)),
        DeviationKind::MissedDeadline => Some(Place::Awaited(edge)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn deviation(kind: DeviationKind, at_ms: u64, first: u64, last: u64) -> Deviation {
        let mut deviation = Deviation {
            kind,
            role: Role::Plant,
            input: Deviation::input_from("wrench_command"),
            due_ns: if kind == DeviationKind::LateSamples { (at_ms - 3) * 1_000_000 } else { 0 },
            first,
            last,
            ..Deviation::default()
        };
        deviation.header.release_ns = at_ms * 1_000_000;
        deviation
    }

    #[test]
    fn what_a_writer_published_while_it_did_not_count_is_no_miss() {
        let mut log = MissLog::default();
        let lost = deviation(DeviationKind::LostSamples, 500, 7, 57);
        log.observe(&Deviation { due_ns: 500_000_000, ..lost }, false);
        assert_eq!(log.places().count(), 0);
        log.observe(&lost, false);
        assert_eq!(log.places().count(), 1);
    }

    #[test]
    fn counts_end_at_the_largest_number() {
        let mut log = MissLog::default();
        for at_ms in [500, 3700] {
            log.observe(&deviation(DeviationKind::SkippedReleases, at_ms, 0, u64::MAX), false);
        }
        assert_eq!(log.places().map(|(_, misses)| misses.count).collect::<Vec<_>>(), [u64::MAX]);
        assert_eq!(log.take_news().len(), 2);
    }

    #[test]
    fn late_samples_are_counted_located_and_named_by_their_edge() {
        let mut log = MissLog::default();
        log.observe(&deviation(DeviationKind::LateSamples, 500, 7, 8), false);
        log.observe(&deviation(DeviationKind::LateSamples, 700, 20, 20), false);
        log.observe(&deviation(DeviationKind::Resumed, 800, 1, 1), false);
        let [(place, misses)] = log.places().collect::<Vec<_>>()[..] else { panic!("{log:?}") };
        assert_eq!(place.to_string(), "late samples attitude -> wrench_command -> plant");
        assert_eq!((misses.count, misses.first_ns, misses.last_ns), (3, 500_000_000, 700_000_000));
        assert_eq!((misses.worst_ns, misses.worst_at_ns), (3_000_000, 500_000_000));
        let json = log.to_json();
        assert_eq!((&json[0]["topic"], &json[0]["count"]), (&json!("wrench_command"), &json!(3)));
        // Both within one second: reported once.
        assert_eq!(log.take_news().len(), 1);
    }

    #[test]
    fn a_place_that_goes_on_missing_is_reported_ever_more_rarely_with_what_is_new() {
        let mut log = MissLog::default();
        for second in 1..=16 {
            log.observe(&deviation(DeviationKind::LateSamples, second * 1000, 7, 7), false);
        }
        let news = log.take_news();
        let seconds: Vec<_> = news.iter().map(|(at_ns, _)| at_ns / 1_000_000_000).collect();
        assert_eq!(seconds, [1, 2, 4, 8, 16]);
        let last = &news[4].1;
        assert!(
            last.contains(": 8 more since the last report, in all 16, first at 1.000"),
            "{last}"
        );
    }

    #[test]
    fn skipped_releases_are_those_of_their_loop_and_waits_count_steps() {
        let mut log = MissLog::default();
        log.observe(&deviation(DeviationKind::SkippedReleases, 40, 3, 5), false);
        log.observe(&deviation(DeviationKind::MissedDeadline, 50, 1, 1), false);
        let counts: Vec<_> = log.places().map(|(place, m)| (place.kind(), m.count)).collect();
        assert_eq!(counts, [("not final", 1), ("skipped", 3)]);
    }

    #[test]
    fn without_a_position_loop_set_points_come_from_the_pilot() {
        let mut log = MissLog::default();
        let mut late = deviation(DeviationKind::LateSamples, 500, 7, 8);
        late.input = Deviation::input_from("attitude_setpoint");
        late.role = Role::Attitude;
        log.observe(&late, true);
        let place = log.places().next().unwrap().0.to_string();
        assert_eq!(place, "late samples pilot -> attitude_setpoint -> attitude");
    }
}
