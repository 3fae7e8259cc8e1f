//! One step of the position law, (7) and (10)-(17).

use controller::Setpoint;
use mpc::{IncrementalMpc, Limits, Measured, Move, Operating, QpStatus};
use nalgebra::{SVector, Vector3};
use vehicle::VehicleParameters;

use crate::cone::Cone;
use crate::config::{ConfigError, PositionLawConfig};
use crate::memory::Memory;
use crate::model;
use crate::takeover::Takeover;
use crate::thrust_vector::{angles_at, input_of, lift};
use crate::transport::{HISTORY, Transport};

/// What the law knows at its sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Input<'a> {
    /// p \[m\] in W.
    pub position_w_m: Vector3<f64>,
    /// v \[m/s\] in W.
    pub velocity_w_m_s: Vector3<f64>,
    /// γ = (φ, θ, ψ) \[rad\].
    pub gamma_rad: Vector3<f64>,
    /// Time since these were valid \[s\].
    pub age_s: f64,
    /// Desired p \[m\] in W at k+1, k+2, …: [`PositionLaw::look_ahead`] of them are used, and the last one
    /// is held if there are fewer. Empty holds what was last given.
    pub reference_w_m: &'a [Vector3<f64>],
    /// Desired ψ \[rad\].
    pub reference_yaw_rad: f64,
    /// Setpoint in effect at the attitude loop just before this sample; `None` takes the law's
    /// own as applied.
    pub applied: Option<Setpoint>,
}

/// Why a step was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Refusal {
    /// A NaN or an infinity in the input.
    NotFinite,
}

/// How a step ended.
pub type LawStatus = mpc::LawStatus<Refusal>;

/// The setpoint and the way it came about. Vectors over inputs are (θ₀, φ₀, T₀), tangents of the tilt at ψ = 0 and the part
/// of the thrust that carries, in which the law computes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Output {
    /// For the attitude loop.
    pub setpoint: Setpoint,
    /// How the step ended.
    pub status: LawStatus,
    /// u(k) \[1, 1, N\].
    pub command: Vector3<f64>,
    /// Least u(k) \[1, 1, N\].
    pub command_min: Vector3<f64>,
    /// Largest u(k) \[1, 1, N\].
    pub command_max: Vector3<f64>,
    /// Bound on |Δu(k)|, relaxation included \[1, 1, N\].
    pub increment_bound: Vector3<f64>,
    /// Part of it that is relaxation \[1, 1, N\].
    pub relaxation: Vector3<f64>,
    /// How far the solver's own move was outside these bounds.
    pub violation: f64,
    /// Changes of the working set, or sweeps.
    pub iterations: u32,
    /// Rows at a bound.
    pub active: u32,
    /// Soft rows beyond their bound, see [`mpc::Move::yielded`].
    pub yielded: u32,
}

/// x = \[p, v, (θ₀, φ₀, T₀) as achieved, u(k−1)\].
type State = SVector<f64, 12>;

/// The position MPC.
#[derive(Debug)]
pub struct PositionLaw {
    config: PositionLawConfig,
    transports: [Transport; 3],
    operating: Operating<3>,
    limits: Limits<'static, 3>,
    cone: Cone,
    engine: IncrementalMpc<3>,
    takeover: Takeover,
    memory: Memory,
}

impl PositionLaw {
    /// Reserves all memory and starts at trim.
    ///
    /// # Errors
    /// A number outside its range, a horizon that does not fit, an impossible vehicle.
    pub fn new(
        config: PositionLawConfig,
        vehicle: &VehicleParameters,
    ) -> Result<Self, ConfigError> {
        config.validate()?;
        vehicle.validate()?;
        let drag_per_s = vehicle.drag_n_s_m / vehicle.mass_kg;
        let transports = model::transports(&config, drag_per_s);
        let late = transports.iter().map(|transport| transport.periods).max().unwrap_or(0);
        Ok(Self {
            config,
            takeover: Takeover::new(config.horizon.prediction + late, config.period_s()),
            transports,
            operating: model::operating(&config, vehicle),
            limits: model::limits(&config, vehicle),
            cone: Cone::of(config.tilt_bound, config.tilt_max_rad),
            engine: IncrementalMpc::new(&model::design(&config, drag_per_s), config.solver)?,
            memory: Memory::at_trim(vehicle.weight_n()),
        })
    }

