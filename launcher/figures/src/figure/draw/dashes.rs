//! Dashed lines as lines with gaps.
//!
//! The plotting crate begins its pattern anew at every corner of a line in a raster, so that a curve of many points is
//! drawn without a gap.

use kuva::render::render::{PathData, Primitive};

/// Most periods of a pattern along a line.
const MAX_PERIODS: f64 = 1e5;

/// The same drawing with every dashed line as the pieces of it that are drawn.
pub(super) fn cut(elements: Vec<Primitive>) -> Vec<Primitive> {
    elements.into_iter().flat_map(pieces).collect()
}

fn pieces(element: Primitive) -> Vec<Primitive> {
    let (points, pattern, stroke, stroke_width) = match &element {
        Primitive::PolyLine { points, stroke, stroke_width, stroke_dasharray: Some(pattern) } => {
            (points.clone(), pattern.clone(), stroke.clone(), *stroke_width)
        }
        Primitive::Path(path) => {
            let PathData { d, fill, stroke, stroke_width, stroke_dasharray, opacity } = &**path;
            match (stroke_dasharray, fill.is_none() && opacity.is_none(), corners(d)) {
                (Some(pattern), true, Some(points)) => {
                    (points, pattern.clone(), stroke.clone(), *stroke_width)
                }
                _ => return vec![element],
            }
        }
        _ => return vec![element],
    };
    let lengths: Vec<f64> = pattern.split([',', ' ']).filter_map(|it| it.parse().ok()).collect();
    let period: f64 = lengths.iter().sum();
    let way: f64 = points
        .windows(2)
        .map(|ends| libm::hypot(ends[1].0 - ends[0].0, ends[1].1 - ends[0].1))
        .sum();
    // What is no pattern, and a line that leaves any picture, stay as they are.
    let is_drawable =
        lengths.iter().all(|length| *length >= 0.0) && period > 0.0 && way < MAX_PERIODS * period;
    if !is_drawable {
        return vec![element];
    }
    let line = |points| {
        let (stroke, stroke_dasharray) = (stroke.clone(), None);
        Primitive::PolyLine { points, stroke, stroke_width, stroke_dasharray }
    };
    dashes(&points, &lengths).into_iter().map(line).collect()
}

/// The stretches of a line on which a pattern of dashes and gaps draws.
fn dashes(points: &[(f64, f64)], lengths: &[f64]) -> Vec<Vec<(f64, f64)>> {
    let (mut all, mut dash) = (Vec::new(), points.first().copied().into_iter().collect::<Vec<_>>());
    let mut pattern = (0..).map(|i: usize| (lengths[i % lengths.len()], i.is_multiple_of(2)));
    let (mut left, mut is_drawn) = pattern.next().unwrap_or((0.0, true));
    for ends in points.windows(2) {
        let [(mut x, mut y), (to_x, to_y)] = [ends[0], ends[1]];
        let mut way = libm::hypot(to_x - x, to_y - y);
        while way > left {
            let share = left / way;
            (x, y) = (x + share * (to_x - x), y + share * (to_y - y));
            way -= left;
            if is_drawn {
                dash.push((x, y));
                all.push(core::mem::take(&mut dash));
            } else {
                dash = vec![(x, y)];
            }
            (left, is_drawn) = pattern.next().unwrap_or((0.0, true));
        }
        left -= way;
        if is_drawn {
            dash.push((to_x, to_y));
        }
    }
    if is_drawn && dash.len() > 1 {
        all.push(dash);
    }
    all
}

/// Corners of a path of straight lines; none if it has anything else.
fn corners(path: &str) -> Option<Vec<(f64, f64)>> {
    let moves = path.matches(['M', 'm']).count();
    let is_straight = path.chars().all(|c| !c.is_ascii_alphabetic() || "MLe".contains(c));
    if moves != 1 || !is_straight {
        return None;
    }
    let numbers = path.split(|c: char| c == ',' || c == 'M' || c == 'L' || c.is_whitespace());
    let numbers: Vec<f64> = numbers.filter_map(|number| number.parse().ok()).collect();
    Some(numbers.chunks_exact(2).map(|pair| (pair[0], pair[1])).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pattern_goes_on_across_the_corners_of_a_line() {
        let points: Vec<(f64, f64)> = (0..=100).map(|i| (0.1 * f64::from(i), 0.0)).collect();
        let found = dashes(&points, &[2.0, 1.0]);
        let ends: Vec<[f64; 2]> =
            found.iter().map(|dash| [dash[0].0, dash[dash.len() - 1].0]).collect();
        for (dash, wanted) in ends.iter().zip([[0.0, 2.0], [3.0, 5.0], [6.0, 8.0], [9.0, 10.0]]) {
            assert!(dash.iter().zip(wanted).all(|(is, it)| (is - it).abs() < 1e-9), "{ends:?}");
        }
        assert_eq!(ends.len(), 4);
    }

    #[test]
    fn straight_paths_have_corners_and_others_none() {
        assert_eq!(corners("M1,2 L3,4.5"), Some(vec![(1.0, 2.0), (3.0, 4.5)]));
        assert_eq!(corners("M 1 2 L 3 4e1 L 5 6").map(|it| it.len()), Some(3));
        assert_eq!(corners("M1,2 C1,2 3,4 5,6"), None);
        assert_eq!(corners("M1,2 L3,4 M5,6 L7,8"), None);
    }
}
