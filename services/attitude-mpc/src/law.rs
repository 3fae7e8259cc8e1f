//! One step of the attitude law, (8)-(17), in the order of the paper.

use mpc::{Measured, QpStatus};
use nalgebra::Vector3;
use vehicle::{MorphAngle, VehicleParameters, euler_rate_matrix, wrap_pi};

use crate::config::{AttitudeLawConfig, ConfigError};
use crate::memory::Memory;
use crate::ramp::Ramp;
use crate::schedule::{self, Engine, State};

/// Far below any period \[s\]: 1/500 − 0.001 must count as 0.001.
const ROUNDING_S: f64 = 1e-9;

/// What the position loop asks for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setpoint {
    /// γ = (φ, θ, ψ) \[rad\], intrinsic z-y-x.
    pub gamma_rad: Vector3<f64>,
    /// Collective thrust T \[N\].
    pub thrust_n: f64,
}

/// What the law knows at its sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Input {
    /// γ = (φ, θ, ψ) \[rad\].
    pub gamma_rad: Vector3<f64>,
    /// ω \[rad/s\] in B.
    pub body_rate_rad_s: Vector3<f64>,
    /// Time since γ and ω were valid \[s\]; where the rates do not divide one another, the latest
    /// estimate is older than the sample, by another time at each.
    pub age_s: f64,
    /// β.
    pub morph_angle: MorphAngle,
    /// Setpoint in effect.
    pub setpoint: Setpoint,
    /// Torque \[N m\] the plant's allocation left of the command in effect just before this
    /// sample; `None` if unknown, which takes the command as applied in full.
    pub applied_torque_nm: Option<Vector3<f64>>,
}

/// Why a step was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Refusal {
    /// A NaN or an infinity in the input.
    NotFinite,
    /// |θ| beyond [`vehicle::MAX_PITCH_RAD`], where Euler rates lose their meaning.
    SteepPitch,
}

/// How a step ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LawStatus {
    /// The optimum.
    Solved,
    /// The solver did not finish; its first move was clipped to its bounds.
    Fallback(QpStatus),
    /// The input could not be used; the last command is held.
    Refused(Refusal),
}

/// The command and the way it came about.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Output {
    /// τ \[N m\] in B.
    pub torque_nm: Vector3<f64>,
    /// T \[N\], the setpoint's within 0..=4 `F_max`.
    pub thrust_n: f64,
    /// How the step ended.
    pub status: LawStatus,
    /// γ \[rad\] aimed at now, on the ramp.
    pub reference_rad: Vector3<f64>,
    /// Bound on |τ| in this step \[N m\].
    pub torque_bound_nm: Vector3<f64>,
    /// Bound on |Δτ| in this step \[N m\], relaxation included.
    pub increment_bound_nm: Vector3<f64>,
    /// Part of it that is relaxation \[N m\].
    pub relaxation_nm: Vector3<f64>,
    /// How far the solver's own move was outside these bounds \[N m\].
    pub violation_nm: f64,
    /// Changes of the working set, or sweeps.
    pub iterations: u32,
    /// Rows at a bound.
    pub active: u32,
}

/// The attitude MPC.
#[derive(Debug)]
pub struct AttitudeLaw {
    config: AttitudeLawConfig,
    vehicle: VehicleParameters,
    engine: Engine,
    memory: Memory,
}

impl AttitudeLaw {
    /// Reserves all memory and starts at trim.
    ///
    /// # Errors
    /// A number outside its range, a horizon that does not fit, an impossible vehicle.
    pub fn new(
        config: AttitudeLawConfig,
        vehicle: &VehicleParameters,
    ) -> Result<Self, ConfigError> {
        config.validate()?;
        vehicle.validate()?;
        let engine = Engine::new(&config, config.horizon.samples(config.rate_hz)?)?;
        let memory = Memory::at_trim(vehicle.weight_n());
        Ok(Self { config, vehicle: *vehicle, engine, memory })
    }

    /// One sample: measure, Δx, program, u(k) = u(k−1) + Δu(k).
    pub fn step(&mut self, input: &Input) -> Output {
        self.memory.counters.steps += 1;
        self.follow_actuators(input);
        match self.state(input) {
            Ok(state) => self.control(input, &state),
            Err(refusal) => self.refuse(refusal),
        }
    }

