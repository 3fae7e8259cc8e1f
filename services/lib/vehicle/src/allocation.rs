//! Control allocation: a wrench onto four rotors for the present arms, and what to give up when
//! the rotors cannot.
//!
//! With a = τx/2L, b = τy/2L, t = T/4, c = τz/4k the inverse of M splits into two pairs,
//! F₁,₃ = (t − c) ∓ b and F₂,₄ = (t + c) ± a. Each pair's mean bounds only its own torque: roll and
//! pitch are feasible whenever |a|, |b| ≤ `F_max`/2, whatever thrust and yaw become. So roll and
//! pitch are kept first, then t moves as little as it must, and c last, between zero and the
//! command, so that no yaw torque appears that was not asked for.

use nalgebra::Vector3;

/// Collective thrust along body z and torque in body axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wrench {
    /// T = Σ `F_i` \[N\].
    pub thrust_n: f64,
    /// τ = (τx, τy, τz) \[N m\] in B.
    pub torque_b_nm: Vector3<f64>,
}

impl Wrench {
    /// Thrust alone, no torque.
    #[must_use]
    pub fn thrust(thrust_n: f64) -> Self {
        Self { thrust_n, torque_b_nm: Vector3::zeros() }
    }

    /// True if no component is NaN or infinite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.thrust_n.is_finite() && self.torque_b_nm.iter().all(|t| t.is_finite())
    }
}

/// Rotor thrusts that were possible, and the wrench they make.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Allocation {
    /// `F_i` \[N\], each in [0, `F_max`]; 1 front, 2 left, 3 rear, 4 right.
    pub rotor_thrust_n: [f64; 4],
    /// M F of these thrusts.
    pub achieved: Wrench,
    /// True if the command was out of reach.
    pub clipped: bool,
}

/// Map between wrench and rotor thrusts, eq. (1) with `M_i` = k `F_i`, for one arm length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Allocator {
    /// Arm length L \[m\], above zero.
    pub arm_length_m: f64,
    /// Rotor drag torque per thrust k \[m\], above zero.
    pub yaw_coefficient_m: f64,
    /// Largest thrust of one rotor \[N\], above zero.
    pub thrust_max_n: f64,
}

impl Allocator {
    /// \[T; τ\] = M F with M = [1 1 1 1; 0 L 0 −L; −L 0 L 0; −k k −k k], eq. (1).
    #[must_use]
    pub fn wrench(&self, rotor_thrust_n: &[f64; 4]) -> Wrench {
        let [f1, f2, f3, f4] = *rotor_thrust_n;
        Wrench {
            thrust_n: (f1 + f3) + (f2 + f4),
            torque_b_nm: Vector3::new(
                self.arm_length_m * (f2 - f4),
                self.arm_length_m * (f3 - f1),
                self.yaw_coefficient_m * ((f2 + f4) - (f1 + f3)),
            ),
        }
    }

    /// F = M⁻¹ \[T; τ\] \[N\], without limits.
    #[must_use]
    pub fn unlimited_thrusts(&self, wrench: &Wrench) -> [f64; 4] {
        self.shares(wrench).thrusts()
    }

    /// Thrusts in [0, `F_max`] for `wrench`, giving up yaw first, then collective thrust, and roll
    /// and pitch only beyond L `F_max`. `None` if a component is not finite or the allocator's own
    /// numbers are not finite and above zero.
    #[must_use]
    pub fn allocate(&self, wrench: &Wrench) -> Option<Allocation> {
        if !(wrench.is_finite() && self.is_usable()) {
            return None;
        }
        let Shares { roll, pitch, collective, yaw } = self.shares(wrench);
        let half = 0.5 * self.thrust_max_n;
        let a = roll.clamp(-half, half);
        let b = pitch.clamp(-half, half);
        let pairs = PairLimits { left_right: a.abs(), front_rear: b.abs(), max: self.thrust_max_n };

        let (t_low, t_high) = pairs.collective_range(yaw);
        let t = collective.max(t_low).min(t_high);
        let (c_low, c_high) = pairs.yaw_range(t);
        let c = yaw.max(c_low).min(c_high);

        let clipped = roll.abs() > half
            || pitch.abs() > half
            || collective < t_low
            || collective > t_high
            || yaw < c_low
            || yaw > c_high;
        // The clamp removes rounding only: the shares already satisfy the limits.
        let rotor_thrust_n = Shares { roll: a, pitch: b, collective: t, yaw: c }
            .thrusts()
            .map(|thrust| thrust.clamp(0.0, self.thrust_max_n));
        Some(Allocation { rotor_thrust_n, achieved: self.wrench(&rotor_thrust_n), clipped })
    }

    fn is_usable(&self) -> bool {
        [self.arm_length_m, self.yaw_coefficient_m, self.thrust_max_n]
            .iter()
            .all(|x| *x > 0.0 && x.is_finite())
    }

    fn shares(&self, wrench: &Wrench) -> Shares {
        let tau = &wrench.torque_b_nm;
        Shares {
            roll: tau.x / (2.0 * self.arm_length_m),
            pitch: tau.y / (2.0 * self.arm_length_m),
            collective: wrench.thrust_n / 4.0,
            yaw: tau.z / (4.0 * self.yaw_coefficient_m),
        }
    }
}

/// a, b, t, c of the module's head: what each rotor gives to each axis \[N\].
#[derive(Debug, Clone, Copy)]
struct Shares {
    roll: f64,
    pitch: f64,
    collective: f64,
    yaw: f64,
}

impl Shares {
    fn thrusts(&self) -> [f64; 4] {
        let front_rear = self.collective - self.yaw;
        let left_right = self.collective + self.yaw;
        [
            front_rear - self.pitch,
            left_right + self.roll,
            front_rear + self.pitch,
            left_right - self.roll,
        ]
    }
}

/// The means of the pairs must stay in |a| ≤ t + c ≤ `F_max` − |a| and |b| ≤ t − c ≤ `F_max` − |b|.
#[derive(Debug, Clone, Copy)]
struct PairLimits {
    left_right: f64,
    front_rear: f64,
    max: f64,
}

impl PairLimits {
    /// All t that some c between zero and `yaw` makes feasible: a projection of a polygon, so an
    /// interval. Its ends lie where both pairs meet their limit, or at an end of c.
    fn collective_range(&self, yaw: f64) -> (f64, f64) {
        let (a, b) = (self.left_right, self.front_rear);
        let (c_min, c_max) = (yaw.min(0.0), yaw.max(0.0));
        let c = (0.5 * (a - b)).clamp(c_min, c_max);
        let low = (a - c).max(b + c);
        let c = (0.5 * (b - a)).clamp(c_min, c_max);
        let high = self.max - (a + c).max(b - c);
        (low, high)
    }

    /// All c that are feasible with t; contains a value between zero and the commanded yaw share,
    /// because t was chosen so.
    fn yaw_range(&self, t: f64) -> (f64, f64) {
        let (a, b) = (self.left_right, self.front_rear);
        ((a - t).max(t - self.max + b), (t - b).min(self.max - a - t))
    }
}
