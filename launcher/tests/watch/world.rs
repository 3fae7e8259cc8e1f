//! A flight in one thread: plant with gate, estimator, an owner that is watched and the one before it in
//! one of the slots, the other slot's owner, and the monitor. Everything is the code that flies; only who
//! is told what, and when, is done by hand.

use crate::course::{Course, course_at, gust_at, morph_at};
use crate::spoil::{Around, Spoil, Spoiler};
use attitude_lqr::{AttitudeLqr, LqrLaw};
use attitude_mpc::AttitudeMpc;
use attitude_pid::{AttitudePid, PidLaw, Timing};
use controller::attitude as att;
use controller::position as pos;
use estimator::Estimator;
use monitor::{Limits, Monitor, MonitorConfig};
use nalgebra::{UnitQuaternion, Vector3};
use plant::gate::GateConfig;
use plant::sensors::{ImuConfig, MorphEncoderConfig, PoseFixConfig};
use plant::{ModelKind, Motion, Plant, PlantConfig};
use position_mpc::{Landing, PositionMpc};
use position_pid::PositionPid;
use runtime::graph::Edge;
use runtime::{InputSet, Output, Service, Source};
use shared_types::{
    AppliedCommand, AttitudeSetpoint, Disturbance, Flag, GateMode, Header, MorphCommand, NO_SEAT,
    OwnerRecord, Reference, Role, Sample, Trip, TripCause, Truth, WrenchCommand, topics,
};
use vehicle::{MorphAngle, VehicleParameters};

pub(crate) const MS: u64 = 1_000_000;
/// The watched owner commands from here on \[ms\].
pub(crate) const FLIP_MS: u64 = 1_500;
const END_MS: u64 = 12_000;

/// A slot with a pair of controllers: who flies first, and who is watched.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Case {
    pub slot: Role,
    pub course: Course,
    pub seed: u64,
    pub spoil: Spoil,
    /// Laws of the owner before, and of the watched one.
    pub laws: [usize; 2],
    pub with_fallback: bool,
    /// Trips at this instant and not when the monitor says so \[ms\].
    pub trip_at_ms: Option<u64>,
}

/// How it ended.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Outcome {
    /// Effective instant of the first trip \[ms\], and why.
    pub trip: Option<(f64, TripCause)>,
    pub tilt_rad: f64,
    pub error_m: f64,
    pub last_error_m: f64,
    pub on_ground_ms: Option<u64>,
    pub was_cut: bool,
    pub recovering_ms: u64,
    pub failed_over: bool,
}

impl Outcome {
    /// The vehicle has not been lost: no ground, rotors never cut, and it follows its reference again.
    pub(crate) fn is_safe(&self) -> bool {
        self.on_ground_ms.is_none() && !self.was_cut && self.last_error_m < 0.35
    }
}

trait Seat<I, O> {
    fn fly(&mut self, now_ns: u64, inputs: &I, outputs: &mut O);
}

impl<S: Service> Seat<S::Inputs, S::Outputs> for S {
    fn fly(&mut self, now_ns: u64, inputs: &S::Inputs, outputs: &mut S::Outputs) {
        if self.is_displaced(inputs) {
            self.track(now_ns, inputs);
        }
        self.step(now_ns, inputs, outputs);
    }
}

struct Silent;

impl<T> Source<T> for Silent {
    fn receive(&mut self) -> Option<T> {
        None
    }
}

/// What a step says on an output, stamped.
fn take<T: Sample>(output: &mut Output<T>, header: Header, latency_ns: u64) -> Option<T> {
    let mut said = *output.written()?;
    output.flush(&Header::default());
    let (sequence, valid_ns) = (output.sequence(), header.release_ns + latency_ns);
    *said.header_mut() = Header { sequence, valid_ns, ..header };
    Some(said)
}

