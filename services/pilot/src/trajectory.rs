//! The reference trajectory: position, its derivatives and heading as functions of time.

use super::figure_eight::{FigureEight, FigureEightConfig};
use super::polynomials::{PathSample, Piece, Polynomials};
use super::waypoints::{self, Waypoint};
use super::{PilotError, TrajectoryPoint, error};
use shared_types::time::{ns_from_s, s_from_ns};

/// A trajectory as configured. World frame ENU, headings counter-clockwise from east.
#[derive(Debug, Clone, PartialEq)]
pub enum TrajectoryConfig {
    /// Stays where it is.
    Hover {
        /// Position \[m\].
        position_w_m: [f64; 3],
        /// Heading \[rad\].
        yaw_rad: f64,
    },
    /// A three-dimensional figure eight, started from rest and, with a duration, ended at rest.
    FigureEight(FigureEightConfig),
    /// Minimum-jerk segments, at rest at each waypoint; the first and last are held.
    Waypoints(Vec<Waypoint>),
    /// Pieces one after another, passed through without stopping; what moves in the end comes to rest.
    Pieces(Vec<Piece>),
    /// Samples, passed through without stopping, from the first one on; what moves in the end comes to rest.
    Samples(Vec<PathSample>),
}

/// A checked trajectory, defined at every instant: twice continuously differentiable, as far as given pieces are.
#[derive(Debug, Clone)]
pub struct Trajectory(Shape);

#[derive(Debug, Clone)]
enum Shape {
    Hover(TrajectoryPoint),
    FigureEight(FigureEight),
    Waypoints(Vec<Waypoint>),
    Polynomials(Polynomials),
}

impl Trajectory {
    /// Checks a configuration.
    ///
    /// # Errors
    /// [`PilotError`] naming the first parameter that is not finite, out of range or out of order.
    pub fn new(config: &TrajectoryConfig) -> Result<Self, PilotError> {
        Ok(Self(match config {
            TrajectoryConfig::Hover { position_w_m, yaw_rad } => {
                error::position("trajectory.position_w_m", *position_w_m)?;
                error::yaw("trajectory.yaw_rad", *yaw_rad)?;
                Shape::Hover(TrajectoryPoint::at_rest(*position_w_m, *yaw_rad))
            }
            TrajectoryConfig::FigureEight(figure) => Shape::FigureEight(FigureEight::new(figure)?),
            TrajectoryConfig::Waypoints(list) => {
                waypoints::check(list)?;
                Shape::Waypoints(list.clone())
            }
            TrajectoryConfig::Pieces(list) => {
                Shape::Polynomials(Polynomials::new("trajectory.pieces", list.clone())?)
            }
            TrajectoryConfig::Samples(list) => Shape::Polynomials(Polynomials::through(list)?),
        }))
    }

    /// The trajectory at an instant of the flight.
    #[must_use]
    pub fn at(&self, t_ns: u64) -> TrajectoryPoint {
        let t_s = s_from_ns(t_ns);
        match &self.0 {
            Shape::Hover(point) => *point,
            Shape::FigureEight(figure) => figure.at(t_s),
            Shape::Waypoints(list) => waypoints::at(list, t_s),
            Shape::Polynomials(polynomials) => polynomials.at(t_s),
        }
    }

    /// From when on the trajectory rests \[s\], of those that end by themselves.
    #[must_use]
    pub fn rest_s(&self) -> Option<f64> {
        match &self.0 {
            Shape::Hover(_) | Shape::FigureEight(_) => None,
            Shape::Waypoints(list) => list.last().map(|waypoint| waypoint.t_s),
            Shape::Polynomials(polynomials) => Some(polynomials.rest_s()),
        }
    }

    /// Pieces of a trajectory of polynomials; none of another one.
    #[must_use]
    pub fn pieces(&self) -> Option<usize> {
        let Shape::Polynomials(path) = &self.0 else { return None };
        Some(path.count())
    }

    /// How fast a trajectory of polynomials turns at most from one instant to another \[rad/s\]; 0 of another one.
    #[must_use]
    pub fn fastest_turn_rad_s(&self, [from_ns, until_ns]: [u64; 2]) -> f64 {
        let Shape::Polynomials(path) = &self.0 else { return 0.0 };
        path.fastest_turn_rad_s((s_from_ns(from_ns), s_from_ns(until_ns)))
    }

