//! Makes a [`Snapshot`] from samples, and only from those that a real vehicle has.

use crate::snapshot::{Guidance, Snapshot, Turn, Way};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use shared_types::time::ns_from_s;
use shared_types::{
    AngleDiversion, AppliedCommand, GateMode, GuidanceOrder, PositionDiversion, Sample,
    StateEstimate,
};
use std::any::Any;
use std::collections::VecDeque;
use vehicle::{MorphAngle, VehicleParameters};

/// Time over which force and torque are averaged \[ns\]: long enough to suppress the noise of the
/// accelerometer and the oscillation of an attitude loop, and short compared with a gust.
const MEAN_NS: u64 = 300_000_000;
/// Samples that are kept of each topic: enough for the averaging time at 10 kHz.
const KEPT: usize = 4096;
/// Largest constant torque, as a share of the torque bound; a larger one comes from a manoeuvre and not from
/// a load.
const TORQUE_SHARE: f64 = 0.25;

mod sealed {
    pub trait Sealed {}
    impl Sealed for shared_types::StateEstimate {}
    impl Sealed for shared_types::AppliedCommand {}
    impl Sealed for shared_types::GuidanceOrder {}
}

/// A sample that a real vehicle has. The trait is sealed, so that no other crate can implement it for the
/// ground truth of a simulation:
///
/// ```compile_fail
/// fn of_a_vehicle<T: rehearsal::Known>() {}
/// of_a_vehicle::<shared_types::Truth>();
/// ```
/// ```compile_fail
/// fn of_a_vehicle<T: rehearsal::Known>() {}
/// of_a_vehicle::<shared_types::ActuatorState>();
/// ```
pub trait Known: Sample + sealed::Sealed {
    /// Topic that carries it.
    const TOPIC: &'static str;
    /// Passes the sample to a watcher.
    fn pass_to(&self, watcher: &mut Watcher);
}

/// A state estimate with its effective instant.
#[derive(Debug, Clone, Copy)]
struct Believed {
    valid_ns: u64,
    estimate: StateEstimate,
}

/// The part of an applied command that a snapshot needs.
#[derive(Debug, Clone, Copy)]
struct Applied {
    valid_ns: u64,
    rotor_thrust_n: [f64; 4],
    thrust_n: f64,
    torque_b_nm: [f64; 3],
    is_normal: bool,
}

/// Keeps the most recent samples of a flight, so that the snapshot of an instant does not depend on the order
/// in which topics are read.
#[derive(Debug)]
pub struct Watcher {
    vehicle: VehicleParameters,
    estimates: VecDeque<Believed>,
    commands: VecDeque<Applied>,
    orders: VecDeque<GuidanceOrder>,
}

/// Passes a sample to a watcher if it is of the type `T`; false if not.
fn pass<T: Known>(watcher: &mut Watcher, any: &dyn Any) -> bool {
    any.downcast_ref::<T>().map(|sample| sample.pass_to(watcher)).is_some()
}

/// Appends a sample and drops the oldest one when [`KEPT`] are stored.
fn keep<T>(queue: &mut VecDeque<T>, value: T) {
    if queue.len() == KEPT {
        queue.pop_front();
    }
    queue.push_back(value);
}

impl Watcher {
    /// A watcher of a flight whose controllers use these vehicle parameters as their model.
    #[must_use]
    pub fn new(vehicle: &VehicleParameters) -> Self {
        Self {
            vehicle: *vehicle,
            estimates: VecDeque::with_capacity(KEPT),
            commands: VecDeque::with_capacity(KEPT),
            orders: VecDeque::with_capacity(16),
        }
    }

    /// Takes a sample.
    pub fn observe<T: Known>(&mut self, sample: &T) {
        sample.pass_to(self);
    }

    /// Takes a sample of any topic if a real vehicle has it; false if not.
    pub fn observe_any<T: Sample>(&mut self, sample: &T) -> bool {
        let any: &dyn Any = sample;
        pass::<StateEstimate>(self, any)
            || pass::<AppliedCommand>(self, any)
            || pass::<GuidanceOrder>(self, any)
    }

