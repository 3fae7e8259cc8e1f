//! The inverse of a block's Hessian, and products with symmetric matrices.
//!
//! Such matrices are stored as rows padded with zeros to whole groups of lanes. Every entry of a
//! product is one sum in the order of the variables, however many entries are worked on at a
//! time: the width of the machine cannot show in the result.

use super::structure::LANES;

/// Writes the inverse of a symmetric positive definite matrix of `n` rows, `wide` numbers each;
/// the matrix itself is lost. Refuses the first pivot that is at most `least` of its diagonal
/// entry, with index and ratio. Leaves in `diagonal` the one that the matrix had (`n`).
pub(super) fn invert(
    matrix: &mut [f64],
    inverse: &mut [f64],
    n: usize,
    wide: usize,
    diagonal: &mut [f64],
    least: f64,
) -> Result<(), (usize, f64)> {
    // With a width that the compiler knows, the rows stay in registers.
    match wide {
        4 => invert_inline(matrix, inverse, n, 4, diagonal, least),
        8 => invert_inline(matrix, inverse, n, 8, diagonal, least),
        12 => invert_inline(matrix, inverse, n, 12, diagonal, least),
        20 => invert_inline(matrix, inverse, n, 20, diagonal, least),
        wide => invert_inline(matrix, inverse, n, wide, diagonal, least),
    }
}

/// V = D^-1/2 L⁻¹ of H = L D L' by elimination in place, then V'V: exactly symmetric, and as
/// accurate as solving for every column; elimination on both sides of the diagonal is not.
#[inline(always)]
#[expect(clippy::inline_always, reason = "the widths above are constants only when inlined")]
fn invert_inline(
    matrix: &mut [f64],
    inverse: &mut [f64],
    n: usize,
    wide: usize,
    diagonal: &mut [f64],
    least: f64,
) -> Result<(), (usize, f64)> {
    for (k, (entry, row)) in diagonal.iter_mut().zip(matrix.chunks_exact(wide)).enumerate() {
        *entry = row[k];
    }
    for (k, original) in diagonal.iter().enumerate().take(n) {
        let (source, after) = matrix[k * wide..].split_at_mut(wide);
        let pivot = source[k];
        let safe = pivot > least * original;
        if !safe {
            return Err((k, pivot / original));
        }
        let inverted = 1.0 / pivot;
        source[k] = 1.0;
        for row in after.chunks_exact_mut(wide) {
            let share = row[k] * inverted;
            row[k] = 0.0;
            for (entry, source) in row.iter_mut().zip(source.iter()) {
                *entry -= share * source;
            }
        }
        let scale = inverted.sqrt();
        for (j, entry) in source.iter_mut().enumerate() {
            *entry = if j <= k { *entry * scale } else { 0.0 };
        }
    }
    for (i, target) in inverse.chunks_exact_mut(wide).enumerate() {
        let mut sources = matrix[i * wide..].chunks_exact(wide);
        if let Some(first) = sources.next() {
            let share = first[i];
            for (entry, source) in target.iter_mut().zip(first) {
                *entry = share * source;
            }
        }
        for source in sources {
            let share = source[i];
            for (entry, source) in target.iter_mut().zip(source) {
                *entry += share * source;
            }
        }
    }
    Ok(())
}

/// out <- M v, all of `out` (`wide` numbers), for a symmetric M in padded rows.
pub(super) fn times(matrix: &[f64], v: &[f64], out: &mut [f64]) {
    match out.len() {
        4 => times_fixed::<4>(matrix, v, out),
        8 => times_fixed::<8>(matrix, v, out),
        12 => times_fixed::<12>(matrix, v, out),
        wide => {
            const CHUNK: usize = 2 * LANES;
            let mut at = 0;
            let (chunks, rest) = out.as_chunks_mut::<CHUNK>();
            for chunk in chunks {
                *chunk = sums(matrix, wide, at, v);
                at += CHUNK;
            }
            if let Some(rest) = rest.first_chunk_mut::<LANES>() {
                *rest = sums(matrix, wide, at, v);
            }
        }
    }
}

fn times_fixed<const WIDE: usize>(matrix: &[f64], v: &[f64], out: &mut [f64]) {
    let mut sums = [0.0; WIDE];
    for (row, value) in matrix.as_chunks::<WIDE>().0.iter().zip(v) {
        for (sum, entry) in sums.iter_mut().zip(row) {
            *sum += entry * value;
        }
    }
    out.copy_from_slice(&sums);
}

/// Entries `at..` of M v.
fn sums<const COUNT: usize>(matrix: &[f64], wide: usize, at: usize, v: &[f64]) -> [f64; COUNT] {
    let mut sums = [0.0; COUNT];
    for (row, value) in matrix.chunks_exact(wide).zip(v) {
        let part = row.get(at..).and_then(|rest| rest.first_chunk::<COUNT>());
        for (sum, entry) in sums.iter_mut().zip(part.into_iter().flatten()) {
            *sum += entry * value;
        }
    }
    sums
}
