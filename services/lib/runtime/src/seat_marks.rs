//! How far every seat has got, and which seats count, as one process knows it.

use crate::graph::MarkView;
use crate::graph::{Edge, Node, ROLES};
use crate::ownership::SlotBook;
use crate::state_header::StateHeader;
use shared_types::{Handover, Progress, RegistryEntry, Role, SEATS, Seat};

/// How far every seat has got, and which seats count, as one process knows it.
#[derive(Debug, Clone)]
pub struct SeatMarks {
    marks: [[u64; SEATS]; ROLES],
    /// Nothing that another loop waits for comes for a release before these, at or after the marks.
    quiet_until_ns: [[u64; SEATS]; ROLES],
    generations: [[Option<u32>; SEATS]; ROLES],
    /// By [`Seat::number`]: the process of the known generation has left, according to the registry.
    has_left: [bool; Seat::COUNT],
    /// By [`Seat::number`]: see [`Progress::served_mono_ns`] \[ns\].
    served_mono_ns: [u64; Seat::COUNT],
    books: [SlotBook; ROLES],
}

impl Default for SeatMarks {
    fn default() -> Self {
        Self {
            marks: [[0; SEATS]; ROLES],
            quiet_until_ns: [[0; SEATS]; ROLES],
            generations: [[None; SEATS]; ROLES],
            has_left: [false; Seat::COUNT],
            served_mono_ns: [0; Seat::COUNT],
            books: [SlotBook::default(); ROLES],
        }
    }
}

impl SeatMarks {
    /// The tenures of a role's slot.
    pub fn book(&mut self, role: Role) -> Option<&mut SlotBook> {
        self.books.get_mut(role.index())
    }

    /// The same, to be read.
    #[must_use]
    pub fn book_of(&self, role: Role) -> Option<&SlotBook> {
        self.books.get(role.index())
    }

    /// True if a consumer of the role may have to wait for this seat.
    #[must_use]
    pub fn concerns(&self, role: Role, seat: u32) -> bool {
        self.books.get(role.index()).is_none_or(|book| book.concerns(seat))
    }

    /// How far the process has got that has a seat as `generation`; 0 if nothing is known of it \[ns\].
    #[must_use]
    pub fn of_seat(&self, seat: Seat, generation: u32) -> u64 {
        let index = usize::try_from(seat.index).unwrap_or(usize::MAX);
        let role = seat.role.index();
        let known = self.generations.get(role).and_then(|seats| seats.get(index)).copied();
        let mark = self.marks.get(role).and_then(|seats| seats.get(index)).copied();
        mark.filter(|_| known == Some(Some(generation))).unwrap_or(0)
    }

    /// Takes in how far a seat's process of this generation has got.
    pub fn advance(&mut self, role: Role, seat: u32, generation: u32, mark_ns: u64) {
        self.advance_quietly(role, seat, generation, (mark_ns, mark_ns));
    }

    /// The same for a process that has reported until when it is quiet: mark and that instant \[ns\].
    fn advance_quietly(&mut self, role: Role, seat: u32, generation: u32, reported_ns: (u64, u64)) {
        let Some(one) = self.seat(role, seat) else { return };
        let (mark_ns, quiet_until_ns) = (reported_ns.0, reported_ns.1.max(reported_ns.0));
        match *one.generation {
            Some(known) if known > generation => {}
            Some(known) if known == generation => {
                *one.mark_ns = mark_ns.max(*one.mark_ns);
                *one.quiet_until_ns = quiet_until_ns.max(*one.quiet_until_ns);
            }
            _ => {
                *one.generation = Some(generation);
                (*one.mark_ns, *one.quiet_until_ns) = (mark_ns, quiet_until_ns);
            }
        }
    }

    /// Takes in the progress that a process has reported. A report from before the reader's ports
    /// were open, at `opened_mono_ns` of `CLOCK_MONOTONIC`, may promise samples that have not come;
    /// returns false then.
    pub fn update(&mut self, seat: Seat, progress: &Progress, opened_mono_ns: u64) -> bool {
        let Progress { mark_ns, quiet_until_ns, served_mono_ns, generation, .. } = *progress;
        let is_believed = served_mono_ns == 0 || served_mono_ns >= opened_mono_ns;
        if is_believed {
            let reported_ns = (mark_ns, quiet_until_ns);
            self.advance_quietly(seat.role, seat.index, generation, reported_ns);
            if let Some(number) =
                seat.number().filter(|_| self.generation(seat) == Some(generation))
            {
                // A writer that does not report this is not waited for.
                self.served_mono_ns[number] =
                    if served_mono_ns == 0 { u64::MAX } else { served_mono_ns };
            }
        }
        is_believed
    }

