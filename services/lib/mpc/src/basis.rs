//! How the moves of an input are parameterised: sequences of Δu, orthonormal over all time.

use crate::MpcError;

/// Energy, of 1 at the beginning, below which a function counts as died out.
const DIED_OUT: f64 = 0.01;

/// The sequences that span Δu of one input: Δu(k+m) = L(m)ᵀ η.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Basis {
    /// Discrete Laguerre functions, an orthonormal basis of decaying sequences (\[Wang\], chapter 3): L(m+1) = A L(m) with A
    /// lower triangular, `pole` on its diagonal. At pole 0 they are unit pulses, and with Nc terms η is
    /// Δu(k), ..., Δu(k+Nc−1): the classic form.
    Laguerre {
        /// a in 0..1: the functions decay like its powers.
        pole: f64,
        /// N: number of functions, the unknowns of this input.
        terms: usize,
    },
    /// Blocks in which Δu stays: the input is linear between their ends, so that bounds kept at the ends are kept
    /// throughout. The first of several has one sample, and each is longer than the one before by about the same factor, since what is
    /// far ahead will be planned again.
    Blocks {
        /// N: number of blocks, the unknowns of this input.
        terms: usize,
        /// Samples that they last together.
        samples: usize,
    },
}

impl Basis {
    /// One unknown per move of a control horizon.
    #[must_use]
    pub const fn pulses(control: usize) -> Self {
        Self::Laguerre { pole: 0.0, terms: control }
    }

    /// The Laguerre functions a scenario asks for, by poles, by numbers or by both; `None` if by neither,
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
        Some(core::array::from_fn(|i| Self::Laguerre { pole: pole[i], terms: terms[i] }))
    }

    /// N: the unknowns of this input.
    #[must_use]
    pub const fn terms(&self) -> usize {
        match *self {
            Self::Laguerre { terms, .. } | Self::Blocks { terms, .. } => terms,
        }
    }

    /// Checks the pole, 1 <= N <= `limit`, and that no block is empty.
    ///
    /// # Errors
    /// [`MpcError::Pole`], [`MpcError::Terms`] or [`MpcError::Blocks`].
    pub fn check(&self, limit: usize) -> Result<(), MpcError> {
        match *self {
            Self::Laguerre { pole, .. } if !(0.0..1.0).contains(&pole) => {
                Err(MpcError::Pole { pole })
            }
            Self::Laguerre { terms, .. } if terms == 0 || terms > limit => {
                Err(MpcError::Terms { terms, limit })
            }
            Self::Blocks { terms, samples } if terms == 0 || terms > samples.min(limit) => {
                Err(MpcError::Blocks { terms, limit: samples.min(limit) })
            }
            _ => Ok(()),
        }
    }

    /// Samples, at most `most`, after which all that is left of any function is below a hundredth of
    /// its energy: N at pole 0, where they are pulses.
    #[must_use]
    pub fn span(&self, most: usize) -> usize {
        let values = self.sequence(most);
        // They are orthonormal: the energy of each over all time is 1.
        let mut left = vec![1.0; self.terms()];
        for (m, l) in values.chunks(self.terms().max(1)).enumerate() {
            for (left, value) in left.iter_mut().zip(l) {
                *left -= value * value;
            }
            if left.iter().all(|left| *left <= DIED_OUT) {
                return m + 1;
            }
        }
        most
    }

    /// First and last sample of each block; none for functions that have no blocks.
    pub(crate) fn blocks(&self) -> Option<Vec<[usize; 2]>> {
        let Self::Blocks { terms, samples } = *self else { return None };
        let ends = block_ends(terms, samples);
        let starts = core::iter::once(0).chain(ends.iter().copied());
        Some(starts.zip(&ends).map(|(start, end)| [start, end - 1]).collect())
    }

    /// L(0), ..., L(samples − 1), one after the other; `terms` numbers each.
    #[must_use]
    pub fn sequence(&self, samples: usize) -> Vec<f64> {
        match *self {
            Self::Laguerre { pole, terms } => laguerre(pole, terms, samples),
            Self::Blocks { terms, samples: all } => {
                let (mut values, mut start) = (vec![0.0; samples * terms], 0);
                for (term, end) in block_ends(terms, all).into_iter().enumerate() {
                    let height = 1.0 / ((end - start) as f64).sqrt();
                    for m in start..end.min(samples) {
                        values[m * terms + term] = height;
                    }
                    start = end;
                }
                values
            }
        }
    }
}

