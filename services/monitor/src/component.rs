//! The monitor as a process: it reads what a real vehicle can measure or estimate, and publishes trips.

use crate::blame::{Hands, Watched, blame};
use crate::finding::Finding;
use crate::judge::{Applied, Findings, Judge, JudgeMemory, Moment, Setpoint};
use crate::last_trip::{LastTrip, is_recovering};
use crate::limits::Limits;
use crate::reports::{Asked, Record, Report, Reports, ReportsMemory};
use crate::torque::{Torque, TorqueMemory};
use controller::preview::{Landing, target};
use nalgebra::Vector3;
use runtime::{Authority, Input, Link, Service, inputs, outputs};
use shared_types::{
    AppliedCommand, AppliedSetpoint, AttitudeSetpoint, GateMode, Header, NO_SEAT, OwnerRecord,
    Reference, Role, Slot, StateEstimate, Trip, TripCause, topics,
};
use vehicle::{MorphAngle, VehicleParameters, rotation};

/// Age above which an estimate is ignored, because it no longer shows what the owner does \[ns\]; twice the
/// period of the monitor where that is longer.
const STALE_NS: u64 = 20_000_000;
/// Longest step over which motion is integrated \[s\]; twice the period of the monitor where that is longer. After a
/// longer pause the step counts as zero, so that a gap in the estimates is not mistaken for a motion.
const MAX_STEP_S: f64 = 0.1;
/// Periods after which an attitude controller flies by its backup law for want of another set point: one is valid for two,
/// and held for two more.
const SILENT_PERIODS: u64 = 4;

inputs! {
    /// What an owner is judged by. A trip is traced back to the state estimate, the primary input.
    pub struct Inputs {
        /// Estimated state of the vehicle.
        state_estimate: StateEstimate = topics::STATE_ESTIMATE,
        /// Command that the plant applied to the rotors.
        applied_command: AppliedCommand = topics::APPLIED_COMMAND,
        /// Set point that the attitude loop tracks.
        applied_setpoint: AppliedSetpoint = topics::APPLIED_SETPOINT,
        /// Set points of the position slot.
        attitude_setpoint: AttitudeSetpoint = topics::ATTITUDE_SETPOINT,
        /// Trajectory to follow.
        reference: Reference = topics::REFERENCE,
        /// Owner of the attitude slot.
        attitude_owner: OwnerRecord = topics::ATTITUDE_OWNER,
        /// Owner of the position slot.
        position_owner: OwnerRecord = topics::POSITION_OWNER,
    }
}

outputs! {
    /// What the monitor publishes.
    pub struct Outputs {
        /// Takes command from an owner.
        trip: Trip = topics::TRIP,
    }
}

/// Configuration of the monitor, fixed for a flight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MonitorConfig {
    /// Thresholds.
    pub limits: Limits,
    /// Period of the loop \[s\].
    pub period_s: f64,
    /// Latency of the trip topic: from a step of the monitor to the instant at which its trip takes effect
    /// \[s\].
    pub latency_s: f64,
    /// Landing that position controllers fly when the reference has ended; it replaces the reference then.
    pub landing: Landing,
    /// Whether the laws of the attitude slot ask for no more torque than hover thrust leaves. Full
    /// torque of a law that may ask for more proves nothing.
    pub keeps_to_rotors: bool,
}

shared_types::memory! {
    /// State of the monitor between two steps.
    #[derive(PartialEq)]
    pub struct Memory {
        /// State of the criteria.
        pub judge: JudgeMemory,
        /// Set points, and what was reported of them.
        pub reports: ReportsMemory,
        /// Roll and pitch torque.
        pub torque: TorqueMemory,
        /// Set point that the attitude slot's owner tracks: φ, θ, ψ \[rad\] and T \[N\].
        pub setpoint: [f64; 4],
        /// Whether a set point has been received.
        pub has_setpoint: bool,
        /// What the position slot's owner has asked for last, as `setpoint`.
        pub asked: [f64; 4],
        /// Whether it has asked for something.
        pub has_asked: bool,
        /// Effective instant of the last set point that counted \[ns\]; 0 for none.
        pub asked_ns: u64,
        /// Until when the position slot has asked for nothing \[ns\]; 0 for never.
        pub silent_ns: u64,
        /// Since when commands have been clipped without a break \[ns\]; 0 if the last one was not.
        pub clipped_from_ns: u64,
        /// Of each slot: seat that commanded it at the last step, [`NO_SEAT`] for none.
        pub commanding: [u32; Slot::COUNT],
        /// Epoch of its record in which the fallback commanded in place of the owner last; 0 for none.
        pub replaced: [u64; Slot::COUNT],
        /// Since when \[ns\]; 0 for never.
        pub replaced_ns: [u64; Slot::COUNT],
        /// Epoch of the position slot in which the attitude slot has last reported the fallback in command; 0 for none.
        pub failed_over: u64,
        /// Of each slot: last trip published for it.
        pub trips: [LastTrip; Slot::COUNT],
        /// Whether the actuation gate brakes the vehicle after a trip of the position slot, or is about to.
        pub is_braked: bool,
        /// Instant of the last step \[ns\].
        pub seen_ns: u64,
    }
}

