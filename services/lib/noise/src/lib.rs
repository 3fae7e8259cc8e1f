//! Seeded noise whose place in its stream can be stored and taken up again.
//!
//! The generator is [`ChaCha8Rng`], whose stream no version of its crate may change. Normal numbers
//! come from Box and Muller's transform through `libm`: the same bits on every machine, and always
//! the same number of words per draw, which a rejection method does not give.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;

/// Bytes of the key: eight of the seed, the rest for the source.
const KEY_BYTES: usize = 32;

/// What has noise. Its bytes are part of the key, hence of every flight with a seed: they stay as they are, whatever
/// the source, its topic and its service are called today.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Source([u8; KEY_BYTES - 8]);

impl Source {
    /// The inertial sensor.
    pub const IMU: Self = Self::of_bytes(b"imu");
    /// The tracker.
    pub const POSE_FIX: Self = Self::of_bytes(b"pose_fix");
    /// The encoder of the deployable angle.
    pub const MORPH_ENCODER: Self = Self::of_bytes(b"morph_encoder");
    /// Disturbances; each event is a stream of its own.
    pub const DISTURBANCE: Self = Self::of_bytes(b"disturbance-injector");
    /// What happens to the time of loops and samples; each entry is a stream of its own.
    pub const TIMING: Self = Self::of_bytes(b"timing");

    /// The source of at most 24 bytes; the others are zero.
    ///
    /// # Panics
    /// If there are more.
    #[must_use]
    pub const fn of_bytes(bytes: &[u8]) -> Self {
        let mut key = [0; KEY_BYTES - 8];
        let mut i = 0;
        while i < bytes.len() {
            key[i] = bytes[i];
            i += 1;
        }
        Self(key)
    }
}

shared_types::memory! {
    /// A noise generator as plain numbers.
    #[derive(PartialEq, Eq)]
    pub struct NoiseMemory {
        /// Key: the seed and the source.
        pub key: [u64; 4],
        /// One of the key's independent streams.
        pub stream: u64,
        /// Words already drawn.
        pub word_position: u64,
    }
}

impl NoiseMemory {
    /// The same place in the stream of another seed.
    #[must_use]
    pub fn with_seed(self, seed: u64) -> Self {
        let [_, a, b, c] = self.key;
        Self { key: [seed, a, b, c], ..self }
    }
}

/// Noise of one source: independent of that of every other source, stream and seed.
#[derive(Debug, Clone)]
pub struct Noise {
    generator: ChaCha8Rng,
}

impl Noise {
    /// From the first number of one of the 2⁶⁴ streams of a source on.
    #[must_use]
    pub fn new(seed: u64, Source(source): Source, stream: u64) -> Self {
        let mut key = [0; KEY_BYTES];
        key[..8].copy_from_slice(&seed.to_le_bytes());
        key[8..].copy_from_slice(&source);
        let mut generator = ChaCha8Rng::from_seed(key);
        generator.set_stream(stream);
        Self { generator }
    }

    /// Uniform in [0, 1), 53 bits.
    pub fn uniform(&mut self) -> f64 {
        (self.generator.next_u64() >> 11) as f64 * f64::EPSILON * 0.5
    }

    /// Three independent numbers from N(0, 1).
    pub fn normal3(&mut self) -> [f64; 3] {
        let ([x, y], [z, _]) = (self.normal2(), self.normal2());
        [x, y, z]
    }

    /// Two independent numbers from N(0, 1) [Box, Muller 1958].
    pub fn normal2(&mut self) -> [f64; 2] {
        // 1 − u lies in (0, 1], so the logarithm is finite.
        let radius = (-2.0 * libm::log(1.0 - self.uniform())).sqrt();
        let (sin, cos) = libm::sincos(TAU * self.uniform());
        [radius * cos, radius * sin]
    }

    /// Stream of the source.
    #[must_use]
    pub fn stream(&self) -> u64 {
        self.generator.get_stream()
    }

    /// To the place after so many uniform numbers from the first one on.
    pub fn seek(&mut self, numbers: u64) {
        self.generator.set_word_pos(2 * u128::from(numbers));
    }

    /// The generator as plain numbers.
    #[must_use]
    pub fn memory(&self) -> NoiseMemory {
        let seed = self.generator.get_seed();
        let key = std::array::from_fn(|i| {
            u64::from_le_bytes(std::array::from_fn(|byte| seed[8 * i + byte]))
        });
        // A draw takes two words of 32 bits, so 2⁶⁴ of them outlast any flight.
        let position = self.generator.get_word_pos();
        let word_position = u64::try_from(position).unwrap_or(u64::MAX);
        NoiseMemory { key, stream: self.stream(), word_position }
    }

