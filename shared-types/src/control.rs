//! Controllers' arrows: position slot -> attitude slot -> plant, and what they report.

use crate::{Flag, Header, Sample, sample};

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
        /// Sequence of the set point sample in use; 0 before the first, and where a backup law flies: the owner has
        /// tripped, or no set point has come any more.
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
        /// The fallback gives the set points: until the next epoch, after a trip for as long as `tripped`.
        pub failed_over: Flag,
        /// The owner has tripped: true until a record names another owner or fallback.
        pub tripped: Flag,
        /// Keeps the size a multiple of eight bytes.
        #[padding]
        pub reserved: u32,
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
    /// What finding a step's input took, and how it ended.
    pub struct SolveReport {
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

sample! {
    /// The torque that an attitude controller commanded and the bounds it followed, about the body axes.
    pub struct AttitudeReport {
        /// Identity and time.
        pub header: Header,
        /// Commanded torque τ(k) \[N m\].
        pub torque_b_nm: [f64; 3],
        /// Previous torque τ(k-1) \[N m\], as the controller used it.
        pub previous_torque_b_nm: [f64; 3],
        /// Lower bound on τ(k) \[N m\].
        pub torque_min_b_nm: [f64; 3],
        /// Upper bound on τ(k) \[N m\].
        pub torque_max_b_nm: [f64; 3],
        /// Bound on |Δτ(k)| \[N m\], relaxation included.
        pub torque_increment_max_b_nm: [f64; 3],
        /// By how much that bound was relaxed because those on τ(k) shrank \[N m\].
        pub torque_relaxation_b_nm: [f64; 3],
        /// Collective thrust that went with τ(k) \[N\].
        pub thrust_n: f64,
        /// Arm length \[m\] in the bounds.
        pub arm_length_m: f64,
        /// Rotor torque per thrust \[m\] in the bounds.
        pub yaw_coefficient_m: f64,
        /// Bound on each rotor's thrust \[N\]; infinite or 0 if rotors are not bounded here.
        pub rotor_thrust_max_n: f64,
        /// Verdict and effort.
        pub solve: SolveReport,
    }
}

sample! {
    /// Input of the position loop: intrinsic z-y-x angles in the ψ = 0 frame, and thrust.
    pub struct PositionInput {
        /// Pitch θ \[rad\].
        pub pitch_rad: f64,
        /// Roll φ \[rad\].
        pub roll_rad: f64,
        /// Collective thrust T \[N\].
        pub thrust_n: f64,
    }
}

impl From<[f64; 3]> for PositionInput {
    /// From (θ, φ, T) [rad, rad, N].
    fn from([pitch_rad, roll_rad, thrust_n]: [f64; 3]) -> Self {
        Self { pitch_rad, roll_rad, thrust_n }
    }
}

impl From<PositionInput> for [f64; 3] {
    /// As (θ, φ, T) [rad, rad, N].
    fn from(input: PositionInput) -> Self {
        [input.pitch_rad, input.roll_rad, input.thrust_n]
    }
}

sample! {
    /// What a position controller commanded and the bounds it followed.
    pub struct PositionReport {
        /// Identity and time.
        pub header: Header,
        /// Commanded input u(k).
        pub input: PositionInput,
        /// Previous input u(k-1), as the controller used it.
        pub previous_input: PositionInput,
        /// Lower bound on u(k).
        pub input_min: PositionInput,
        /// Upper bound on u(k).
        pub input_max: PositionInput,
        /// Bound on |Δu(k)|, relaxation included.
        pub increment_max: PositionInput,
        /// By how much that bound was relaxed because those on u(k) shrank.
        pub relaxation: PositionInput,
        /// Verdict and effort.
        pub solve: SolveReport,
    }
}

/// An input between its bounds, each component in the unit that its report's fields name.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoundedInput {
    /// u(k).
    pub input: [f64; 3],
    /// u(k-1).
    pub previous: [f64; 3],
    /// Lower bound on u(k).
    pub min: [f64; 3],
    /// Upper bound on u(k).
    pub max: [f64; 3],
    /// Bound on |Δu(k)|, relaxation included.
    pub increment_max: [f64; 3],
    /// By how much that bound was relaxed.
    pub relaxation: [f64; 3],
}

impl BoundedInput {
    /// The last input, held: it followed the bounds of its own step, so it is within these.
    #[must_use]
    pub const fn held(self) -> Self {
        Self { previous: self.input, min: self.input, max: self.input, ..self }
    }

    /// Share that component `i` of u(k) takes of whichever bound it is towards; 0 without one.
    #[must_use]
    pub fn used(&self, i: usize) -> f64 {
        let bound = if self.input[i] < 0.0 { self.min[i] } else { self.max[i] };
        let share = self.input[i] / bound;
        if share.is_finite() { share } else { 0.0 }
    }

    /// Largest amount by which u(k) or Δu(k) leaves its bounds; 0 if inside, infinite if u(k) is not
    /// finite.
    #[must_use]
    pub fn worst_violation(&self) -> f64 {
        if !self.input.iter().all(|u| u.is_finite()) {
            return f64::INFINITY;
        }
        (0..3)
            .map(|i| {
                let increment = (self.input[i] - self.previous[i]).abs();
                (self.min[i] - self.input[i])
                    .max(self.input[i] - self.max[i])
                    .max(increment - self.increment_max[i])
            })
            .fold(0.0, f64::max)
    }
}

/// What reports of all controllers have in common.
pub trait ControllerReport: Sample {
    /// The input and its bounds.
    fn bounded(&self) -> BoundedInput;

