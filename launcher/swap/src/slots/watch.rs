//! What the recorder sees of the slots: commands by seat, and which seat each consumer follows.

use rehearsal::{Snapshot, Watcher};
use runtime::seat_of_loop;
use shared_types::{
    AppliedCommand, AppliedSetpoint, AttitudeSetpoint, GateMode, Header, LoopStats, MorphAngle,
    Reference, Role, Sample, StateEstimate, Trip, WrenchCommand,
};
use slot::SlotConfig;
use std::any::Any;
use std::collections::VecDeque;
use vehicle::VehicleParameters;

/// Age from which on no controller flies on an estimate \[ns\].
const STALE_NS: u64 = 20_000_000;

/// References that are kept: the pilot runs ahead of the flight by its lead.
const REFERENCES: usize = 256;

/// A command that the controller on a seat has published.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Commanded {
    pub(super) slot: Role,
    pub(super) seat: u32,
    pub(super) release_ns: u64,
    pub(super) effective_ns: u64,
    /// T and τ, or T, φ, θ and ψ.
    pub(super) value: [f64; 4],
}

/// What the consumer of a slot reports about the seat that it follows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Followed {
    pub(super) at_ns: u64,
    pub(super) epoch: u64,
    pub(super) seat: u32,
    pub(super) failed_over: bool,
    pub(super) tripped: bool,
    pub(super) refused_epoch: u64,
}

/// One observation, in the order drained.
#[derive(Debug, Clone, Copy)]
pub enum Seen {
    Command(Commanded),
    /// The report of a consumer has changed, or is its first.
    Follows {
        /// Role of the slot.
        slot: Role,
        /// Seat of the consumer.
        by_seat: u32,
        /// What it follows.
        followed: Followed,
    },
    /// Whether the controller on this seat of the attitude slot had received a set point at an instant.
    HasSetpoint {
        /// Seat of the candidate.
        seat: u32,
        /// Logical instant \[ns\].
        at_ns: u64,
        /// Whether there was a set point to follow.
        something: bool,
    },
    /// A consumer has been on its own since `since_ns`.
    Unguided {
        /// Role of the slot.
        slot: Role,
        /// Seat of the consumer.
        by_seat: u32,
        /// Epoch of the record that it goes by.
        epoch: u64,
        /// Since when it has had nothing to follow \[ns\].
        since_ns: u64,
        /// Logical instant \[ns\].
        at_ns: u64,
    },
    /// A trip that the monitor has published.
    Trip(Trip),
    /// The encoder's reading.
    Angle {
        /// Logical instant \[ns\].
        at_ns: u64,
        /// The deployable angle \[rad\].
        angle_rad: f64,
    },
    /// A process on a seat has left out so many releases since its start. An input that was not there in
    /// time is no fault of the process that waited for it.
    Missed {
        /// Role of the slot.
        slot: Role,
        /// Seat of the candidate.
        seat: u32,
        /// Steps that it has missed.
        steps: u64,
        /// Logical instant \[ns\].
        at_ns: u64,
    },
}

/// Keeps what has been seen until it is asked for.
#[derive(Debug, Default)]
pub struct SlotWatch {
    seen: Vec<Seen>,
    /// The last report of each consumer: the plant, then the seats of the attitude slot.
    last: [Followed; 1 + shared_types::SEATS],
    /// When each of them last had something new to follow, and the sequence of that.
    guided: [(u64, u64); 1 + shared_types::SEATS],
    /// Realtime: instant of the newest estimate \[ns\]; a consumer's report is seen shortly after it.
    estimated_ns: Option<u64>,
    /// Remembers what the vehicle knows, from which candidates are flown ahead.
    known: Option<Watcher>,
    /// Where the vehicle was to be at the last instants \[m\].
    references: VecDeque<(u64, [f64; 3])>,
}

impl SlotWatch {
    /// Of a flight whose controllers model this vehicle.
    #[must_use]
    pub fn new(vehicle: &VehicleParameters) -> Self {
        Self { known: Some(Watcher::new(vehicle)), ..Self::default() }
    }

    /// Of a flight by the wall clock, in which estimates may fail to come, and references while a launcher takes over: a
    /// controller that has just begun commands nothing without, and that is no reason to take it away. In lockstep all wait
    /// until they come.
    #[must_use]
    pub fn by_the_wall(mut self) -> Self {
        self.estimated_ns = Some(0);
        self
    }

