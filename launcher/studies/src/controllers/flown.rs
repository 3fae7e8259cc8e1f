//! What is measured in one flight.

use super::{Case, ControllersError, Kind, PULSE_AT_S, PUSH_S};
use ::verdict::Grade;
use nalgebra::Vector3;
use observe::Observer;
use observe::{Closing, Metrics};
use runtime::clock::mono_now_ns;
use scenario::Scenario;
use shared_types::{Role, Sample, Topic, Truth};
use simulate::in_process::{InProcess, StateSource};
use std::any::Any;
use vehicle::{euler_from_quaternion, rotation, wrap_pi};

/// Within this of where it should be a pushed vehicle has recovered \[m\].
const RECOVERED_M: f64 = 0.1;
/// The same for a vehicle that was turned \[rad\].
const RECOVERED_RAD: f64 = 0.02;

/// One flight in numbers; what it is not about is zero or none.
#[derive(Debug, Clone, Default)]
pub(super) struct Flown {
    pub(super) rms_m: f64,
    pub(super) max_m: f64,
    /// Roll or pitch, and yaw.
    pub(super) settling_s: [Option<f64>; 2],
    pub(super) peak_rad: f64,
    pub(super) deviation_rad: f64,
    pub(super) recovery_s: Option<f64>,
    pub(super) violations: u64,
    pub(super) clipped_share: f64,
    pub(super) lost: bool,
    /// Attitude and position loop.
    pub(super) step_ns: [u64; 2],
}

/// Where the vehicle really was.
#[derive(Default)]
struct Path(Vec<(f64, Vector3<f64>, Vector3<f64>)>);

impl Observer for Path {
    fn observe<T: Sample>(&mut self, _topic: &'static Topic<T>, sample: &T) {
        let any: &dyn Any = sample;
        if let Some(truth) = any.downcast_ref::<Truth>() {
            let q = rotation(truth.q_wb.to_array());
            let t_s = truth.header.valid_ns as f64 * 1e-9;
            self.0.push((t_s, truth.position_w_m.into(), euler_from_quaternion(&q)));
        }
    }
}

impl Path {
    /// Largest deviation after `from_s`, and how long after `over_s` the last one beyond `limit` is;
    /// none if that is the last instant of the flight.
    fn upset(
        &self,
        from_s: f64,
        over_s: f64,
        limit: f64,
        deviation: impl Fn(&Vector3<f64>, &Vector3<f64>) -> f64,
    ) -> (f64, Option<f64>) {
        let after = self.0.iter().filter(|(t_s, ..)| *t_s >= from_s);
        let (mut worst, mut last_s, mut end_s) = (0.0_f64, over_s, 0.0);
        for (t_s, position, gamma) in after {
            let away = deviation(position, gamma);
            worst = worst.max(away);
            end_s = *t_s;
            if away > limit {
                last_s = last_s.max(*t_s);
            }
        }
        (worst, (last_s < end_s).then_some(last_s - over_s))
    }

    /// Where it was just before `t_s`.
    fn at(&self, t_s: f64) -> (Vector3<f64>, Vector3<f64>) {
        let before = self.0.iter().rfind(|(at_s, ..)| *at_s < t_s);
        before.map_or((Vector3::zeros(), Vector3::zeros()), |(_, p, gamma)| (*p, *gamma))
    }
}

/// Flies one flight and measures it.
pub(super) fn fly_one(scenario: &Scenario, case: &Case) -> Result<Flown, ControllersError> {
    let seen = (Metrics::of(scenario), Path::default());
    let mut flight = InProcess::new(scenario, StateSource::Estimator, seen)?;
    flight.stamp_by(mono_now_ns);
    flight.fly_until(u64::MAX)?;
    let (mut metrics, path) = flight.seen(core::mem::take);
    metrics.finish();
    let loops = metrics.loops();
    let median = |role: Role| {
        let times = loops.iter().find(|of| of.role == role).and_then(|of| metrics.compute(of));
        times.map_or(0, |times| times.value_at_quantile(0.5))
    };
    let mut flown = Flown {
        violations: metrics.violations(),
        clipped_share: metrics.clipped_share(),
        lost: metrics.judge(&Closing::default()).grade() >= Grade::Lost,
        step_ns: [median(Role::Attitude), median(Role::Position)],
        ..Flown::default()
    };
    match case.kind {
        Kind::Figure { .. } => {
            let tracking = metrics.tracking();
            (flown.rms_m, flown.max_m) = (tracking.rms_m, tracking.max_m);
        }
        Kind::Push => {
            let [from_s, to_s] = PUSH_S;
            let (start, _) = path.at(from_s);
            let away = |position: &Vector3<f64>, _: &Vector3<f64>| (position - start).norm();
            (flown.max_m, flown.recovery_s) = path.upset(from_s, to_s, RECOVERED_M, away);
        }
        Kind::Step { .. } => {
            let [roll, pitch, yaw] = metrics
                .step_response()
                .unwrap_or_else(|| unreachable!("the rig of the step writes set points"));
            let tilt_s = roll.settling_s.zip(pitch.settling_s).map(|(a, b)| a.max(b));
            flown.settling_s = [tilt_s, yaw.settling_s];
            flown.peak_rad =
                [roll, pitch, yaw].iter().map(|axis| axis.peak_rad).fold(0.0, f64::max);
        }
        Kind::Pulse { .. } => {
            let (_, start) = path.at(PULSE_AT_S);
            let turned =
                |_: &Vector3<f64>, gamma: &Vector3<f64>| (gamma - start).map(wrap_pi).amax();
            (flown.deviation_rad, flown.recovery_s) =
                path.upset(PULSE_AT_S, PULSE_AT_S, RECOVERED_RAD, turned);
        }
    }
    Ok(flown)
}