    /// Least and largest height from one instant to another \[m\].
    #[must_use]
    pub fn heights_m(&self, [from_ns, until_ns]: [u64; 2]) -> [f64; 2] {
        let (from_s, until_s) = (s_from_ns(from_ns), s_from_ns(until_ns));
        let extremes = |instants: &mut dyn Iterator<Item = f64>| {
            let heights = instants.map(|t_s| self.at(ns_from_s(t_s)).position_w_m[2]);
            heights.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], height_m| {
                [low.min(height_m), high.max(height_m)]
            })
        };
        match &self.0 {
            Shape::Hover(point) => [point.position_w_m[2]; 2],
            Shape::FigureEight(figure) => {
                let inside = figure.instants_s(until_s).filter(|t_s| *t_s >= from_s);
                extremes(&mut inside.chain([from_s, until_s]))
            }
            Shape::Waypoints(list) => {
                // Between two of them the height is between theirs.
                let passed = list.iter().map(|waypoint| waypoint.t_s.clamp(from_s, until_s));
                extremes(&mut passed.chain([from_s, until_s]))
            }
            Shape::Polynomials(path) => {
                let window_s = (from_s, until_s);
                let high_m = path.largest(window_s, |point| point.position_w_m[2]);
                [-path.largest(window_s, |point| -point.position_w_m[2]), high_m]
            }
        }
    }

    /// Largest acceleration \[m/s²\] from one instant to another.
    #[must_use]
    pub fn peak_acceleration_m_s2(&self, window_ns: [u64; 2]) -> f64 {
        self.peak(window_ns, |point| point.acceleration_w_m_s2)
    }

    /// Largest acceleration sideways \[m/s²\] from one instant to another, where the vehicle climbs faster as much less,
    /// as its thrust is then larger: for the question whether mean drag + 3 σ + m a stays well below what the tilt bound
    /// can give. Infinite where the thrust would have to be nothing.
    #[must_use]
    pub fn peak_sideways_m_s2(&self, window_ns: [u64; 2], gravity_m_s2: f64) -> f64 {
        self.peak(window_ns, |point| {
            let [x, y, up] = point.acceleration_w_m_s2;
            let lift = (1.0 + up / gravity_m_s2).max(0.0);
            let share = |sideways: f64| if sideways == 0.0 { 0.0 } else { sideways / lift };
            [share(x), share(y), 0.0]
        })
    }

    /// Largest acceleration downwards and upwards \[m/s²\] from one instant to another, none below 0.
    #[must_use]
    pub fn peak_vertical_m_s2(&self, window_ns: [u64; 2]) -> [f64; 2] {
        let up = |point: &TrajectoryPoint| point.acceleration_w_m_s2[2];
        [
            self.peak(window_ns, |point| [(-up(point)).max(0.0), 0.0, 0.0]),
            self.peak(window_ns, |point| [up(point).max(0.0), 0.0, 0.0]),
        ]
    }

    /// Largest speed \[m/s\] from one instant to another.
    #[must_use]
    pub fn peak_speed_m_s(&self, window_ns: [u64; 2]) -> f64 {
        self.peak(window_ns, |point| point.velocity_w_m_s)
    }

    /// Largest length of a vector of the trajectory, at the instants at which it can be largest.
    fn peak(&self, window_ns: [u64; 2], of: impl Fn(&TrajectoryPoint) -> [f64; 3]) -> f64 {
        let [from_s, until_s] = window_ns.map(s_from_ns);
        let squared = |point: &TrajectoryPoint| of(point).iter().map(|x| x * x).sum::<f64>();
        let squared = match &self.0 {
            Shape::Hover(point) => squared(point),
            Shape::FigureEight(figure) => {
                let instants = figure.instants_s(until_s).filter(|t_s| *t_s >= from_s);
                let instants = instants.chain([from_s]);
                instants.map(|t_s| squared(&figure.at(t_s))).fold(0.0, f64::max)
            }
            Shape::Waypoints(list) => {
                let instants = waypoints::instants_s(list, until_s).filter(|t_s| *t_s >= from_s);
                let instants = instants.chain([from_s]);
                instants.map(|t_s| squared(&waypoints::at(list, t_s))).fold(0.0, f64::max)
            }
            Shape::Polynomials(polynomials) => polynomials.largest((from_s, until_s), squared),
        };
        squared.sqrt()
    }
}
