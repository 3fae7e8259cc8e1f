//! Shapes against closed forms, differences and refusals.

#![expect(
    clippy::disallowed_methods,
    reason = "an oracle shares no function with the code under test"
)]

use super::{MS, along_path, distance, figure, shapes, waypoints};
use crate::{
    FigureEightConfig, Heading, PilotError, Trajectory, TrajectoryConfig, TrajectoryPoint, Waypoint,
};
use core::f64::consts::{PI, TAU};

#[test]
fn velocity_and_acceleration_are_the_derivatives_of_position() {
    for config in shapes() {
        let trajectory = Trajectory::new(&config).unwrap();
        let (step_ns, step_s) = (MS / 10, 1e-4);
        // Central differences: step² / 6 times the next derivative but one, below 1e-6 here.
        for t_ns in (step_ns..22_000 * MS).step_by(7_300_000) {
            let around = [t_ns - step_ns, t_ns, t_ns + step_ns].map(|t| trajectory.at(t));
            let slope = |of: fn(&TrajectoryPoint) -> [f64; 3]| {
                let [a, _, b] = around.each_ref().map(of);
                core::array::from_fn(|i| (b[i] - a[i]) / (2.0 * step_s))
            };
            let velocity = slope(|p| p.position_w_m);
            let acceleration = slope(|p| p.velocity_w_m_s);
            assert!(distance(velocity, around[1].velocity_w_m_s) < 1e-6, "{config:?} {t_ns}");
            assert!(
                distance(acceleration, around[1].acceleration_w_m_s2) < 1e-5,
                "{config:?} {t_ns}"
            );
        }
    }
}

#[test]
fn position_velocity_and_acceleration_have_no_jump_anywhere() {
    // Jerk stays below 18 m/s³ in all shapes, so 1 ms changes the acceleration by less than 0.018.
    for config in shapes() {
        let trajectory = Trajectory::new(&config).unwrap();
        let mut last = trajectory.at(0);
        for t_ns in (MS..22_000 * MS).step_by(1_000_000) {
            let next = trajectory.at(t_ns);
            assert!(distance(last.position_w_m, next.position_w_m) < 0.003, "{config:?} {t_ns}");
            assert!(
                distance(last.velocity_w_m_s, next.velocity_w_m_s) < 0.003,
                "{config:?} {t_ns}"
            );
            let jump = distance(last.acceleration_w_m_s2, next.acceleration_w_m_s2);
            assert!(jump < 0.02, "{config:?} {t_ns} {jump}");
            assert!((last.yaw_rad - next.yaw_rad).abs() < 0.006, "{config:?} {t_ns}");
            last = next;
        }
    }
}

#[test]
fn waypoints_are_reached_at_rest_and_without_acceleration() {
    let TrajectoryConfig::Waypoints(list) = waypoints() else { unreachable!() };
    let trajectory = Trajectory::new(&waypoints()).unwrap();
    for (waypoint, t_ns) in list.iter().zip([500 * MS, 2500 * MS, 4000 * MS, 7000 * MS]) {
        for near_ns in [t_ns - 1000, t_ns, t_ns + 1000] {
            let point = trajectory.at(near_ns);
            assert!(distance(point.position_w_m, waypoint.position_w_m) < 1e-12);
            assert!(distance(point.velocity_w_m_s, [0.0; 3]) < 1e-9);
            // Jerk at the joint is 60 D / T³, at most 18 m/s³: 2e-5 after a microsecond.
            assert!(distance(point.acceleration_w_m_s2, [0.0; 3]) < 3e-5);
            assert!((point.yaw_rad - waypoint.yaw_rad).abs() < 1e-12);
        }
    }
    assert!(distance(trajectory.at(0).position_w_m, list[0].position_w_m) < 1e-15);
    assert_eq!(trajectory.at(u64::MAX).yaw_rad.to_bits(), TAU.to_bits());
}