    /// Names of the topics that are read.
    #[must_use]
    pub fn topics() -> [&'static str; 3] {
        [StateEstimate::TOPIC, AppliedCommand::TOPIC, GuidanceOrder::TOPIC]
    }

    /// The snapshot of the instant `at_ns` \[ns\]; `None` before the first estimate and command.
    #[must_use]
    pub fn snapshot(&self, at_ns: u64) -> Option<Snapshot> {
        let believed = self.estimates.iter().rev().find(|e| e.valid_ns <= at_ns)?;
        let applied = self.commands.iter().rev().find(|c| c.valid_ns <= at_ns)?;
        let e = &believed.estimate;
        let worst = |values: [f64; 3]| values.into_iter().fold(0.0, f64::max);
        let order = self.orders.iter().rev().find(|order| order.header.valid_ns <= at_ns);
        Some(Snapshot {
            at_ns,
            position_w_m: e.position_w_m,
            velocity_w_m_s: e.velocity_w_m_s,
            q_wb: e.q_wb.to_array(),
            body_rate_b_rad_s: e.body_rate_b_rad_s,
            morph_angle_rad: e.morph_angle_rad,
            morph_rate_rad_s: e.morph_rate_rad_s,
            position_sigma_w_m: e.position_sigma_w_m,
            velocity_sigma_w_m_s: e.velocity_sigma_w_m_s,
            attitude_sigma_b_rad: e.attitude_sigma_b_rad,
            gyro_bias_sigma_rad_s: worst(e.gyro_bias_sigma_b_rad_s),
            accelerometer_bias_sigma_m_s2: worst(e.accelerometer_bias_sigma_b_m_s2),
            rotor_thrust_n: applied.rotor_thrust_n,
            commanded: applied.is_normal,
            force_w_n: self.force_w_n(at_ns),
            torque_b_nm: self.torque_b_nm(at_ns),
            guidance: order.map(guidance).unwrap_or_default(),
        })
    }

    /// Estimates of the averaging time that ends at `at_ns`.
    fn lately(&self, at_ns: u64) -> impl Iterator<Item = &StateEstimate> {
        let from_ns = at_ns.saturating_sub(MEAN_NS);
        let within = move |e: &&Believed| e.valid_ns <= at_ns && e.valid_ns > from_ns;
        self.estimates.iter().filter(within).map(|e| &e.estimate)
    }

    /// Mean external force in the world frame \[N\]: the part of the specific force f that neither thrust T
    /// nor drag in still air (w = 0) explains, from m R f = T R e₃ + d (w − v) + F. T is the thrust commanded
    /// one rotor lag earlier.
    fn force_w_n(&self, at_ns: u64) -> [f64; 3] {
        let lag_ns = ns_from_s(self.vehicle.rotor_lag_s);
        let (mut sum, mut count) = (Vector3::zeros(), 0.0);
        let mut commands = self.commands.iter().peekable();
        let mut thrust_n = None;
        for e in self.lately(at_ns) {
            let due_ns = e.header.valid_ns.saturating_sub(lag_ns);
            while let Some(command) = commands.next_if(|command| command.valid_ns <= due_ns) {
                thrust_n = Some(command.thrust_n);
            }
            let Some(thrust_n) = thrust_n else { continue };
            let f = Vector3::from(e.specific_force_b_m_s2) * self.vehicle.mass_kg;
            let velocity = Vector3::from(e.velocity_w_m_s);
            let rest_b = f - Vector3::new(0.0, 0.0, thrust_n);
            sum += rotation(e) * rest_b + velocity * self.vehicle.drag_n_s_m;
            count += 1.0;
        }
        if count > 0.0 { (sum / count).into() } else { [0.0; 3] }
    }