    /// True if the process that has the seat as this generation has given what it had published to every reader that had
    /// its ports open at `since_mono_ns` of `CLOCK_MONOTONIC`.
    #[must_use]
    pub fn has_served(&self, seat: Seat, generation: u32, since_mono_ns: u64) -> bool {
        let served = seat.number().map_or(u64::MAX, |number| self.served_mono_ns[number]);
        self.generation(seat) == Some(generation) && served >= since_mono_ns
    }

    /// Generation of the process that has, or last had, a seat.
    #[must_use]
    pub fn generation(&self, Seat { role, index }: Seat) -> Option<u32> {
        let seats = self.generations.get(role.index())?;
        *seats.get(usize::try_from(index).ok()?)?
    }

    /// Adds to a hand-over, which `state` follows, the writers that the process reads: of each seat
    /// the process that is there when it begins, or the next.
    #[must_use]
    pub fn name_writers(&self, order: Handover, state: &[u8]) -> Handover {
        let head = StateHeader::of(state);
        let begins_ns = order.join_ns.max(head.map_or(0, |head| head.release_ns));
        Handover { first_generations: self.first_generations(begins_ns), ..order }
    }

    fn first_generations(&self, t_ns: u64) -> [u32; Seat::COUNT] {
        let mut first_generations = [0; Seat::COUNT];
        for seat in Role::STEPPING.into_iter().flat_map(Seat::all) {
            let (Some(number), Some(generation)) = (seat.number(), self.generation(seat)) else {
                continue;
            };
            let book = self.books.get(seat.role.index());
            let is_taken = book.is_none_or(|book| book.is_taken_from(seat.index, t_ns));
            // The record of a newcomer may not be written yet.
            let has_flown = self.of_seat(seat, generation) > 0;
            let has_gone = self.has_left[number] || has_flown && !is_taken;
            first_generations[number] = generation.saturating_add(u32::from(has_gone));
        }
        first_generations
    }

    /// Takes in the registry: a process that has left is not waited for, and one that comes after it begins anew.
    pub fn learn_registry(&mut self, entries: &[RegistryEntry]) {
        for entry in entries {
            let seat = Seat { role: entry.role, index: entry.seat };
            let Some(one) = self.seat(entry.role, entry.seat) else { continue };
            match *one.generation {
                Some(known) if known > entry.generation => continue,
                Some(known) if known == entry.generation => {
                    if !entry.present.is_set() {
                        (*one.mark_ns, *one.quiet_until_ns) = (u64::MAX, u64::MAX);
                    }
                }
                _ => {
                    let mark_ns = if entry.present.is_set() { 0 } else { u64::MAX };
                    *one.generation = Some(entry.generation);
                    (*one.mark_ns, *one.quiet_until_ns) = (mark_ns, mark_ns);
                    if let Some(number) = seat.number() {
                        self.served_mono_ns[number] = 0;
                    }
                }
            }
            if let Some(number) = seat.number() {
                self.has_left[number] = !entry.present.is_set();
            }
        }
    }

    /// From which release on a quiet loop is woken, one with a single seat \[ns\]: from the middle of its quiet on, so that
    /// it has several to run, unless none lies between there and the end, before which no loop waits for it.
    #[must_use]
    pub fn woken_from_ns(&self, node: &Node) -> u64 {
        let mark_ns = self.of_role(node.role);
        let quiet_until_ns = self.quiet_until_ns.get(node.role.index()).map_or(0, |seats| seats[0]);
        let middle_ns = mark_ns.midpoint(quiet_until_ns);
        let first_ns = node.rate.release_ns(node.rate.first_at_or_after(middle_ns));
        if first_ns < quiet_until_ns { first_ns } else { mark_ns }
    }

    fn seat(&mut self, role: Role, seat: u32) -> Option<KnownSeat<'_>> {
        let (role, index) = (role.index(), usize::try_from(seat).ok()?);
        Some(KnownSeat {
            mark_ns: self.marks.get_mut(role)?.get_mut(index)?,
            quiet_until_ns: self.quiet_until_ns.get_mut(role)?.get_mut(index)?,
            generation: self.generations.get_mut(role)?.get_mut(index)?,
        })
    }
}

/// What is known of the process on a seat.
struct KnownSeat<'a> {
    mark_ns: &'a mut u64,
    quiet_until_ns: &'a mut u64,
    generation: &'a mut Option<u32>,
}

