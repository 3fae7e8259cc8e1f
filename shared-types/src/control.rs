//! Controllers' arrows: position slot -> attitude slot -> plant, and what they report.

use crate::{Flag, Header, sample};
use iceoryx2::prelude::ZeroCopySend;

sample! {
    /// Target handed to the attitude loop. Euler angles are intrinsic z-y-x.
    pub struct AttitudeSetpoint {
        /// Identity and time.
        pub header: Header,
        /// Collective thrust \[N\].
        pub thrust_n: f64,
        /// Roll `φ_d` \[rad\].
        pub roll_rad: f64,
        /// Pitch `θ_d` \[rad\].
        pub pitch_rad: f64,
        /// Yaw `ψ_d` \[rad\].
        pub yaw_rad: f64,
    }
}

sample! {
    /// Set point that the attitude slot's owner actually tracks.
    pub struct AppliedSetpoint {
        /// Identity and time.
        pub header: Header,
        /// Sequence of the set point sample in use; 0 before the first.
        pub setpoint_sequence: u64,
        /// Epoch of the position slot's owner record in effect; 0 before the first.
        pub epoch: u64,
        /// Epoch of the last owner record refused because it came too late; 0 for none.
        pub refused_epoch: u64,
        /// Collective thrust \[N\].
        pub thrust_n: f64,
        /// Roll \[rad\].
        pub roll_rad: f64,
        /// Pitch \[rad\].
        pub pitch_rad: f64,
        /// Yaw \[rad\].
        pub yaw_rad: f64,
        /// Seat whose set points count: the owner's, or after a fail-over the fallback's;
        /// [`NO_SEAT`](crate::NO_SEAT) before the first record.
        pub seat: u32,
        /// The fallback gives the set points, until the next epoch.
        pub failed_over: Flag,
    }
}

sample! {
    /// Wrench asked of the rotors.
    pub struct WrenchCommand {
        /// Identity and time.
        pub header: Header,
        /// Collective thrust along body z \[N\].
        pub thrust_n: f64,
        /// Torque about the body axes \[N m\].
        pub torque_b_nm: [f64; 3],
        /// How long past its effective instant the command stays valid \[ns\].
        pub validity_ns: u64,
    }
}

crate::code! {
    /// Verdict of the optimiser behind a command.
    pub enum SolveStatus {
        /// Optimal to tolerance.
        Solved = 0,
        /// Iteration cap hit; the first move was clipped into its bounds.
        IterationLimit = 1,
        /// No feasible point; the first move was clipped into its bounds.
        Infeasible = 2,
        /// Input was not finite; the previous command was kept.
        NotFinite = 3,
        /// Outside the model's domain; the previous command was kept.
        Refused = 4,
    }
}

sample! {
    /// What an incremental controller commanded and the bounds it obeyed, in its own coordinates:
    /// (τx, τy, τz) \[N m\] for attitude, (θ, φ, T) [rad, rad, N] in the ψ = 0 frame for position.
    pub struct ControllerReport {
        /// Identity and time.
        pub header: Header,
        /// Commanded input u(k).
        pub input: [f64; 3],
        /// Previous input u(k-1), as the controller used it.
        pub previous_input: [f64; 3],
        /// Lower bound on u(k).
        pub input_min: [f64; 3],
        /// Upper bound on u(k).
        pub input_max: [f64; 3],
        /// Bound on |Δu(k)|, relaxation included.
        pub increment_max: [f64; 3],
        /// By how much the increment bound was relaxed because the input bounds shrank.
        pub relaxation: [f64; 3],
        /// Collective thrust that went with u(k) \[N\]; attitude only.
        pub thrust_n: f64,
        /// Arm length \[m\] in the bounds; attitude only.
        pub arm_length_m: f64,
        /// Rotor torque per thrust \[m\] in the bounds; attitude only.
        pub yaw_coefficient_m: f64,
        /// Bound on each rotor's thrust \[N\]; infinite or 0 if rotors are not bounded here.
        pub rotor_thrust_max_n: f64,
        /// Steps so far whose move was clipped because the solver did not finish.
        pub fallbacks: u64,
        /// Steps so far that were refused.
        pub refused: u64,
        /// Iterations of the optimiser.
        pub iterations: u64,
        /// Active constraints at the solution.
        pub active_constraints: u64,
        /// Verdict.
        pub status: SolveStatus,
        /// Rows of soft constraints that the solution leaves, by more than a millionth of what they
        /// allow.
        pub yielded: u32,
    }
}

impl ControllerReport {
    /// Largest amount by which u(k) or Δu(k) leaves its bounds, in input units; 0 if inside,
    /// infinite if the command is not finite.
    #[must_use]
    pub fn worst_violation(&self) -> f64 {
        if !self.input.iter().all(|u| u.is_finite()) {
            return f64::INFINITY;
        }
        (0..3)
            .map(|i| {
                let increment = (self.input[i] - self.previous_input[i]).abs();
                (self.input_min[i] - self.input[i])
                    .max(self.input[i] - self.input_max[i])
                    .max(increment - self.increment_max[i])
            })
            .fold(self.worst_rotor_violation(), f64::max)
    }

    /// Largest amount \[N\] by which a rotor's share of thrust and torque leaves its bounds.
    fn worst_rotor_violation(&self) -> f64 {
        let most = self.rotor_thrust_max_n;
        if !(most > 0.0 && most.is_finite()) || self.status == SolveStatus::Refused {
            return 0.0;
        }
        let roll = self.input[0] / (2.0 * self.arm_length_m);
        let pitch = self.input[1] / (2.0 * self.arm_length_m);
        let yaw = self.input[2] / (4.0 * self.yaw_coefficient_m);
        let share = 0.25 * self.thrust_n;
        [share - yaw - pitch, share + yaw + roll, share - yaw + pitch, share + yaw - roll]
            .into_iter()
            .map(|thrust| (-thrust).max(thrust - most))
            .fold(
                0.0,
                |worst, excess| if excess.is_nan() { f64::INFINITY } else { worst.max(excess) },
            )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// T = 1 N on arms of 0.1 m with k = 0.02 m; one newton per rotor at most.
    fn report(input: [f64; 3]) -> ControllerReport {
        ControllerReport {
            input,
            input_min: [-1.0; 3],
            input_max: [1.0; 3],
            increment_max: [1.0; 3],
            thrust_n: 1.0,
            arm_length_m: 0.1,
            yaw_coefficient_m: 0.02,
            rotor_thrust_max_n: 1.0,
            ..ControllerReport::default()
        }
    }

    #[test]
    fn a_rotor_beyond_its_bound_is_a_violation_in_newtons() {
        // By (1): the left rotor has T/4 + roll/2L + yaw/4k, the right one T/4 − roll/2L + yaw/4k.
        assert!(report([0.05, 0.0, 0.0]).worst_violation() < 1e-12);
        assert!((report([0.06, 0.0, 0.0]).worst_violation() - 0.05).abs() < 1e-12);
        assert!((report([0.05, 0.0, 0.008]).worst_violation() - 0.0).abs() < 1e-12);
        assert!((report([0.05, 0.0, -0.008]).worst_violation() - 0.1).abs() < 1e-12);
        let unbounded =
            ControllerReport { rotor_thrust_max_n: f64::INFINITY, ..report([0.06, 0.0, 0.0]) };
        assert!(unbounded.worst_violation() <= 0.0);
        let lost = ControllerReport { thrust_n: f64::NAN, ..report([0.0; 3]) };
        assert!(lost.worst_violation().is_infinite());
    }
}