    /// Mean external torque in the body frame \[N m\], `τ_d` of `I Δω / Δt + ω × I ω = τ + τ_d`; 0 while the
    /// samples cover less than half of the averaging time.
    fn torque_b_nm(&self, at_ns: u64) -> [f64; 3] {
        let (mut first, mut last) = (None, None);
        let (mut turning, mut count) = (Vector3::zeros(), 0.0);
        for e in self.lately(at_ns) {
            let Some(beta) = MorphAngle::saturating_from_rad(e.morph_angle_rad) else { continue };
            let omega = Vector3::from(e.body_rate_b_rad_s);
            let inertia = self.vehicle.inertia_kg_m2(beta);
            turning += omega.cross(&inertia.component_mul(&omega));
            count += 1.0;
            let moment = (e.header.valid_ns, omega, inertia, beta);
            first = first.or(Some(moment));
            last = Some(moment);
        }
        let from_ns = at_ns.saturating_sub(MEAN_NS);
        let given = self.commands.iter().filter(|c| c.valid_ns <= at_ns && c.valid_ns > from_ns);
        let (mut torque, mut commands) = (Vector3::zeros(), 0.0);
        for command in given {
            torque += Vector3::from(command.torque_b_nm);
            commands += 1.0;
        }
        let (Some((begin_ns, before, ..)), Some((end_ns, after, inertia, beta))) = (first, last)
        else {
            return [0.0; 3];
        };
        if end_ns.saturating_sub(begin_ns) < MEAN_NS / 2 || commands < 1.0 {
            return [0.0; 3];
        }
        let span_s = (end_ns - begin_ns) as f64 * 1e-9;
        let mean = inertia.component_mul(&((after - before) / span_s)) + turning / count
            - torque / commands;
        let most = self.vehicle.torque_bound_nm(beta, self.vehicle.weight_n()) * TORQUE_SHARE;
        core::array::from_fn(|i| mean[i].clamp(-most[i], most[i]))
    }
}

fn rotation(e: &StateEstimate) -> UnitQuaternion<f64> {
    UnitQuaternion::new_normalize(Quaternion::new(e.q_wb.w, e.q_wb.x, e.q_wb.y, e.q_wb.z))
}

impl Known for StateEstimate {
    const TOPIC: &'static str = "state_estimate";
    fn pass_to(&self, watcher: &mut Watcher) {
        let believed = Believed { valid_ns: self.header.valid_ns, estimate: *self };
        keep(&mut watcher.estimates, believed);
    }
}

impl Known for AppliedCommand {
    const TOPIC: &'static str = "applied_command";
    fn pass_to(&self, watcher: &mut Watcher) {
        let applied = Applied {
            valid_ns: self.header.valid_ns,
            rotor_thrust_n: self.rotor_thrust_n,
            thrust_n: self.thrust_n,
            torque_b_nm: self.torque_b_nm,
            is_normal: self.mode == GateMode::Normal,
        };
        keep(&mut watcher.commands, applied);
    }
}

impl Known for GuidanceOrder {
    const TOPIC: &'static str = "guidance_order";
    fn pass_to(&self, watcher: &mut Watcher) {
        if watcher.orders.len() == 16 {
            watcher.orders.pop_front();
        }
        watcher.orders.push_back(*self);
    }
}

fn guidance(order: &GuidanceOrder) -> Guidance {
    let position = &order.position;
    let goes = position.ordered.is_set();
    Guidance {
        position: goes.then(|| way(position)),
        yaw: (goes && order.yaw.ordered.is_set()).then(|| turn(&order.yaw)),
        morph: order.morph.ordered.is_set().then(|| turn(&order.morph)),
    }
}

fn way(way: &PositionDiversion) -> Way {
    Way {
        begin_s: way.begin_ns as f64 / 1e9,
        from_w_m: way.from_w_m,
        velocity_w_m_s: way.velocity_w_m_s,
        acceleration_w_m_s2: way.acceleration_w_m_s2,
        goal_w_m: way.goal_w_m,
        brake_s: way.brake_s,
        move_s: way.move_s,
    }
}

fn turn(turn: &AngleDiversion) -> Turn {
    Turn {
        begin_s: turn.begin_ns as f64 / 1e9,
        from_rad: turn.from_rad,
        rate_rad_s: turn.rate_rad_s,
        acceleration_rad_s2: turn.acceleration_rad_s2,
        goal_rad: turn.goal_rad,
        brake_s: turn.brake_s,
        move_s: turn.move_s,
    }
}
