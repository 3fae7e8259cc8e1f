//! Which commands may reach the rotors, whichever process writes them.

use vehicle::{MorphAngle, VehicleParameters, Wrench};

use super::config::GateConfig;

/// How far beyond what the laws of its slot ask for an unproven owner may go, as a share: they have measured the
/// arms a few milliseconds before.
const BEYOND_LAW: f64 = 0.05;

/// Commands at a bound must not fail by the rounding of a solver, whose residuals are below 1e-8.
const SLACK: f64 = 1e-6;

/// A wrench command.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Command {
    /// Commanded wrench.
    pub wrench: Wrench,
    /// Logical instant from which it is in effect \[ns\].
    pub effective_ns: u64,
    /// How long it stays valid from then on \[ns\]: two control periods.
    pub validity_ns: u64,
}

shared_types::memory! {
    /// What happened since start. The sums never go back.
    #[derive(PartialEq, Eq)]
    pub struct GateCounters {
        /// Commands refused because their writer has no seat in the slot.
        pub refused_wrong_owner: u64,
        /// Commands refused because a number was not finite.
        pub refused_not_finite: u64,
        /// Commands refused because they ask for more than the rotors can ever give.
        pub refused_out_of_range: u64,
        /// Commands refused because they were not yet in effect or no longer valid.
        pub refused_out_of_time: u64,
        /// Commands of an owner that has not proven itself, reduced to what the laws of its slot may ask for.
        pub reduced: u64,
        /// Inertial readings ignored because they were not finite or beyond any sensor.
        pub bad_readings: u64,
        /// Times the gate left [`Mode::Normal`](super::Mode::Normal), each counted once however long it
        /// lasted.
        pub safe_mode_episodes: u64,
    }
}

/// What an owner that has not proven itself is held to, until its monitor can trip it: what the laws of its slot may
/// ask of the rotors, which turns the vehicle about half as far as the rotors could, and a tilt.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UnprovenRange {
    /// The vehicle as its controllers believe it to be.
    pub believed: VehicleParameters,
    /// Least and largest thrust \[N\].
    pub thrust_n: [f64; 2],
    /// Tilt beyond which it may not take the vehicle \[rad\]: the gate levels it while that still keeps it below.
    pub tilt_rad: f64,
}

impl UnprovenRange {
    /// Largest angular acceleration that it allows about an axis across z \[rad/s²\]: roll and pitch at their bounds.
    pub(super) fn turning_rad_s2(&self, beta: MorphAngle) -> f64 {
        let most_nm = self.believed.torque_bound_nm(beta, self.believed.weight_n()).xy();
        let alpha = most_nm.component_div(&self.believed.inertia_kg_m2(beta).xy());
        (1.0 + BEYOND_LAW) * libm::hypot(alpha.x, alpha.y)
    }

    /// A finite wrench within the range at `beta`; one that is in it keeps its bits.
    pub(super) fn within(&self, wrench: &Wrench, beta: MorphAngle) -> Wrench {
        let [least_n, most_n] = self.thrust_n;
        let thrust_n = wrench.thrust_n.clamp(least_n, most_n);
        let most_nm = self.believed.torque_bound_nm(beta, thrust_n) * (1.0 + BEYOND_LAW);
        let within = wrench.torque_b_nm.zip_map(&most_nm, |torque, most| torque.clamp(-most, most));
        Wrench { thrust_n, torque_b_nm: within }
    }
}

/// Why a command is refused; of several reasons the first in this order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Refusal {
    WrongOwner,
    NotFinite,
    OutOfRange,
    OutOfTime,
}

impl GateCounters {
    pub(super) fn refuse(&mut self, refusal: Refusal) {
        let counter = match refusal {
            Refusal::WrongOwner => &mut self.refused_wrong_owner,
            Refusal::NotFinite => &mut self.refused_not_finite,
            Refusal::OutOfRange => &mut self.refused_out_of_range,
            Refusal::OutOfTime => &mut self.refused_out_of_time,
        };
        *counter += 1;
    }
}

/// What rotors can ever give, whatever the arms do.
#[derive(Debug, Clone, Copy)]
pub(super) struct CommandRange {
    thrust_max: f64,
    torque_max: [f64; 3],
    validity_max_ns: u64,
}

impl CommandRange {
    pub(super) fn new(config: &GateConfig, vehicle: &VehicleParameters) -> Self {
        // L(β) by the degree: a replaced law may peak inside the range.
        let arm = (45..=160)
            .filter_map(|degrees| MorphAngle::from_degrees(f64::from(degrees)).ok())
            .map(|beta| vehicle.geometry.arm_length_m(beta))
            .fold(0.0, f64::max);
        let factor = config.torque_range_factor * vehicle.rotor_thrust_max_n;
        Self {
            thrust_max: config.thrust_range_weights * vehicle.weight_n(),
            // eq. (1): |τx| ≤ L F, |τy| ≤ L F, |τz| ≤ 2 k F with each rotor in [0, F].
            torque_max: [arm, arm, 2.0 * vehicle.yaw_coefficient_m].map(|lever| lever * factor),
            validity_max_ns: config.validity_max_ns(),
        }
    }

    /// End of the command's validity; an absurd validity counts as the longest allowed.
    pub(super) fn valid_until_ns(&self, command: &Command) -> u64 {
        command.effective_ns.saturating_add(command.validity_ns.min(self.validity_max_ns))
    }