    /// Brings actuator copy and u(k−1) to this sample from what the plant reported.
    ///
    /// The report is of the plant's last whole tick. A command was in effect for all of it if
    /// delay and tick fit into a period: then the report is u(k−1). With a delay of one period
    /// it is u(k−2). In between it may be either, and is not used.
    fn follow_actuators(&mut self, input: &Input) {
        let memory = &mut self.memory;
        let reported =
            input.applied_torque_nm.filter(|torque| torque.iter().all(|t| t.is_finite()));
        if !memory.commanded {
            // A successor starts from what its predecessor left in effect.
            let start = reported.map_or(memory.torque_nm, Into::into);
            (memory.torque_nm, memory.applied_nm, memory.actuator_nm) = (start, start, start);
            return;
        }
        let (period, latency) = (self.config.period_s(), self.config.command_latency_s);
        let mut before = Vector3::from(memory.applied_nm);
        let mut latest = Vector3::from(memory.torque_nm);
        if latency + self.config.report_period_s <= period + ROUNDING_S {
            latest = reported.unwrap_or(latest);
        } else if latency >= period {
            before = reported.unwrap_or(before);
        }
        let delay = self.config.command_delay_s;
        let axis = schedule::actuator(&self.config);
        for i in 0..3 {
            let early = axis.actuator_after(memory.actuator_nm[i], before[i], delay);
            memory.actuator_nm[i] = axis.actuator_after(early, latest[i], period - delay);
        }
        memory.applied_nm = latest.into();
    }

    /// x(k) = \[γ, γ̇, τ, u(k−1)\], or why there is none.
    fn state(&self, input: &Input) -> Result<State, Refusal> {
        let Input { gamma_rad: gamma, body_rate_rad_s: omega, setpoint, age_s, .. } = input;
        let numbers = gamma.iter().chain(omega).chain(&setpoint.gamma_rad);
        if !numbers.chain([&setpoint.thrust_n, age_s]).all(|value| value.is_finite()) {
            return Err(Refusal::NotFinite);
        }
        // γ̇ = R₂(γ) ω   (5)
        let rate = euler_rate_matrix(gamma).ok_or(Refusal::SteepPitch)? * omega;
        // From the instant of the estimate to this one by (6): Δx must span whole periods.
        let age = age_s.clamp(0.0, self.config.period_s());
        let torque = Vector3::from(self.memory.actuator_nm);
        let acceleration = torque.component_div(&self.vehicle.inertia_kg_m2(self.angle(input)));
        let mut x = State::zeros();
        x.fixed_rows_mut::<3>(0).copy_from(&(gamma + (rate + acceleration * (0.5 * age)) * age));
        x.fixed_rows_mut::<3>(3).copy_from(&(rate + acceleration * age));
        x.fixed_rows_mut::<3>(6).copy_from_slice(&self.memory.actuator_nm);
        x.fixed_rows_mut::<3>(9).copy_from_slice(&self.memory.applied_nm);
        Ok(x)
    }

    /// β of model, weights and bounds.
    fn angle(&self, input: &Input) -> MorphAngle {
        self.config.fixed_morph_angle.unwrap_or(input.morph_angle)
    }

    fn control(&mut self, input: &Input, x: &State) -> Output {
        let beta = self.angle(input);
        let (config, vehicle) = (&self.config, &self.vehicle);
        let ramp_s = config.setpoint_ramp_s;
        let thrust = input.setpoint.thrust_n.clamp(0.0, 4.0 * vehicle.rotor_thrust_max_n);
        let mut ramp = self.memory.ramp;
        if !self.memory.commanded {
            ramp = Ramp::at(&input.gamma_rad);
        }
        ramp.aim(&input.setpoint.gamma_rad, ramp_s);

        self.engine.schedule(config, vehicle, beta);
        let bounds = schedule::bounds(config, vehicle, beta, thrust);
        let now = self.measured(x);
        let reference = ramp.value(0.0, ramp_s);
        // Whole turns that bring the yaw error at k into (−π, π], the same over the horizon.
        let error = reference.z - now.output.z;
        let turns = wrap_pi(error) - error;
        let period = config.period_s();
        let desired = |ahead: usize| {
            let mut gamma = ramp.value(ahead as f64 * period, ramp_s);
            gamma.z += turns;
            gamma
        };
        let chosen = self.engine.step(&now, desired, &bounds);

        ramp.advance(period, ramp_s);
        self.memory.ramp = ramp;
        self.remember(x, &chosen, beta, thrust);
        Output {
            torque_nm: chosen.u,
            thrust_n: thrust,
            status: match chosen.status {
                QpStatus::Solved => LawStatus::Solved,
                unfinished => LawStatus::Fallback(unfinished),
            },
            reference_rad: reference,
            torque_bound_nm: bounds.u_max,
            increment_bound_nm: bounds.du_max + chosen.relaxation,
            relaxation_nm: chosen.relaxation,
            violation_nm: chosen.violation,
            iterations: chosen.iterations,
            active: chosen.active,
        }
    }

