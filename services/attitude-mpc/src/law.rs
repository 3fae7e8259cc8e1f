//! One step of the attitude law, (8)-(17), in the order of the paper.

use controller::Setpoint;
use mpc::{IncrementalMpc, Measured, Move};
use nalgebra::{SVector, Vector3};
use vehicle::{MorphAngle, VehicleParameters, euler_rate_matrix, wrap_pi};

use crate::config::{AttitudeLawConfig, ConfigError, TorqueBound};
use crate::memory::Memory;
use crate::preview::{MorphPlan, Preview, mean_gain};
use crate::ramp::Ramp;
use crate::schedule::{self, StepLimits};

/// x = \[γ, γ̇, τ, u(k−1)\]; without lag and delay the last two do not matter.
type State = SVector<f64, 12>;

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
pub type LawStatus = mpc::LawStatus<Refusal>;

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
    /// Soft rows beyond their bound, see [`mpc::Move::yielded`].
    pub yielded: u32,
    /// L \[m\] of the bounds.
    pub arm_length_m: f64,
    /// Bound on each rotor's thrust \[N\]; infinite if torques are bounded instead.
    pub rotor_bound_n: f64,
}

/// The attitude MPC.
#[derive(Debug)]
pub struct AttitudeLaw {
    config: AttitudeLawConfig,
    vehicle: VehicleParameters,
    engine: IncrementalMpc<3>,
    preview: Preview,
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
        let design = schedule::design(&config)?;
        let engine = IncrementalMpc::new(&design, config.solver)?;
        let preview = Preview::new(design.horizon, config.preview_reach(design.horizon));
        let memory = Memory::at_trim(vehicle.weight_n());
        Ok(Self { config, vehicle: *vehicle, engine, preview, memory })
    }

    /// One sample: measure, Δx, program, u(k) = u(k−1) + Δu(k).
    pub fn step(&mut self, input: &Input) -> Output {
        self.step_along(input, None)
    }

    /// As [`Self::step`], with the morph that is commanded.
    pub fn step_along(&mut self, input: &Input, plan: Option<&MorphPlan<'_>>) -> Output {
        self.memory.counters.steps += 1;
        let (timing, axis) = (self.config.timing(), schedule::actuator(&self.config));
        self.memory.actuators.follow(input.applied_torque_nm, &timing, &axis);
        match self.state(input) {
            Ok(state) => self.control(input, &state, plan),
            Err(refusal) => self.refuse(refusal),
        }
    }

    /// Takes u(k−1) from another controller, whose command the plant last applied: `torque_nm` \[N m\]
    /// as reported, with `thrust_n` \[N\]. For each sample before its step, while another one flies.
    pub fn track(&mut self, torque_nm: &Vector3<f64>, thrust_n: f64) {
        let memory = &mut self.memory;
        let numbers = torque_nm.iter().chain([&thrust_n]);
        if !memory.actuators.commanded || !numbers.into_iter().all(|value| value.is_finite()) {
            // The first step starts from the report anyway.
            return;
        }
        memory.actuators.track(torque_nm, &self.config.timing());
        memory.thrust_n = thrust_n;
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
        let torque = Vector3::from(self.memory.actuators.torque_nm);
        let acceleration = torque.component_div(&self.vehicle.inertia_kg_m2(self.angle(input)));
        let mut x = State::zeros();
        x.fixed_rows_mut::<3>(0).copy_from(&(gamma + (rate + acceleration * (0.5 * age)) * age));
        x.fixed_rows_mut::<3>(3).copy_from(&(rate + acceleration * age));
        x.fixed_rows_mut::<3>(6).copy_from_slice(&self.memory.actuators.torque_nm);
        x.fixed_rows_mut::<3>(9).copy_from_slice(&self.memory.actuators.applied_nm);
        Ok(x)
    }

    /// β of model, weights and bounds.
    fn angle(&self, input: &Input) -> MorphAngle {
        self.config.fixed_morph_angle.unwrap_or(input.morph_angle)
    }

    /// β of gains and weights, which stay until it has moved by the tolerance.
    fn scheduled(&self, beta: MorphAngle) -> MorphAngle {
        let last = self.memory.scheduled_rad;
        let stays = (beta.rad() - last).abs() <= self.config.rebuild_tolerance_rad;
        MorphAngle::from_rad(last).ok().filter(|_| stays).unwrap_or(beta)
    }

    fn control(&mut self, input: &Input, x: &State, plan: Option<&MorphPlan<'_>>) -> Output {
        let beta = self.angle(input);
        let scheduled = self.scheduled(beta);
        let (config, vehicle) = (&self.config, &self.vehicle);
        let (period, ramp_s) = (config.period_s(), config.setpoint_ramp_s);
        let thrust = input.setpoint.thrust_n.clamp(0.0, 4.0 * vehicle.rotor_thrust_max_n);
        let mut ramp = self.memory.ramp;
        if !self.memory.actuators.commanded {
            ramp = Ramp::at(&input.gamma_rad);
        }
        ramp.aim(&input.setpoint.gamma_rad, ramp_s);

        let plan = plan.filter(|_| config.morph_preview && config.fixed_morph_angle.is_none());
        let morphing = plan.is_some_and(|plan| self.preview.follow(plan, beta, vehicle, period));
        let unit = schedule::unit(config, vehicle, scheduled);
        let operating = schedule::operating(config, vehicle, scheduled, &unit);
        let bound = schedule::torque_bounds(config, vehicle, beta, thrust);
        let limits = StepLimits::new(config, vehicle, &bound, &unit, thrust);
        let now = measured(&self.memory, x, &unit, morphing.then_some((vehicle, beta)));
        let reference = ramp.value(0.0, ramp_s);
        // Whole turns that bring the yaw error at k into (−π, π], the same over the horizon.
        let error = reference.z - now.output.z;
        let turns = wrap_pi(error) - error;
        let desired = |ahead: usize| {
            let mut gamma = ramp.value(ahead as f64 * period, ramp_s);
            gamma.z += turns;
            gamma
        };
        let ahead = morphing.then(|| self.preview.ahead(config, vehicle, &unit, thrust));
        let limits = limits.limits(config);
        let chosen = self.engine.step(&now, &operating, desired, &limits, ahead.as_ref());

        let output = Output {
            thrust_n: thrust,
            reference_rad: reference,
            arm_length_m: vehicle.geometry.arm_length_m(beta),
            ..output(config, vehicle, &chosen, &unit, &bound)
        };
        ramp.advance(period, ramp_s);
        self.memory.ramp = ramp;
        self.memory.scheduled_rad = scheduled.rad();
        self.memory.morph_angle_rad = beta.rad();
        self.remember(x, &output);
        output
    }

    fn remember(&mut self, x: &State, output: &Output) {
        let memory = &mut self.memory;
        memory.primed = true;
        memory.gamma_rad.copy_from_slice(x.fixed_rows::<3>(0).as_slice());
        memory.gamma_rate_rad_s.copy_from_slice(x.fixed_rows::<3>(3).as_slice());
        memory.previous_actuator_nm = memory.actuators.torque_nm;
        memory.previous_applied_nm = memory.actuators.applied_nm;
        memory.actuators.command(&output.torque_nm);
        memory.thrust_n = output.thrust_n;
        self.engine.pack_working_set(&mut memory.working_set);
        memory.counters.fallbacks += u64::from(output.status != LawStatus::Solved);
        memory.counters.relaxed += u64::from(output.relaxation_nm.max() > 0.0);
    }

    /// Holds the last command; the next good sample starts with Δx = 0.
    fn refuse(&mut self, refusal: Refusal) -> Output {
        self.memory.counters.refused += 1;
        self.memory.primed = false;
        let zero = Vector3::zeros();
        Output {
            torque_nm: self.memory.actuators.command_nm.into(),
            thrust_n: self.memory.thrust_n,
            status: LawStatus::Refused(refusal),
            reference_rad: self.memory.ramp.value(0.0, self.config.setpoint_ramp_s),
            torque_bound_nm: zero,
            increment_bound_nm: zero,
            relaxation_nm: zero,
            violation_nm: 0.0,
            iterations: 0,
            active: 0,
            yielded: 0,
            arm_length_m: 0.0,
            rotor_bound_n: f64::INFINITY,
        }
    }

    /// So many samples without a step, for want of a usable estimate or of time, with the torque that the plant has
    /// reported of the last \[N m\], if it is known. Δx would span more than a period: the next step starts with Δx = 0.
    pub fn leave_out(&mut self, samples: u64, reported_nm: Option<Vector3<f64>>) {
        self.memory.primed = false;
        self.memory.actuators.pass(samples, reported_nm, &self.config.timing());
    }

    /// The program of the last step, for study and benchmarks.
    #[must_use]
    pub fn program(&self) -> mpc::Program<'_> {
        self.engine.program()
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
        self.memory = *memory;
        Ok(())
    }
}

