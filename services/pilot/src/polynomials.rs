//! Trajectories that users bring: polynomials piece by piece, as planners write them, or samples joined by polynomials.
//!
//! Nothing stops at a joint. What moves in the end comes to rest along a cubic of its speed.

use super::error::{MAX_GAPS, position, within};
use super::pace::{POSITION_BRAKE, YAW, braked};
use super::spline::Spline;
use super::{PilotError, TrajectoryPoint};
use core::f64::consts::{PI, TAU};

/// Coefficients of one axis: polynomials have a degree of up to 7.
pub const COEFFICIENTS: usize = 8;

/// Instants of a piece at which it is looked at for what is largest.
const INSTANTS: u32 = 32;

/// A polynomial of the time since it began, for each axis, with coefficients in ascending powers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Piece {
    /// How long it lasts \[s\].
    pub duration_s: f64,
    /// Of x, y and z, the k-th in m/s^k.
    pub position_w: [[f64; COEFFICIENTS]; 3],
    /// Of the heading, the k-th in rad/s^k.
    pub yaw: [f64; COEFFICIENTS],
}

/// Where a trajectory is at one instant, passed through without stopping.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathSample {
    /// When \[s\]; the trajectory begins with the first one, whenever that is.
    pub t_s: f64,
    /// Where \[m\].
    pub position_w_m: [f64; 3],
    /// Heading \[rad\]; from one sample to the next it turns the shorter way.
    pub yaw_rad: f64,
    /// How fast \[m/s\]; that of a cubic spline through the positions if left out.
    pub velocity_w_m_s: Option<[f64; 3]>,
    /// With which acceleration \[m/s²\]; that of a cubic spline through the velocities if left out.
    pub acceleration_w_m_s2: Option<[f64; 3]>,
}

/// Value and first two derivatives of a polynomial at `t`.
fn value(coefficients: &[f64; COEFFICIENTS], t: f64) -> [f64; 3] {
    let (mut value, mut slope, mut bend) = (0.0, 0.0, 0.0);
    for coefficient in coefficients.iter().rev() {
        bend = bend * t + slope;
        slope = slope * t + value;
        value = value * t + coefficient;
    }
    [value, slope, 2.0 * bend]
}

impl Piece {
    /// Value and first two derivatives of x, y, z and heading, `t_s` after it began.
    fn at(&self, t_s: f64) -> [[f64; 3]; 4] {
        let [x, y, z] = &self.position_w;
        [x, y, z, &self.yaw].map(|axis| value(axis, t_s))
    }

    /// Without motion.
    fn still(duration_s: f64, position_w_m: [f64; 3], yaw_rad: f64) -> Self {
        let constant = |value| core::array::from_fn(|k| if k == 0 { value } else { 0.0 });
        Self { duration_s, position_w: position_w_m.map(constant), yaw: constant(yaw_rad) }
    }
}

/// A trajectory that has been checked.
#[derive(Debug, Clone)]
pub(super) struct Polynomials {
    pieces: Vec<Piece>,
    /// When each begins \[s\].
    begins_s: Vec<f64>,
    end_s: f64,
    /// Value and first two derivatives of x, y, z and heading when the last piece ends.
    end: [[f64; 3]; 4],
    /// Times in which position and heading then come to rest \[s\].
    brakes_s: [f64; 2],
}

impl Polynomials {
    /// Checks pieces of what complaints call `list`.
    pub(super) fn new(list: &'static str, mut pieces: Vec<Piece>) -> Result<Self, PilotError> {
        let (mut begins_s, mut end_s) = (Vec::with_capacity(pieces.len()), 0.0);
        let mut end: Option<[[f64; 3]; 4]> = None;
        for (index, piece) in pieces.iter_mut().enumerate() {
            within(format_args!("{list}[{index}].duration_s"), piece.duration_s, (1e-6, 1e6))?;
            if let Some(end) = end {
                // A heading may be written within a turn.
                let turns = libm::round((end[3][0] - piece.yaw[0]) / TAU);
                // Where nothing has to be added, not a bit changes.
                if turns != 0.0 {
                    piece.yaw[0] += TAU * turns;
                }
                joins(list, index, &piece.at(0.0), &end)?;
            }
            for t_s in instants_s(0.0, piece.duration_s) {
                let [x, y, z, turned] = piece.at(t_s).map(|axis| axis[0]);
                position(format_args!("{list}[{index}].position_w"), [x, y, z])?;
                // Whole turns have been added, as many as there are.
                within(format_args!("{list}[{index}].yaw"), turned, (-1e6, 1e6))?;
            }
            begins_s.push(end_s);
            end_s += piece.duration_s;
            end = Some(piece.at(piece.duration_s));
        }
        let Some(end) = end else { return Err(PilotError::Empty { parameter: list }) };
        let length = |order: usize| norm([end[0][order], end[1][order], end[2][order]]);
        let brake_s = POSITION_BRAKE.brake_s(length(1), length(2));
        let turn_brake_s = YAW.brake_s(end[3][1].abs(), end[3][2].abs());
        Ok(Self { pieces, begins_s, end_s, end, brakes_s: [brake_s, turn_brake_s] })
    }