    /// What the vehicle knows of itself at an instant; `None` before it knows anything.
    #[must_use]
    pub fn snapshot(&self, at_ns: u64) -> Option<Snapshot> {
        self.known.as_ref()?.snapshot(at_ns)
    }

    /// Distance from the estimate to the reference at an instant \[m\]; `None` without either.
    #[must_use]
    pub fn tracking_error_m(&self, at_ns: u64) -> Option<f64> {
        let (_, wanted) = *self.references.iter().rev().find(|(from_ns, _)| *from_ns <= at_ns)?;
        let is = self.snapshot(at_ns)?.position_w_m;
        let squares = is.iter().zip(wanted).map(|(is, wanted)| (is - wanted) * (is - wanted));
        Some(squares.sum::<f64>().sqrt())
    }

    /// Looks at one sample.
    pub fn observe<T: Sample>(&mut self, sample: &T) {
        let any: &dyn Any = sample;
        if let Some(known) = &mut self.known {
            known.observe_any(sample);
        }
        if let Some(command) = any.downcast_ref::<WrenchCommand>() {
            let [x, y, z] = command.torque_b_nm;
            self.command(Role::Attitude, &command.header, [command.thrust_n, x, y, z]);
        } else if let Some(setpoint) = any.downcast_ref::<AttitudeSetpoint>() {
            let AttitudeSetpoint { thrust_n, roll_rad, pitch_rad, yaw_rad, .. } = *setpoint;
            let value = [thrust_n, roll_rad, pitch_rad, yaw_rad];
            self.command(Role::Position, &setpoint.header, value);
        } else if let Some(applied) = any.downcast_ref::<AppliedCommand>() {
            let followed = Followed {
                at_ns: applied.header.release_ns,
                epoch: applied.epoch,
                seat: applied.seat,
                failed_over: applied.failed_over.is_set(),
                tripped: applied.tripped.is_set(),
                refused_epoch: applied.refused_epoch,
            };
            self.follows(Role::Attitude, 0, 0, followed);
            // A command in effect is always news; after a cut nothing can be, and while the gate brings
            // the vehicle back nothing needs to.
            let sequence = match applied.mode {
                GateMode::Normal | GateMode::Cut | GateMode::Recover => u64::MAX,
                _ => applied.command_sequence,
            };
            self.note_guidance(Role::Attitude, 0, 0, followed, sequence);
        } else if let Some(applied) = any.downcast_ref::<AppliedSetpoint>() {
            let followed = Followed {
                at_ns: applied.header.release_ns,
                epoch: applied.epoch,
                seat: applied.seat,
                failed_over: applied.failed_over.is_set(),
                tripped: applied.tripped.is_set(),
                refused_epoch: applied.refused_epoch,
            };
            let by_seat = applied.header.seat;
            let (at_ns, something) = (followed.at_ns, applied.setpoint_sequence > 0);
            self.seen.push(Seen::HasSetpoint { seat: by_seat, at_ns, something });
            let place = 1 + usize::try_from(by_seat).unwrap_or(usize::MAX - 1);
            self.follows(Role::Position, by_seat, place, followed);
            self.note_guidance(Role::Position, by_seat, place, followed, applied.setpoint_sequence);
        } else if let Some(estimate) = any.downcast_ref::<StateEstimate>() {
            self.estimated_ns = self.estimated_ns.map(|last| last.max(estimate.described_ns));
        } else if let Some(trip) = any.downcast_ref::<Trip>() {
            self.seen.push(Seen::Trip(*trip));
        } else if let Some(reference) = any.downcast_ref::<Reference>() {
            self.keep_reference(reference);
        } else if let Some(reading) = any.downcast_ref::<MorphAngle>() {
            let (at_ns, angle_rad) = (reading.header.release_ns, reading.angle_rad);
            self.seen.push(Seen::Angle { at_ns, angle_rad });
        } else if let Some(stats) = any.downcast_ref::<LoopStats>()
            && matches!(stats.role, Role::Attitude | Role::Position)
        {
            self.seen.push(Seen::Missed {
                slot: stats.role,
                seat: seat_of_loop(stats.header.seat),
                steps: stats.skipped,
                at_ns: stats.header.release_ns,
            });
        }
    }

    fn keep_reference(&mut self, reference: &Reference) {
        if self.references.len() == REFERENCES {
            self.references.pop_front();
        }
        self.references.push_back((reference.header.valid_ns, reference.points[0].position_w_m));
    }

    fn command(&mut self, slot: Role, header: &Header, value: [f64; 4]) {
        self.seen.push(Seen::Command(Commanded {
            slot,
            seat: header.seat,
            release_ns: header.release_ns,
            effective_ns: header.valid_ns,
            value,
        }));
    }