#[test]
fn a_figure_eight_starts_and_ends_at_rest_on_its_crossing() {
    for phase_rad in [0.0, 0.7] {
        let config = FigureEightConfig { phase_rad, ..FigureEightConfig::default() };
        let trajectory = Trajectory::new(&figure(config)).unwrap();
        let start = [0.0, 0.0, 1.5 + 0.25 * phase_rad.sin()];
        // 16 s of way and 2 s for both leads fit into 20 s, another half eight would not.
        for t_ns in [0, 18_000 * MS, 20_000 * MS, 1_000_000 * MS] {
            let point = trajectory.at(t_ns);
            assert!(distance(point.position_w_m, start) < 1e-12, "{t_ns} {point:?}");
            assert!(distance(point.velocity_w_m_s, [0.0; 3]) < 1e-12, "{t_ns} {point:?}");
            assert!(distance(point.acceleration_w_m_s2, [0.0; 3]) < 1e-12, "{t_ns} {point:?}");
        }
        assert!(distance(trajectory.at(17_900 * MS).velocity_w_m_s, [0.0; 3]) > 1e-4);
    }
}

#[test]
fn a_figure_eight_at_full_speed_is_the_closed_form() {
    let trajectory = Trajectory::new(&figure(along_path())).unwrap();
    for t_ns in (2_000 * MS..16_000 * MS).step_by(113_000_000) {
        let angle = TAU / 8.0 * (t_ns as f64 / 1e9 - 1.0);
        let expected = [angle.sin(), 0.5 * (2.0 * angle).sin(), 1.5 + 0.25 * (angle + 0.7).sin()];
        assert!(distance(trajectory.at(t_ns).position_w_m, expected) < 1e-12);
    }
}

#[test]
fn the_default_figure_eight_asks_for_little_acceleration() {
    let trajectory = Trajectory::new(&figure(FigureEightConfig::default())).unwrap();
    let peak = trajectory.peak_acceleration_m_s2([0, 20_000 * MS]);
    // 1.31562 by quadrature of the speed profile and second differences, in another language.
    assert!((peak - 1.31562).abs() < 1e-3, "{peak}");
    assert!(peak < 0.5 * 0.8 * 9.81 * 0.35_f64.tan());
}

#[test]
fn the_peaks_of_a_trajectory_are_those_of_a_dense_look_at_any_spacing() {
    let circle = |spacing_s: f64| {
        let waypoint = |i: u32| {
            let t_s = f64::from(i) * spacing_s;
            let position_w_m = [t_s.cos(), t_s.sin(), 1.0];
            Waypoint { t_s, position_w_m, yaw_rad: 0.0 }
        };
        TrajectoryConfig::Waypoints((0..200).map(waypoint).collect())
    };
    for config in shapes().into_iter().chain([0.005, 0.01, 0.02].map(circle)) {
        let trajectory = Trajectory::new(&config).unwrap();
        for until_ns in [900 * MS, 1_003 * MS, 5_171 * MS, 22_000 * MS] {
            let dense = |of: fn(&TrajectoryPoint) -> [f64; 3]| {
                let instants = (0..=until_ns).step_by(100_000);
                let length = |[x, y, z]: [f64; 3]| x.hypot(y).hypot(z);
                instants.map(|t_ns| length(of(&trajectory.at(t_ns)))).fold(0.0, f64::max)
            };
            // Between two instants of the look, a fiftieth of the shortest segment apart, it may be larger.
            let is_peak =
                |peak: f64, dense: f64| peak >= (1.0 - 3e-6) * dense && peak <= 1.002 * dense;
            let pairs = [
                (trajectory.peak_speed_m_s([0, until_ns]), dense(|p| p.velocity_w_m_s)),
                (
                    trajectory.peak_acceleration_m_s2([0, until_ns]),
                    dense(|p| p.acceleration_w_m_s2),
                ),
            ];
            for (peak, dense) in pairs {
                assert!(is_peak(peak, dense), "{until_ns}: {peak} {dense} {config:?}");
            }
        }
    }
}

#[test]
fn a_flight_of_a_year_has_the_peaks_of_one_of_a_minute() {
    let endless = FigureEightConfig { duration_s: None, ..along_path() };
    let trajectory = Trajectory::new(&figure(endless)).unwrap();
    let year_ns = 31_536_000 * 1_000 * MS;
    let (long, short) =
        (trajectory.peak_speed_m_s([0, year_ns]), trajectory.peak_speed_m_s([0, 60_000 * MS]));
    assert!((long - short).abs() < 1e-12, "{long} {short}");
}

