//! Applies a fault to the candidate's commands in a flight within one process.

use crate::{Seen, Spoiler};
use observe::Observer;
use shared_types::{AttitudeSetpoint, Sample, Slot, StateEstimate, Topic, WrenchCommand};
use std::any::Any;

/// Process slot of a swap candidate in a flight of two.
const CANDIDATE_SEAT: u32 = 1;

/// An observer that alters what the candidate's process slot publishes.
#[derive(Debug, Default)]
pub struct Altering {
    spoiler: Option<(Slot, Spoiler)>,
    seen: Seen,
}

impl Altering {
    /// Applies `spoiler` to the commands of the candidate for `slot`.
    #[must_use]
    pub fn new(slot: Slot, spoiler: Spoiler) -> Self {
        Self { spoiler: Some((slot, spoiler)), seen: Seen::default() }
    }
}

impl Observer for Altering {
    fn observe<T: Sample>(&mut self, _topic: &'static Topic<T>, sample: &T) {
        if let Some(estimate) = (sample as &dyn Any).downcast_ref::<StateEstimate>() {
            self.seen = Seen::from(estimate);
        }
    }

    fn alter<T: Sample>(&mut self, _topic: &'static Topic<T>, sample: &mut T) {
        let Some((slot, spoiler)) = &mut self.spoiler else { return };
        let header = *sample.header();
        if header.seat != CANDIDATE_SEAT {
            return;
        }
        let any: &mut dyn Any = sample;
        match slot {
            Slot::Attitude => {
                if let Some(command) = any.downcast_mut::<WrenchCommand>() {
                    spoil_wrench(spoiler, header.release_ns, command, self.seen);
                }
            }
            Slot::Position => {
                if let Some(command) = any.downcast_mut::<AttitudeSetpoint>() {
                    spoil_setpoint(spoiler, header.release_ns, command, self.seen);
                }
            }
        }
    }
}

pub(crate) fn spoil_wrench(
    spoiler: &mut Spoiler,
    now_ns: u64,
    command: &mut WrenchCommand,
    seen: Seen,
) {
    let [x, y, z] = command.torque_b_nm;
    let [thrust_n, x, y, z] = spoiler.spoil(now_ns, [command.thrust_n, x, y, z], seen);
    command.thrust_n = thrust_n;
    command.torque_b_nm = [x, y, z];
}

pub(crate) fn spoil_setpoint(
    spoiler: &mut Spoiler,
    now_ns: u64,
    command: &mut AttitudeSetpoint,
    seen: Seen,
) {
    let good = [command.thrust_n, command.roll_rad, command.pitch_rad, command.yaw_rad];
    [command.thrust_n, command.roll_rad, command.pitch_rad, command.yaw_rad] =
        spoiler.spoil(now_ns, good, seen);
}
