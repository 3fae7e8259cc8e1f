//! Instants that a controller gives its samples: which of them a reader goes by.

use crate::graph::Edge;
use shared_types::{Header, SEATS};

/// What one process has stamped.
#[derive(Debug, Clone, Copy)]
struct Written {
    generation: u32,
    /// Of its newest sample.
    sequence: u64,
    /// Of its newest sample \[ns\].
    release_ns: u64,
    /// The first number, if any, from which on it has not kept to its steps and is not followed.
    broken_from: Option<u64>,
}

/// What each process on a slot's seats has stamped.
///
/// A reader waits until a process has published all it owes for a step. A sample that names an earlier step than the one
/// it was made at is not among that: chance would decide at which step of the reader it arrives, and a flight would not
/// be the same twice. A process that sends one is not followed any longer.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Stamps([Option<Written>; SEATS]);

impl Stamps {
    /// True if a process has kept to its steps up to this sample: none of its samples names an earlier step than the
    /// one before, and each takes effect the latency of its topic after it.
    pub(super) fn follow(&mut self, edge: &Edge, header: &Header) -> bool {
        let latency_ns = edge.latency_ns.saturating_sub(edge.held_back_ns);
        let is_due = edge.asap || header.valid_ns == header.release_ns.saturating_add(latency_ns);
        self.go_on(header, is_due)
    }

    /// Takes in a sample that was followed before.
    pub(super) fn begin_with(&mut self, header: &Header) {
        self.go_on(header, true);
    }

    fn go_on(&mut self, header: &Header, is_due: bool) -> bool {
        let Header { generation, sequence, release_ns, .. } = *header;
        let seat = usize::try_from(header.seat).ok().and_then(|seat| self.0.get_mut(seat));
        let Some(of_seat) = seat else { return false };
        // What its predecessor wrote before it went may arrive later.
        if of_seat.is_some_and(|known| known.generation > generation) {
            return is_due;
        }
        let first = Written { generation, sequence, release_ns, broken_from: None };
        let known = match of_seat {
            Some(known) if known.generation == generation => known,
            _ => of_seat.insert(first),
        };
        // Samples may change places on their way.
        let is_newest = sequence >= known.sequence;
        if !is_due || (is_newest && release_ns < known.release_ns) {
            let from = known.broken_from.map_or(sequence, |from| from.min(sequence));
            known.broken_from = Some(from);
        } else if is_newest {
            (known.sequence, known.release_ns) = (sequence, release_ns);
        }
        known.broken_from.is_none_or(|from| sequence < from)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::{Role, topics};

    const MS: u64 = 1_000_000;

    fn edge() -> Edge {
        Edge { latency_ns: 2 * MS, ..Edge::unwaited(&topics::WRENCH_COMMAND.info, Role::Plant) }
    }

    fn header(sequence: u64, release_ms: u64) -> Header {
        let release_ns = release_ms * MS;
        Header { sequence, release_ns, valid_ns: release_ns + 2 * MS, ..Header::default() }
    }

    #[test]
    fn a_process_whose_sample_is_not_due_a_latency_after_its_release_is_left() {
        let earlier = Header { valid_ns: 15 * MS, ..header(2, 20) };
        let later = Header { valid_ns: 90 * MS, ..header(2, 20) };
        for wrong in [earlier, later] {
            let mut stamps = Stamps::default();
            assert!(stamps.follow(&edge(), &header(1, 10)));
            assert!(!stamps.follow(&edge(), &wrong) && !stamps.follow(&edge(), &header(3, 30)));
            let successor = Header { generation: 1, ..header(1, 25) };
            assert!(stamps.follow(&edge(), &successor), "it is judged for itself");
        }
        let asap = Edge { asap: true, ..edge() };
        assert!(Stamps::default().follow(&asap, &earlier), "it is due when it is published");
    }

    #[test]
    fn a_process_that_names_a_step_before_its_last_one_is_left() {
        let mut stamps = Stamps::default();
        let released = [(1, 10), (2, 20), (3, 20), (4, 5), (5, 15), (6, 40)];
        let followed = released.map(|(n, ms)| stamps.follow(&edge(), &header(n, ms)));
        assert_eq!(followed, [true, true, true, false, false, false]);
        assert!(stamps.follow(&edge(), &header(2, 20)), "what it wrote before may come again");
        let last = header(u64::MAX, 10);
        assert!(Stamps::default().follow(&edge(), &last), "every number can be followed");
    }

    #[test]
    fn a_process_is_judged_from_the_sample_on_that_a_state_holds() {
        let mut stamps = Stamps::default();
        stamps.begin_with(&header(7, 70));
        assert!(!stamps.follow(&edge(), &header(8, 60)));
    }

    #[test]
    fn samples_that_change_places_on_their_way_are_followed() {
        let mut stamps = Stamps::default();
        let arrived = [(1, 10), (3, 30), (2, 20), (4, 40)];
        assert!(arrived.iter().all(|&(n, ms)| stamps.follow(&edge(), &header(n, ms))));
        let successor = Header { generation: 1, ..header(1, 50) };
        assert!(stamps.follow(&edge(), &successor) && stamps.follow(&edge(), &header(5, 45)));
    }

    #[test]
    fn seats_are_judged_each_by_itself_and_one_that_there_is_not_is_refused() {
        let mut stamps = Stamps::default();
        let of = |seat, ms| Header { seat, ..header(1, ms) };
        assert!(stamps.follow(&edge(), &of(0, 50)) && stamps.follow(&edge(), &of(1, 10)));
        assert!(!stamps.follow(&edge(), &of(9, 10)));
    }
}