    /// Joins samples, each interval by the quintic that has position, velocity and acceleration at both ends.
    pub(super) fn through(samples: &[PathSample]) -> Result<Self, PilotError> {
        const LIST: &str = "trajectory.samples";
        super::error::increasing(LIST, samples.iter().map(|sample| sample.t_s))?;
        if let [only] = samples {
            return Self::new(LIST, vec![Piece::still(1.0, only.position_w_m, only.yaw_rad)]);
        }
        let t_s: Vec<f64> = samples.iter().map(|sample| sample.t_s).collect();
        let axes: [Axis; 4] = core::array::from_fn(|axis| {
            let of = |sample: &PathSample, vector: Option<[f64; 3]>, or: f64| {
                if axis < 3 { vector.map_or(or, |v| v[axis]) } else { sample.yaw_rad }
            };
            let mut values: Vec<f64> =
                samples.iter().map(|s| of(s, Some(s.position_w_m), 0.0)).collect();
            if axis == 3 {
                unwrap(&mut values);
            }
            let spline = Spline::through(&t_s, &values);
            // Heading has no derivatives of its own.
            let given = |v: fn(&PathSample) -> Option<[f64; 3]>| {
                axis < 3 && samples.iter().all(|s| v(s).is_some())
            };
            let (slopes, bends) = if given(|s| s.velocity_w_m_s) {
                let slopes: Vec<f64> =
                    samples.iter().map(|s| of(s, s.velocity_w_m_s, 0.0)).collect();
                let bends = Spline::through(&t_s, &slopes).slopes;
                (slopes, bends)
            } else {
                (spline.slopes, spline.bends)
            };
            let bends = if given(|s| s.acceleration_w_m_s2) {
                samples.iter().map(|s| of(s, s.acceleration_w_m_s2, 0.0)).collect()
            } else {
                bends
            };
            Axis { values, slopes, bends }
        });
        let pieces = t_s.windows(2).enumerate().map(|(i, t_s)| {
            let duration_s = t_s[1] - t_s[0];
            let [x, y, z, yaw] = axes.each_ref().map(|axis| axis.quintic(i, duration_s));
            Piece { duration_s, position_w: [x, y, z], yaw }
        });
        Self::new(LIST, pieces.collect())
    }

    /// How many pieces it has.
    pub(super) fn count(&self) -> usize {
        self.pieces.len()
    }

    /// Fastest that it turns in the pieces of a window, at the instants at which they are looked at \[rad/s\].
    pub(super) fn fastest_turn_rad_s(&self, (from_s, until_s): (f64, f64)) -> f64 {
        let pieces = self.begins_s.iter().zip(&self.pieces);
        let flown = pieces.filter(|(begin_s, piece)| {
            **begin_s <= until_s && *begin_s + piece.duration_s >= from_s
        });
        let rates = flown.flat_map(|(_, piece)| {
            instants_s(0.0, piece.duration_s).map(|t_s| value(&piece.yaw, t_s)[1].abs())
        });
        rates.fold(0.0, f64::max)
    }

    /// From when on it rests \[s\].
    pub(super) fn rest_s(&self) -> f64 {
        let [position_s, turn_s] = self.brakes_s;
        self.end_s + position_s.max(turn_s)
    }

    pub(super) fn at(&self, t_s: f64) -> TrajectoryPoint {
        let t_s = t_s.max(0.0);
        let index = self.begins_s.partition_point(|begin_s| *begin_s <= t_s).saturating_sub(1);
        let at = match (self.pieces.get(index), self.begins_s.get(index)) {
            (Some(piece), Some(begin_s)) if t_s < self.end_s => piece.at(t_s - begin_s),
            _ => core::array::from_fn(|axis| {
                let ([from, rate, acceleration], [position_s, turn_s]) =
                    (self.end[axis], self.brakes_s);
                let brake_s = if axis < 3 { position_s } else { turn_s };
                let [way, rate, acceleration] =
                    braked(rate, acceleration, brake_s, t_s - self.end_s);
                [from + way, rate, acceleration]
            }),
        };
        let [x, y, z, [yaw_rad, ..]] = at;
        TrajectoryPoint {
            position_w_m: [x[0], y[0], z[0]],
            velocity_w_m_s: [x[1], y[1], z[1]],
            acceleration_w_m_s2: [x[2], y[2], z[2]],
            yaw_rad,
        }
    }

