//! The manoeuvre `kind = "trajectory"`: what a planner or a log has written, as a file or in the scenario.

use crate::{PathSample, Piece, TrajectoryConfig};
use garde::Validate;
use schemars::JsonSchema;
use serde::Deserialize;

/// Most rows: a scenario has all of them in it, and each process of a flight reads it.
pub const MAX_ROWS: usize = 10_000;

/// Fastest that a trajectory may be, which is how fast a flight may begin \[m/s\].
pub const MAX_SPEED_M_S: f64 = 100.0;

/// Largest `time_scale`.
pub const MAX_TIME_SCALE: f64 = 100.0;

/// A trajectory that is passed through as it is given, without stopping.
///
/// A flight begins where the trajectory does, as fast as it does there, and ends two seconds after it, unless
/// `[start]` and `[scenario]` set another. Once a file has been read, its rows stand in the scenario in its place, so
/// that a recording has all that was flown.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields, default)]
pub struct Trajectory {
    /// A file of comma-separated values, from the folder of the scenario or, by `--set`, from where the command runs:
    /// `pieces` as planners write them, or `samples`, distinguished by the names in the first line.
    #[garde(skip)]
    pub file: Option<String>,
    /// Polynomials: duration \[s\], then eight coefficients in ascending powers of time for each of x, y, z \[m/s^k\] and
    /// heading \[rad/s^k\], which may be left out.
    #[garde(custom(rows_of("25 or 33", &[25, 33])))]
    pub pieces: Vec<Vec<f64>>,
    /// Points: t \[s\], x, y, z \[m\], heading \[rad\], velocity \[m/s\], acceleration \[m/s²\]; what comes later may
    /// be left out.
    #[garde(custom(rows_of("4, 5, 8 or 11", &[4, 5, 8, 11])), custom(in_order))]
    pub samples: Vec<Vec<f64>>,
    /// Where the trajectory's own origin is \[m\].
    #[garde(inner(range(min = -10000.0, max = 10000.0)))]
    pub origin_w_m: [f64; 3],
    /// How many times as long as given it takes.
    #[garde(range(min = 0.01, max = MAX_TIME_SCALE))]
    pub time_scale: f64,
}

impl Default for Trajectory {
    fn default() -> Self {
        let (pieces, samples) = (Vec::new(), Vec::new());
        Self { file: None, pieces, samples, origin_w_m: [0.0; 3], time_scale: 1.0 }
    }
}

/// Refuses rows of other lengths, or of several.
fn rows_of(
    sizes: &'static str,
    lengths: &'static [usize],
) -> impl FnOnce(&Vec<Vec<f64>>, &()) -> garde::Result {
    move |rows, _context| {
        if rows.len() > MAX_ROWS {
            let text = format!("{} rows are too many, {MAX_ROWS} fit", rows.len());
            return Err(garde::Error::new(text));
        }
        let first = rows.first().map_or(0, Vec::len);
        let wrong = rows.iter().position(|row| row.len() != first || !lengths.contains(&row.len()));
        wrong.map_or(Ok(()), |row| {
            let given = rows[row].len();
            let text = format!("[{row}] has {given} numbers and is not a list of {sizes} numbers, as many in each row");
            Err(garde::Error::new(text))
        })
    }
}

/// Refuses times that do not increase.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "the signature that the validator calls")]
fn in_order(rows: &[Vec<f64>], _context: &()) -> garde::Result {
    first_not_increasing(rows).map_or(Ok(()), |row| {
        let at = |row: usize| rows[row].first().copied().unwrap_or(0.0);
        let text = format!("[{row}] is at {:?} s, after one at {:?} s", at(row), at(row - 1));
        Err(garde::Error::new(text))
    })
}

/// The first sample that is not later than the one before it.
#[must_use]
pub fn first_not_increasing(rows: &[Vec<f64>]) -> Option<usize> {
    let is_late = |pair: &[Vec<f64>]| pair[1].first() > pair[0].first();
    Some(rows.windows(2).position(|pair| !is_late(pair))? + 1)
}

impl Trajectory {
    /// What the pilot flies.
    #[must_use]
    pub fn config(&self) -> TrajectoryConfig {
        if self.pieces.is_empty() {
            TrajectoryConfig::Samples(self.samples.iter().map(|row| self.sample(row)).collect())
        } else {
            TrajectoryConfig::Pieces(self.pieces.iter().map(|row| self.piece(row)).collect())
        }
    }

    fn piece(&self, row: &[f64]) -> Piece {
        let axis = |axis: usize| {
            core::array::from_fn(|k| {
                let given = row.get(1 + 8 * axis + k).copied().unwrap_or(0.0);
                let origin = self.origin_w_m.get(axis).filter(|_| k == 0).copied().unwrap_or(0.0);
                origin + given / (0..k).fold(1.0, |power, _| power * self.time_scale)
            })
        };
        let duration_s = self.time_scale * row.first().copied().unwrap_or(0.0);
        Piece { duration_s, position_w: [axis(0), axis(1), axis(2)], yaw: axis(3) }
    }

    fn sample(&self, row: &[f64]) -> PathSample {
        let number = |column: usize| row.get(column).copied().unwrap_or(0.0);
        let vector = |column: usize, divided: f64| {
            (row.len() > column).then(|| core::array::from_fn(|i| number(column + i) / divided))
        };
        PathSample {
            t_s: self.time_scale * (number(0) - self.begin_s()),
            position_w_m: core::array::from_fn(|i| self.origin_w_m[i] + number(1 + i)),
            yaw_rad: number(4),
            velocity_w_m_s: vector(5, self.time_scale),
            acceleration_w_m_s2: vector(8, self.time_scale * self.time_scale),
        }
    }

    /// Time of the first sample \[s\]: a log may begin at any.
    fn begin_s(&self) -> f64 {
        self.samples.first().and_then(|row| row.first()).copied().unwrap_or(0.0)
    }
}
