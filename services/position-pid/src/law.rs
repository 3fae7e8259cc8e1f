//! One step of the law.

use controller::heading::{angles_at, input_of};
use controller::preview::Target;
use controller::{Limited, OutOfRange, Setpoint, within};
use nalgebra::Vector3;
use vehicle::VehicleParameters;

/// Thrust is raised with the tilt up to this: cos 0.8, beyond which no set point goes.
const MIN_COSINE: f64 = 0.7;

/// The complete configuration of the law; gains for x, y and z.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PositionPidConfig {
    /// Control rate \[Hz\].
    pub rate_hz: f64,
    /// Velocity per position error \[1/s\].
    pub position_gain_s: [f64; 3],
    /// Acceleration per velocity error \[1/s\].
    pub velocity_gain_s: [f64; 3],
    /// Integral time of the velocity error \[s\].
    pub integral_s: [f64; 3],
    /// Largest velocity that a position error may ask for beside the reference's \[m/s\].
    pub speed_max_m_s: f64,
    /// How far ahead the reference's acceleration is taken \[s\].
    pub lead_s: f64,
    /// Time \[s\] in which the integral takes back what was not applied.
    pub windup_s: f64,
    /// Bound on |φ| and |θ| in the ψ = 0 frame \[rad\].
    pub tilt_max_rad: f64,
    /// Bound on their change in one sample \[rad\].
    pub tilt_step_max_rad: f64,
    /// Least and largest thrust over weight.
    pub thrust_weights: [f64; 2],
    /// Bound on the change of thrust over weight in one sample.
    pub thrust_step_max_weights: f64,
}

impl PositionPidConfig {
    fn validate(&self) -> Result<(), OutOfRange> {
        within("rate_hz", self.rate_hz, 1.0, 1000.0)?;
        for gain in self.position_gain_s {
            within("position_gain_s", gain, 1e-3, 1e3)?;
        }
        for gain in self.velocity_gain_s {
            within("velocity_gain_s", gain, 1e-3, 1e3)?;
        }
        for time_s in self.integral_s {
            within("integral_s", time_s, 1e-3, 1e6)?;
        }
        within("speed_max_m_s", self.speed_max_m_s, 1e-3, 1e3)?;
        within("lead_s", self.lead_s, 0.0, 0.5)?;
        within("windup_s", self.windup_s, 1e-3, 1e3)?;
        within("tilt_max_rad", self.tilt_max_rad, 0.01, 0.8)?;
        within("tilt_step_max_rad", self.tilt_step_max_rad, 1e-3, 1.6)?;
        within("thrust_min_weights", self.thrust_weights[0], 0.0, 1.0)?;
        within("thrust_max_weights", self.thrust_weights[1], 1.0, 4.0)?;
        within("thrust_step_max_weights", self.thrust_step_max_weights, 1e-3, 4.0)
    }
}

/// What the law knows at its sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Input {
    /// p \[m\] in W.
    pub position_w_m: Vector3<f64>,
    /// v \[m/s\] in W.
    pub velocity_w_m_s: Vector3<f64>,
    /// γ = (φ, θ, ψ) \[rad\].
    pub gamma_rad: Vector3<f64>,
    /// Time since these were valid \[s\].
    pub age_s: f64,
    /// The reference.
    pub target: Target,
    /// Set point in effect at the attitude loop just before this sample; `None` takes the law's own as
    /// applied.
    pub applied: Option<Setpoint>,
}

/// The set point and its bounds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Output {
    /// For the attitude loop.
    pub setpoint: Setpoint,
    /// (θ₀, φ₀, T) \[rad, rad, N\] in the ψ = 0 frame, in which the bounds hold.
    pub command: Limited,
    /// False if the last set point is held because the sample could not be used.
    pub is_new: bool,
}

shared_types::memory! {
    /// The law's whole evolving memory.
    #[derive(PartialEq)]
    pub struct Memory {
        /// False until a set point was commanded.
        pub commanded: bool,
        /// False before the first sample and after one that could not be used.
        pub primed: bool,
        /// Integral of the velocity error \[m/s²\] in W.
        pub integral_m_s2: [f64; 3],
        /// (θ₀, φ₀, T) as the law would have had it.
        pub wish: [f64; 3],
        /// Last command (θ₀, φ₀, T).
        pub command: [f64; 3],
        /// ψ \[rad\] by which it was rotated.
        pub heading_rad: f64,
        /// Last set point (φ, θ, ψ, T).
        pub setpoint: [f64; 4],
        /// The set point before it.
        pub previous_setpoint: [f64; 4],
        /// Samples refused because they were not finite.
        pub refused: u64,
    }
}