/// The monitor between its ports.
#[derive(Debug)]
pub struct Monitor {
    judge: Judge,
    reports: Reports,
    torque: Torque,
    landing: Landing,
    latency_ns: u64,
    stale_ns: u64,
    max_step_s: f64,
    memory: Memory,
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "positive")]
fn ns(s: f64) -> u64 {
    (1e9 * s).ceil() as u64
}

/// Owner records by slot.
fn records(inputs: &Inputs) -> [&Input<OwnerRecord>; Slot::COUNT] {
    Slot::ALL.map(|slot| match slot {
        Slot::Attitude => &inputs.attitude_owner,
        Slot::Position => &inputs.position_owner,
    })
}

/// Period of the controller on a seat, by its slot's record \[ns\]; 0 for none.
fn period_ns(record: &OwnerRecord, seat: u32) -> u64 {
    let seat = usize::try_from(seat).ok();
    seat.and_then(|seat| record.period_ns.get(seat)).copied().unwrap_or(0)
}

impl Monitor {
    /// A monitor at the beginning of a flight, for a vehicle with these parameters.
    #[must_use]
    pub fn new(config: &MonitorConfig, vehicle: &VehicleParameters) -> Self {
        let command_s = config.period_s + config.latency_s;
        Self {
            judge: Judge::new(config.limits, vehicle, command_s),
            reports: Reports::new(4.0 * vehicle.rotor_thrust_max_n),
            torque: Torque::new(vehicle, config.keeps_to_rotors),
            landing: config.landing,
            latency_ns: ns(config.latency_s),
            stale_ns: STALE_NS.max(2 * ns(config.period_s)),
            max_step_s: MAX_STEP_S.max(2.0 * config.period_s),
            memory: Memory { commanding: [NO_SEAT; Slot::COUNT], ..Memory::default() },
        }
    }

    /// Takes what the controller that the plant follows reports of its set point.
    fn take_tracked(&mut self, inputs: &Inputs) {
        let followed = inputs.applied_command.latest();
        let applied = inputs.applied_setpoint.in_command(&inputs.attitude_owner, followed);
        let Some(applied) = applied else { return };
        let record = inputs.attitude_owner.in_effect_at(applied.header.valid_ns);
        let is_proven = record.is_some_and(|record| !record.watched.is_set());
        // Of one that is not, only as far as there is a reason for it.
        let is_believed = is_proven || self.reports.may_have_failed_over();
        let has_failed_over = applied.failed_over.is_set() && is_believed;
        self.memory.failed_over = if has_failed_over { applied.epoch } else { 0 };
        let setpoint = [applied.roll_rad, applied.pitch_rad, applied.yaw_rad, applied.thrust_n];
        if applied.setpoint_sequence > 0 && setpoint.iter().all(|number| number.is_finite()) {
            self.memory.setpoint = setpoint;
            self.memory.has_setpoint = true;
        } else if applied.setpoint_sequence == 0 {
            // By the backup law: there is no set point to compare with.
            self.memory.has_setpoint = false;
        }
    }

    /// Takes what the controllers that may command the position slot ask for.
    fn take_asked(&mut self, now_ns: u64, inputs: &Inputs) {
        if let Some(record) = inputs.position_owner.in_effect_at(now_ns) {
            let hands = [record.owner, record.fallback];
            let every_ns = period_ns(record, record.owner);
            let at_ns = record.header.valid_ns;
            let record = Record { epoch: record.epoch, hands, at_ns, every_ns };
            self.memory.has_asked &= !self.reports.take_record(&record);
        }
        // A monitor that joins a flight begins with the one in effect.
        let joins = self.reports.is_empty();
        let known = inputs.attitude_setpoint.before_fresh().filter(|_| joins);
        for sample in known.into_iter().chain(inputs.attitude_setpoint.fresh()) {
            let value = [sample.roll_rad, sample.pitch_rad, sample.yaw_rad, sample.thrust_n];
            // What its consumers refuse, and what they do not listen to, is not tracked.
            let authority = inputs.position_owner.authority_of(&sample.header);
            let counts = matches!(authority, Authority::Owner | Authority::Fallback);
            if counts && value.iter().all(|number| number.is_finite()) {
                let Header { sequence, valid_ns, seat, .. } = sample.header;
                self.reports.ask(seat, Asked { value, sequence, valid_ns });
                self.memory.asked_ns = self.memory.asked_ns.max(valid_ns);
                if authority == Authority::Owner {
                    self.memory.asked = value;
                    self.memory.has_asked = true;
                }
            }
        }
        self.reports.note_silence(now_ns);
    }

