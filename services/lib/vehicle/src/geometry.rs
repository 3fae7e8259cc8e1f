//! The morph law: arm length and inertia as functions of the morph angle β.
//!
//! The true linkage law is not public. The default is the quadratic through the three sizes of
//! Table I; another vehicle gives other coefficients.

use nalgebra::Vector3;

use crate::ParameterError;
use crate::parameter_error::positive;

/// Morph angle β, always inside the linkage's range of 45° to 160°.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
pub struct MorphAngle(f64);

impl MorphAngle {
    /// The smallest vehicle, 45°.
    pub const MIN: Self = Self(45.0_f64.to_radians());
    /// The medium vehicle of Table I, 94.5°.
    pub const MEDIUM: Self = Self(94.5_f64.to_radians());
    /// The largest vehicle, 160°.
    pub const MAX: Self = Self(160.0_f64.to_radians());

    /// An angle that must already lie in the range, as in a configuration.
    ///
    /// # Errors
    /// Outside the range, or not a number.
    pub fn from_rad(angle_rad: f64) -> Result<Self, ParameterError> {
        if (Self::MIN.0..=Self::MAX.0).contains(&angle_rad) {
            Ok(Self(angle_rad))
        } else {
            let remedy = "a morph angle lies between 45 and 160 degrees (0.785 and 2.793 rad)";
            Err(ParameterError { name: "morph_angle_rad", value: angle_rad, remedy })
        }
    }

    /// As [`from_rad`](Self::from_rad), from degrees.
    ///
    /// # Errors
    /// Outside the range, or not a number.
    pub fn from_degrees(angle_deg: f64) -> Result<Self, ParameterError> {
        Self::from_rad(angle_deg.to_radians())
    }

    /// The nearest angle in the range, as a measurement or a command needs; `None` for NaN.
    #[must_use]
    pub fn saturating_from_rad(angle_rad: f64) -> Option<Self> {
        (!angle_rad.is_nan()).then(|| Self(angle_rad.clamp(Self::MIN.0, Self::MAX.0)))
    }

    /// β \[rad\].
    #[must_use]
    pub fn rad(self) -> f64 {
        self.0
    }

    /// β \[°\].
    #[must_use]
    pub fn degrees(self) -> f64 {
        self.0.to_degrees()
    }
}

/// c0 + c1 β + c2 β² with β in degrees, the unit of Table I; the value's unit is the owner's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quadratic {
    /// Value at β = 0.
    pub c0: f64,
    /// Slope at β = 0, per degree.
    pub c1: f64,
    /// Half the curvature, per square degree.
    pub c2: f64,
}

impl Quadratic {
    /// The same value at every angle, for a rigid vehicle.
    #[must_use]
    pub const fn constant(value: f64) -> Self {
        Self { c0: value, c1: 0.0, c2: 0.0 }
    }

    /// This law times a factor.
    #[must_use]
    pub const fn scaled(self, factor: f64) -> Self {
        Self { c0: self.c0 * factor, c1: self.c1 * factor, c2: self.c2 * factor }
    }

    /// Value at `beta`.
    #[must_use]
    pub fn value(&self, beta: MorphAngle) -> f64 {
        let b = beta.degrees();
        self.c0 + b * (self.c1 + b * self.c2)
    }

    /// d/dβ at `beta`, per **radian**.
    #[must_use]
    pub fn slope_per_rad(&self, beta: MorphAngle) -> f64 {
        (self.c1 + 2.0 * self.c2 * beta.degrees()).to_degrees()
    }

    /// Least value over the morph range: at an end, or at the vertex if it lies inside.
    fn minimum(&self) -> f64 {
        let vertex = MorphAngle::from_degrees(-0.5 * self.c1 / self.c2).map(|b| self.value(b));
        let ends = self.value(MorphAngle::MIN).min(self.value(MorphAngle::MAX));
        vertex.map_or(ends, |v| v.min(ends))
    }
}

/// Arm length and principal inertia over β.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Geometry {
    /// Arm length L(β) \[m\], from the centre of mass to each rotor.
    pub arm_length_m: Quadratic,
    /// Ixx(β) \[kg m²\].
    pub inertia_xx_kg_m2: Quadratic,
    /// Iyy(β) \[kg m²\].
    pub inertia_yy_kg_m2: Quadratic,
    /// Izz(β) \[kg m²\].
    pub inertia_zz_kg_m2: Quadratic,
}

impl Default for Geometry {
    /// The quadratics through Table I, with Ixx = Iyy and Izz = 2 Ixx.
    fn default() -> Self {
        let roll = Quadratic { c0: -2.83927224e-4, c1: 9.70843516e-6, c2: -2.61493126e-8 };
        Self {
            arm_length_m: Quadratic { c0: 5.40472498e-2, c1: 9.87483196e-4, c2: -1.72049067e-6 },
            inertia_xx_kg_m2: roll,
            inertia_yy_kg_m2: roll,
            inertia_zz_kg_m2: roll.scaled(2.0),
        }
    }
}

impl Geometry {
    /// Arm length L \[m\] at `beta`.
    #[must_use]
    pub fn arm_length_m(&self, beta: MorphAngle) -> f64 {
        self.arm_length_m.value(beta)
    }

