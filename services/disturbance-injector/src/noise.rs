//! Seeded noise whose place in its stream can be stored and taken up again.
//!
//! The generator is [`ChaCha8Rng`], whose stream no version of its crate may change. Normal numbers
//! come from Box and Muller's transform through `libm`: the same bits on every machine, and always
//! the same number of words per draw, which a rejection method does not give.

use std::f64::consts::TAU;

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Keeps these streams apart from those of other sources with the same seed.
const SOURCE: &[u8; 24] = b"disturbance-injector\0\0\0\0";

shared_types::memory! {
    /// A noise generator as plain numbers.
    #[derive(PartialEq, Eq)]
    pub struct NoiseMemory {
        /// The scenario's seed.
        pub seed: u64,
        /// Place of the event in the script.
        pub stream: u64,
        /// Words already drawn.
        pub word_position: u64,
    }
}

/// Noise of one event: independent of every other stream and of every other seed.
#[derive(Debug, Clone)]
pub(crate) struct Noise {
    seed: u64,
    generator: ChaCha8Rng,
}

impl Noise {
    /// The stream of the event at place `stream`.
    pub(crate) fn new(seed: u64, stream: u64) -> Self {
        let mut key = [0; 32];
        key[..8].copy_from_slice(&seed.to_le_bytes());
        key[8..].copy_from_slice(SOURCE);
        let mut generator = ChaCha8Rng::from_seed(key);
        generator.set_stream(stream);
        Self { seed, generator }
    }

    /// Uniform in [0, 1), 53 bits.
    fn uniform(&mut self) -> f64 {
        (self.generator.next_u64() >> 11) as f64 * f64::EPSILON * 0.5
    }

    /// Three independent numbers from N(0, 1).
    pub(crate) fn normal3(&mut self) -> [f64; 3] {
        let ([x, y], [z, _]) = (self.normal2(), self.normal2());
        [x, y, z]
    }

    /// Two independent numbers from N(0, 1) [Box, Muller 1958].
    fn normal2(&mut self) -> [f64; 2] {
        // 1 − u lies in (0, 1], so the logarithm is finite.
        let radius = (-2.0 * libm::log(1.0 - self.uniform())).sqrt();
        let (sin, cos) = libm::sincos(TAU * self.uniform());
        [radius * cos, radius * sin]
    }

    pub(crate) fn memory(&self) -> NoiseMemory {
        // A draw takes two words of 32 bits, so 2⁶⁴ of them outlast any flight.
        let position = self.generator.get_word_pos();
        NoiseMemory {
            seed: self.seed,
            stream: self.generator.get_stream(),
            word_position: u64::try_from(position).unwrap_or(u64::MAX),
        }
    }

    pub(crate) fn restore(&mut self, memory: &NoiseMemory) {
        *self = Self::new(memory.seed, memory.stream);
        self.generator.set_word_pos(u128::from(memory.word_position));
    }

    /// Place of the event in the script.
    pub(crate) fn stream(&self) -> u64 {
        self.generator.get_stream()
    }

    /// Back to the first word.
    pub(crate) fn rewind(&mut self) {
        self.generator.set_word_pos(0);
    }

    /// Goes on in the stream of another seed, at the place reached in this one.
    pub(crate) fn reseed(&mut self, seed: u64) {
        self.restore(&NoiseMemory { seed, ..self.memory() });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_restored_stream_continues_bit_for_bit_from_every_position() {
        let mut noise = Noise::new(7, 3);
        let mut other = Noise::new(1, 0);
        // 200 draws cross the generator's block and buffer borders several times.
        for _ in 0..200 {
            other.restore(&noise.memory());
            assert_eq!(other.memory(), noise.memory());
            let next = |noise: &Noise| noise.clone().normal3().map(f64::to_bits);
            assert_eq!(next(&other), next(&noise));
            noise.uniform();
        }
    }

    #[test]
    fn other_seeds_and_other_places_give_other_streams() {
        let first = |seed, stream| Noise::new(seed, stream).normal3().map(f64::to_bits);
        assert_eq!(first(1, 0), first(1, 0));
        assert_ne!(first(1, 0), first(2, 0));
        assert_ne!(first(1, 0), first(1, 1));
    }
}
