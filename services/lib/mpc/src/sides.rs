//! The working set as plain words, for a controller's published memory.

/// Rows that fit into a [`PackedSides`].
pub const ROW_CAPACITY: usize = 1024;

/// The side each row is held at, two bits per row: 0 none, 1 upper, 2 lower.
pub type PackedSides = [u64; ROW_CAPACITY / 32];

/// Packs `sides` (-1 lower, 0 none, +1 upper); words beyond them are left alone.
pub(crate) fn pack(sides: &[i8], packed: &mut PackedSides) {
    for (word, sides) in packed.iter_mut().zip(sides.chunks(32)) {
        *word = sides.iter().rev().fold(0, |word, side| {
            word << 2
                | match side {
                    0 => 0,
                    1.. => 1,
                    _ => 2,
                }
        });
    }
}

/// Reverses [`pack`]. The bits that it never writes become 2, which no solver accepts.
pub(crate) fn unpack(packed: &PackedSides, sides: &mut [i8]) {
    for (word, sides) in packed.iter().zip(sides.chunks_mut(32)) {
        for (i, side) in sides.iter_mut().enumerate() {
            *side = [0, 1, -1, 2][(word >> (2 * i) & 3) as usize];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packing_and_unpacking_leaves_every_side_as_it_was() {
        for length in [0, 1, 31, 32, 33, 100, ROW_CAPACITY] {
            let sides: Vec<i8> = (0..length).map(|i| [0, 1, -1, -1, 0][i % 5]).collect();
            let mut packed = [0; ROW_CAPACITY / 32];
            pack(&sides, &mut packed);
            let mut back = vec![9; length];
            unpack(&packed, &mut back);
            assert_eq!(back, sides);
        }
    }

    #[test]
    fn bits_that_mean_nothing_stay_recognisable() {
        let mut sides = [0; 40];
        unpack(&[u64::MAX; ROW_CAPACITY / 32], &mut sides);
        assert_eq!(sides, [2; 40]);
    }
}
