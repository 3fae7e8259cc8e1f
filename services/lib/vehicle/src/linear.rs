//! The paper's own plant, (3) and (6): two double integrators that take the wrench directly, for
//! reproducing its tests. No rotor lag, no drag, no ground.

use nalgebra::Vector3;

use crate::actuators::ServoPath;
use crate::{
    Actuation, Disturbance, MODEL_MEMORY_LEN, MorphAngle, ParameterError, PlantInputs, PlantModel,
    RigidBodyState, StepStatus, Truth, VehicleParameters, Wrench, body_rate_matrix,
    euler_from_quaternion, euler_rate_matrix, quaternion_from_euler,
};

/// Linear plant, exact zero-order hold at a fixed β.
///
/// While β moves, a step holds the inertia of its middle. The body rate it shows is R₂⁻¹(γ) γ̇, so
/// that an observer that applies (5) gets back the γ̇ that (6) integrates.
#[derive(Debug, Clone)]
pub struct LinearModel {
    parameters: VehicleParameters,
    memory: Memory,
}

#[derive(Debug, Clone, Copy)]
struct Memory {
    position_w: Vector3<f64>,
    velocity_w: Vector3<f64>,
    gamma: Vector3<f64>,
    gamma_rate: Vector3<f64>,
    beta: MorphAngle,
    beta_rate: f64,
    /// In effect over the last step.
    wrench: Wrench,
}

/// p̈ and γ̈ of a step.
#[derive(Debug, Clone, Copy)]
struct Held {
    linear_w: Vector3<f64>,
    gamma: Vector3<f64>,
}

impl LinearModel {
    /// A vehicle at `state`; its rotor thrusts become the wrench last in effect.
    ///
    /// # Errors
    /// A parameter that no vehicle can have, a state that is not finite, or a pitch beyond the range of (5).
    pub fn new(
        parameters: VehicleParameters,
        state: &RigidBodyState,
    ) -> Result<Self, ParameterError> {
        parameters.validate()?;
        state.validate()?;
        let gamma = euler_from_quaternion(&state.q_wb);
        let remedy = "the linear plant starts below 1.2 rad of pitch";
        let r2 = euler_rate_matrix(&gamma).ok_or(ParameterError {
            name: "initial_pitch_rad",
            value: gamma.y,
            remedy,
        })?;
        let memory = Memory {
            position_w: state.position_w,
            velocity_w: state.velocity_w,
            gamma,
            gamma_rate: r2 * state.omega_b,
            beta: state.beta,
            beta_rate: state.beta_rate_rad_s,
            wrench: parameters.allocator(state.beta).wrench(&state.rotor_thrust_n),
        };
        Ok(Self { parameters, memory })
    }

    /// γ = (φ, θ, ψ) \[rad\], not wrapped.
    #[must_use]
    pub fn euler_rad(&self) -> Vector3<f64> {
        self.memory.gamma
    }

    /// γ̇ \[rad/s\].
    #[must_use]
    pub fn euler_rate_rad_s(&self) -> Vector3<f64> {
        self.memory.gamma_rate
    }

    /// A commanded wrench acts as it is; rotor thrusts act through M, with their efficiencies.
    fn wrench(&self, inputs: &PlantInputs) -> Wrench {
        match &inputs.actuation {
            Actuation::Wrench(wrench) => *wrench,
            Actuation::Rotors(thrusts) => {
                let efficiency = &inputs.disturbance.rotor_efficiency;
                let produced = std::array::from_fn(|i| thrusts[i] * efficiency[i]);
                self.parameters.allocator(self.memory.beta).wrench(&produced)
            }
        }
    }

    fn held(
        &self,
        wrench: &Wrench,
        d: &Disturbance,
        gamma: &Vector3<f64>,
        beta: MorphAngle,
    ) -> Held {
        let (m, g) = (self.parameters.mass_kg + d.payload_kg, self.parameters.gravity_m_s2);
        // [ẍ ÿ z̈] + [0 0 g] = [0 g 0; −g 0 0; 0 0 1/m] [φ θ T]   (3)
        let linear_w = Vector3::new(g * gamma.y, -g * gamma.x, wrench.thrust_n / m - g);
        // γ̈ = I⁻¹ τ   (6)
        let torque = wrench.torque_b_nm + d.torque_b_nm;
        Held {
            linear_w: linear_w + d.force_w_n / m,
            gamma: torque.component_div(&self.parameters.inertia_kg_m2(beta)),
        }
    }
}