#[test]
fn a_nose_along_the_path_follows_the_velocity_and_holds_at_rest() {
    let trajectory = Trajectory::new(&figure(along_path())).unwrap();
    for t_ns in (MS..20_000 * MS).step_by(3_700_000) {
        let TrajectoryPoint { velocity_w_m_s: [x, y, _], yaw_rad, .. } = trajectory.at(t_ns);
        let speed = x.hypot(y);
        if speed > 1e-6 {
            assert!((speed * yaw_rad.cos() - x).abs() < 1e-12 * speed.max(1.0), "{t_ns}");
            assert!((speed * yaw_rad.sin() - y).abs() < 1e-12 * speed.max(1.0), "{t_ns}");
        }
        assert!((-1.5 * PI..=0.5 * PI).contains(&yaw_rad));
    }
    // A w against 2 B w with A = 2 B: 45° at the crossing, which is also where it rests.
    for t_ns in [0, 18_500 * MS, 30_000 * MS] {
        assert!((trajectory.at(t_ns).yaw_rad - PI / 4.0).abs() < 1e-12);
    }
}

#[test]
fn bad_trajectories_are_refused_by_name() {
    let eight = FigureEightConfig::default();
    let with = |f: fn(&mut FigureEightConfig)| {
        let mut config = along_path();
        f(&mut config);
        figure(config)
    };
    let hover = |x, yaw_rad| TrajectoryConfig::Hover { position_w_m: [x, 0.0, 1.0], yaw_rad };
    let waypoint = |t_s, x| Waypoint { t_s, position_w_m: [x, 0.0, 1.0], yaw_rad: 0.0 };
    let cases = [
        (hover(f64::NAN, 0.0), "trajectory.position_w_m[0]"),
        (hover(0.0, f64::INFINITY), "trajectory.yaw_rad"),
        (with(|c| c.center_w_m[2] = f64::NAN), "trajectory.center_w_m[2]"),
        (with(|c| c.amplitude_m[1] = 0.0), "trajectory.amplitude_m[1]"),
        (with(|c| c.amplitude_m[2] = -1.0), "trajectory.amplitude_m[2]"),
        (with(|c| c.phase_rad = f64::NAN), "trajectory.phase_rad"),
        (with(|c| c.period_s = 0.0), "trajectory.period_s"),
        (with(|c| c.lead_in_s = 0.0), "trajectory.lead_in_s"),
        (with(|c| c.lead_out_s = f64::NAN), "trajectory.lead_out_s"),
        (with(|c| c.duration_s = Some(f64::NAN)), "trajectory.duration_s"),
        (with(|c| c.heading = Heading::Fixed { yaw_rad: f64::NAN }), "trajectory.heading.yaw_rad"),
        (TrajectoryConfig::Waypoints(vec![]), "trajectory.waypoints"),
        (
            TrajectoryConfig::Waypoints(vec![waypoint(0.0, f64::NAN)]),
            "waypoints[0].position_w_m[0]",
        ),
        (
            TrajectoryConfig::Waypoints(vec![waypoint(2.0, 0.0), waypoint(1.0, 0.0)]),
            "waypoints[1].t_s",
        ),
    ];
    for (config, parameter) in cases {
        let error = Trajectory::new(&config).unwrap_err().to_string();
        assert!(error.contains(parameter), "{error}");
    }
    let flat = FigureEightConfig { amplitude_m: [0.0, 0.0, 0.5], ..eight };
    assert!(Trajectory::new(&figure(flat)).is_ok());
}

#[test]
fn a_duration_too_short_for_half_an_eight_is_refused_and_the_shortest_one_flies() {
    let short = FigureEightConfig { duration_s: Some(5.9), ..FigureEightConfig::default() };
    let error = Trajectory::new(&figure(short)).unwrap_err();
    assert_eq!(error, PilotError::FigureTooShort { duration_s: 5.9, shortest_s: 6.0 });
    let shortest = FigureEightConfig { duration_s: Some(6.0), ..short };
    let end = Trajectory::new(&figure(shortest)).unwrap().at(6_000 * MS);
    assert!(distance(end.position_w_m, [0.0, 0.0, 1.5]) < 1e-12);
}