    /// dL/dβ \[m/rad\] at `beta`.
    #[must_use]
    pub fn arm_length_slope_m_rad(&self, beta: MorphAngle) -> f64 {
        self.arm_length_m.slope_per_rad(beta)
    }

    /// Principal inertia (Ixx, Iyy, Izz) \[kg m²\] in B at `beta`.
    #[must_use]
    pub fn inertia_kg_m2(&self, beta: MorphAngle) -> Vector3<f64> {
        self.inertia_laws().map(|law| law.value(beta)).into()
    }

    /// dI/dβ \[kg m²/rad\] in B at `beta`.
    #[must_use]
    pub fn inertia_slope_kg_m2_rad(&self, beta: MorphAngle) -> Vector3<f64> {
        self.inertia_laws().map(|law| law.slope_per_rad(beta)).into()
    }

    /// Refuses a law that makes an arm or an inertia non-positive somewhere in the range.
    ///
    /// # Errors
    /// The first such law, with its least value.
    pub fn validate(&self) -> Result<(), ParameterError> {
        const REMEDY: &str = "its least value between 45 and 160 degrees must be above zero";
        positive("geometry.arm_length_m", self.arm_length_m.minimum(), REMEDY)?;
        positive("geometry.inertia_xx_kg_m2", self.inertia_xx_kg_m2.minimum(), REMEDY)?;
        positive("geometry.inertia_yy_kg_m2", self.inertia_yy_kg_m2.minimum(), REMEDY)?;
        positive("geometry.inertia_zz_kg_m2", self.inertia_zz_kg_m2.minimum(), REMEDY)
    }

    fn inertia_laws(&self) -> [Quadratic; 3] {
        [self.inertia_xx_kg_m2, self.inertia_yy_kg_m2, self.inertia_zz_kg_m2]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_law_reproduces_table_i() {
        let table = [
            (MorphAngle::MIN, 0.095, 1e-4),
            (MorphAngle::MEDIUM, 0.132, 4e-4),
            (MorphAngle::MAX, 0.168, 6e-4),
        ];
        let law = Geometry::default();
        for (beta, arm, roll) in table {
            // Nine printed digits of the coefficients leave a few 1e-9 relative.
            assert!((law.arm_length_m(beta) / arm - 1.0).abs() < 1e-8);
            let expected = Vector3::new(roll, roll, 2.0 * roll);
            // and here a few 1e-12 absolute: half a last digit times 160².
            assert!((law.inertia_kg_m2(beta) - expected).norm() < 1e-11);
        }
    }

    #[test]
    fn the_slopes_are_the_derivatives_of_the_laws() {
        let law = Geometry::default();
        let h = 1e-4;
        for degrees in [46.0, 70.0, 100.0, 159.0] {
            let at = |offset: f64| MorphAngle::from_rad(degrees * 1f64.to_radians() + offset);
            let (low, mid, high) = (at(-h).unwrap(), at(0.0).unwrap(), at(h).unwrap());
            // A central difference is exact for a quadratic, up to rounding.
            let arm = (law.arm_length_m(high) - law.arm_length_m(low)) / (2.0 * h);
            assert!((law.arm_length_slope_m_rad(mid) - arm).abs() < 1e-11);
            let inertia = (law.inertia_kg_m2(high) - law.inertia_kg_m2(low)) / (2.0 * h);
            assert!((law.inertia_slope_kg_m2_rad(mid) - inertia).norm() < 1e-13);
        }
    }

    #[test]
    fn angles_outside_the_linkage_are_refused_or_brought_back() {
        for bad in [44.9, 160.1, f64::NAN, f64::INFINITY] {
            assert!(MorphAngle::from_degrees(bad).is_err());
        }
        assert_eq!(MorphAngle::from_degrees(160.0), Ok(MorphAngle::MAX));
        assert_eq!(MorphAngle::saturating_from_rad(9.0), Some(MorphAngle::MAX));
        assert_eq!(MorphAngle::saturating_from_rad(-1.0), Some(MorphAngle::MIN));
        assert_eq!(MorphAngle::saturating_from_rad(f64::NAN), None);
        assert!((MorphAngle::MEDIUM.degrees() - 94.5).abs() < 1e-12);
    }

    #[test]
    fn a_law_that_dips_below_zero_inside_the_range_is_refused() {
        // Positive at both ends, zero at its vertex of 100 degrees.
        let dip = Quadratic { c0: 1.0, c1: -0.02, c2: 1e-4 };
        let law = Geometry { inertia_yy_kg_m2: dip.scaled(0.999), ..Geometry::default() };
        let sunk = Quadratic { c0: dip.c0 - 1e-3, ..dip };
        let bad = Geometry { inertia_yy_kg_m2: sunk, ..law };
        assert_eq!(bad.validate().unwrap_err().name, "geometry.inertia_yy_kg_m2");
        let rigid = Geometry { inertia_yy_kg_m2: Quadratic::constant(1e-4), ..law };
        assert_eq!(rigid.validate(), Ok(()));
    }
}
