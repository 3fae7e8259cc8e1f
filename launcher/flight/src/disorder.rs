//! A start in disorder, for tests: the flight must not depend on which process starts first, or where.

use rand::seq::SliceRandom as _;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use shared_types::Role;
use swap::child::ChildSpec;

/// Longest pause before a start \[ns\].
const MAX_PAUSE_NS: u64 = 20_000_000;
/// Least priority that is given.
const NICEST: i32 = 15;

/// Shuffles the order of starting, and gives each process a pause before its start, one of the
/// `processors` or none, and a priority.
pub(super) fn shuffle(specs: &mut [(Role, ChildSpec)], seed: u64, processors: &[usize]) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    specs.shuffle(&mut random);
    for (_, spec) in specs {
        spec.cpu = processors.get(random.random_range(0..=processors.len())).copied();
        spec.nice = Some(random.random_range(0..=NICEST));
        spec.pause_ns = random.random_range(0..MAX_PAUSE_NS);
    }
}