    /// Takes what the plant has applied: the torques, and since when the rotors have been clipped.
    fn take_applied(&mut self, inputs: &Inputs) {
        let estimate = inputs.state_estimate.latest();
        let beta = estimate.and_then(|s| MorphAngle::saturating_from_rad(s.morph_angle_rad));
        for applied in inputs.applied_command.fresh() {
            self.torque.take(applied, beta.unwrap_or(MorphAngle::MAX));
            let is_clipped = applied.clipped.is_set() && applied.mode == GateMode::Normal;
            self.memory.clipped_from_ns = match self.memory.clipped_from_ns {
                _ if !is_clipped => 0,
                0 => applied.header.release_ns,
                from_ns => from_ns,
            };
        }
    }

    /// Which seats command the slots at `now_ns`. Other hands reset the criteria, since they are not to blame for what
    /// came before.
    fn hands(&mut self, now_ns: u64, inputs: &Inputs) -> [Hands; Slot::COUNT] {
        // A report about an epoch that is over does not hold for the next one.
        let command = inputs.applied_command.latest();
        let command = command.filter(|applied| applied.failed_over.is_set());
        let failed_over = [command.map_or(0, |applied| applied.epoch), self.memory.failed_over];
        let mut hands = [Hands::Proven; Slot::COUNT];
        let mut seats = [NO_SEAT; Slot::COUNT];
        for slot in Slot::ALL.map(Slot::index) {
            let Some(record) = records(inputs)[slot].in_effect_at(now_ns) else { continue };
            // A trip is known here before it takes effect. Without a fallback the slot's consumer flies by itself.
            let is_there = period_ns(record, record.fallback) > 0;
            let fallback = if is_there { record.fallback } else { NO_SEAT };
            let has_tripped = self.memory.trips[slot].holds(record, fallback, now_ns);
            // Once in an epoch is for all of it: a later report of an attitude controller does not revoke it.
            let is_replaced = failed_over[slot] == record.epoch
                || has_tripped
                || self.memory.replaced[slot] == record.epoch;
            (hands[slot], seats[slot]) = if is_replaced {
                (Hands::Replaced, record.fallback)
            } else if record.watched.is_set() {
                let OwnerRecord { epoch, owner, .. } = *record;
                let watched = Watched { epoch, instance: owner, fallback };
                (Hands::Watched(watched), record.owner)
            } else {
                (Hands::Proven, record.owner)
            };
            if is_replaced && self.memory.replaced[slot] != record.epoch {
                self.memory.replaced[slot] = record.epoch;
                self.memory.replaced_ns[slot] = now_ns;
            }
        }
        let changes = |slot: Slot| seats[slot.index()] != self.memory.commanding[slot.index()];
        if changes(Slot::Attitude) {
            self.reports.forget();
        }
        if seats != self.memory.commanding {
            self.memory.clipped_from_ns = 0;
            self.torque.forget();
            self.judge.forget(changes(Slot::Position));
            self.memory.commanding = seats;
        }
        hands
    }

    /// What is wrong with what the attitude slot's owner reports of its set point.
    fn misreported(&mut self, now_ns: u64, inputs: &Inputs) -> Option<Finding> {
        let attitude = inputs.attitude_owner.in_effect_at(now_ns)?;
        let position = inputs.position_owner.in_effect_at(now_ns)?;
        let mut cause = None;
        for applied in inputs.applied_setpoint.fresh() {
            if inputs.attitude_owner.authority_of(&applied.header) == Authority::Owner {
                let found = self.reports.check(&Report {
                    release_ns: applied.header.release_ns,
                    seat: applied.seat,
                    sequence: applied.setpoint_sequence,
                    epoch: applied.epoch,
                    refused_epoch: applied.refused_epoch,
                    has_failed_over: applied.failed_over.is_set(),
                    has_tripped: applied.tripped.is_set(),
                    value: [applied.roll_rad, applied.pitch_rad, applied.yaw_rad, applied.thrust_n],
                    period_ns: period_ns(attitude, applied.header.seat),
                    asked_every_ns: [position.owner, position.fallback]
                        .map(|seat| period_ns(position, seat)),
                });
                cause = cause.or(found);
            }
        }
        Some(Finding::of(cause?, 0.0, 0.0))
    }

