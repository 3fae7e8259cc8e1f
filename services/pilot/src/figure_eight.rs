//! A figure eight in three dimensions.

use super::error::{position, within, yaw};
use super::time_scaling::TimeScaling;
use super::{PilotError, TrajectoryPoint};
use core::f64::consts::{FRAC_PI_2, TAU};

/// Intervals of a period or a lead in which the largest speed and acceleration are looked for: a peak between two
/// instants exceeds them by less than 3e-6.
const SAMPLES: u32 = 4096;

/// Which way the nose points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Heading {
    /// Always the same way.
    Fixed {
        /// Heading \[rad\].
        yaw_rad: f64,
    },
    /// Along the tangent of the path's ground track, also while at rest on it.
    AlongPath,
}

/// x = A sin(w s), y = B sin(2 w s), z = C sin(w s + phase) about the center, where s(t) is time
/// with a smooth start and end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FigureEightConfig {
    /// Crossing point \[m\].
    pub center_w_m: [f64; 3],
    /// A, B, C: half of the figure's extent along each axis \[m\].
    pub amplitude_m: [f64; 3],
    /// Phase of the height \[rad\].
    pub phase_rad: f64,
    /// Time of one whole eight at full speed, 2π / w \[s\].
    pub period_s: f64,
    /// Time from rest to full speed \[s\].
    pub lead_in_s: f64,
    /// Time from full speed to rest \[s\].
    pub lead_out_s: f64,
    /// Latest instant at which it rests again \[s\]. It then has flown the largest possible number of
    /// half eights and holds the crossing point. Endless if absent.
    pub duration_s: Option<f64>,
    /// Which way the nose points.
    pub heading: Heading,
}

impl Default for FigureEightConfig {
    /// 2 m long, 1 m wide, 0.5 m high, 8 s each, in a flight of 20 s. Its largest acceleration is
    /// about 1.3 m/s², well below the 2.9 m/s² that four fifths of a tilt of 0.35 rad give.
    fn default() -> Self {
        Self {
            center_w_m: [0.0, 0.0, 1.5],
            amplitude_m: [1.0, 0.5, 0.25],
            phase_rad: 0.0,
            period_s: 8.0,
            lead_in_s: 2.0,
            lead_out_s: 2.0,
            duration_s: Some(20.0),
            heading: Heading::Fixed { yaw_rad: 0.0 },
        }
    }
}

impl FigureEightConfig {
    fn check(&self) -> Result<(), PilotError> {
        position("trajectory.center_w_m", self.center_w_m)?;
        for (axis, value) in self.amplitude_m.into_iter().enumerate() {
            // A tangent needs an extent; without one there is nothing to point the nose along.
            let smallest = if self.heading == Heading::AlongPath && axis < 2 { 1e-3 } else { 0.0 };
            within(format_args!("trajectory.amplitude_m[{axis}]"), value, (smallest, 1000.0))?;
        }
        within("trajectory.phase_rad", self.phase_rad, (-TAU, TAU))?;
        within("trajectory.period_s", self.period_s, (0.1, 1e5))?;
        within("trajectory.lead_in_s", self.lead_in_s, (0.1, 1e4))?;
        within("trajectory.lead_out_s", self.lead_out_s, (0.1, 1e4))?;
        if let Heading::Fixed { yaw_rad } = self.heading {
            yaw("trajectory.heading.yaw_rad", yaw_rad)?;
        }
        if let Some(duration_s) = self.duration_s {
            within("trajectory.duration_s", duration_s, (0.1, 1e6))?;
        }
        Ok(())
    }

    fn scaling(&self) -> Result<TimeScaling, PilotError> {
        let Some(duration_s) = self.duration_s else {
            return Ok(TimeScaling::endless(self.lead_in_s));
        };
        // Both leads together cover half the way that their time would at full speed.
        let leads_s = TimeScaling::shortest_end_s(self.lead_in_s, self.lead_out_s);
        let half_s = 0.5 * self.period_s;
        // The margin keeps rounding from costing a half.
        let most = ((duration_s - leads_s) / half_s + 1e-9).floor();
        let fewest = (leads_s / half_s - 1e-9).ceil();
        if most < fewest {
            let shortest_s = fewest * half_s + leads_s;
            return Err(PilotError::FigureTooShort { duration_s, shortest_s });
        }
        Ok(TimeScaling::ending_at(most * half_s, self.lead_in_s, self.lead_out_s))
    }
}

/// A checked figure eight.
#[derive(Debug, Clone, Copy)]
pub(super) struct FigureEight {
    config: FigureEightConfig,
    scaling: TimeScaling,
}

impl FigureEight {
    pub(super) fn new(config: &FigureEightConfig) -> Result<Self, PilotError> {
        config.check()?;
        Ok(Self { config: *config, scaling: config.scaling()? })
    }

    /// Instants until `until_s` close enough to one another to find what is largest \[s\]: both leads, and one of the
    /// periods between them, which are alike.
    pub(super) fn instants_s(&self, until_s: f64) -> impl Iterator<Item = f64> {
        let FigureEightConfig { period_s, lead_in_s, lead_out_s, .. } = self.config;
        let slows_s = self.scaling.lead_out_start_s();
        let stretches = [
            (0.0, lead_in_s),
            (lead_in_s, (lead_in_s + period_s).min(slows_s)),
            (slows_s, slows_s + lead_out_s),
        ];
        let flown = stretches.into_iter().filter(move |(from_s, _)| *from_s <= until_s);
        flown.flat_map(move |(from_s, to_s)| {
            let length_s = to_s.min(until_s) - from_s;
            (0..=SAMPLES).map(move |i| from_s + length_s * f64::from(i) / f64::from(SAMPLES))
        })
    }

    pub(super) fn at(&self, t_s: f64) -> TrajectoryPoint {
        let config = &self.config;
        let w = TAU / config.period_s;
        let [s, rate, acceleration] = self.scaling.at(t_s);
        // (factor of w s, phase) of the three axes.
        let axes = [(1.0, 0.0), (2.0, 0.0), (1.0, config.phase_rad)];
        let mut point = TrajectoryPoint::at_rest(config.center_w_m, 0.0);
        let mut tangent = [0.0; 3];
        for (i, (factor, phase)) in axes.into_iter().enumerate() {
            let w = factor * w;
            let (sin, cos) = libm::sincos(w * s + phase);
            // p = A sin, p' = A w cos, p'' = −A w² sin; v = p' ṡ, a = p'' ṡ² + p' s̈
            let slope = config.amplitude_m[i] * w * cos;
            let bend = -config.amplitude_m[i] * w * w * sin;
            point.position_w_m[i] += config.amplitude_m[i] * sin;
            point.velocity_w_m_s[i] = slope * rate;
            point.acceleration_w_m_s2[i] = bend * rate * rate + slope * acceleration;
            tangent[i] = slope;
        }
        point.yaw_rad = match config.heading {
            Heading::Fixed { yaw_rad } => yaw_rad,
            Heading::AlongPath => heading(tangent),
        };
        point
    }
}

/// Heading of the tangent, continuous along the whole eight. Where the tangent has no x part it
/// points to −y and never to +y, so the cut of atan2 goes there. The path is a function of s, so
/// its tangent exists where the speed is zero.
fn heading([x, y, _]: [f64; 3]) -> f64 {
    libm::atan2(x, -y) - FRAC_PI_2
}