    /// One sample: measure, Δx, program, u(k) = u(k−1) + Δu(k), rotate by the heading.
    pub fn step(&mut self, input: &Input<'_>) -> Output {
        self.memory.counters.steps += 1;
        let is_another = self.follow_applied(input);
        if !is_finite(input) {
            return self.refuse();
        }
        let x = self.state(input);
        let now = self.measured(&x);
        let points = input.reference_w_m;
        let last = points.last().copied().unwrap_or_else(|| self.hold(&x));
        let [next, after] = [0, 1].map(|i| points.get(i).unwrap_or(&last));
        let period_s = self.config.period_s();
        let away = part(&x, 0) + part(&x, 1) * period_s - next;
        let velocity = part(&x, 1) - (after - next) / period_s;
        let beside = self.takeover.beside(&mut self.memory, away, velocity, is_another);
        let (transports, left) = (self.transports, self.takeover.left());
        // What a command of now can reach begins later by the periods that it is under way.
        let reference = |ahead: usize| {
            Vector3::from_fn(|i, _| {
                let j = ahead + transports[i].periods;
                points.get(j - 1).unwrap_or(&last)[i] + left[j] * beside[i]
            })
        };
        let [phi, theta, ..] = self.memory.setpoints[0];
        let coupled = self.cone.rows();
        let limits = Limits { coupled, ..self.limits_at(lift(phi, theta)) };
        let mut chosen = self.engine.step(&now, &self.operating, reference, &limits, None);

        let psi = input.gamma_rad.z;
        let (phi, theta) = angles_at(&chosen.u, psi);
        let lift = lift(phi, theta);
        self.bound_thrust(&mut chosen, lift);
        let setpoint = Setpoint {
            gamma_rad: Vector3::new(phi, theta, input.reference_yaw_rad),
            thrust_n: chosen.u.z / lift,
        };
        self.memory.heading_rad = psi;
        self.memory.hold_w_m = last.into();
        self.memory.setpoints.rotate_right(1);
        self.memory.setpoints[0] = <[f64; 4]>::from(setpoint);
        self.remember(&x, &chosen);
        self.output(&chosen, setpoint)
    }