    /// Whether the position slot asks for nothing any more, although it has an owner: a backup law without an integral
    /// stands in, and where the vehicle goes meanwhile is not judged.
    fn is_silent(&self, now_ns: u64, inputs: &Inputs) -> bool {
        let record = inputs.position_owner.in_effect_at(now_ns);
        let every_ns = record.map_or(0, |record| period_ns(record, record.owner));
        let asked_ns = self.memory.asked_ns;
        asked_ns > 0 && now_ns > asked_ns.saturating_add(every_ns.saturating_mul(SILENT_PERIODS))
    }

    /// Of each slot: whether its owner has been replaced lately.
    fn recovers(&self, now_ns: u64) -> [bool; Slot::COUNT] {
        self.memory.replaced_ns.map(|from_ns| is_recovering(from_ns, now_ns))
    }

    /// Whether the gate itself flies the vehicle because the position slot's owner has tripped beside a watched one of the
    /// attitude slot: where the vehicle turns meanwhile is not that one's doing.
    fn is_braked(&mut self, now_ns: u64, inputs: &Inputs) -> bool {
        let tripped_ns = self.memory.trips[Slot::Position.index()].at_ns + self.latency_ns;
        let applied = inputs.applied_command.latest();
        let is_since = |applied: &&AppliedCommand| applied.header.release_ns > tripped_ns;
        let applied = applied.filter(is_since);
        self.memory.is_braked &= applied
            .map_or(now_ns <= tripped_ns + self.stale_ns, |now| now.mode == GateMode::Recover);
        self.memory.is_braked
    }

    /// Whether the actuation gate levels the vehicle because the attitude slot's watched owner was about to overturn it: no
    /// set point that it should follow asks for so much. After a trip of either slot it is not its fault.
    fn overturns(&self, now_ns: u64, inputs: &Inputs, hands: &Hands) -> Option<Finding> {
        let Hands::Watched(owner) = hands else { return None };
        let applied = inputs.applied_command.latest()?;
        let is_its_own = applied.epoch == owner.epoch && !applied.tripped.is_set();
        let is_after_trip = self.recovers(now_ns).contains(&true);
        (applied.mode == GateMode::Recover && is_its_own && !is_after_trip)
            .then(|| Finding::of(TripCause::Overturns, 0.0, self.judge.tilt_limit_rad()))
    }

    fn moment(
        &mut self,
        now_ns: u64,
        inputs: &Inputs,
        hands: &[Hands; Slot::COUNT],
    ) -> Option<Moment> {
        let Link::Fresh(estimate) = inputs.state_estimate.link(now_ns, self.stale_ns) else {
            return None;
        };
        let elapsed_s = now_ns.saturating_sub(self.memory.seen_ns) as f64 * 1e-9;
        self.memory.seen_ns = now_ns;
        let setpoint = |[roll, pitch, yaw, thrust_n]: [f64; 4]| Setpoint {
            gamma_rad: Vector3::new(roll, pitch, yaw),
            thrust_n,
        };
        let clipped_s = match self.memory.clipped_from_ns {
            0 => 0.0,
            from_ns => now_ns.saturating_sub(from_ns) as f64 * 1e-9,
        };
        let applied = inputs.applied_command.latest().map(|applied| Applied {
            clipped_s,
            full_s: self.torque.full_s(),
            lagged_nm: self.torque.lagged_nm(),
            thrust_n: applied.thrust_n,
            is_commanded: applied.mode == GateMode::Normal && applied.command_sequence > 0,
        });
        let record = inputs.position_owner.in_effect_at(now_ns);
        let asked_every_ns = record.map_or(0, |record| period_ns(record, record.owner));
        let reference = inputs.reference.latest();
        let reference = reference.map(|reference| target(reference, now_ns, 0.0, &self.landing));
        Some(Moment {
            now_ns,
            elapsed_s: if elapsed_s > self.max_step_s { 0.0 } else { elapsed_s },
            morph_angle: MorphAngle::saturating_from_rad(estimate.morph_angle_rad)?,
            q_wb: rotation(estimate.q_wb.to_array()),
            rate_b_rad_s: estimate.body_rate_b_rad_s.into(),
            position_w_m: estimate.position_w_m.into(),
            velocity_w_m_s: estimate.velocity_w_m_s.into(),
            setpoint: self.memory.has_setpoint.then(|| setpoint(self.memory.setpoint)),
            asked: self.memory.has_asked.then(|| setpoint(self.memory.asked)),
            asked_every_s: asked_every_ns as f64 * 1e-9,
            recovers: self.recovers(now_ns),
            is_unsteered: matches!(hands[Slot::Position.index()], Hands::Proven)
                && is_recovering(self.memory.silent_ns, now_ns),
            applied,
            reference,
        })
    }
}