    /// Notes the report of a consumer if it has changed.
    fn follows(&mut self, slot: Role, by_seat: u32, place: usize, followed: Followed) {
        let Some(last) = self.last.get_mut(place) else { return };
        if (Followed { at_ns: last.at_ns, ..followed }) != *last {
            *last = followed;
            self.seen.push(Seen::Follows { slot, by_seat, followed });
        }
    }

    /// Notes a consumer that has nothing new to follow, and has had nothing for long.
    fn note_guidance(
        &mut self,
        slot: Role,
        by_seat: u32,
        place: usize,
        followed: Followed,
        sequence: u64,
    ) {
        let Some((since_ns, last)) = self.guided.get_mut(place) else { return };
        let Followed { at_ns, epoch, .. } = followed;
        let is_over = |known_ns: u64| at_ns > known_ns + STALE_NS;
        let has_no_reference = slot == Role::Position
            && self.references.back().is_none_or(|(valid_ns, _)| is_over(*valid_ns));
        let is_helpless = self.estimated_ns.is_some_and(|ns| is_over(ns) || has_no_reference);
        if sequence == u64::MAX || sequence != *last || epoch == 0 || is_helpless {
            (*since_ns, *last) = (at_ns, sequence);
        } else if at_ns.saturating_sub(*since_ns) >= SlotConfig::REALTIME.unguided_ns {
            let since_ns = *since_ns;
            self.seen.push(Seen::Unguided { slot, by_seat, epoch, since_ns, at_ns });
        }
    }

    /// True once the consumers of both slots, or the plant alone if there is only one, have reported
    /// which seat they follow.
    #[must_use]
    pub fn has_reports(&self, position_too: bool) -> bool {
        let [plant, controllers @ ..] = &self.last;
        plant.epoch > 0 && (!position_too || controllers.iter().any(|last| last.epoch > 0))
    }

    /// Everything seen since the last time.
    pub fn take(&mut self) -> Vec<Seen> {
        core::mem::take(&mut self.seen)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The plant holds the last command of an owner from 1 s on, and estimates come until `estimated_ms`; how many times
    /// the watch has reported by 1.5 s that there is nothing to follow.
    fn unguided(watch: SlotWatch, estimated_ms: u64) -> usize {
        let mut watch = watch;
        for ms in 1_000..1_500_u64 {
            if ms < estimated_ms {
                watch
                    .observe(&StateEstimate { described_ns: ms * 1_000_000, ..Default::default() });
            }
            let header = Header { release_ns: ms * 1_000_000, ..Header::default() };
            let mode = GateMode::Hold;
            watch.observe(&AppliedCommand {
                header,
                mode,
                epoch: 1,
                command_sequence: 1,
                ..Default::default()
            });
        }
        watch.take().iter().filter(|seen| matches!(seen, Seen::Unguided { .. })).count()
    }

    #[test]
    fn an_owner_without_estimates_is_not_reported_as_silent() {
        let by_the_wall = || SlotWatch::default().by_the_wall();
        assert_eq!(unguided(by_the_wall(), 1_100), 0, "it has nothing to fly on");
        assert_eq!(unguided(by_the_wall(), 1_500), 300, "it says nothing although it could");
        assert_eq!(unguided(SlotWatch::default(), 1_100), 300, "lockstep waits for estimates");
    }

    /// The same of the position slot: estimates come all the time, and references until `referred_ms`.
    #[test]
    fn an_owner_of_the_position_slot_without_references_is_not_silent() {
        let unguided = |referred_ms: u64| {
            let mut watch = SlotWatch::default().by_the_wall();
            for ms in 1_000..1_500_u64 {
                let ns = ms * 1_000_000;
                watch.observe(&StateEstimate { described_ns: ns, ..Default::default() });
                if ms < referred_ms {
                    let header = Header { valid_ns: ns, ..Header::default() };
                    watch.observe(&Reference { header, ..Default::default() });
                }
                let header = Header { release_ns: ns, ..Header::default() };
                watch.observe(&AppliedSetpoint {
                    header,
                    epoch: 1,
                    setpoint_sequence: 1,
                    ..Default::default()
                });
            }
            watch.take().iter().filter(|seen| matches!(seen, Seen::Unguided { .. })).count()
        };
        assert_eq!(unguided(1_100), 0, "it has nothing to follow");
        assert_eq!(unguided(1_500), 300, "it says nothing although it could");
    }
}