fn laguerre(pole: f64, terms: usize, samples: usize) -> Vec<f64> {
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

/// Where each of `terms` blocks ends: 1, 1 + r, 1 + r + r², ... rounded, with the r by which the last one ends at `samples`.
fn block_ends(terms: usize, samples: usize) -> Vec<usize> {
    let sums = |ratio: f64| {
        (0..terms).scan((0.0, 1.0), move |(sum, length), _| {
            *sum += *length;
            *length *= ratio;
            Some(*sum)
        })
    };
    // Halving finds it to the last bit.
    let (mut least, mut most) = (1.0, samples as f64);
    for _ in 0..64 {
        let ratio = 0.5 * (least + most);
        let fits = sums(ratio).last().unwrap_or(0.0) <= samples as f64;
        *(if fits { &mut least } else { &mut most }) = ratio;
    }
    let mut ends: Vec<usize> = Vec::with_capacity(terms);
    for (i, sum) in sums(least).enumerate() {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a sample")]
        let rounded = sum.round() as usize;
        // None is empty, and each that is left has a sample.
        let before = ends.last().copied().unwrap_or(0);
        ends.push(rounded.clamp(before + 1, samples + i + 1 - terms));
    }
    // A single block has no factor.
    if let Some(last) = ends.last_mut() {
        *last = samples;
    }
    ends
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_functions_are_those_of_the_book() {
        let values = Basis::Laguerre { pole: 0.5, terms: 3 }.sequence(6);
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
            let values = Basis::Laguerre { pole, terms: 4 }.sequence(2000);
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
        assert_eq!(Basis::Laguerre { pole: 0.0, terms: 50 }.span(50), 50);
        // One function decays like a^2m in energy: 0.5^(2·4) < 0.01 < 0.5^(2·3).
        assert_eq!(Basis::Laguerre { pole: 0.5, terms: 1 }.span(50), 4);
        assert_eq!(Basis::Laguerre { pole: 0.95, terms: 3 }.span(20), 20);
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
    fn blocks_grow_fill_their_samples_and_are_orthonormal() {
        for (terms, samples) in [(1, 1), (1, 7), (3, 3), (5, 6), (8, 80), (10, 64), (50, 200)] {
            let basis = Basis::Blocks { terms, samples };
            let blocks = basis.blocks().unwrap();
            let lengths: Vec<usize> = blocks.iter().map(|[first, last]| last + 1 - first).collect();
            assert_eq!((lengths.len(), lengths.iter().sum()), (terms, samples), "{lengths:?}");
            assert!(terms == 1 || lengths[0] == 1, "{lengths:?}");
            // Rounding may take a sample back, but no more.
            assert!(lengths.windows(2).all(|pair| pair[1] + 1 >= pair[0]), "{lengths:?}");
            let values = basis.sequence(samples);
            for i in 0..terms {
                for j in 0..terms {
                    let product: f64 = values.chunks(terms).map(|l| l[i] * l[j]).sum();
                    assert!((product - f64::from(i == j)).abs() < 1e-12);
                }
            }
        }
        assert_eq!(
            Basis::Blocks { terms: 3, samples: 3 }.sequence(5),
            Basis::pulses(3).sequence(5)
        );
    }

    #[test]
    fn a_pole_outside_the_unit_interval_and_an_empty_basis_are_refused() {
        for pole in [1.0, -0.1, f64::NAN] {
            assert!(matches!(
                Basis::Laguerre { pole, terms: 3 }.check(9),
                Err(MpcError::Pole { .. })
            ));
        }
        for terms in [0, 10] {
            assert_eq!(
                Basis::Laguerre { pole: 0.5, terms }.check(9),
                Err(MpcError::Terms { terms, limit: 9 })
            );
        }
        for (terms, samples, limit) in [(0, 5, 5), (6, 5, 5), (10, 50, 9)] {
            let refusal = Basis::Blocks { terms, samples }.check(9);
            assert_eq!(refusal, Err(MpcError::Blocks { terms, limit }));
        }
    }
}
