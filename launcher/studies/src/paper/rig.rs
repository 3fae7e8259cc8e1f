//! The attitude law in closed loop with a vehicle, in this process and without sensors.

use super::PaperError;
use attitude_mpc::{AttitudeLaw, AttitudeLawConfig, Input, LawStatus, Output, Setpoint};
use nalgebra::Vector3;
use shared_types::time::ns_from_s;
use std::collections::VecDeque;
use vehicle::{
    Actuation, Allocator, Disturbance, LinearModel, MODEL_MEMORY_LEN, MorphAngle, NonlinearModel,
    PlantInputs, PlantModel, RigidBodyState, StepStatus, VehicleParameters, Wrench,
    euler_from_quaternion,
};

/// Longest integration step \[ns\], and the distance of the points in between.
const TICK_NS: u64 = 1_000_000;
/// Shortest lag that the vehicle's equations take \[s\].
const MIN_LAG_S: f64 = 1e-4;
/// Where the attitude stands in the memory of the linear plant.
const LINEAR_GAMMA: usize = 6;

/// What the law flies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum World {
    /// The paper's: the law's own linear model (6), the torque there at once.
    Linear,
    /// The nonlinear vehicle with its rotors, their limits and the allocation.
    Rotors {
        /// First-order lag of the rotors \[s\].
        lag_s: f64,
        /// Time from a step of the law to its command taking effect \[ns\].
        delay_ns: u64,
    },
}

impl World {
    /// The vehicle as `morphquad run` flies it.
    pub const FLIGHT: Self = Self::Rotors { lag_s: 0.015, delay_ns: 1_000_000 };
    /// With the rotors' limits, but without their lag and without delay.
    pub const PROMPT: Self = Self::Rotors { lag_s: MIN_LAG_S, delay_ns: 0 };
}

/// What happens to the vehicle once.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Blow {
    /// A torque \[N m\] over one control period.
    Torque(Vector3<f64>),
    /// A jump of γ̇ \[rad/s\].
    Rate(Vector3<f64>),
    /// A jump of γ \[rad\].
    Angle(Vector3<f64>),
}

/// One closed loop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Experiment {
    pub law: AttitudeLawConfig,
    /// Size of the vehicle.
    pub morph_angle: MorphAngle,
    /// The vehicle.
    pub world: World,
    /// Set point from the first sample on \[rad\].
    pub target_rad: Vector3<f64>,
    /// A blow at the first sample at or after this instant \[s\].
    pub blow: Option<(f64, Blow)>,
    /// Length \[s\].
    pub duration_s: f64,
}

/// One control sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Instant \[s\].
    pub t_s: f64,
    /// γ \[rad\] as the law saw it.
    pub gamma_rad: Vector3<f64>,
    /// ω \[rad/s\] as the law saw it.
    pub body_rate_rad_s: Vector3<f64>,
    /// u(k−1) \[N m\] as the law took it.
    pub previous_nm: Vector3<f64>,
    /// What the law made of it.
    pub output: Output,
    /// How far a rotor's thrust for it would lie beyond its limits \[N\], where the law bounds
    /// thrusts; minus infinity where it does not.
    pub rotor_excess_n: f64,
}

impl Sample {
    /// Δu(k) = u(k) − u(k−1) \[N m\].
    #[must_use]
    pub fn increment_nm(&self) -> Vector3<f64> {
        self.output.torque_nm - self.previous_nm
    }

    /// How far u or Δu lies beyond its bound \[N m\]; negative inside.
    #[must_use]
    pub fn excess_nm(&self) -> f64 {
        let level = self.output.torque_nm.abs() - self.output.torque_bound_nm;
        let increment = self.increment_nm().abs() - self.output.increment_bound_nm;
        level.max().max(increment.max())
    }
}

/// What became of an experiment.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    /// Control samples, from t = 0.
    pub samples: Vec<Sample>,
    /// γ \[rad\] over t \[s\]: at the samples in the linear world, each millisecond among rotors.
    pub gamma_rad: Vec<(f64, Vector3<f64>)>,
    /// When the law or the plant no longer accepted the state, the vehicle tumbling \[s\].
    pub lost_s: Option<f64>,
    /// Samples without an exact answer of the solver.
    pub unsolved: usize,
}

impl Experiment {
    /// The paper's closed loop: its law, its plant, all angles to 0.2 rad.
    #[must_use]
    pub fn paper(rate_hz: f64, increment_weight: f64, morph_angle: MorphAngle) -> Self {
        let law = AttitudeLawConfig { rate_hz, increment_weight, ..AttitudeLawConfig::paper() };
        Self {
            law,
            morph_angle,
            world: World::Linear,
            target_rad: Vector3::repeat(0.2),
            blow: None,
            duration_s: 0.5,
        }
    }

