//! Cubic splines: the smoothest curve through given values.

/// Derivatives of a spline at its knots.
#[derive(Debug)]
pub(super) struct Spline {
    /// First derivatives.
    pub(super) slopes: Vec<f64>,
    /// Second derivatives.
    pub(super) bends: Vec<f64>,
}

impl Spline {
    /// Through `values` at increasing `knots`, at least two. The slope at each end is that of the cubic through the four
    /// values nearest to it (de Boor, "A Practical Guide to Splines", 1978, chapter IV).
    pub(super) fn through(knots: &[f64], values: &[f64]) -> Self {
        let lengths: Vec<f64> = knots.windows(2).map(|t| t[1] - t[0]).collect();
        let steps = values.windows(2).map(|y| y[1] - y[0]);
        let chords: Vec<f64> = steps.zip(&lengths).map(|(step, length)| step / length).collect();
        let slopes = slopes(
            &lengths,
            &chords,
            [end_slope(knots, values), {
                let (mut knots, mut values) = (knots.to_vec(), values.to_vec());
                knots.reverse();
                values.reverse();
                end_slope(&knots, &values)
            }],
        );
        let last = chords.len() - 1;
        let bend = |i: usize| {
            let at = i.min(last);
            let (own, other) = (slopes[i], slopes[if i > last { last } else { i + 1 }]);
            let side = if i > last { -1.0 } else { 1.0 };
            side * (6.0 * chords[at] - 4.0 * own - 2.0 * other) / lengths[at]
        };
        let bends = (0..values.len()).map(bend).collect();
        Self { slopes, bends }
    }
}

/// Slopes at all knots, such that the second derivative has no jump: a tridiagonal system, which is diagonally dominant,
/// solved by elimination from the front.
fn slopes(lengths: &[f64], chords: &[f64], ends: [f64; 2]) -> Vec<f64> {
    // Slope i is `known - factor * slope i+1`.
    let mut eliminated = vec![(ends[0], 0.0)];
    for (length, chord) in lengths.windows(2).zip(chords.windows(2)) {
        let (before, after) = (1.0 / length[0], 1.0 / length[1]);
        let (known, factor) = eliminated[eliminated.len() - 1];
        let pivot = 2.0 * (before + after) - before * factor;
        let right = 3.0 * (chord[0] * before + chord[1] * after);
        eliminated.push(((right - before * known) / pivot, after / pivot));
    }
    let mut slope = ends[1];
    let mut backward = vec![slope];
    for (known, factor) in eliminated.iter().skip(1).rev() {
        slope = known - factor * slope;
        backward.push(slope);
    }
    backward.push(ends[0]);
    backward.reverse();
    backward
}

/// Derivative at the first knot of the polynomial through the first four values, or as many as there are.
fn end_slope(knots: &[f64], values: &[f64]) -> f64 {
    let knots = &knots[..knots.len().min(4)];
    let others = || 1..knots.len();
    let of_first: f64 = others().map(|k| 1.0 / (knots[0] - knots[k])).sum();
    others().fold(values[0] * of_first, |slope, k| {
        let product = others()
            .filter(|m| *m != k)
            .fold(1.0, |product, m| product * (knots[0] - knots[m]) / (knots[k] - knots[m]));
        slope + values[k] * product / (knots[k] - knots[0])
    })
}