    /// Largest value of a smooth function of the trajectory from one instant to another.
    pub(super) fn largest(
        &self,
        (begin_s, until_s): (f64, f64),
        of: impl Fn(&TrajectoryPoint) -> f64,
    ) -> f64 {
        let brake = (self.end_s, self.rest_s().max(begin_s));
        let pieces = self.begins_s.iter().zip(&self.pieces);
        let stretches = pieces.map(|(begin_s, piece)| (*begin_s, begin_s + piece.duration_s));
        let flown = stretches.chain([brake]).take_while(|(from_s, _)| *from_s <= until_s);
        let flown = flown.filter(|(_, to_s)| *to_s >= begin_s);
        let at = |t_s: f64| of(&self.at(t_s));
        flown.fold(f64::NEG_INFINITY, |largest, (from_s, to_s)| {
            let (from_s, to_s) = (from_s.max(begin_s), to_s.min(until_s));
            let spacing_s = (to_s - from_s) / f64::from(INSTANTS);
            let look = instants_s(from_s, to_s).map(|t_s| (at(t_s), t_s));
            let (most, near_s) =
                look.fold(
                    (f64::NEG_INFINITY, from_s),
                    |most, here| {
                        if here.0 > most.0 { here } else { most }
                    },
                );
            // It has one top between the neighbours of the largest look.
            let mut range_s = ((near_s - spacing_s).max(from_s), (near_s + spacing_s).min(to_s));
            for _ in 0..24 {
                let third_s = (range_s.1 - range_s.0) / 3.0;
                let (low_s, high_s) = (range_s.0 + third_s, range_s.1 - third_s);
                if at(low_s) < at(high_s) { range_s.0 = low_s } else { range_s.1 = high_s }
            }
            largest.max(most).max(at(0.5 * (range_s.0 + range_s.1)))
        })
    }
}

/// Refuses a piece that begins elsewhere than where the one before it ends.
fn joins(
    list: &'static str,
    index: usize,
    begin: &[[f64; 3]; 4],
    end: &[[f64; 3]; 4],
) -> Result<(), PilotError> {
    let apart = |order: usize| norm(core::array::from_fn(|i| begin[i][order] - end[i][order]));
    let turned = |order: usize| (begin[3][order] - end[3][order]).abs();
    let gaps = [apart(0), apart(1), turned(0), turned(1)];
    for (gap, (limit, unit)) in gaps.into_iter().zip(MAX_GAPS) {
        if gap > limit || gap.is_nan() {
            return Err(PilotError::Disjoint { list, index, gap, limit, unit });
        }
    }
    Ok(())
}

/// What samples give for one axis.
struct Axis {
    values: Vec<f64>,
    slopes: Vec<f64>,
    bends: Vec<f64>,
}

impl Axis {
    /// From sample `i` to the next.
    fn quintic(&self, i: usize, duration_s: f64) -> [f64; COEFFICIENTS] {
        let (t, from, slope, bend) = (duration_s, self.values[i], self.slopes[i], self.bends[i]);
        // What is missing at the end if the motion just goes on.
        let way = self.values[i + 1] - from - t * (slope + 0.5 * t * bend);
        let rate = t * (self.slopes[i + 1] - slope - t * bend);
        let curve = 0.5 * t * t * (self.bends[i + 1] - bend);
        let cube = t * t * t;
        [
            from,
            slope,
            0.5 * bend,
            (10.0 * way - 4.0 * rate + curve) / cube,
            (-15.0 * way + 7.0 * rate - 2.0 * curve) / (cube * t),
            (6.0 * way - 3.0 * rate + curve) / (cube * t * t),
            0.0,
            0.0,
        ]
    }
}

/// Adds whole turns, so that no angle is more than half a turn from the one before.
fn unwrap(angles_rad: &mut [f64]) {
    let mut last: Option<f64> = None;
    for angle_rad in angles_rad {
        if let Some(last) = last {
            let turns = libm::floor((*angle_rad - last + PI) / TAU);
            // Where nothing has to be added, not a bit changes.
            if turns != 0.0 {
                *angle_rad -= TAU * turns;
            }
        }
        last = Some(*angle_rad);
    }
}

/// Instants from one to another, both included.
fn instants_s(from_s: f64, to_s: f64) -> impl Iterator<Item = f64> {
    (0..=INSTANTS).map(move |i| from_s + (to_s - from_s) * f64::from(i) / f64::from(INSTANTS))
}

fn norm([x, y, z]: [f64; 3]) -> f64 {
    (x * x + y * y + z * z).sqrt()
}