    /// The flight controller on the vehicle it is for.
    #[must_use]
    pub fn flight(rate_hz: f64, morph_angle: MorphAngle) -> Self {
        let law = AttitudeLawConfig::flight(rate_hz);
        Self { law, world: World::FLIGHT, ..Self::paper(rate_hz, 1.0, morph_angle) }
    }

    /// Runs it.
    ///
    /// # Errors
    /// A law or a vehicle that is impossible.
    pub fn run(&self) -> Result<Trajectory, PaperError> {
        let mut vehicle = VehicleParameters::default();
        let mut law = AttitudeLaw::new(self.law, &vehicle)?;
        if let World::Rotors { lag_s, .. } = self.world {
            vehicle.rotor_lag_s = lag_s.max(MIN_LAG_S);
        }
        let mut loop_ = ClosedLoop::new(self, vehicle)?;
        let mut k: u32 = 0;
        while loop_.running() {
            let t_s = f64::from(k) * self.law.period_s();
            if t_s > self.duration_s + 1e-9 {
                break;
            }
            loop_.sample(t_s, &mut law);
            k += 1;
            loop_.advance(ns_from_s(f64::from(k) * self.law.period_s()));
        }
        Ok(loop_.trajectory)
    }
}

fn rotor_excess_n(output: &Output) -> f64 {
    if output.rotor_bound_n.is_infinite() {
        return f64::NEG_INFINITY;
    }
    let allocator = Allocator {
        arm_length_m: output.arm_length_m,
        yaw_coefficient_m: VehicleParameters::default().yaw_coefficient_m,
        thrust_max_n: output.rotor_bound_n,
    };
    let wrench = Wrench { thrust_n: output.thrust_n, torque_b_nm: output.torque_nm };
    let thrusts = allocator.unlimited_thrusts(&wrench);
    thrusts.iter().map(|f| (f - output.rotor_bound_n).max(-f)).fold(f64::MIN, f64::max)
}

enum Plant {
    Linear(LinearModel),
    Rotors(NonlinearModel),
}

struct ClosedLoop<'a> {
    experiment: &'a Experiment,
    plant: Plant,
    weight_n: f64,
    now_ns: u64,
    blow: Option<(f64, Blow)>,
    torque_until_ns: u64,
    inputs: PlantInputs,
    pending: VecDeque<(u64, Wrench)>,
    trajectory: Trajectory,
}

impl<'a> ClosedLoop<'a> {
    fn new(experiment: &'a Experiment, vehicle: VehicleParameters) -> Result<Self, PaperError> {
        let start = RigidBodyState::hover(&vehicle, Vector3::zeros(), experiment.morph_angle);
        let plant = match experiment.world {
            World::Linear => Plant::Linear(LinearModel::new(vehicle, &start)?),
            World::Rotors { .. } => Plant::Rotors(NonlinearModel::new(vehicle, None, start)?),
        };
        Ok(Self {
            experiment,
            plant,
            weight_n: vehicle.weight_n(),
            now_ns: 0,
            blow: experiment.blow,
            torque_until_ns: 0,
            inputs: PlantInputs {
                actuation: Actuation::Wrench(Wrench::thrust(vehicle.weight_n())),
                morph_command_rad: experiment.morph_angle.rad(),
                disturbance: Disturbance::default(),
            },
            pending: VecDeque::new(),
            trajectory: Trajectory {
                samples: Vec::new(),
                gamma_rad: vec![(0.0, Vector3::zeros())],
                lost_s: None,
                unsolved: 0,
            },
        })
    }

    fn running(&self) -> bool {
        self.trajectory.lost_s.is_none()
    }

    fn gamma(&self) -> Vector3<f64> {
        match &self.plant {
            Plant::Linear(plant) => plant.euler_rad(),
            Plant::Rotors(plant) => euler_from_quaternion(&plant.state().q_wb),
        }
    }

    fn body_rate(&self) -> Vector3<f64> {
        match &self.plant {
            Plant::Linear(plant) => plant.truth(&self.inputs).state.omega_b,
            Plant::Rotors(plant) => plant.state().omega_b,
        }
    }