    /// The limits where so much of the thrust carries, with what a vehicle that is caught needs.
    fn limits_at(&self, lift: f64) -> Limits<'static, 3> {
        let mut limits = self.limits;
        limits.inputs.u_min.z *= lift;
        limits.inputs.u_max.z *= lift;
        let rate = Takeover::tilt_rate(&self.memory);
        limits.inputs.du_max.x *= rate;
        limits.inputs.du_max.y *= rate;
        limits
    }

    /// The engine has bounded what carried at the tilt of before: brings it within the bounds at the tilt that it chose.
    fn bound_thrust(&self, chosen: &mut Move<3>, lift: f64) {
        if self.config.level_penalty.is_some() {
            return;
        }
        let limits = self.limits_at(lift).inputs;
        let before_n = chosen.u.z - chosen.du.z;
        chosen.u.z = chosen.u.z.clamp(limits.u_min.z, limits.u_max.z);
        chosen.du.z = chosen.u.z - before_n;
        if self.config.increment_penalty.is_none() {
            let beyond_n = chosen.du.z.abs() - limits.du_max.z;
            chosen.relaxation.z = chosen.relaxation.z.max(beyond_n);
        }
    }

    /// Brings the inputs as applied and the thrust copy to this sample; true if another controller's set point is applied.
    fn follow_applied(&mut self, input: &Input<'_>) -> bool {
        let memory = &mut self.memory;
        let foreign = input.applied.filter(|setpoint| {
            // The law's own command keeps its bits instead of being rotated there and back. One that is reported late is
            // still its own: what came after it is under way.
            !memory.setpoints.iter().any(|own| Setpoint::from(*own) == *setpoint)
                && setpoint.gamma_rad.iter().chain([&setpoint.thrust_n]).all(|v| v.is_finite())
        });
        let heading = if memory.commanded { memory.heading_rad } else { input.gamma_rad.z };
        let latest = foreign.map_or(Vector3::from(memory.command), |setpoint| {
            let gamma = &setpoint.gamma_rad;
            input_of(gamma.x, gamma.y, heading, setpoint.thrust_n)
        });
        if memory.commanded && (memory.primed || foreign.is_none()) {
            self.pass_period(latest);
        } else if heading.is_finite() {
            // A successor starts from what its predecessor left in effect, and one that has paused from what has been
            // applied meanwhile.
            memory.thrust_n = latest.z;
            memory.inputs = [latest.into(); HISTORY];
        }
        foreign.is_some()
    }

    /// Remembers that `latest` was commanded for this period, and what the thrust has become meanwhile.
    fn pass_period(&mut self, latest: Vector3<f64>) {
        let memory = &mut self.memory;
        memory.inputs.rotate_right(1);
        memory.inputs[0] = latest.into();
        let Transport { periods, axis } = &self.transports[2];
        let [acting, before] = [*periods, periods + 1].map(|late| memory.inputs[late][2]);
        let early = axis.actuator_after(memory.thrust_n, before, axis.delay_s);
        let rest = self.config.period_s() - axis.delay_s;
        memory.thrust_n = axis.actuator_after(early, acting, rest);
    }

    /// Takes u(k−1) from another controller, whose set point the attitude loop last applied. For each
    /// sample before its step, while another one flies.
    ///
    /// An attitude loop that is no faster than this one, or receives a set point late, still reports
    /// u(k−1−`late`). It is carried on by the increments that this law chose since.
    ///
    /// Where the other one leaves the vehicle up to 0.2 m beside the reference, the law returns to it along a path that
    /// fades with a time constant of half a second, so that neither set point nor vehicle jumps when it takes over.
    pub fn track(&mut self, applied: &Setpoint, late: usize) {
        self.memory.tracks = true;
        let gamma = &applied.gamma_rad;
        let numbers = gamma.iter().chain([&applied.thrust_n]);
        if !self.memory.commanded || !numbers.into_iter().all(|value| value.is_finite()) {
            // The first step starts from what is applied anyway.
            return;
        }
        let memory = &mut self.memory;
        let given = [gamma.x, gamma.y, gamma.z, applied.thrust_n];
        let late = late.min(HISTORY - 1);
        let own = memory.setpoints[late];
        // By how much it differs from what this law would have flown.
        let seen = |[phi, theta, _, thrust_n]: [f64; 4]| {
            input_of(phi, theta, memory.heading_rad, thrust_n)
        };
        let apart = seen(given) - seen(own);
        let [phi, theta, _, thrust] = core::array::from_fn(|i| given[i] - own[i]);
        memory.command = (Vector3::from(memory.command) + apart).into();
        memory.setpoints[late] = given;
        for later in &mut memory.setpoints[..late] {
            *later = [later[0] + phi, later[1] + theta, gamma.z, later[3] + thrust];
        }
    }

    /// Points of the reference that a step uses: Np, and those of the periods that a set point is under way.
    #[must_use]
    pub fn look_ahead(&self) -> usize {
        self.takeover.look_ahead()
    }

    fn state(&self, input: &Input<'_>) -> State {
        let age = input.age_s.clamp(0.0, self.config.period_s());
        let gamma = &input.gamma_rad;
        let tilt = input_of(gamma.x, gamma.y, gamma.z, 0.0);
        let mut x = State::zeros();
        let position = input.position_w_m + input.velocity_w_m_s * age;
        x.fixed_rows_mut::<3>(0).copy_from(&position);
        x.fixed_rows_mut::<3>(3).copy_from(&input.velocity_w_m_s);
        x.fixed_rows_mut::<3>(6).copy_from_slice(&[tilt.x, tilt.y, self.memory.thrust_n]);
        x.fixed_rows_mut::<3>(9).copy_from_slice(&self.memory.inputs[0]);
        x
    }

    /// Δx, y and u(k−1) at the sample at which a command of now begins to act, axis by axis.
    ///
    /// The gain of position is that of the velocity and not the difference of two estimates of position: the prediction
    /// takes it for a motion that goes on over the whole look-ahead, and a pose fix after a drop-out makes that
    /// difference a step. Where there is no sample k−1 the velocity has not changed.
    fn measured(&self, x: &State) -> Measured<3> {
        let Memory { primed, state, inputs, .. } = &self.memory;
        let before = if *primed { State::from(*state) } else { *x };
        let increment = x - before;
        let mean_rate = (part(x, 1) + part(&before, 1)) * 0.5;
        let mut now = Measured {
            output: part(x, 0),
            output_increment: mean_rate * self.config.period_s(),
            rate: part(x, 1),
            rate_increment: part(&increment, 1),
            actuator_increment: part(&increment, 2),
            input_increment: part(&increment, 3),
            u_previous: part(x, 3),
        };
        for (i, transport) in
            self.transports.iter().enumerate().filter(|(_, transport)| transport.periods > 0)
        {
            let gain = self.operating.gain[i];
            let move_at = |late: usize| gain * (inputs[late][i] - inputs[late + 1][i]);
            let actuator = gain * now.actuator_increment[i];
            let acting = if *primed { move_at(transport.periods) } else { 0.0 };
            let mut z = [now.output_increment[i], now.rate_increment[i], actuator, acting];
            let gained = transport.carry(&mut z, move_at, self.config.period_s());
            now.output[i] += gained[0];
            now.rate[i] += gained[1];
            now.output_increment[i] = z[0];
            now.rate_increment[i] = z[1];
            now.actuator_increment[i] = z[2] / gain;
            now.input_increment[i] = z[3] / gain;
        }
        now
    }

    /// Where to stay when no reference is given: the last point of the last one.
    fn hold(&self, x: &State) -> Vector3<f64> {
        if self.memory.commanded {
            self.memory.hold_w_m.into()
        } else {
            x.fixed_rows::<3>(0).into_owned()
        }
    }

    fn remember(&mut self, x: &State, chosen: &Move<3>) {
        let memory = &mut self.memory;
        memory.primed = true;
        memory.commanded = true;
        memory.state = (*x).into();
        memory.command = chosen.u.into();
        self.engine.pack_working_set(&mut memory.working_set);
        memory.counters.fallbacks += u64::from(chosen.is_fallback());
        memory.counters.relaxed += u64::from(chosen.relaxation.max() > 0.0);
    }

    fn output(&self, chosen: &Move<3>, setpoint: Setpoint) -> Output {
        let bounds = self.limits_at(lift(setpoint.gamma_rad.x, setpoint.gamma_rad.y)).inputs;
        // Soft bounds bind nothing.
        let level = self.config.level_penalty.is_none();
        let step = self.config.increment_penalty.is_none();
        let endless = Vector3::repeat(f64::INFINITY);
        Output {
            setpoint,
            status: chosen.status.into(),
            command: chosen.u,
            command_min: if level { bounds.u_min } else { -endless },
            command_max: if level { bounds.u_max } else { endless },
            increment_bound: if step { bounds.du_max + chosen.relaxation } else { endless },
            relaxation: chosen.relaxation,
            violation: chosen.violation,
            iterations: chosen.iterations,
            active: chosen.active,
            yielded: chosen.yielded,
        }
    }

    /// Holds the last setpoint; the next good sample starts with Δx = 0.
    fn refuse(&mut self) -> Output {
        self.memory.counters.refused += 1;
        self.memory.primed = false;
        let setpoint = Setpoint::from(self.memory.setpoints[0]);
        let held = Move {
            u: self.memory.command.into(),
            du: Vector3::zeros(),
            relaxation: Vector3::zeros(),
            violation: 0.0,
            status: QpStatus::NotFinite,
            iterations: 0,
            active: 0,
            yielded: 0,
        };
        Output { status: LawStatus::Refused(Refusal::NotFinite), ..self.output(&held, setpoint) }
    }

    /// True if it has commanded, and not at the sample before.
    #[must_use]
    pub fn has_paused(&self) -> bool {
        self.memory.commanded && !self.memory.primed
    }

    /// So many samples without a step, for want of a usable estimate or of time: the last command stays in effect
    /// meanwhile, and the next step starts with Δx = 0.
    pub fn leave_out(&mut self, samples: u64) {
        self.memory.primed = false;
        if !self.memory.commanded {
            return;
        }
        for _ in 0..samples.min(HISTORY as u64) {
            self.pass_period(self.memory.command.into());
            self.memory.setpoints.rotate_right(1);
            self.memory.setpoints[0] = self.memory.setpoints[1];
        }
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

/// Three of the numbers of x: position, velocity, actuators or u(k−1).
fn part(x: &State, i: usize) -> Vector3<f64> {
    x.fixed_rows::<3>(3 * i).into_owned()
}

fn is_finite(input: &Input<'_>) -> bool {
    let vectors = [&input.position_w_m, &input.velocity_w_m_s, &input.gamma_rad];
    let points = vectors.into_iter().chain(input.reference_w_m);
    points.flatten().chain([&input.age_s, &input.reference_yaw_rad]).all(|v| v.is_finite())
}