    /// Goes on from a memory, bit for bit.
    pub fn restore(&mut self, memory: &NoiseMemory) {
        let mut key = [0; KEY_BYTES];
        for (slot, word) in key.chunks_exact_mut(8).zip(memory.key) {
            slot.copy_from_slice(&word.to_le_bytes());
        }
        self.generator = ChaCha8Rng::from_seed(key);
        self.generator.set_stream(memory.stream);
        self.generator.set_word_pos(u128::from(memory.word_position));
    }

    /// Goes on in the stream of another seed, at the place reached in this one.
    pub fn reseed(&mut self, seed: u64) {
        self.restore(&self.memory().with_seed(seed));
    }
}

#[cfg(test)]
mod tests {
    use statrs::distribution::{ContinuousCDF, Normal};

    use super::*;

    #[test]
    fn a_restored_stream_continues_bit_for_bit_from_every_position() {
        let mut noise = Noise::new(7, Source::IMU, 3);
        let mut other = Noise::new(1, Source::of_bytes(b"x"), 0);
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
    fn a_reseeded_stream_is_the_other_seeds_from_the_place_reached() {
        let (mut noise, mut other) = (Noise::new(1, Source::IMU, 0), Noise::new(2, Source::IMU, 0));
        noise.normal3();
        other.normal3();
        assert_ne!(noise.memory(), other.memory());
        noise.reseed(2);
        assert_eq!(noise.memory(), other.memory());
        assert_eq!(noise.normal3().map(f64::to_bits), other.normal3().map(f64::to_bits));
    }

    #[test]
    fn a_stream_is_entered_at_any_number() {
        let mut noise = Noise::new(1, Source::TIMING, 0);
        for number in 0..100 {
            let mut entered = Noise::new(1, Source::TIMING, 0);
            entered.seek(number);
            assert_eq!(entered.uniform().to_bits(), noise.uniform().to_bits(), "{number}");
        }
    }

    #[test]
    fn other_seeds_sources_and_streams_give_other_numbers() {
        let first = |seed, source, stream| Noise::new(seed, source, stream).uniform().to_bits();
        let of_imu = first(1, Source::IMU, 0);
        assert_eq!(first(1, Source::IMU, 0), of_imu);
        for other in
            [first(2, Source::IMU, 0), first(1, Source::POSE_FIX, 0), first(1, Source::IMU, 1)]
        {
            assert_ne!(of_imu, other);
        }
    }

    #[test]
    fn every_source_keeps_its_bytes() {
        let words = |source| {
            let [_, words @ ..] = Noise::new(0, source, 0).memory().key;
            words.map(u64::to_le_bytes).concat()
        };
        for (source, bytes) in [
            (Source::IMU, &b"imu"[..]),
            (Source::POSE_FIX, b"pose_fix"),
            (Source::MORPH_ENCODER, b"morph_encoder"),
            (Source::DISTURBANCE, b"disturbance-injector"),
            (Source::TIMING, b"timing"),
        ] {
            let mut whole = bytes.to_vec();
            whole.resize(24, 0);
            assert_eq!(words(source), whole);
        }
    }

    #[test]
    fn the_normal_numbers_follow_the_normal_distribution() {
        let mut noise = Noise::new(3, Source::of_bytes(b"test"), 0);
        let count = 100_000;
        let mut values: Vec<f64> = (0..count / 2).flat_map(|_| noise.normal2()).collect();
        values.sort_by(f64::total_cmp);
        let law = Normal::standard();
        let distance = values
            .iter()
            .enumerate()
            .map(|(i, x)| (law.cdf(*x) - (i as f64 + 0.5) / f64::from(count)).abs())
            .fold(0.0, f64::max);
        // Kolmogorov: 1.95 / √n is passed by 99.9 % of true samples.
        assert!(distance < 1.95 / f64::from(count).sqrt(), "distance {distance}");
    }

    #[test]
    fn the_stream_is_the_published_chacha8_stream() {
        // First word of ChaCha8 for the all-zero key and nonce (ECRYPT test vector set 1, 256 bit).
        let mut generator = Noise::new(0, Source::of_bytes(b""), 0).generator;
        assert_eq!(generator.next_u32().to_le_bytes(), [0x3e, 0x00, 0xef, 0x2f]);
    }
}
