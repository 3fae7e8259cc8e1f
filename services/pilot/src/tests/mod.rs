//! The pilot as its readers see it.

mod morphing;
mod polynomials;
mod services;
mod trajectories;

use super::{FigureEightConfig, Heading, MorphKnot, PathSample, TrajectoryConfig, Waypoint};
use core::f64::consts::TAU;
use vehicle::VehicleParameters;

const MS: u64 = 1_000_000;

fn figure(config: FigureEightConfig) -> TrajectoryConfig {
    TrajectoryConfig::FigureEight(config)
}

fn along_path() -> FigureEightConfig {
    FigureEightConfig {
        heading: Heading::AlongPath,
        phase_rad: 0.7,
        ..FigureEightConfig::default()
    }
}

fn waypoints() -> TrajectoryConfig {
    let at = |t_s, position_w_m, yaw_rad| Waypoint { t_s, position_w_m, yaw_rad };
    TrajectoryConfig::Waypoints(vec![
        at(0.5, [0.0, 0.0, 1.0], 0.0),
        at(2.5, [1.0, -0.5, 1.5], 1.0),
        at(4.0, [1.0, 0.5, 1.2], -1.0),
        at(7.0, [0.0, 0.0, 1.0], TAU),
    ])
}

fn knots(list: &[(f64, f64)]) -> Vec<MorphKnot> {
    list.iter()
        .map(|(t_s, degrees)| MorphKnot { t_s: *t_s, angle_rad: degrees.to_radians() })
        .collect()
}

fn sweeps() -> Vec<MorphKnot> {
    knots(&[(1.0, 45.0), (1.3, 160.0), (2.0, 160.0), (3.0, 94.5), (3.5, 45.0)])
}

fn vehicle() -> VehicleParameters {
    VehicleParameters::default()
}

/// A point of a round that climbs and sinks, in motion, with all of its derivatives.
fn round(t_s: f64) -> PathSample {
    let (sin, cos) = libm::sincos(t_s);
    let (half, slow) = libm::sincos(0.5 * t_s);
    PathSample {
        t_s,
        position_w_m: [0.5 * cos, 0.5 * sin, 1.5 + 0.2 * half],
        yaw_rad: 0.1 * t_s,
        velocity_w_m_s: Some([-0.5 * sin, 0.5 * cos, 0.1 * slow]),
        acceleration_w_m_s2: Some([-0.5 * cos, -0.5 * sin, -0.05 * half]),
    }
}

fn shapes() -> [TrajectoryConfig; 6] {
    let hover = TrajectoryConfig::Hover { position_w_m: [1.0, 2.0, 3.0], yaw_rad: 0.5 };
    let endless = FigureEightConfig { duration_s: None, ..along_path() };
    [
        hover,
        figure(FigureEightConfig::default()),
        figure(along_path()),
        figure(endless),
        waypoints(),
        TrajectoryConfig::Samples((0..204).map(|i| round(0.1 * f64::from(i))).collect()),
    ]
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|i| (a[i] - b[i]).abs()).fold(0.0, f64::max)
}
