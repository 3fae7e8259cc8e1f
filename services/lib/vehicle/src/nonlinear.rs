//! The vehicle as the plant flies it: nonlinear rigid body, rotor lag, morph servo, drag, ground.

use nalgebra::{UnitQuaternion, Vector3};

use crate::actuators::{Morph, ServoPath, lagged_thrusts};
use crate::dynamics::{ActuatorSample, Surroundings};
use crate::integrator::{RigidBody, Stage, rk4};
use crate::{
    Actuation, Disturbance, GroundContact, MODEL_MEMORY_LEN, MorphAngle, ParameterError,
    PlantInputs, PlantModel, RigidBodyState, StepStatus, Truth, VehicleParameters,
};

/// Longest step \[s\]: beyond it the ground contact of the smallest arms is no longer stable.
pub const MAX_NONLINEAR_STEP_S: f64 = 2e-3;

/// Nonlinear plant, RK4 with a fixed step.
#[derive(Debug, Clone)]
pub struct NonlinearModel {
    parameters: VehicleParameters,
    ground: Option<GroundContact>,
    state: RigidBodyState,
}

impl NonlinearModel {
    /// A vehicle at `state`, over `ground` or over none.
    ///
    /// # Errors
    /// A parameter of the vehicle or of the ground that no vehicle can have, or a state that is not
    /// finite.
    pub fn new(
        parameters: VehicleParameters,
        ground: Option<GroundContact>,
        state: RigidBodyState,
    ) -> Result<Self, ParameterError> {
        parameters.validate()?;
        ground.as_ref().map_or(Ok(()), GroundContact::validate)?;
        state.validate()?;
        Ok(Self { parameters, ground, state })
    }

    /// The state now.
    #[must_use]
    pub fn state(&self) -> &RigidBodyState {
        &self.state
    }

    /// The vehicle's parameters.
    #[must_use]
    pub fn parameters(&self) -> &VehicleParameters {
        &self.parameters
    }

    fn surroundings<'a>(&'a self, disturbance: &'a Disturbance) -> Surroundings<'a> {
        Surroundings { parameters: &self.parameters, ground: self.ground.as_ref(), disturbance }
    }

    fn body(&self) -> RigidBody {
        RigidBody {
            position_w: self.state.position_w,
            velocity_w: self.state.velocity_w,
            q: self.state.q_wb.into_inner(),
            omega_b: self.state.omega_b,
        }
    }

    /// Commanded thrusts within the rotors' limits; a wrench is allocated for the present arms.
    fn commanded_thrusts(&self, actuation: &Actuation) -> Option<[f64; 4]> {
        match actuation {
            Actuation::Rotors(thrusts) => {
                Some(thrusts.map(|f| f.clamp(0.0, self.parameters.rotor_thrust_max_n)))
            }
            Actuation::Wrench(wrench) => self
                .parameters
                .allocator(self.state.beta)
                .allocate(wrench)
                .map(|allocation| allocation.rotor_thrust_n),
        }
    }

    fn actuators(&self, morph: Morph, thrusts: &[f64; 4], efficiency: &[f64; 4]) -> ActuatorSample {
        let p = &self.parameters;
        let produced = std::array::from_fn(|i| thrusts[i] * efficiency[i]);
        let allocator = p.allocator(morph.beta);
        ActuatorSample {
            wrench: allocator.wrench(&produced),
            arm_length: allocator.arm_length_m,
            inertia: p.inertia_kg_m2(morph.beta),
            inertia_rate: p.inertia_slope_kg_m2_rad(morph.beta) * morph.rate,
        }
    }
}

impl PlantModel for NonlinearModel {
    /// `dt_s` in (0, [`MAX_NONLINEAR_STEP_S`]].
    fn step(&mut self, dt_s: f64, inputs: &PlantInputs) -> StepStatus {
        if !(dt_s > 0.0 && dt_s <= MAX_NONLINEAR_STEP_S && inputs.is_usable()) {
            return StepStatus::BadInput;
        }
        let morph_command = MorphAngle::saturating_from_rad(inputs.morph_command_rad);
        let commands = self.commanded_thrusts(&inputs.actuation).zip(morph_command);
        let Some((thrust_command, morph_command)) = commands else {
            return StepStatus::BadInput;
        };

        let servo = ServoPath::new(&self.parameters, self.state.beta, morph_command);
        let share = |t: f64| -libm::expm1(-t / self.parameters.rotor_lag_s);
        let thrusts_at =
            |t: f64| lagged_thrusts(&self.state.rotor_thrust_n, &thrust_command, share(t));
        let efficiency = &inputs.disturbance.rotor_efficiency;
        let sample = |t: f64| self.actuators(servo.at(t), &thrusts_at(t), efficiency);
        let (start, middle, end) = (sample(0.0), sample(0.5 * dt_s), sample(dt_s));

        let surroundings = self.surroundings(&inputs.disturbance);
        let body = rk4(&self.body(), dt_s, |stage, body| {
            let actuators = match stage {
                Stage::Start => &start,
                Stage::Middle => &middle,
                Stage::End => &end,
            };
            surroundings.acceleration(actuators, body)
        });
        let morph = servo.at(dt_s);
        let next = RigidBodyState {
            position_w: body.position_w,
            velocity_w: body.velocity_w,
            q_wb: UnitQuaternion::new_unchecked(body.q),
            omega_b: body.omega_b,
            rotor_thrust_n: thrusts_at(dt_s),
            beta: morph.beta,
            beta_rate_rad_s: morph.rate,
        };
        if next.to_array().iter().any(|x| !x.is_finite()) {
            return StepStatus::Diverged;
        }
        self.state = next;
        StepStatus::Advanced
    }

    fn truth(&self, inputs: &PlantInputs) -> Truth {
        let calm = Disturbance::default();
        let disturbance = if inputs.disturbance.is_usable() { &inputs.disturbance } else { &calm };
        let s = &self.state;
        let morph = Morph { beta: s.beta, rate: s.beta_rate_rad_s };
        let actuators = self.actuators(morph, &s.rotor_thrust_n, &disturbance.rotor_efficiency);
        let a = self.surroundings(disturbance).acceleration(&actuators, &self.body());
        let gravity = Vector3::new(0.0, 0.0, self.parameters.gravity_m_s2);
        Truth {
            state: *s,
            wrench: actuators.wrench,
            acceleration_w_m_s2: a.linear_w,
            specific_force_b_m_s2: s.q_wb.inverse_transform_vector(&(a.linear_w + gravity)),
            angular_acceleration_b_rad_s2: a.angular_b,
        }
    }

    fn memory(&self) -> [f64; MODEL_MEMORY_LEN] {
        self.state.to_array()
    }

    fn restore(&mut self, memory: &[f64; MODEL_MEMORY_LEN]) -> Option<()> {
        self.state = RigidBodyState::from_array(memory)?;
        Some(())
    }
}
