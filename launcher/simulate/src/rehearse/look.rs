//! Observes a rehearsed flight and records what the comparison needs.

use super::derive::Role;
use observe::Observer;
use rehearsal::{Facts, Motion, Track, Wanted};
use shared_types::time::s_from_ns;
use shared_types::{
    AppliedCommand, AppliedSetpoint, AttitudeSetpoint, GateMode, OwnerRecord, Reference, Sample,
    Slot, Topic, Truth, WrenchCommand,
};
use std::any::Any;
use vehicle::{MorphAngle, VehicleParameters};

/// Process slot of the candidate; the owner has slot 0.
const CANDIDATE_SEAT: u32 = 1;
/// A tilt of 100°, beyond which a flight is not continued, as x² + y² of the attitude quaternion, which is
/// (1 − cos 100°) / 2.
const TUMBLED: f64 = 0.586_824;

/// Observer of one rehearsed flight.
#[derive(Debug, Default)]
pub(super) struct Look {
    pub(super) track: Track,
    /// True once the judged controller commands the slot.
    pub(super) flipped: bool,
    /// True once the vehicle cannot be recovered, so that the rest of the flight need not be flown.
    pub(super) is_over: bool,
    /// Last warning of the flight.
    pub(super) warning: Option<String>,
    seat: u32,
    slot: Option<Slot>,
    vehicle: Option<VehicleParameters>,
    /// Largest command: T \[N\], and torques \[N m\] or angles \[rad\].
    largest: [f64; 4],
}

impl Look {
    pub(super) fn new(slot: Slot, facts: &Facts, role: Role) -> Self {
        let beta =
            MorphAngle::saturating_from_rad(facts.morph_angle_rad).unwrap_or(MorphAngle::MIN);
        let wrench = facts.vehicle.largest_wrench(beta);
        let largest = match slot {
            Slot::Attitude => wrench,
            Slot::Position => {
                let tilt = facts.tilt_max_rad;
                [wrench[0], tilt, tilt, tilt]
            }
        };
        let seat = if role == Role::Candidate { CANDIDATE_SEAT } else { 0 };
        let flipped = role == Role::Owner;
        let vehicle = Some(facts.vehicle);
        Self { seat, slot: Some(slot), vehicle, largest, flipped, ..Self::default() }
    }

    /// True in a flight in which a candidate takes over.
    pub(super) fn has_candidate(&self) -> bool {
        self.seat == CANDIDATE_SEAT
    }

    /// Updates the largest command, since the largest torque depends on the morph angle.
    fn measure_by(&mut self, morph_angle_rad: f64) {
        let beta = MorphAngle::saturating_from_rad(morph_angle_rad);
        if let (Some(Slot::Attitude), Some(vehicle), Some(beta)) = (self.slot, &self.vehicle, beta)
        {
            self.largest = vehicle.largest_wrench(beta);
        }
    }

    fn moved(&mut self, truth: &Truth) {
        self.measure_by(truth.morph_angle_rad);
        let q = &truth.q_wb;
        self.is_over |= q.x * q.x + q.y * q.y > TUMBLED;
        self.track.moved(Motion {
            t_s: s_from_ns(truth.header.valid_ns),
            position_w_m: truth.position_w_m,
            velocity_w_m_s: truth.velocity_w_m_s,
            q_wb: q.to_array(),
            body_rate_b_rad_s: truth.body_rate_b_rad_s,
        });
    }

    fn commanded(&mut self, header: &shared_types::Header, command: [f64; 4]) {
        if self.flipped && header.seat == self.seat {
            let share = core::array::from_fn(|i| command[i] / self.largest[i]);
            self.track.commanded(s_from_ns(header.valid_ns), share);
        }
    }
}

impl Observer for Look {
    fn observe<T: Sample>(&mut self, _topic: &'static Topic<T>, sample: &T) {
        let any: &dyn Any = sample;
        if let Some(truth) = any.downcast_ref::<Truth>() {
            self.moved(truth);
        } else if let Some(reference) = any.downcast_ref::<Reference>() {
            self.track.wants(Wanted {
                t_s: s_from_ns(reference.header.valid_ns),
                position_w_m: reference.points[0].position_w_m,
                velocity_w_m_s: reference.points[0].velocity_w_m_s,
                yaw_rad: reference.points[0].yaw_rad,
            });
        } else if let Some(setpoint) = any.downcast_ref::<AppliedSetpoint>() {
            // A shadowing attitude controller reports its set point too; after the flip only that of the
            // judged controller counts.
            if self.slot != Some(Slot::Attitude)
                || !self.flipped
                || setpoint.header.seat == self.seat
            {
                let gamma = [setpoint.roll_rad, setpoint.pitch_rad, setpoint.yaw_rad];
                self.track.tracks(s_from_ns(setpoint.header.valid_ns), gamma);
            }
        } else if let Some(command) = any.downcast_ref::<WrenchCommand>() {
            if self.slot == Some(Slot::Attitude) {
                let [x, y, z] = command.torque_b_nm;
                self.commanded(&command.header, [command.thrust_n, x, y, z]);
            }
        } else if let Some(command) = any.downcast_ref::<AttitudeSetpoint>() {
            if self.slot == Some(Slot::Position) {
                let AttitudeSetpoint { thrust_n, roll_rad, pitch_rad, yaw_rad, header } = *command;
                self.commanded(&header, [thrust_n, roll_rad, pitch_rad, yaw_rad]);
            }
        } else if let Some(applied) = any.downcast_ref::<AppliedCommand>() {
            if matches!(applied.mode, GateMode::Level | GateMode::Cut) {
                self.track.unguided(s_from_ns(applied.header.valid_ns));
                self.is_over |= applied.mode == GateMode::Cut;
            }
        } else if let Some(record) = any.downcast_ref::<OwnerRecord>() {
            let own = self.slot.is_some_and(|slot| slot.role() == record.slot);
            self.flipped |= own && record.owner == self.seat && self.seat != 0;
        }
    }

    fn note(&mut self, _logical_ns: u64, warning: bool, text: &str) {
        if warning {
            self.warning = Some(text.to_owned());
        }
    }
}