/// Builds the trip for a finding; the cause decides which of the sample's fields carry number and limit.
fn trip(slot: Role, owner: Watched, finding: &Finding) -> Trip {
    let Finding { cause, value, limit, lasted_s, reversals } = *finding;
    let common = Trip {
        epoch: owner.epoch,
        slot,
        instance: owner.instance,
        cause,
        lasted_s,
        reversals,
        ..Trip::default()
    };
    match cause {
        TripCause::RateOscillates => Trip { rate_rad_s: value, rate_limit_rad_s: limit, ..common },
        TripCause::ThrustAstray => Trip { speed_m_s: value, speed_limit_m_s: limit, ..common },
        TripCause::ThrustBeyond => Trip { thrust_n: value, thrust_limit_n: limit, ..common },
        TripCause::PositionDeparts | TripCause::Sinks => {
            Trip { distance_m: value, distance_limit_m: limit, ..common }
        }
        _ => Trip { angle_rad: value, angle_limit_rad: limit, ..common },
    }
}

impl Service for Monitor {
    type Inputs = Inputs;
    type Outputs = Outputs;
    type Memory = Memory;

    fn step(&mut self, now_ns: u64, inputs: &Inputs, outputs: &mut Outputs) {
        self.take_asked(now_ns, inputs);
        self.take_tracked(inputs);
        self.take_applied(inputs);
        let hands = self.hands(now_ns, inputs);
        if self.is_silent(now_ns, inputs) {
            self.memory.silent_ns = now_ns;
        }
        let misreported = self.misreported(now_ns, inputs);
        if !hands.iter().any(|hands| matches!(hands, Hands::Watched(_))) {
            return;
        }
        let moment = self.moment(now_ns, inputs, &hands);
        let mut findings = moment.map(|moment| self.judge.see(&moment)).unwrap_or_default();
        if self.is_braked(now_ns, inputs) {
            self.judge.forget_attitude();
            findings = Findings { attitude: None, commanded: None, ..findings };
        }
        let [attitude, position] = blame(findings, &hands);
        let found =
            [misreported.or(self.overturns(now_ns, inputs, &hands[0])).or(attitude), position];
        for slot in Slot::ALL {
            let index = slot.index();
            let Hands::Watched(owner) = hands[index] else { continue };
            let found = found[index].map(|finding| trip(slot.role(), owner, &finding));
            let last = &mut self.memory.trips[index];
            let due = last.again(&owner, now_ns).or(found);
            // One trip per epoch is enough, and one sample per step: a second one follows at the next step.
            if let Some(trip) = due.filter(|_| last.trip.epoch < owner.epoch) {
                *last = LastTrip { trip, at_ns: now_ns, fallback: owner.fallback };
                // The trip takes effect before the next step, which may find another record.
                self.memory.replaced_ns[index] = now_ns;
                if slot == Slot::Position {
                    self.reports.trip(owner.instance, now_ns + self.latency_ns);
                    self.memory.is_braked = matches!(hands[0], Hands::Watched(_));
                }
                outputs.trip.write(trip);
                break;
            }
        }
    }

    /// A trip is published only while an owner is watched.
    fn quiet_until_ns(&self, from_ns: u64, known_ns: u64, inputs: &Inputs) -> u64 {
        let watched =
            records(inputs).map(|slot| slot.first_in_effect_ns(from_ns, |r| r.watched.is_set()));
        watched.into_iter().flatten().fold(known_ns, u64::min).max(from_ns)
    }

    fn memory(&self) -> Memory {
        Memory {
            judge: self.judge.memory(),
            reports: self.reports.memory(),
            torque: self.torque.memory(),
            ..self.memory
        }
    }

    fn restore(&mut self, memory: &Memory) -> Result<(), String> {
        self.judge.restore(&memory.judge);
        self.reports.restore(&memory.reports);
        self.torque.restore(&memory.torque);
        self.memory = *memory;
        Ok(())
    }
}

#[cfg(test)]
mod tests;