    /// Δx(k), y(k) and u(k−1); Δx = 0 where there is no sample k−1.
    fn measured(&self, x: &State) -> Measured<12, 3, 3> {
        let memory = &self.memory;
        let mut increment = State::zeros();
        if memory.primed {
            let parts = [memory.gamma_rad, memory.gamma_rate_rad_s];
            for (i, previous) in parts.iter().flatten().enumerate() {
                increment[i] = x[i] - previous;
            }
            increment[2] = wrap_pi(increment[2]);
            let parts = [memory.previous_actuator_nm, memory.previous_applied_nm];
            for (i, previous) in parts.iter().flatten().enumerate() {
                increment[6 + i] = x[6 + i] - previous;
            }
        }
        Measured {
            state_increment: increment,
            output: x.fixed_rows::<3>(0).into_owned(),
            u_previous: x.fixed_rows::<3>(9).into_owned(),
        }
    }

    fn remember(&mut self, x: &State, chosen: &mpc::Move<3>, beta: MorphAngle, thrust: f64) {
        let memory = &mut self.memory;
        memory.primed = true;
        memory.commanded = true;
        memory.gamma_rad.copy_from_slice(x.fixed_rows::<3>(0).as_slice());
        memory.gamma_rate_rad_s.copy_from_slice(x.fixed_rows::<3>(3).as_slice());
        memory.previous_actuator_nm = memory.actuator_nm;
        memory.previous_applied_nm = memory.applied_nm;
        memory.torque_nm = chosen.u.into();
        memory.thrust_n = thrust;
        memory.scheduled_rad = self.engine.scheduled().unwrap_or(beta.rad());
        let set = self.engine.working_set();
        memory.working_set[..set.len()].copy_from_slice(set);
        memory.counters.fallbacks += u64::from(chosen.is_fallback());
        memory.counters.relaxed += u64::from(chosen.relaxation.max() > 0.0);
    }

    /// Holds the last command; the next good sample starts with Δx = 0.
    fn refuse(&mut self, refusal: Refusal) -> Output {
        self.memory.counters.refused += 1;
        self.memory.primed = false;
        let zero = Vector3::zeros();
        Output {
            torque_nm: self.memory.torque_nm.into(),
            thrust_n: self.memory.thrust_n,
            status: LawStatus::Refused(refusal),
            reference_rad: self.memory.ramp.value(0.0, self.config.setpoint_ramp_s),
            torque_bound_nm: zero,
            increment_bound_nm: zero,
            relaxation_nm: zero,
            violation_nm: 0.0,
            iterations: 0,
            active: 0,
        }
    }

    /// A sample without a usable estimate: nothing is commanded, and the next good one starts with
    /// Δx = 0.
    pub fn miss(&mut self) {
        self.memory.primed = false;
    }

    /// The whole evolving memory.
    #[must_use]
    pub fn memory(&self) -> &Memory {
        &self.memory
    }

    /// Takes over the memory of an instance with the same configuration; from here on both give
    /// the same bits.
    ///
    /// # Errors
    /// A working set that no solver can have; nothing is taken over then.
    pub fn restore(&mut self, memory: &Memory) -> Result<(), ConfigError> {
        self.engine.restore(&memory.working_set)?;
        if let Some(beta) = MorphAngle::saturating_from_rad(memory.scheduled_rad) {
            self.engine.schedule(&self.config, &self.vehicle, beta);
        }
        self.memory = *memory;
        Ok(())
    }
}
