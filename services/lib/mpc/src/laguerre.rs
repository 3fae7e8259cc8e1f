//! Discrete Laguerre functions, an orthonormal basis of decaying sequences ([Wang], chapter 3).

use crate::MpcError;

/// Energy, of 1 at the beginning, below which a function counts as died out.
const DIED_OUT: f64 = 0.01;

/// The sequences that span Δu of one input: Δu(k+m) = L(m)ᵀ η.
///
/// L(m+1) = A L(m) with A lower triangular, `pole` on its diagonal. At pole 0 the functions are
/// unit pulses, and with Nc terms η is Δu(k), ..., Δu(k+Nc−1): the classic form.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Basis {
    /// a in 0..1: the functions decay like its powers.
    pub pole: f64,
    /// N: number of functions, the unknowns of this input.
    pub terms: usize,
}

impl Basis {
    /// One unknown per move of a control horizon.
    #[must_use]
    pub const fn pulses(control: usize) -> Self {
        Self { pole: 0.0, terms: control }
    }

    /// The functions a scenario asks for, by poles, by numbers or by both; `None` if by neither,
    /// and `control` functions or pole 0 where one is missing.
    #[must_use]
    pub fn given<const N: usize>(
        pole: Option<[f64; N]>,
        terms: Option<[u8; N]>,
        control: usize,
    ) -> Option<[Self; N]> {
        if pole.is_none() && terms.is_none() {
            return None;
        }
        let pole = pole.unwrap_or([0.0; N]);
        let terms = terms.map_or([control; N], |terms| terms.map(usize::from));
        Some(core::array::from_fn(|i| Self { pole: pole[i], terms: terms[i] }))
    }

    /// Checks the pole, and 1 <= N <= `limit`.
    ///
    /// # Errors
    /// [`MpcError::Pole`] or [`MpcError::Terms`] outside that range.
    pub fn check(&self, limit: usize) -> Result<(), MpcError> {
        let Self { pole, terms } = *self;
        if !(0.0..1.0).contains(&pole) {
            return Err(MpcError::Pole { pole });
        }
        if terms == 0 || terms > limit {
            return Err(MpcError::Terms { terms, limit });
        }
        Ok(())
    }

    /// Samples, at most `most`, after which all that is left of any function is below a hundredth of
    /// its energy: N at pole 0, where they are pulses.
    #[must_use]
    pub fn span(&self, most: usize) -> usize {
        let values = self.sequence(most);
        // They are orthonormal: the energy of each over all time is 1.
        let mut left = vec![1.0; self.terms];
        for (m, l) in values.chunks(self.terms.max(1)).enumerate() {
            for (left, value) in left.iter_mut().zip(l) {
                *left -= value * value;
            }
            if left.iter().all(|left| *left <= DIED_OUT) {
                return m + 1;
            }
        }
        most
    }

    /// L(0), ..., L(samples − 1), one after the other; `terms` numbers each.
    #[must_use]
    pub fn sequence(&self, samples: usize) -> Vec<f64> {
        let Self { pole, terms } = *self;
        let beta = 1.0 - pole * pole;
        // (−a)^0, (−a)^1, ...
        let mut powers = vec![1.0; terms];
        for i in 1..terms {
            powers[i] = -pole * powers[i - 1];
        }
        let mut values = vec![0.0; samples * terms];
        for m in 0..samples {
            let (before, rest) = values.split_at_mut(m * terms);
            let now = &mut rest[..terms];
            if m == 0 {
                for (value, power) in now.iter_mut().zip(&powers) {
                    *value = beta.sqrt() * power;
                }
                continue;
            }
            let last = &before[(m - 1) * terms..];
            for (i, value) in now.iter_mut().enumerate() {
                let below: f64 = (0..i).map(|j| powers[i - 1 - j] * last[j]).sum();
                *value = pole * last[i] + beta * below;
            }
        }
        values
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_functions_are_those_of_the_book() {
        let values = Basis { pole: 0.5, terms: 3 }.sequence(6);
        let close = |m: usize, expected: [f64; 3]| {
            for (value, expected) in values[3 * m..3 * m + 3].iter().zip(expected) {
                assert!((value - expected).abs() < 1e-7, "L({m}): {value} {expected}");
            }
        };
        close(0, [0.8660254, -0.4330127, 0.2165064]);
        close(5, [0.02706329, 0.18944306, 0.41271523]);
    }

    #[test]
    fn the_functions_are_orthonormal() {
        for pole in [0.0, 0.3, 0.7, 0.9] {
            let values = Basis { pole, terms: 4 }.sequence(2000);
            for i in 0..4 {
                for j in 0..4 {
                    let product: f64 = values.chunks(4).map(|l| l[i] * l[j]).sum();
                    assert!((product - f64::from(i == j)).abs() < 1e-10, "{pole} {i} {j}");
                }
            }
        }
    }

    #[test]
    fn they_span_as_many_samples_as_they_have_terms_at_pole_zero_and_more_beyond() {
        assert_eq!(Basis::pulses(3).span(50), 3);
        assert_eq!(Basis { pole: 0.0, terms: 50 }.span(50), 50);
        // One function decays like a^2m in energy: 0.5^(2·4) < 0.01 < 0.5^(2·3).
        assert_eq!(Basis { pole: 0.5, terms: 1 }.span(50), 4);
        assert_eq!(Basis { pole: 0.95, terms: 3 }.span(20), 20);
    }

    #[test]
    fn at_pole_zero_they_are_unit_pulses() {
        let values = Basis::pulses(3).sequence(5);
        for (m, l) in values.chunks(3).enumerate() {
            for (i, value) in l.iter().enumerate() {
                assert_eq!(*value, f64::from(i == m));
            }
        }
    }

    #[test]
    fn a_pole_outside_the_unit_interval_and_an_empty_basis_are_refused() {
        for pole in [1.0, -0.1, f64::NAN] {
            assert!(matches!(Basis { pole, terms: 3 }.check(9), Err(MpcError::Pole { .. })));
        }
        for terms in [0, 10] {
            assert_eq!(
                Basis { pole: 0.5, terms }.check(9),
                Err(MpcError::Terms { terms, limit: 9 })
            );
        }
    }
}