/// Δx(k), y(k) and u(k−1) in torques of `unit`; Δx = 0 where there is no sample k−1.
///
/// While the arms move, the rate stands for the momentum I ω and Δγ for what the momentum turned,
/// both over the inertia of now.
fn measured(
    memory: &Memory,
    x: &State,
    unit: &Vector3<f64>,
    morphing: Option<(&VehicleParameters, MorphAngle)>,
) -> Measured<3> {
    let part = |i: usize| x.fixed_rows::<3>(3 * i).into_owned();
    let torque = |nm: Vector3<f64>| nm.component_div(unit);
    let mut now = Measured {
        output: part(0),
        output_increment: Vector3::zeros(),
        rate: part(1),
        rate_increment: Vector3::zeros(),
        actuator_increment: Vector3::zeros(),
        input_increment: Vector3::zeros(),
        u_previous: torque(part(3)),
    };
    if !memory.primed {
        return now;
    }
    now.output_increment = part(0) - Vector3::from(memory.gamma_rad);
    now.output_increment.z = wrap_pi(now.output_increment.z);
    let mut previous_rate = Vector3::from(memory.gamma_rate_rad_s);
    let before = MorphAngle::from_rad(memory.morph_angle_rad).ok();
    if let (Some((vehicle, beta)), Some(before)) = (morphing, before) {
        let inertia = vehicle.inertia_kg_m2(beta);
        let ratio = vehicle.inertia_kg_m2(before).component_div(&inertia);
        previous_rate.component_mul_assign(&ratio);
        let mean = mean_gain(vehicle, before, beta).component_mul(&inertia);
        now.output_increment.component_div_assign(&mean);
    }
    now.rate_increment = part(1) - previous_rate;
    now.actuator_increment = torque(part(2) - Vector3::from(memory.previous_actuator_nm));
    now.input_increment = torque(part(3) - Vector3::from(memory.previous_applied_nm));
    now
}

