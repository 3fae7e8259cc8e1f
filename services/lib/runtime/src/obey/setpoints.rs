//! The position slot's consumer, and what its owner reads back from the attitude slot.

use super::{Obedience, ObedienceMemory};
use crate::input::Input;
use crate::ownership::Standing;
use shared_types::{AppliedSetpoint, AttitudeSetpoint, Flag, OwnerRecord};
use slot::{Command, Standing as Seated};

/// A change of kind may step the tilt at once by 10 % of this bound of the position loops \[rad\].
const TILT_BOUND_RAD: f64 = 0.35;
/// Share of a bound by which a change of kind may step at once.
const STEP_SHARE: f64 = 0.1;

shared_types::memory! {
    /// A [`SetpointSlot`] as plain numbers.
    #[derive(PartialEq)]
    pub struct SetpointMemory {
        /// Whose set point counts.
        pub obedience: ObedienceMemory,
        /// Set points refused because they are not finite.
        pub refused: u64,
    }
}

/// Whose attitude set point counts, at whoever tracks it.
#[derive(Debug, Clone, PartialEq)]
pub struct SetpointSlot {
    obedience: Obedience,
    refused: u64,
    limit: [f64; 4],
}

impl SetpointSlot {
    /// Obeys nobody yet; `weight_n` is the vehicle's.
    #[must_use]
    pub fn new(weight_n: f64) -> Self {
        let tilt = STEP_SHARE * TILT_BOUND_RAD;
        // The heading comes from the reference whoever owns the slot, and it wraps: never limited.
        let limit = [STEP_SHARE * weight_n, tilt, tilt, f64::INFINITY];
        Self { obedience: Obedience::new(), refused: 0, limit }
    }

    /// The set point to track at `now_ns`, its value T \[N\], φ, θ, ψ \[rad\]; `None` if nobody's is
    /// valid, which is for two control periods of its writer.
    pub fn take(
        &mut self,
        now_ns: u64,
        records: &Input<OwnerRecord>,
        setpoints: &Input<AttitudeSetpoint>,
    ) -> Option<Command> {
        let joins = self.obedience.consumer.record().is_none();
        self.obedience.hear(records);
        if joins && let Some(known) = setpoints.before_fresh() {
            // In effect since before this controller began.
            self.obedience.advance(known.header.valid_ns);
            self.offer(known);
        }
        let at_once =
            |a: &AttitudeSetpoint, b: &AttitudeSetpoint| a.header.valid_ns == b.header.valid_ns;
        for samples in setpoints.fresh().chunk_by(at_once) {
            let Some(first) = samples.first() else { continue };
            // A late one counts from the last decision on, which stays as it was.
            let at_ns = first.header.valid_ns.max(self.obedience.consumer.open_ns());
            self.obedience.advance(at_ns);
            for sample in samples {
                self.offer(sample);
            }
            if at_ns < now_ns {
                self.obedience.decide(at_ns, &self.limit);
            }
        }
        self.obedience.advance(now_ns);
        self.obedience.decide(now_ns, &self.limit).map(|order| order.command)
    }

    fn offer(&mut self, sample: &AttitudeSetpoint) {
        let standing = self.obedience.standing_of(&sample.header);
        if !matches!(standing, Seated::Owner | Seated::Fallback) {
            return;
        }
        let value = [sample.thrust_n, sample.roll_rad, sample.pitch_rad, sample.yaw_rad];
        if value.iter().all(|v| v.is_finite()) {
            let validity_ns = self.obedience.two_periods_ns(&sample.header);
            self.obedience.offer(&sample.header, value, validity_ns);
        } else {
            self.refused += 1;
        }
    }

    /// A sample that tells who commands; the set point itself is the caller's to fill in.
    #[must_use]
    pub fn applied(&self) -> AppliedSetpoint {
        AppliedSetpoint {
            epoch: self.obedience.epoch(),
            refused_epoch: self.obedience.counters().refused_epoch,
            seat: self.obedience.seat(),
            failed_over: Flag::from(self.obedience.failed_over()),
            ..AppliedSetpoint::default()
        }
    }

    /// Set points refused because they are not finite.
    #[must_use]
    pub fn refused(&self) -> u64 {
        self.refused
    }

    /// Everything that evolves.
    #[must_use]
    pub fn memory(&self) -> SetpointMemory {
        SetpointMemory { obedience: self.obedience.memory(), refused: self.refused }
    }

    /// Continues from a memory, bit for bit.
    pub fn restore(&mut self, memory: &SetpointMemory) {
        self.obedience.restore(&memory.obedience);
        self.refused = memory.refused;
    }
}

impl Input<AppliedSetpoint> {
    /// The newest of this step that the attitude slot's owner has said; the fallback's if the owner
    /// says nothing any more. Shadows say what they track too.
    #[must_use]
    pub fn in_command(&self, records: &Input<OwnerRecord>) -> Option<&AppliedSetpoint> {
        let newest = |standing| {
            self.fresh().iter().rev().find(|s| records.standing_of(&s.header) == standing)
        };
        newest(Standing::Owner).or_else(|| newest(Standing::Fallback))
    }
}