#[derive(Debug)]
pub struct PositionPidLaw {
    config: PositionPidConfig,
    mass_kg: f64,
    gravity_m_s2: f64,
    windup_share: f64,
    memory: Memory,
    tracking: bool,
}

impl PositionPidLaw {
    /// Hovering at trim.
    ///
    /// # Errors
    /// A number outside its range.
    pub fn new(config: PositionPidConfig, vehicle: &VehicleParameters) -> Result<Self, OutOfRange> {
        config.validate()?;
        let weight_n = vehicle.weight_n();
        let trim = [0.0, 0.0, weight_n];
        let setpoint = [0.0, 0.0, 0.0, weight_n];
        Ok(Self {
            config,
            mass_kg: vehicle.mass_kg,
            gravity_m_s2: vehicle.gravity_m_s2,
            windup_share: -libm::expm1(-1.0 / (config.rate_hz * config.windup_s)),
            memory: Memory {
                commanded: false,
                primed: false,
                integral_m_s2: [0.0; 3],
                wish: trim,
                command: trim,
                heading_rad: 0.0,
                setpoint,
                previous_setpoint: setpoint,
                refused: 0,
            },
            tracking: false,
        })
    }

    /// One sample: errors, acceleration, thrust and tilt, bounds, heading.
    pub fn step(&mut self, input: &Input) -> Output {
        let tracking = core::mem::take(&mut self.tracking);
        if !is_finite(input) {
            return self.refuse();
        }
        let previous = self.applied(input);
        self.take_back(&previous, tracking);
        let age = input.age_s.clamp(0.0, 1.0 / self.config.rate_hz);
        let velocity = input.velocity_w_m_s;
        let position = input.position_w_m + velocity * age;
        let wish =
            self.thrust_and_tilt(&self.acceleration(&position, &velocity, &input.target), input);
        self.integrate(&position, &velocity, &input.target);
        let [min, max, step] = self.bounds();
        let command = Limited::new(&wish, &previous, [&min, &max], &step);
        let psi = input.gamma_rad.z;
        let (phi, theta) = angles_at(&command.input, psi);
        let gamma_rad = Vector3::new(phi, theta, input.target.yaw_rad);
        let setpoint = Setpoint { gamma_rad, thrust_n: command.input.z };
        let memory = &mut self.memory;
        memory.wish = wish.into();
        memory.command = command.input.into();
        memory.heading_rad = psi;
        memory.previous_setpoint = memory.setpoint;
        memory.setpoint = [phi, theta, input.target.yaw_rad, command.input.z];
        (memory.commanded, memory.primed) = (true, true);
        Output { setpoint, command, is_new: true }
    }

    /// u(k−1), from the set point in effect if that is not the law's own.
    fn applied(&self, input: &Input) -> Vector3<f64> {
        let memory = &self.memory;
        // An attitude loop no faster than this one takes the last set point only now.
        let own = [memory.setpoint, memory.previous_setpoint].map(Setpoint::from);
        let foreign = input.applied.filter(|setpoint| {
            !(memory.commanded && own.contains(setpoint))
                && setpoint.gamma_rad.iter().chain([&setpoint.thrust_n]).all(|v| v.is_finite())
        });
        let heading = if memory.commanded { memory.heading_rad } else { input.gamma_rad.z };
        foreign.map_or(memory.command.into(), |setpoint| {
            let gamma = &setpoint.gamma_rad;
            input_of(gamma.x, gamma.y, heading, setpoint.thrust_n)
        })
    }

    /// Back-calculation [Astrom, Hagglund] 3.5: of what was wished at k−1 and not applied, by bounds or
    /// because another controller flies, the integral gives way; at once while tracking.
    fn take_back(&mut self, previous: &Vector3<f64>, tracking: bool) {
        let wish = if self.memory.primed {
            Vector3::from(self.memory.wish)
        } else if self.memory.commanded {
            return;
        } else {
            // A successor starts from what its predecessor left in effect.
            Vector3::new(0.0, 0.0, self.mass_kg * self.gravity_m_s2)
        };
        let share = if tracking || !self.memory.commanded { 1.0 } else { self.windup_share };
        let lacking = (previous - wish) * share;
        let g = self.gravity_m_s2;
        let acceleration = Vector3::new(g * lacking.x, -g * lacking.y, lacking.z / self.mass_kg);
        self.memory.integral_m_s2 =
            (Vector3::from(self.memory.integral_m_s2) + acceleration).into();
    }