/// A move in the engine's `unit` as torque, with the bounds that are hard; `bound` \[N m\] is that
/// on the torque.
fn output(
    config: &AttitudeLawConfig,
    vehicle: &VehicleParameters,
    chosen: &Move<3>,
    unit: &Vector3<f64>,
    bound: &Vector3<f64>,
) -> Output {
    let hard = config.level_penalty.is_none();
    let stepwise = config.increment_bound && config.increment_penalty.is_none();
    let by_rotor = hard && config.torque_bound == TorqueBound::RotorThrusts;
    let unbounded = Vector3::repeat(f64::INFINITY);
    let torque = chosen.u.component_mul(unit);
    let relaxation = chosen.relaxation.component_mul(unit);
    Output {
        // Rounding of the unit may leave a bound by its last bit.
        torque_nm: if hard { torque.sup(&-bound).inf(bound) } else { torque },
        thrust_n: 0.0,
        status: chosen.status.into(),
        reference_rad: Vector3::zeros(),
        torque_bound_nm: if hard { *bound } else { unbounded },
        increment_bound_nm: if stepwise { bound + relaxation } else { unbounded },
        relaxation_nm: relaxation,
        violation_nm: chosen.violation * unit.max(),
        iterations: chosen.iterations,
        active: chosen.active,
        yielded: chosen.yielded,
        arm_length_m: 0.0,
        rotor_bound_n: if by_rotor { vehicle.rotor_thrust_max_n } else { f64::INFINITY },
    }
}