impl PlantModel for LinearModel {
    /// Any finite `dt_s` above zero. Wind has no effect, (3) knows no drag.
    fn step(&mut self, dt_s: f64, inputs: &PlantInputs) -> StepStatus {
        let command = MorphAngle::saturating_from_rad(inputs.morph_command_rad);
        let (Some(command), true) = (command, dt_s > 0.0 && dt_s.is_finite() && inputs.is_usable())
        else {
            return StepStatus::BadInput;
        };
        let h = dt_s;
        let m = &self.memory;
        let wrench = self.wrench(inputs);
        let servo = ServoPath::new(&self.parameters, m.beta, command);
        let held = self.held(&wrench, &inputs.disturbance, &m.gamma, servo.at(0.5 * h).beta);
        let g = self.parameters.gravity_m_s2;
        // (3) is driven by γ, itself a parabola inside the step: its higher terms enter here.
        let tilt = |v: &Vector3<f64>| Vector3::new(g * v.y, -g * v.x, 0.0);
        let (jerk, snap) = (tilt(&m.gamma_rate), tilt(&held.gamma));
        let (h2, h3, h4) = (h * h / 2.0, h * h * h / 6.0, h * h * h * h / 24.0);
        let morph = servo.at(h);
        let next = Memory {
            position_w: m.position_w
                + m.velocity_w * h
                + held.linear_w * h2
                + jerk * h3
                + snap * h4,
            velocity_w: m.velocity_w + held.linear_w * h + jerk * h2 + snap * h3,
            gamma: m.gamma + m.gamma_rate * h + held.gamma * h2,
            gamma_rate: m.gamma_rate + held.gamma * h,
            beta: morph.beta,
            beta_rate: morph.rate,
            wrench,
        };
        if next.to_array().iter().any(|x| !x.is_finite()) {
            return StepStatus::Diverged;
        }
        self.memory = next;
        StepStatus::Advanced
    }

    fn truth(&self, inputs: &PlantInputs) -> Truth {
        let m = &self.memory;
        let (wrench, disturbance) = if inputs.is_usable() {
            (self.wrench(inputs), inputs.disturbance)
        } else {
            (m.wrench, Disturbance::default())
        };
        let held = self.held(&wrench, &disturbance, &m.gamma, m.beta);
        let q_wb = quaternion_from_euler(&m.gamma);
        let to_body = body_rate_matrix(&m.gamma);
        let gravity = Vector3::new(0.0, 0.0, self.parameters.gravity_m_s2);
        Truth {
            state: RigidBodyState {
                position_w: m.position_w,
                velocity_w: m.velocity_w,
                q_wb,
                omega_b: to_body * m.gamma_rate,
                rotor_thrust_n: self.parameters.allocator(m.beta).unlimited_thrusts(&wrench),
                beta: m.beta,
                beta_rate_rad_s: m.beta_rate,
            },
            wrench,
            acceleration_w_m_s2: held.linear_w,
            specific_force_b_m_s2: q_wb.inverse_transform_vector(&(held.linear_w + gravity)),
            angular_acceleration_b_rad_s2: to_body * held.gamma
                + body_rate_drift(&m.gamma, &m.gamma_rate),
        }
    }

    fn memory(&self) -> [f64; MODEL_MEMORY_LEN] {
        self.memory.to_array()
    }

    fn restore(&mut self, memory: &[f64; MODEL_MEMORY_LEN]) -> Option<()> {
        self.memory = Memory::from_array(memory)?;
        Some(())
    }
}

/// d(R₂⁻¹)/dt γ̇, the part of ω̇ that no torque makes.
fn body_rate_drift(gamma: &Vector3<f64>, rate: &Vector3<f64>) -> Vector3<f64> {
    let (sp, cp) = libm::sincos(gamma.x);
    let (st, ct) = libm::sincos(gamma.y);
    let (phi, theta, psi) = (rate.x, rate.y, rate.z);
    Vector3::new(
        -psi * ct * theta,
        -theta * sp * phi + psi * (cp * ct * phi - sp * st * theta),
        -theta * cp * phi - psi * (sp * ct * phi + cp * st * theta),
    )
}

impl Memory {
    fn to_array(self) -> [f64; MODEL_MEMORY_LEN] {
        let (p, v, g, r) = (self.position_w, self.velocity_w, self.gamma, self.gamma_rate);
        let (beta, beta_rate) = (self.beta.rad(), self.beta_rate);
        let (t, tau) = (self.wrench.thrust_n, self.wrench.torque_b_nm);
        [
            p.x, p.y, p.z, v.x, v.y, v.z, g.x, g.y, g.z, r.x, r.y, r.z, beta, beta_rate, t, tau.x,
            tau.y, tau.z, 0.0,
        ]
    }

    fn from_array(values: &[f64; MODEL_MEMORY_LEN]) -> Option<Self> {
        if values.iter().any(|v| !v.is_finite()) {
            return None;
        }
        let three = |i: usize| Vector3::new(values[i], values[i + 1], values[i + 2]);
        Some(Self {
            position_w: three(0),
            velocity_w: three(3),
            gamma: three(6),
            gamma_rate: three(9),
            beta: MorphAngle::from_rad(values[12]).ok()?,
            beta_rate: values[13],
            wrench: Wrench { thrust_n: values[14], torque_b_nm: three(15) },
        })
    }
}