    /// The command as it may be applied from `now_ns` on.
    pub(super) fn judge(&self, command: &Command, now_ns: u64) -> Result<Command, Refusal> {
        let Wrench { thrust_n, torque_b_nm } = command.wrench;
        if !command.wrench.is_finite() {
            return Err(Refusal::NotFinite);
        }
        let slack = SLACK * self.thrust_max;
        let thrust_in_range = (-slack..=self.thrust_max + slack).contains(&thrust_n);
        let torque_in_range = torque_b_nm
            .iter()
            .zip(&self.torque_max)
            .all(|(torque, max)| torque.abs() <= max * (1.0 + SLACK));
        if !(thrust_in_range && torque_in_range) {
            return Err(Refusal::OutOfRange);
        }
        let begun = command.effective_ns <= now_ns;
        let ended = self.valid_until_ns(command) <= now_ns;
        if !begun || ended {
            return Err(Refusal::OutOfTime);
        }
        let validity_ns = command.validity_ns.min(self.validity_max_ns);
        Ok(Command { wrench: self.within(&command.wrench), validity_ns, ..*command })
    }

    /// A finite wrench within what rotors can ever give; one in range keeps its torque's bits.
    pub(super) fn within(&self, wrench: &Wrench) -> Wrench {
        let mut torque_b_nm = wrench.torque_b_nm;
        for (torque, max) in torque_b_nm.iter_mut().zip(&self.torque_max) {
            let most = max * (1.0 + SLACK);
            *torque = torque.clamp(-most, most);
        }
        Wrench { thrust_n: wrench.thrust_n.clamp(0.0, self.thrust_max), torque_b_nm }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;

    fn good() -> Command {
        Command {
            wrench: Wrench { thrust_n: 1.0, torque_b_nm: Vector3::new(0.01, -0.01, 0.001) },
            effective_ns: 1000,
            validity_ns: 20_000_000,
        }
    }

    fn with(thrust_n: f64, torque: [f64; 3]) -> Command {
        Command { wrench: Wrench { thrust_n, torque_b_nm: torque.into() }, ..good() }
    }

    fn verdict(command: &Command) -> Result<Wrench, Refusal> {
        let vehicle = VehicleParameters::default();
        let judged = CommandRange::new(&GateConfig::default(), &vehicle).judge(command, 1000);
        judged.map(|command| command.wrench)
    }

    #[test]
    fn a_command_within_range_passes_unchanged() {
        assert_eq!(verdict(&good()), Ok(good().wrench));
    }

    #[test]
    fn each_component_that_is_not_finite_is_refused() {
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert_eq!(verdict(&with(bad, [0.0; 3])), Err(Refusal::NotFinite));
            for axis in 0..3 {
                let mut torque = [0.0; 3];
                torque[axis] = bad;
                assert_eq!(verdict(&with(1.0, torque)), Err(Refusal::NotFinite));
            }
        }
    }

    #[test]
    fn what_four_rotors_at_their_limits_make_passes_and_any_more_is_refused() {
        let vehicle = VehicleParameters::default();
        let rotors = vehicle.allocator(MorphAngle::MAX);
        let full = vehicle.rotor_thrust_max_n;
        let extremes = [
            [full; 4],
            [0.0; 4],
            [0.0, full, 0.0, 0.0],
            [0.0, 0.0, 0.0, full],
            [full, 0.0, 0.0, 0.0],
            [0.0, 0.0, full, 0.0],
            [full, 0.0, full, 0.0],
            [0.0, full, 0.0, full],
        ];
        for thrusts in extremes {
            let wrench = rotors.wrench(&thrusts);
            assert_eq!(verdict(&Command { wrench, ..good() }), Ok(wrench));
            let torque_b_nm = wrench.torque_b_nm * 1.001;
            let thrust_n = if wrench.torque_b_nm.norm() > 0.0 {
                wrench.thrust_n
            } else {
                wrench.thrust_n * 1.001 - 0.001
            };
            let beyond = Command { wrench: Wrench { thrust_n, torque_b_nm }, ..good() };
            assert_eq!(verdict(&beyond), Err(Refusal::OutOfRange), "{thrusts:?}");
        }
    }

    #[test]
    fn rounding_at_the_bounds_passes_and_never_turns_a_rotor_backwards() {
        let passed = verdict(&with(-1e-12, [0.0; 3])).map(|wrench| wrench.thrust_n);
        assert_eq!(passed, Ok(0.0));
    }

    #[test]
    fn future_and_expired_commands_are_refused() {
        let at = |effective_ns, validity_ns| Command { effective_ns, validity_ns, ..good() };
        assert_eq!(verdict(&at(1001, 100)), Err(Refusal::OutOfTime));
        assert_eq!(verdict(&at(900, 100)), Err(Refusal::OutOfTime));
        assert!(verdict(&at(500, 10_000)).is_ok());
    }

    #[test]
    fn an_absurd_validity_does_not_hold_a_command_for_ever() {
        let range = CommandRange::new(&GateConfig::default(), &VehicleParameters::default());
        let endless = Command { validity_ns: u64::MAX, ..good() };
        let judged = range.judge(&endless, 1000).map(|command| command.validity_ns);
        assert_eq!(judged, Ok(200_000_000));
        assert_eq!(range.valid_until_ns(&endless), 1000 + 200_000_000);
    }
}
