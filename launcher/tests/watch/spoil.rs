//! Bad controllers: a shipped law of which only what it says is spoiled, from the flip on.

use nalgebra::Vector3;
use shared_types::{AttitudeSetpoint, WrenchCommand};
use std::collections::VecDeque;
use vehicle::{MorphAngle, VehicleParameters};

/// What is wrong with a controller.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Spoil {
    /// Nothing.
    Good,
    /// One axis has the wrong sign.
    WrongSign(usize),
    /// Two axes are exchanged.
    Exchanged,
    /// It says what it said first.
    Frozen,
    /// No number after 0.7 s.
    NotANumber,
    /// The gain is wrong.
    Gain(f64),
    /// So many milliseconds late.
    Late(u64),
    /// A constant share of the largest command on top.
    Bias(f64),
    /// A share of the largest command on top that grows by this in a second.
    Leak(f64),
    /// The wrong sign beyond ten degrees of tilt.
    BeyondTilt,
    /// Ten times the gain once the arms are spread by more than 100 degrees.
    OnceSpread,
}

pub(crate) const CERTAIN: [Spoil; 6] = [
    Spoil::WrongSign(0),
    Spoil::WrongSign(1),
    Spoil::WrongSign(2),
    Spoil::Exchanged,
    Spoil::Frozen,
    Spoil::NotANumber,
];

pub(crate) const LIKELY: [Spoil; 11] = [
    Spoil::Gain(0.2),
    Spoil::Gain(3.0),
    Spoil::Gain(10.0),
    Spoil::Late(30),
    Spoil::Late(60),
    Spoil::Late(100),
    Spoil::Bias(0.05),
    Spoil::Bias(0.2),
    Spoil::Leak(0.1),
    Spoil::BeyondTilt,
    Spoil::OnceSpread,
];

/// What a spoiled controller knows of the flight.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Around {
    /// Since the flip \[ms\]; none before it.
    pub since_ms: Option<u64>,
    pub tilt_rad: f64,
    pub morph_angle: MorphAngle,
}

/// A spoiled output: thrust \[N\] and three more numbers.
#[derive(Debug)]
pub(crate) struct Spoiler {
    spoil: Spoil,
    frozen: Option<[f64; 4]>,
    late: VecDeque<(u64, [f64; 4])>,
}

impl Spoiler {
    pub(crate) fn new(spoil: Spoil) -> Self {
        Self { spoil, frozen: None, late: VecDeque::new() }
    }

    /// `trim` is what a controller at rest says, `largest` what may be added to it.
    fn spoil(
        &mut self,
        at_ms: u64,
        said: [f64; 4],
        around: &Around,
        trim: f64,
        largest: [f64; 4],
    ) -> [f64; 4] {
        self.late.push_back((at_ms, said));
        let Some(since_ms) = around.since_ms else { return said };
        let since_s = since_ms as f64 * 1e-3;
        let [thrust, x, y, z] = said;
        let times = |k: f64| [trim + k.min(2.0) * (thrust - trim), k * x, k * y, k * z];
        match self.spoil {
            Spoil::Good => said,
            Spoil::WrongSign(axis) => {
                let mut said = said;
                said[axis + 1] = -said[axis + 1];
                said
            }
            Spoil::Exchanged => [thrust, y, x, z],
            Spoil::Frozen => *self.frozen.get_or_insert(said),
            Spoil::NotANumber if since_s > 0.7 => [f64::NAN; 4],
            Spoil::Gain(k) => times(k),
            Spoil::Late(ms) => {
                while self.late.get(1).is_some_and(|(then, _)| then + ms <= at_ms) {
                    self.late.pop_front();
                }
                self.late.front().map_or(said, |(_, then)| *then)
            }
            Spoil::Bias(share) => [thrust, x + share * largest[1], y, z],
            Spoil::Leak(share) => [thrust, x + share * since_s * largest[1], y, z],
            Spoil::BeyondTilt if around.tilt_rad > 10.0_f64.to_radians() => [thrust, -x, -y, z],
            Spoil::OnceSpread if around.morph_angle.degrees() > 100.0 => times(-1.0),
            _ => said,
        }
    }

    pub(crate) fn wrench(
        &mut self,
        at_ms: u64,
        said: WrenchCommand,
        around: &Around,
    ) -> WrenchCommand {
        let vehicle = VehicleParameters::default();
        let [x, y, z] = said.torque_b_nm;
        let largest = vehicle.largest_wrench(around.morph_angle);
        let spoilt = self.spoil(at_ms, [said.thrust_n, x, y, z], around, said.thrust_n, largest);
        let torque: Vector3<f64> = Vector3::new(spoilt[1], spoilt[2], spoilt[3]);
        // Whoever asks for more than rotors can ever give is refused, which is another matter.
        let most = Vector3::new(largest[1], largest[2], largest[3]) * 1.9;
        let within = |v: f64, most: f64| if v.is_nan() { v } else { v.clamp(-most, most) };
        let torque = torque.zip_map(&most, within);
        WrenchCommand { thrust_n: spoilt[0], torque_b_nm: torque.into(), ..said }
    }

    pub(crate) fn setpoint(
        &mut self,
        at_ms: u64,
        said: AttitudeSetpoint,
        around: &Around,
    ) -> AttitudeSetpoint {
        let weight = VehicleParameters::default().weight_n();
        let asked = [said.thrust_n, said.roll_rad, said.pitch_rad, said.yaw_rad];
        let mut spoilt = self.spoil(at_ms, asked, around, weight, [weight, 0.35, 0.35, 0.0]);
        if self.spoil == Spoil::WrongSign(2) && around.since_ms.is_some() {
            spoilt = [2.0 * weight - said.thrust_n, said.roll_rad, said.pitch_rad, said.yaw_rad];
        } else if self.spoil != Spoil::NotANumber {
            spoilt[3] = said.yaw_rad;
        }
        let [thrust_n, roll_rad, pitch_rad, yaw_rad] = spoilt;
        AttitudeSetpoint { thrust_n: thrust_n.max(0.0), roll_rad, pitch_rad, yaw_rad, ..said }
    }
}