    /// Verdict and effort.
    fn solve(&self) -> &SolveReport;

    /// Largest amount by which the command leaves its bounds; 0 if inside, infinite if it is not
    /// finite.
    fn worst_violation(&self) -> f64 {
        self.bounded().worst_violation()
    }
}

impl ControllerReport for PositionReport {
    fn bounded(&self) -> BoundedInput {
        BoundedInput {
            input: self.input.into(),
            previous: self.previous_input.into(),
            min: self.input_min.into(),
            max: self.input_max.into(),
            increment_max: self.increment_max.into(),
            relaxation: self.relaxation.into(),
        }
    }

    fn solve(&self) -> &SolveReport {
        &self.solve
    }
}

impl From<BoundedInput> for PositionReport {
    fn from(bounded: BoundedInput) -> Self {
        Self {
            input: bounded.input.into(),
            previous_input: bounded.previous.into(),
            input_min: bounded.min.into(),
            input_max: bounded.max.into(),
            increment_max: bounded.increment_max.into(),
            relaxation: bounded.relaxation.into(),
            ..Self::default()
        }
    }
}

impl ControllerReport for AttitudeReport {
    fn bounded(&self) -> BoundedInput {
        BoundedInput {
            input: self.torque_b_nm,
            previous: self.previous_torque_b_nm,
            min: self.torque_min_b_nm,
            max: self.torque_max_b_nm,
            increment_max: self.torque_increment_max_b_nm,
            relaxation: self.torque_relaxation_b_nm,
        }
    }

    fn solve(&self) -> &SolveReport {
        &self.solve
    }

    /// In N m for torques, in N for rotors.
    fn worst_violation(&self) -> f64 {
        self.bounded().worst_violation().max(self.worst_rotor_violation_n())
    }
}

impl From<BoundedInput> for AttitudeReport {
    fn from(bounded: BoundedInput) -> Self {
        Self {
            torque_b_nm: bounded.input,
            previous_torque_b_nm: bounded.previous,
            torque_min_b_nm: bounded.min,
            torque_max_b_nm: bounded.max,
            torque_increment_max_b_nm: bounded.increment_max,
            torque_relaxation_b_nm: bounded.relaxation,
            ..Self::default()
        }
    }
}

impl AttitudeReport {
    /// Largest amount \[N\] by which a rotor's share of thrust and torque leaves its bounds.
    fn worst_rotor_violation_n(&self) -> f64 {
        let most = self.rotor_thrust_max_n;
        if !(most > 0.0 && most.is_finite()) || self.solve.status == SolveStatus::Refused {
            return 0.0;
        }
        let [roll_nm, pitch_nm, yaw_nm] = self.torque_b_nm;
        let roll = roll_nm / (2.0 * self.arm_length_m);
        let pitch = pitch_nm / (2.0 * self.arm_length_m);
        let yaw = yaw_nm / (4.0 * self.yaw_coefficient_m);
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
#[expect(clippy::float_cmp, reason = "numbers that doubles hold exactly")]
mod tests {
    use super::*;

    /// T = 1 N on arms of 0.1 m with k = 0.02 m; one newton per rotor at most.
    fn report(torque_b_nm: [f64; 3]) -> AttitudeReport {
        AttitudeReport {
            torque_b_nm,
            torque_min_b_nm: [-1.0; 3],
            torque_max_b_nm: [1.0; 3],
            torque_increment_max_b_nm: [1.0; 3],
            thrust_n: 1.0,
            arm_length_m: 0.1,
            yaw_coefficient_m: 0.02,
            rotor_thrust_max_n: 1.0,
            ..AttitudeReport::default()
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
            AttitudeReport { rotor_thrust_max_n: f64::INFINITY, ..report([0.06, 0.0, 0.0]) };
        assert!(unbounded.worst_violation() <= 0.0);
        let lost = AttitudeReport { thrust_n: f64::NAN, ..report([0.0; 3]) };
        assert!(lost.worst_violation().is_infinite());
    }

    #[test]
    fn both_reports_give_back_the_input_and_the_bounds_they_were_made_of() {
        let of = |first: f64| [first, first + 0.25, first + 0.5];
        let bounded = BoundedInput {
            input: of(1.0),
            previous: of(2.0),
            min: of(-3.0),
            max: of(4.0),
            increment_max: of(5.0),
            relaxation: of(6.0),
        };
        assert_eq!(AttitudeReport::from(bounded).bounded(), bounded);
        assert_eq!(PositionReport::from(bounded).bounded(), bounded);
        assert_eq!(PositionReport::from(bounded).input_max.thrust_n, 4.5);
    }

    #[test]
    fn an_input_is_measured_by_the_bound_it_is_towards_and_one_that_is_held_keeps_it() {
        let bounded = BoundedInput {
            input: [1.5, -0.5, 2.5],
            previous: [0.0; 3],
            min: [-1.0; 3],
            max: [3.0, 3.0, f64::INFINITY],
            increment_max: [1.0, 1.0, 2.0],
            relaxation: [0.0; 3],
        };
        assert_eq!([0, 1, 2].map(|i| bounded.used(i)), [0.5, 0.5, 0.0]);
        assert_eq!(bounded.worst_violation(), 0.5);
        assert_eq!(bounded.held().worst_violation(), 0.0);
        let lost = BoundedInput { input: [0.0, f64::NAN, 0.0], ..bounded };
        assert!(lost.worst_violation().is_infinite() && lost.used(1) <= 0.0);
    }
}
