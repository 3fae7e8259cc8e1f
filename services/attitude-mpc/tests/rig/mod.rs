//! A noise-free flight of the nonlinear vehicle: 1 ms plant, rotor lag, allocation with clipping,
//! commands in effect `DELAY_NS` after their release, measurements of the last whole millisecond.
#![allow(dead_code, reason = "each test file uses its own part of the rig")]

use std::collections::VecDeque;

use attitude_mpc::{AttitudeLaw, Input, LawStatus, Output, Setpoint};
use nalgebra::Vector3;
use vehicle::{
    Actuation, Disturbance, MorphAngle, NonlinearModel, PlantInputs, PlantModel, RigidBodyState,
    StepStatus, VehicleParameters, Wrench, euler_from_quaternion,
};

pub(crate) const MS: u64 = 1_000_000;
pub(crate) const SIZES: [MorphAngle; 3] = [MorphAngle::MIN, MorphAngle::MEDIUM, MorphAngle::MAX];

/// Whole nanoseconds of a time \[s\].
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 20 s here")]
pub(crate) fn nanoseconds(seconds: f64) -> u64 {
    (seconds * 1e9 + 1e-3) as u64
}

/// Release k of a loop, in integer nanoseconds.
pub(crate) fn release_ns(k: u64, rate_hz: f64) -> u64 {
    nanoseconds(k as f64 / rate_hz)
}

/// The vehicle with its command edge.
pub(crate) struct Flight {
    pub(crate) plant: NonlinearModel,
    pub(crate) disturbance: Disturbance,
    pub(crate) morph_command: MorphAngle,
    pub(crate) delay_ns: u64,
    now_ns: u64,
    in_effect: Wrench,
    pending: VecDeque<(u64, Wrench)>,
    /// State at the last whole millisecond, and the torque allocated in the tick before it.
    sampled: (RigidBodyState, Vector3<f64>),
}

impl Flight {
    pub(crate) fn hover(vehicle: VehicleParameters, beta: MorphAngle) -> Self {
        let state = RigidBodyState::hover(&vehicle, Vector3::zeros(), beta);
        Self {
            plant: NonlinearModel::new(vehicle, None, state).unwrap(),
            disturbance: Disturbance::default(),
            morph_command: beta,
            delay_ns: MS,
            now_ns: 0,
            in_effect: Wrench::thrust(vehicle.weight_n()),
            pending: VecDeque::new(),
            sampled: (state, Vector3::zeros()),
        }
    }

    pub(crate) fn command(&mut self, wrench: Wrench) {
        self.pending.push_back((self.now_ns + self.delay_ns, wrench));
    }

    pub(crate) fn sampled(&self) -> (RigidBodyState, Vector3<f64>) {
        self.sampled
    }

    /// Integrates to `until_ns`, split at whole milliseconds and at effective instants.
    pub(crate) fn advance(&mut self, until_ns: u64) {
        while self.now_ns < until_ns {
            while self.pending.front().is_some_and(|(at, _)| *at <= self.now_ns) {
                self.in_effect = self.pending.pop_front().unwrap().1;
            }
            let tick = (self.now_ns / MS + 1) * MS;
            let next = self.pending.front().map_or(tick, |(at, _)| tick.min(*at)).min(until_ns);
            let inputs = PlantInputs {
                actuation: Actuation::Wrench(self.in_effect),
                morph_command_rad: self.morph_command.rad(),
                disturbance: self.disturbance,
            };
            let beta = self.plant.state().beta;
            let status = self.plant.step((next - self.now_ns) as f64 * 1e-9, &inputs);
            assert_eq!(status, StepStatus::Advanced);
            self.now_ns = next;
            if next.is_multiple_of(MS) {
                let allocated = self.plant.parameters().allocator(beta).allocate(&self.in_effect);
                self.sampled = (*self.plant.state(), allocated.unwrap().achieved.torque_b_nm);
            }
        }
    }
}

/// γ after every control step of an attitude flight, with the law's outputs.
pub(crate) struct Trace {
    pub(crate) t_s: Vec<f64>,
    pub(crate) gamma: Vec<Vector3<f64>>,
    pub(crate) outputs: Vec<Output>,
}

/// Flies `law` on the setpoints of `setpoint(t)` (seconds) and records γ each millisecond.
pub(crate) fn fly(
    flight: &mut Flight,
    law: &mut AttitudeLaw,
    rate_hz: f64,
    seconds: f64,
    mut setpoint: impl FnMut(f64, &mut Flight) -> Setpoint,
) -> Trace {
    let mut trace = Trace { t_s: vec![], gamma: vec![], outputs: vec![] };
    let mut k = 0;
    let end = nanoseconds(seconds);
    let mut tick = 0;
    while tick * MS < end {
        let release = release_ns(k, rate_hz);
        if release < (tick + 1) * MS {
            flight.advance(release);
            let setpoint = setpoint(release as f64 * 1e-9, flight);
            let (state, applied) = flight.sampled();
            let output = law.step(&Input {
                gamma_rad: euler_from_quaternion(&state.q_wb),
                body_rate_rad_s: state.omega_b,
                age_s: (release % MS) as f64 * 1e-9,
                morph_angle: state.beta,
                setpoint,
                applied_torque_nm: Some(applied),
            });
            assert_eq!(output.status, LawStatus::Solved);
            assert!(output.violation_nm <= 1e-9, "{output:?}");
            flight.command(Wrench { thrust_n: output.thrust_n, torque_b_nm: output.torque_nm });
            trace.outputs.push(output);
            k += 1;
            continue;
        }
        tick += 1;
        flight.advance(tick * MS);
        trace.t_s.push(tick as f64 * 1e-3);
        trace.gamma.push(euler_from_quaternion(&flight.sampled().0.q_wb));
    }
    trace
}

/// Last instant outside ±0.004 rad of `target` on `axis`, after `from_s`, relative to it.
pub(crate) fn settling(trace: &Trace, axis: usize, target: f64, from_s: f64) -> f64 {
    let outside = |i: &usize| (trace.gamma[*i][axis] - target).abs() > 0.004;
    let last = (0..trace.t_s.len()).rev().find(outside);
    last.map_or(0.0, |i| (trace.t_s[i] - from_s).max(0.0))
}

pub(crate) fn peak(trace: &Trace, axis: usize) -> f64 {
    trace.gamma.iter().map(|gamma| gamma[axis]).fold(f64::MIN, f64::max)
}