fn attitude_law(index: usize) -> Box<dyn Seat<att::Inputs, att::Outputs>> {
    let vehicle = VehicleParameters::default();
    let timing = Timing {
        period_s: 0.01,
        latency_s: 0.001,
        report_s: 0.001,
        rotor_lag_s: vehicle.rotor_lag_s,
    };
    match index {
        0 => {
            let around = attitude_mpc::settings::Surroundings {
                rotor_lag_s: vehicle.rotor_lag_s,
                wrench_latency_s: 0.001,
                report_period_s: 0.001,
                setpoint_period_s: 0.02,
            };
            let config = attitude_mpc::settings::Settings::default().law_config(around).unwrap();
            Box::new(AttitudeMpc::new(config, &vehicle, 0.0).unwrap())
        }
        1 => {
            let config = attitude_lqr::settings::Settings::default().law_config(timing);
            let law = LqrLaw::new(config, &vehicle).unwrap();
            Box::new(AttitudeLqr::new(law, &vehicle, timing, 0.0))
        }
        _ => {
            let config = attitude_pid::settings::Settings::default().law_config(timing);
            Box::new(AttitudePid::new(PidLaw::new(config).unwrap(), &vehicle, timing, 0.0))
        }
    }
}

fn position_law(index: usize) -> Box<dyn Seat<pos::Inputs, pos::Outputs>> {
    let vehicle = VehicleParameters::default();
    let mpc = position_mpc::settings::Settings::default();
    let mpc = mpc.law_config(vehicle.rotor_lag_s).unwrap();
    if index == 0 {
        return Box::new(PositionMpc::new(mpc, &vehicle, Landing::default()).unwrap());
    }
    let shared = position_pid::settings::Shared {
        rate_hz: mpc.rate_hz,
        tilt_max_rad: mpc.tilt_max_rad,
        tilt_step_max_rad: mpc.tilt_step_max_rad,
        thrust_weights: [mpc.thrust_min_weights, mpc.thrust_max_weights],
        thrust_step_max_weights: mpc.thrust_step_max_weights,
    };
    let config = position_pid::settings::Settings::default().law_config(&shared);
    Box::new(PositionPid::new(config, &vehicle, Landing::default()).unwrap())
}