    /// The torque in effect, after the rotors' limits.
    fn applied_nm(&self) -> Vector3<f64> {
        let Actuation::Wrench(wrench) = self.inputs.actuation else { return Vector3::zeros() };
        match &self.plant {
            Plant::Linear(_) => wrench.torque_b_nm,
            Plant::Rotors(plant) => {
                let allocator = plant.parameters().allocator(plant.state().beta);
                let allocation = allocator.allocate(&wrench);
                allocation.map_or(wrench.torque_b_nm, |given| given.achieved.torque_b_nm)
            }
        }
    }

    fn sample(&mut self, t_s: f64, law: &mut AttitudeLaw) {
        self.strike(t_s);
        let previous_nm = self.applied_nm();
        let setpoint = Setpoint { gamma_rad: self.experiment.target_rad, thrust_n: self.weight_n };
        let (gamma_rad, body_rate_rad_s) = (self.gamma(), self.body_rate());
        let output = law.step(&Input {
            gamma_rad,
            body_rate_rad_s,
            age_s: 0.0,
            morph_angle: self.experiment.morph_angle,
            setpoint,
            applied_torque_nm: Some(previous_nm),
        });
        match output.status {
            LawStatus::Solved => {}
            LawStatus::Fallback(_) => self.trajectory.unsolved += 1,
            LawStatus::Refused(_) => self.trajectory.lost_s = Some(t_s),
        }
        if self.running() {
            self.trajectory.samples.push(Sample {
                t_s,
                gamma_rad,
                body_rate_rad_s,
                previous_nm,
                output,
                rotor_excess_n: rotor_excess_n(&output),
            });
        }
        let delay_ns = match self.experiment.world {
            World::Linear => 0,
            World::Rotors { delay_ns, .. } => delay_ns,
        };
        let wrench = Wrench { thrust_n: output.thrust_n, torque_b_nm: output.torque_nm };
        self.pending.push_back((self.now_ns + delay_ns, wrench));
    }

    /// The blow, if its instant has come.
    fn strike(&mut self, t_s: f64) {
        let Some((_, blow)) = self.blow.filter(|(at_s, _)| t_s >= at_s - 1e-9) else { return };
        self.blow = None;
        match blow {
            Blow::Torque(torque) => {
                self.inputs.disturbance.torque_b_nm = torque;
                self.torque_until_ns = self.now_ns + ns_from_s(self.experiment.law.period_s());
            }
            Blow::Rate(jump) => self.shift(LINEAR_GAMMA + 3, &jump),
            Blow::Angle(jump) => self.shift(LINEAR_GAMMA, &jump),
        }
    }

    /// Adds to three numbers of the linear plant's memory; the other has no such blow.
    fn shift(&mut self, from: usize, jump: &Vector3<f64>) {
        if let Plant::Linear(plant) = &mut self.plant {
            let mut memory: [f64; MODEL_MEMORY_LEN] = plant.memory();
            for (value, added) in memory[from..from + 3].iter_mut().zip(jump) {
                *value += added;
            }
            // Finite as it was, so it is taken.
            let _ = plant.restore(&memory);
        }
        self.trajectory.gamma_rad.push((self.now_ns as f64 * 1e-9, self.gamma()));
    }

    fn advance(&mut self, until_ns: u64) {
        while self.running() && self.now_ns < until_ns {
            while let Some((_, wrench)) = self.pending.front().filter(|(at, _)| *at <= self.now_ns)
            {
                self.inputs.actuation = Actuation::Wrench(*wrench);
                self.pending.pop_front();
            }
            if self.now_ns >= self.torque_until_ns {
                self.inputs.disturbance.torque_b_nm = Vector3::zeros();
            }
            let status = match &mut self.plant {
                Plant::Linear(plant) => {
                    // One exact step per period, as the paper's.
                    self.now_ns = until_ns;
                    plant.step(self.experiment.law.period_s(), &self.inputs)
                }
                Plant::Rotors(plant) => {
                    let tick_ns = (self.now_ns / TICK_NS + 1) * TICK_NS;
                    let effect_ns = self.pending.front().map_or(tick_ns, |(at, _)| *at);
                    let next_ns = tick_ns.min(effect_ns).min(until_ns);
                    let step_s = (next_ns - self.now_ns) as f64 * 1e-9;
                    self.now_ns = next_ns;
                    plant.step(step_s, &self.inputs)
                }
            };
            let t_s = self.now_ns as f64 * 1e-9;
            if status != StepStatus::Advanced {
                self.trajectory.lost_s = Some(t_s);
            } else if matches!(self.plant, Plant::Linear(_)) || self.now_ns.is_multiple_of(TICK_NS)
            {
                self.trajectory.gamma_rad.push((t_s, self.gamma()));
            }
        }
    }
}
