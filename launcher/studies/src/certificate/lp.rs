//! Linear programs in a handful of variables, by Seidel's incremental method (Discrete and
//! Computational Geometry 6, 1991): constraints come one by one, and where one is violated by the
//! optimum so far, the new optimum lies on it, in one variable less.

/// Variables at most.
pub(super) const WIDEST: usize = 8;
/// Violation up to which a constraint counts as satisfied; they are of about unit length.
const TOLERANCE: f64 = 1e-12;

pub(super) type Point = [f64; WIDEST];

/// normal' z <= bound.
#[derive(Debug, Clone, Copy)]
pub(super) struct Half {
    pub(super) normal: Point,
    pub(super) bound: f64,
}

/// The point within all halves and the box `-size <= z <= size`, in `d` variables, that is largest
/// along `aim`, or `None` if there is none.
pub(super) fn largest(halves: &[Half], d: usize, aim: &Point, size: &Point) -> Option<Point> {
    if d == 1 {
        return on_a_line(halves, aim[0], size[0]);
    }
    let mut z = [0.0; WIDEST];
    for k in 0..d {
        z[k] = if aim[k] < 0.0 { -size[k] } else { size[k] };
    }
    for (i, half) in halves.iter().enumerate() {
        let excess = (0..d).fold(-half.bound, |sum, k| sum + half.normal[k] * z[k]);
        if excess > TOLERANCE {
            z = on_plane(half, &halves[..i], d, aim, size)?;
        }
    }
    Some(z)
}

fn on_a_line(halves: &[Half], aim: f64, size: f64) -> Option<Point> {
    let (mut low, mut high) = (-size, size);
    for half in halves {
        let (a, b) = (half.normal[0], half.bound);
        if a > TOLERANCE {
            high = high.min(b / a);
        } else if a < -TOLERANCE {
            low = low.max(b / a);
        } else if b < -TOLERANCE {
            return None;
        }
    }
    if low > high + TOLERANCE * (1.0 + low.abs()) {
        return None;
    }
    let mut z = [0.0; WIDEST];
    z[0] = if aim < 0.0 { low } else { high.max(low) };
    Some(z)
}

/// The same on the plane normal' z = bound: its largest component is expressed by the others.
fn on_plane(plane: &Half, halves: &[Half], d: usize, aim: &Point, size: &Point) -> Option<Point> {
    let length = |k: &usize| plane.normal[*k].abs();
    let out = (0..d).max_by(|a, b| length(a).total_cmp(&length(b)))?;
    let pivot = plane.normal[out];
    if pivot.abs() <= TOLERANCE {
        return None;
    }
    // The last variable takes the place of the one that goes.
    let without = |point: &Point| {
        let mut rest = *point;
        rest[out] = point[d - 1];
        rest
    };
    let reduced = |normal: &Point, bound: f64| {
        let share = normal[out] / pivot;
        let mut rest = *normal;
        for (rest, p) in rest.iter_mut().zip(&plane.normal).take(d) {
            *rest -= share * p;
        }
        Half { normal: without(&rest), bound: bound - share * plane.bound }
    };
    let side = |sign: f64| {
        let mut normal = [0.0; WIDEST];
        normal[out] = sign;
        reduced(&normal, size[out])
    };
    let mut below = vec![side(1.0), side(-1.0)];
    below.extend(halves.iter().map(|half| reduced(&half.normal, half.bound)));
    let mut z = largest(&below, d - 1, &reduced(aim, 0.0).normal, &without(size))?;
    z[d - 1] = z[out];
    z[out] = 0.0;
    let rest = (0..d).fold(plane.bound, |sum, k| sum - plane.normal[k] * z[k]);
    z[out] = rest / pivot;
    Some(z)
}