impl MarkView for SeatMarks {
    fn of(&self, edge: &Edge) -> u64 {
        let role = edge.from.index();
        match (self.books.get(role), self.quiet_until_ns.get(role)) {
            (Some(book), Some(seats)) => book.mark_ns(seats, edge.latency_ns),
            _ => 0,
        }
    }
    fn of_role(&self, role: Role) -> u64 {
        self.marks.get(role.index()).map_or(0, |seats| seats[0])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::graph::MissPolicy;
    use crate::ownership::tests::{MS, record};
    use crate::rate::Rate;
    use shared_types::{NO_SEAT, OwnerRecord, topics};

    fn marks(seats_ms: [u64; SEATS], records: &[OwnerRecord]) -> SeatMarks {
        let mut marks = SeatMarks::default();
        for (seat, mark_ms) in (0..).zip(seats_ms) {
            marks.advance(Role::Attitude, seat, 0, mark_ms * MS);
        }
        for record in records {
            marks.book(Role::Attitude).unwrap().learn(record);
        }
        marks
    }

    fn of(marks: &SeatMarks, latency_ms: u64) -> u64 {
        let topic = &topics::WRENCH_COMMAND.info;
        let edge = Edge { latency_ns: latency_ms * MS, ..Edge::unwaited(topic, Role::Plant) };
        marks.of(&edge) / MS
    }

    #[test]
    fn consumers_wait_for_the_old_owner_until_the_change_and_for_the_new_one_after_it() {
        let records = [record(1, 0, 0, NO_SEAT), record(2, 101, 1, NO_SEAT)];
        // The change at 101 ms concerns what is released from 100 ms on.
        assert_eq!(of(&marks([90, 120, 0, 0], &records), 1), 90);
        assert_eq!(of(&marks([99, 120, 0, 0], &records), 1), 99);
        assert_eq!(of(&marks([100, 120, 0, 0], &records), 1), 120);
        assert_eq!(of(&marks([100, 80, 0, 0], &records), 1), 100);
        assert_eq!(of(&marks([500, 110, 0, 0], &records), 1), 110);
        // On an arrow without latency it concerns what is released from 101 ms on.
        assert_eq!(of(&marks([100, 120, 0, 0], &records), 0), 100);
    }

    #[test]
    fn a_mark_from_before_the_readers_ports_were_open_counts_once_it_is_repeated() {
        let mut marks = marks([0; SEATS], &[record(1, 0, 0, NO_SEAT)]);
        let progress = |served_mono_ns, mark_ms: u64| Progress {
            mark_ns: mark_ms * MS,
            served_mono_ns,
            ..Progress::default()
        };
        let owner = Seat::first(Role::Attitude);
        assert!(!marks.update(owner, &progress(999, 90), 1000));
        assert_eq!(of(&marks, 1), 0);
        assert!(marks.update(owner, &progress(1000, 90), 1000));
        assert_eq!(of(&marks, 1), 90);
        assert!(marks.update(owner, &progress(0, 100), 1000), "a writer that does not tell");
        assert_eq!(of(&marks, 1), 100);
    }

    #[test]
    fn a_quiet_process_is_waited_for_by_its_quiet_and_judged_by_its_mark() {
        let mut marks = SeatMarks::default();
        let seat = Seat::first(Role::Monitor);
        let mut report = |generation, mark_ms: u64, quiet_until_ms: u64| {
            let (mark_ns, quiet_until_ns) = (mark_ms * MS, quiet_until_ms * MS);
            marks.update(
                seat,
                &Progress { mark_ns, quiet_until_ns, generation, ..Progress::default() },
                0,
            );
            let edge = Edge::unwaited(&topics::TRIP.info, Role::Plant);
            let node = Node {
                role: Role::Monitor,
                rate: Rate::from_hz(100.0).unwrap(),
                lead_ns: 0,
                input_deadline_ns: 0,
                miss_policy: MissPolicy::Skip,
            };
            let all =
                [marks.of(&edge), marks.of_seat(seat, generation), marks.woken_from_ns(&node)];
            all.map(|ns| ns / MS)
        };
        assert_eq!(report(0, 20, 0), [20, 20, 20], "a writer that does not tell");
        assert_eq!(report(0, 20, 100), [100, 20, 60]);
        assert_eq!(report(0, 20, 90), [100, 20, 60], "what it has said holds");
        assert_eq!(report(0, 70, 100), [100, 70, 90]);
        // No release lies between the middle and the end.
        assert_eq!(report(0, 90, 100), [100, 90, 90]);
        assert_eq!(report(1, 50, 0), [50, 50, 50], "its successor begins anew");
    }

    #[test]
    fn a_process_has_served_all_that_had_ports_when_it_looked_after_its_readers() {
        let mut marks = SeatMarks::default();
        let owner = Seat::first(Role::Attitude);
        let progress = |served_mono_ns, generation| Progress {
            served_mono_ns,
            generation,
            ..Progress::default()
        };
        marks.update(owner, &progress(1000, 0), 0);
        assert!(marks.has_served(owner, 0, 1000) && !marks.has_served(owner, 0, 1001));
        assert!(!marks.has_served(owner, 1, 1000), "its successor has not");
        marks.update(owner, &progress(1200, 1), 0);
        marks.update(owner, &progress(1100, 0), 0);
        assert!(marks.has_served(owner, 1, 1200));
        marks.update(owner, &progress(0, 2), 0);
        assert!(marks.has_served(owner, 2, u64::MAX), "a writer that does not tell");
    }

    #[test]
    fn a_fallback_is_waited_for_and_a_shadow_is_not() {
        let alone = [record(1, 0, 0, NO_SEAT)];
        assert_eq!(of(&marks([90, 10, 10, 10], &alone), 1), 90);
        let backed = [record(1, 0, 0, 2)];
        assert_eq!(of(&marks([90, 10, 70, 10], &backed), 1), 70);
    }

    #[test]
    fn a_process_that_has_left_is_not_waited_for_and_its_successor_begins_anew() {
        let mut seats = marks([90, 0, 0, 0], &[record(1, 0, 0, NO_SEAT)]);
        let entry = |generation, present: bool| RegistryEntry {
            role: Role::Attitude,
            generation,
            present: present.into(),
            ..RegistryEntry::default()
        };
        seats.learn_registry(&[entry(0, true)]);
        assert_eq!(of(&seats, 1), 90);
        seats.learn_registry(&[entry(0, false)]);
        assert_eq!(of(&seats, 1), u64::MAX / MS);
        seats.learn_registry(&[entry(0, false), entry(1, true)]);
        assert_eq!(of(&seats, 1), 0);
        seats.advance(Role::Attitude, 0, 0, 95 * MS);
        assert_eq!(of(&seats, 1), 0, "its predecessor's last word comes late");
        seats.advance(Role::Attitude, 0, 1, 96 * MS);
        assert_eq!(of(&seats, 1), 96);
    }

    #[test]
    fn a_process_that_begins_in_flight_reads_the_writer_of_each_seat_or_the_next() {
        let without = OwnerRecord { period_ns: [10, 0, 10, 10], ..record(2, 100, 0, NO_SEAT) };
        let mut seats = marks([0; SEATS], &[record(1, 0, 0, 1), without]);
        let flies = |seats: &mut SeatMarks, seat, generation| {
            seats.advance(Role::Attitude, seat, generation, 50 * MS);
        };
        let entry = |seat, generation, present: bool| RegistryEntry {
            role: Role::Attitude,
            seat,
            generation,
            present: present.into(),
            ..RegistryEntry::default()
        };
        seats.learn_registry(&[entry(0, 3, true), entry(1, 1, true), entry(2, 5, false)]);
        flies(&mut seats, 1, 1);
        let first_generations = |seats: &SeatMarks, t_ms: u64| {
            let order = Handover { join_ns: t_ms * MS, ..Handover::default() };
            let named = seats.name_writers(order, &[]).first_generations;
            assert_eq!(named[Seat::first(Role::Plant).number().unwrap()], 0);
            [0, 1, 2, 3].map(|index| named[Seat { role: Role::Attitude, index }.number().unwrap()])
        };
        assert_eq!(first_generations(&seats, 99), [3, 1, 6, 0]);
        assert_eq!(first_generations(&seats, 100), [3, 2, 6, 0], "its seat is free from then on");
        seats.learn_registry(&[entry(2, 6, true)]);
        seats.advance(Role::Attitude, 2, 6, u64::MAX);
        assert_eq!(
            first_generations(&seats, 99),
            [3, 1, 6, 0],
            "one that has finished is still there"
        );
        seats.learn_registry(&[entry(1, 2, true)]);
        assert_eq!(first_generations(&seats, 100), [3, 2, 6, 0], "its record is still to come");
        let back = record(3, 200, 0, NO_SEAT);
        seats.book(Role::Attitude).unwrap().learn(&back);
        flies(&mut seats, 1, 2);
        assert_eq!(first_generations(&seats, 150), [3, 2, 6, 0], "its record takes effect later");
    }
}