/// Flies a case to its end, or until the vehicle is lost.
pub(crate) fn fly(case: &Case, limits: Limits) -> Outcome {
    let vehicle = VehicleParameters::default();
    let (course, seed) = (case.course, case.seed);
    let mut plant = Plant::new(&PlantConfig {
        vehicle,
        model: ModelKind::Nonlinear { ground: true },
        imu: ImuConfig::default(),
        pose_fix: PoseFixConfig::default(),
        morph_encoder: MorphEncoderConfig::default(),
        gate: GateConfig::default(),
        position_w_m: Vector3::new(0.0, 0.0, 1.5),
        yaw_rad: 0.0,
        morph_angle: MorphAngle::MIN,
        motion: Motion::default(),
        seed,
    })
    .unwrap();
    let settings = estimator::settings::Settings::default();
    let initial = settings.initial_state([0.0, 0.0, 1.5], 0.0, MorphAngle::MIN.rad());
    let config = settings.filter_config(vehicle.gravity_m_s2, 1000.0).unwrap();
    let mut filter = Estimator::new(config, &initial).unwrap();
    let config =
        MonitorConfig { limits, period_s: 0.01, latency_s: 0.001, landing: Landing::default() };
    let mut judge = Monitor::new(&config, &vehicle);
    let attitude_watched = case.slot == Role::Attitude;
    let (mut attitude, mut position) = if attitude_watched {
        (case.laws.map(attitude_law).into_iter().collect::<Vec<_>>(), vec![position_law(0)])
    } else {
        (vec![attitude_law(0)], case.laws.map(position_law).into_iter().collect())
    };
    let mut spoiler = Spoiler::new(case.spoil);

    let mut plant_in = plant::ports::Inputs::default();
    let mut plant_out = plant::ports::Outputs::default();
    let edge = |topic| Some(Edge::unwaited(topic, Role::Plant));
    plant_in.wrench_command.connect(Box::new(Silent), edge(&topics::WRENCH_COMMAND.info));
    plant_in.attitude_owner.connect(Box::new(Silent), edge(&topics::ATTITUDE_OWNER.info));
    plant_in.disturbance.connect(Box::new(Silent), edge(&topics::DISTURBANCE.info));
    plant_in.morph_command.connect(Box::new(Silent), edge(&topics::MORPH_COMMAND.info));
    plant_in.trip.connect(Box::new(Silent), edge(&topics::TRIP.info));
    let mut filter_in = estimator::component::Inputs::default();
    let mut filter_out = estimator::component::Outputs::default();
    let mut judge_in = monitor::component::Inputs::default();
    let mut judge_out = monitor::component::Outputs::default();
    let mut attitude_io: Vec<(att::Inputs, att::Outputs)> =
        attitude.iter().map(|_| Default::default()).collect();
    let mut position_io: Vec<(pos::Inputs, pos::Outputs)> =
        position.iter().map(|_| Default::default()).collect();

    for slot in [Role::Attitude, Role::Position] {
        let watched = slot == case.slot;
        let period_ns = if slot == Role::Attitude { 10 * MS } else { 20 * MS };
        let first = OwnerRecord {
            header: Header { sequence: 1, ..Header::default() },
            epoch: 1,
            period_ns: [period_ns, if watched { period_ns } else { 0 }, 0, 0],
            fallback: NO_SEAT,
            slot,
            ..OwnerRecord::default()
        };
        let second = OwnerRecord {
            header: Header { sequence: 2, valid_ns: FLIP_MS * MS, ..Header::default() },
            epoch: 2,
            owner: 1,
            fallback: if case.with_fallback { 0 } else { NO_SEAT },
            kind_changed: Flag::Yes,
            watched: Flag::Yes,
            ..first
        };
        for record in [Some(first), watched.then_some(second)].into_iter().flatten() {
            if slot == Role::Attitude {
                plant_in.attitude_owner.offer(record);
                judge_in.attitude_owner.offer(record);
                position_io.iter_mut().for_each(|(inputs, _)| inputs.attitude_owner.offer(record));
            } else {
                judge_in.position_owner.offer(record);
                attitude_io.iter_mut().for_each(|(inputs, _)| inputs.position_owner.offer(record));
            }
        }
    }

    let mut outcome = Outcome::default();
    let mut truth = Truth::default();
    for t in 0..END_MS {
        let now = t * MS;
        let before = now.checked_sub(MS);
        let t_s = t as f64 * 1e-3;
        let header = Header { release_ns: now, ..Header::default() };
        if t % 10 == 0 {
            let stamped = Header { sequence: t / 10 + 1, valid_ns: now, ..header };
            let mut path_rad = [0.0; 48];
            for (k, angle) in path_rad.iter_mut().enumerate() {
                *angle = morph_at(course, t_s + k as f64 * 0.01);
            }
            let morph = MorphCommand {
                header: stamped,
                angle_rad: path_rad[0],
                spacing_ns: 10 * MS,
                count: 48,
                path_rad,
            };
            plant_in.morph_command.offer(morph);
            attitude_io.iter_mut().for_each(|(inputs, _)| inputs.morph_command.offer(morph));
            position_io.iter_mut().for_each(|(inputs, _)| inputs.morph_command.offer(morph));
            plant_in.disturbance.offer(Disturbance {
                header: stamped,
                force_w_n: gust_at(course, t_s, seed),
                rotor_efficiency: [1.0; 4],
                ..Disturbance::default()
            });
        }
        if t % 20 == 0 {
            let stamped = Header { sequence: t / 20 + 1, valid_ns: now, ..header };
            let mut reference =
                Reference { header: stamped, spacing_ns: 20 * MS, count: 48, ..Default::default() };
            for (k, point) in reference.points.iter_mut().enumerate() {
                let [place, speed] = course_at(course, t_s + k as f64 * 0.02);
                (point.position_w_m, point.velocity_w_m_s) = (place.into(), speed.into());
            }
            judge_in.reference.offer(reference);
            position_io.iter_mut().for_each(|(inputs, _)| inputs.reference.offer(reference));
        }

        plant_in.accept(now, before);
        plant.step(now, &plant_in, &mut plant_out);
        let said: AppliedCommand = take(&mut plant_out.applied_command, header, 0).unwrap();
        judge_in.applied_command.offer(said);
        attitude_io.iter_mut().for_each(|(inputs, _)| inputs.applied_command.offer(said));
        if let Some(imu) = take(&mut plant_out.imu, header, 0) {
            filter_in.imu.offer(imu);
        }
        if let Some(fix) = take(&mut plant_out.pose_fix, header, 0) {
            filter_in.pose_fix.offer(fix);
        }
        if let Some(angle) = take(&mut plant_out.morph_angle, header, 0) {
            filter_in.morph_angle.offer(angle);
        }
        truth = take(&mut plant_out.truth, header, 0).unwrap_or(truth);
        let _ = take(&mut plant_out.actuator_state, header, 0);

        filter_in.accept(now, before);
        filter.step(now, &filter_in, &mut filter_out);
        let estimate = take(&mut filter_out.state_estimate, header, 0).unwrap();
        judge_in.state_estimate.offer(estimate);
        attitude_io.iter_mut().for_each(|(inputs, _)| inputs.state_estimate.offer(estimate));
        position_io.iter_mut().for_each(|(inputs, _)| inputs.state_estimate.offer(estimate));

        let q = &truth.q_wb;
        let q_wb = UnitQuaternion::new_unchecked(nalgebra::Quaternion::new(q.w, q.x, q.y, q.z));
        let tilt_rad = (q_wb * Vector3::z()).angle(&Vector3::z());
        let morph_angle = MorphAngle::saturating_from_rad(truth.morph_angle_rad).unwrap();
        let around = Around { since_ms: t.checked_sub(FLIP_MS), tilt_rad, morph_angle };

        let ticks = t.checked_sub(20).map(|t| t * MS);
        if t % 20 == 0 {
            let mut all: Vec<AttitudeSetpoint> = Vec::new();
            for (seat, (law, (inputs, outputs))) in
                position.iter_mut().zip(&mut position_io).enumerate()
            {
                inputs.accept(now, ticks);
                law.fly(now, inputs, outputs);
                let header = Header { seat: u32::try_from(seat).unwrap(), ..header };
                if let Some(said) = take(&mut outputs.attitude_setpoint, header, MS) {
                    let spoils = seat == 1;
                    all.push(if spoils { spoiler.setpoint(t, said, &around) } else { said });
                }
                let _ = take(&mut outputs.position_report, header, 0);
            }
            for said in all {
                attitude_io.iter_mut().for_each(|(inputs, _)| inputs.attitude_setpoint.offer(said));
            }
        }
        if t % 10 == 0 {
            let ticks = t.checked_sub(10).map(|t| t * MS);
            let mut all: Vec<WrenchCommand> = Vec::new();
            let mut tracked = Vec::new();
            for (seat, (law, (inputs, outputs))) in
                attitude.iter_mut().zip(&mut attitude_io).enumerate()
            {
                inputs.accept(now, ticks);
                law.fly(now, inputs, outputs);
                let header = Header { seat: u32::try_from(seat).unwrap(), ..header };
                if let Some(said) = take(&mut outputs.wrench_command, header, MS) {
                    let spoils = seat == 1;
                    all.push(if spoils { spoiler.wrench(t, said, &around) } else { said });
                }
                tracked.extend(take(&mut outputs.applied_setpoint, header, MS));
                let _ = take(&mut outputs.attitude_report, header, 0);
            }
            judge_in.accept(now, ticks);
            judge.step(now, &judge_in, &mut judge_out);
            let said: Option<Trip> = take(&mut judge_out.trip, header, MS);
            let forced = case.trip_at_ms.filter(|at| *at == t).map(|_| Trip {
                header: Header { sequence: 1, valid_ns: now + MS, ..header },
                epoch: 2,
                slot: case.slot,
                instance: 1,
                ..Trip::default()
            });
            if let Some(trip) = if case.trip_at_ms.is_some() { forced } else { said } {
                plant_in.trip.offer(trip);
                attitude_io.iter_mut().for_each(|(inputs, _)| inputs.trip.offer(trip));
                outcome.trip.get_or_insert((t_s * 1e3 + 1.0, trip.cause));
            }
            for said in all {
                plant_in.wrench_command.offer(said);
            }
            for said in tracked {
                judge_in.applied_setpoint.offer(said);
                position_io.iter_mut().for_each(|(inputs, _)| inputs.applied_setpoint.offer(said));
            }
        }

        let place = Vector3::from(truth.position_w_m);
        let error = (place - course_at(course, t_s)[0]).norm();
        if t >= FLIP_MS {
            outcome.tilt_rad = outcome.tilt_rad.max(tilt_rad);
            outcome.error_m = outcome.error_m.max(error);
            outcome.recovering_ms += u64::from(said.mode == GateMode::Recover);
            outcome.failed_over |= said.failed_over.is_set();
            outcome.was_cut |= said.mode == GateMode::Cut;
        }
        if t + 300 >= END_MS {
            outcome.last_error_m = outcome.last_error_m.max(error);
        }
        if place.z < 0.03 {
            outcome.on_ground_ms = Some(t);
        }
        if outcome.on_ground_ms.is_some() || outcome.was_cut {
            break;
        }
    }
    outcome
}
