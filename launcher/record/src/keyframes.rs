//! Which of the states that are published are recorded.

use shared_types::{Header, Role};
use std::collections::BTreeMap;

/// Logical time of which the first state of each process is recorded \[ns\].
///
/// Everything else that a loop publishes is a function of a state and the samples after it, so that a replay needs the
/// states from which processes went on, and a branch a recent one. All of them would be two thirds of a recording.
pub const KEYFRAME_PERIOD_NS: u64 = 250_000_000;

/// What has been recorded of the states of a flight.
#[derive(Debug, Default)]
pub struct Keyframes {
    /// The last one from each seat.
    last: BTreeMap<(Role, u32), Kept>,
}

#[derive(Debug, Clone, Copy)]
struct Kept {
    generation: u32,
    sequence: u64,
    period: u64,
    deviation_sequence: u64,
}

impl Keyframes {
    /// True if a state is the first of its process in a period.
    #[must_use]
    pub fn is_due(&self, role: Role, header: &Header) -> bool {
        let period = header.release_ns / KEYFRAME_PERIOD_NS;
        let last = self.last.get(&(role, header.seat));
        last.is_none_or(|last| (last.generation, last.period) != (header.generation, period))
    }

    /// True if the loop has been late or has lost something since its last recorded state: what the machine has done is
    /// not flown again between a keyframe and a branch.
    #[must_use]
    pub fn is_behind(&self, role: Role, header: &Header, deviation_sequence: u64) -> bool {
        self.last
            .get(&(role, header.seat))
            .is_some_and(|last| last.deviation_sequence != deviation_sequence)
    }

    /// Takes note that a state is recorded; false if it is the one that was recorded last.
    pub fn note(&mut self, role: Role, header: &Header, deviation_sequence: u64) -> bool {
        let Header { generation, sequence, release_ns, .. } = *header;
        let period = release_ns / KEYFRAME_PERIOD_NS;
        let state = Kept { generation, sequence, period, deviation_sequence };
        let last = self.last.insert((role, header.seat), state);
        // What a loop publishes when it leaves does not make its last state another one.
        last.is_none_or(|last| (last.generation, last.sequence) != (generation, sequence))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn header(generation: u32, sequence: u64) -> Header {
        Header { generation, sequence, release_ns: sequence * 10_000_000, ..Header::default() }
    }

    #[test]
    fn the_first_state_of_each_process_in_each_quarter_of_a_second_is_due() {
        let mut keyframes = Keyframes::default();
        let mut due = Vec::new();
        for header in (0..60).map(|n| header(0, n)).chain((59..80).map(|n| header(1, n))) {
            if keyframes.is_due(Role::Attitude, &header) {
                assert!(keyframes.note(Role::Attitude, &header, 0));
                due.push((header.generation, header.sequence));
            }
        }
        assert_eq!(due, [(0, 0), (0, 25), (0, 50), (1, 59), (1, 75)]);
        let other_seat = Header { seat: 1, ..header(1, 79) };
        assert!(keyframes.is_due(Role::Attitude, &other_seat));
        assert!(keyframes.is_due(Role::Position, &header(1, 79)));
    }

    #[test]
    fn a_state_that_is_kept_besides_is_recorded_once() {
        let mut keyframes = Keyframes::default();
        assert!(keyframes.note(Role::Plant, &header(0, 10), 0));
        assert!(!keyframes.note(Role::Plant, &header(0, 10), 1));
        assert!(keyframes.note(Role::Plant, &header(0, 13), 0));
        assert!(!keyframes.note(Role::Plant, &header(0, 13), 0));
        assert!(!keyframes.is_due(Role::Plant, &header(0, 24)));
        assert!(keyframes.is_due(Role::Plant, &header(0, 25)));
    }

    #[test]
    fn the_first_state_after_something_was_late_is_recorded() {
        let mut keyframes = Keyframes::default();
        assert!(!keyframes.is_behind(Role::Plant, &header(0, 10), 1), "there is none before it");
        keyframes.note(Role::Plant, &header(0, 10), 0);
        assert!(!keyframes.is_behind(Role::Plant, &header(0, 11), 0));
        assert!(keyframes.is_behind(Role::Plant, &header(0, 12), 2));
        assert!(keyframes.note(Role::Plant, &header(0, 12), 2));
        assert!(!keyframes.is_behind(Role::Plant, &header(0, 13), 2));
    }
}