    /// v of the set point − v \[m/s\].
    fn velocity_error(
        &self,
        position: &Vector3<f64>,
        velocity: &Vector3<f64>,
        target: &Target,
    ) -> Vector3<f64> {
        let most = self.config.speed_max_m_s;
        let gain = Vector3::from(self.config.position_gain_s);
        let asked = (target.position_w_m - position)
            .component_mul(&gain)
            .map(|speed| speed.clamp(-most, most));
        target.velocity_w_m_s + asked - velocity
    }

    fn acceleration(
        &self,
        position: &Vector3<f64>,
        velocity: &Vector3<f64>,
        target: &Target,
    ) -> Vector3<f64> {
        let gain = Vector3::from(self.config.velocity_gain_s);
        let error = self.velocity_error(position, velocity, target);
        target.acceleration_w_m_s2
            + error.component_mul(&gain)
            + Vector3::from(self.memory.integral_m_s2)
    }

    fn integrate(&mut self, position: &Vector3<f64>, velocity: &Vector3<f64>, target: &Target) {
        let gain = Vector3::from(self.config.velocity_gain_s);
        let rate = gain.component_div(&Vector3::from(self.config.integral_s)) / self.config.rate_hz;
        let error = self.velocity_error(position, velocity, target);
        let integral = Vector3::from(self.memory.integral_m_s2) + error.component_mul(&rate);
        self.memory.integral_m_s2 = integral.into();
    }

    /// The wish (θ₀, φ₀, T): the thrust along m (a + g e₃), and so much of it that the present tilt
    /// leaves its vertical part.
    fn thrust_and_tilt(&self, acceleration: &Vector3<f64>, input: &Input) -> Vector3<f64> {
        let g = self.gravity_m_s2;
        let lift = (acceleration.z + g).max(self.config.thrust_weights[0].max(0.1) * g);
        let cosine = libm::cos(input.gamma_rad.x) * libm::cos(input.gamma_rad.y);
        Vector3::new(
            libm::atan2(acceleration.x, lift),
            -libm::atan2(acceleration.y, lift),
            self.mass_kg * (acceleration.z + g) / cosine.max(MIN_COSINE),
        )
    }

    /// Least and largest u, and the largest |Δu|.
    fn bounds(&self) -> [Vector3<f64>; 3] {
        let (tilt, step) = (self.config.tilt_max_rad, self.config.tilt_step_max_rad);
        let weight = self.mass_kg * self.gravity_m_s2;
        let [least, most] = self.config.thrust_weights.map(|weights| weights * weight);
        [
            Vector3::new(-tilt, -tilt, least),
            Vector3::new(tilt, tilt, most),
            Vector3::new(step, step, self.config.thrust_step_max_weights * weight),
        ]
    }

    /// Holds the last set point.
    fn refuse(&mut self) -> Output {
        self.memory.refused += 1;
        self.memory.primed = false;
        let command = Limited::held(&self.memory.command.into());
        Output { setpoint: Setpoint::from(self.memory.setpoint), command, is_new: false }
    }

    /// A sample without a usable estimate: nothing is commanded.
    pub fn miss(&mut self) {
        self.memory.primed = false;
    }

    /// True if it has commanded, and not at the sample before.
    #[must_use]
    pub fn has_paused(&self) -> bool {
        self.memory.commanded && !self.memory.primed
    }

    /// Lets the next step continue from the set point that another controller has applied.
    pub fn track(&mut self) {
        self.tracking = true;
    }

    /// The whole evolving memory.
    #[must_use]
    pub fn memory(&self) -> &Memory {
        &self.memory
    }

    /// Takes over the memory of an instance with the same configuration; from here on both give the
    /// same bits.
    ///
    /// # Errors
    /// A number that is not finite; nothing is taken over then.
    pub fn restore(&mut self, memory: &Memory) -> Result<(), String> {
        let threes = [memory.integral_m_s2, memory.wish, memory.command];
        let fours = [memory.setpoint, memory.previous_setpoint];
        let numbers = threes.iter().flatten().chain(fours.iter().flatten());
        if !numbers.chain([&memory.heading_rad]).all(|number| number.is_finite()) {
            return Err("it holds a number that is not finite".to_owned());
        }
        self.memory = *memory;
        Ok(())
    }
}

fn is_finite(input: &Input) -> bool {
    let target = &input.target;
    let vectors = [
        &input.position_w_m,
        &input.velocity_w_m_s,
        &input.gamma_rad,
        &target.position_w_m,
        &target.velocity_w_m_s,
        &target.acceleration_w_m_s2,
    ];
    vectors.into_iter().flatten().chain([&input.age_s, &target.yaw_rad]).all(|v| v.is_finite())
}
