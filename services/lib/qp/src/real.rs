//! The two kinds of numbers the safe method works in: `f64`, and pairs of them for what rounding
//! of `f64` leaves open.

use core::ops::{Add, AddAssign, Div, DivAssign, Mul, MulAssign, Neg, Sub, SubAssign};

/// What the safe method needs of a number.
pub(crate) trait Real:
    nalgebra::Scalar
    + Copy
    + Send
    + PartialOrd
    + From<f64>
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
    + MulAssign
    + DivAssign
{
    /// Relative rounding of one operation.
    const EPSILON: f64;
    const ZERO: Self;
    /// What a multiply-add costs, in those of `f64`.
    const PRODUCTS: usize;
    /// Nearest `f64`.
    fn round(self) -> f64;
    fn sqrt(self) -> Self;
    fn hypot(self, other: Self) -> Self {
        (self * self + other * other).sqrt()
    }
    fn abs(self) -> Self {
        if self < Self::ZERO { -self } else { self }
    }
}

impl Real for f64 {
    const EPSILON: f64 = f64::EPSILON;
    const ZERO: f64 = 0.0;
    const PRODUCTS: usize = 1;
    fn round(self) -> f64 {
        self
    }
    fn sqrt(self) -> f64 {
        f64::sqrt(self)
    }
    fn hypot(self, other: f64) -> f64 {
        libm::hypot(self, other)
    }
}

/// The sum of two numbers of which the second is below the rounding of the first: about 31 digits
/// from plain sums and products (Dekker, 1971), so the same on every machine.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
pub(crate) struct Pair {
    high: f64,
    low: f64,
}

impl Pair {
    /// `a + b` where `a` is the larger.
    fn quick(a: f64, b: f64) -> Self {
        let high = a + b;
        Self { high, low: b - (high - a) }
    }

    /// `a + b` without error.
    fn sum(a: f64, b: f64) -> Self {
        let high = a + b;
        let part = high - a;
        Self { high, low: (a - (high - part)) + (b - part) }
    }

    /// `a b` without error, from halves of 26 digits.
    fn product(a: f64, b: f64) -> Self {
        let ((a1, a2), (b1, b2)) = (halves(a), halves(b));
        let high = a * b;
        Self { high, low: ((a1 * b1 - high) + a1 * b2 + a2 * b1) + a2 * b2 }
    }
}

fn halves(a: f64) -> (f64, f64) {
    let shifted = a * 134_217_729.0;
    let high = shifted - (shifted - a);
    (high, a - high)
}

impl Real for Pair {
    const EPSILON: f64 = f64::EPSILON * f64::EPSILON;
    const ZERO: Self = Self { high: 0.0, low: 0.0 };
    const PRODUCTS: usize = 32;

    fn round(self) -> f64 {
        self.high
    }

    fn sqrt(self) -> Self {
        if self.high <= 0.0 {
            return Self { high: self.high.sqrt(), low: 0.0 };
        }
        let root = self.high.sqrt();
        let rest = self - Self::product(root, root);
        Self::quick(root, rest.high / (2.0 * root))
    }
}

impl From<f64> for Pair {
    fn from(high: f64) -> Self {
        Self { high, low: 0.0 }
    }
}

impl Add for Pair {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        let (high, low) = (Self::sum(self.high, other.high), Self::sum(self.low, other.low));
        let sum = Self::quick(high.high, high.low + low.high);
        Self::quick(sum.high, sum.low + low.low)
    }
}

impl Mul for Pair {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        let product = Self::product(self.high, other.high);
        let mixed = self.high * other.low + self.low * other.high;
        Self::quick(product.high, product.low + mixed)
    }
}

impl Div for Pair {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        let first = self.high / other.high;
        let rest = self - other * Self::from(first);
        let second = rest.high / other.high;
        let rest = rest - other * Self::from(second);
        Self::quick(first, second) + Self::from(rest.high / other.high)
    }
}

impl Neg for Pair {
    type Output = Self;
    fn neg(self) -> Self {
        Self { high: -self.high, low: -self.low }
    }
}

impl Sub for Pair {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

macro_rules! assign {
    ($($name:ident $method:ident $operation:tt),*) => {$(
        impl $name for Pair {
            fn $method(&mut self, other: Self) {
                *self = *self $operation other;
            }
        }
    )*};
}

assign!(AddAssign add_assign +, SubAssign sub_assign -, MulAssign mul_assign *, DivAssign div_assign /);

#[cfg(test)]
#[expect(
    clippy::disallowed_methods,
    reason = "an oracle shares no function with the code under test"
)]
mod tests {
    use super::{Pair, Real};

    #[test]
    fn pairs_keep_thirty_digits_through_all_operations() {
        let third = Pair::from(1.0) / Pair::from(3.0);
        let root = Pair::from(2.0).sqrt();
        assert!((third * Pair::from(3.0) - Pair::from(1.0)).round().abs() < 1e-30);
        assert!((root * root - Pair::from(2.0)).round().abs() < 1e-30);
        let tiny = Pair::from(1.0) + Pair::from(1e-25) - Pair::from(1.0);
        assert!((tiny.round() - 1e-25).abs() < 1e-31);
        // (1 + 2⁻⁴⁰)² = 1 + 2⁻³⁹ + 2⁻⁸⁰.
        let step = 2.0_f64.powi(-40);
        let square = Pair::from(1.0 + step) * Pair::from(1.0 + step);
        let rest = square - Pair::from(1.0) - Pair::from(2.0 * step);
        assert_eq!(rest.round().to_bits(), 2.0_f64.powi(-80).to_bits());
    }
}
