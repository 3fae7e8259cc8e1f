//! The numbers of the paper's tests, against values that three other solvers agree on.

use super::measure::{
    crossing_s, deviation_rad, excess_nm, overshoot_percent, peak_rad, recovery_s,
};
use super::rig::{Blow, Experiment, World};
use super::{Findings, SIZES, TARGET_RAD, Test, report};
use attitude_mpc::{AttitudeLawConfig, Horizon, HorizonChoice, SolverKind};
use nalgebra::Vector3;
use vehicle::MorphAngle;

fn findings(test: Test) -> Findings {
    test.run().expect("the paper's tests can be run")
}

#[test]
fn test_one_crosses_and_peaks_as_three_other_solvers_do_on_every_axis() {
    for (rate, weight, time_s, peak) in
        [(50.0, 10.0, 0.0713, 0.2086), (100.0, 0.25, 0.0365, 0.2077), (150.0, 0.02, 0.0327, 0.2021)]
    {
        let trajectory = Experiment::paper(rate, weight, MorphAngle::MIN).run().unwrap();
        for axis in 0..3 {
            let crossed = crossing_s(&trajectory.gamma_rad, axis, TARGET_RAD).unwrap();
            let peaked = peak_rad(&trajectory.gamma_rad, axis);
            assert!((crossed - time_s).abs() <= 1e-4, "{rate} Hz, axis {axis}: {crossed} s");
            assert!((peaked - peak).abs() <= 1e-4, "{rate} Hz, axis {axis}: {peaked} rad");
        }
    }
}

/// Overshoot of roll \[%\] at 100 Hz.
fn overshoot(horizon: (usize, usize), weight: f64, target_rad: f64, solver: SolverKind) -> f64 {
    let mut experiment = Experiment::paper(100.0, weight, MorphAngle::MIN);
    let horizon = Horizon { prediction: horizon.0, control: horizon.1 };
    experiment.law =
        AttitudeLawConfig { horizon: HorizonChoice::Samples(horizon), solver, ..experiment.law };
    experiment.target_rad = Vector3::repeat(target_rad);
    overshoot_percent(&experiment.run().unwrap().gamma_rad, 0, target_rad)
}

#[test]
fn test_two_without_weight_and_bounds_overshoots_by_the_closed_percentages() {
    for (prediction, percent) in [(30, 3.35), (20, 4.75), (10, 8.12)] {
        let ours = overshoot((prediction, 3), 1e-9, 1e-6, SolverKind::ActiveSet);
        assert!((ours - percent).abs() <= 0.006, "{prediction}: {ours} %");
    }
}

#[test]
fn test_two_has_the_papers_order_for_weights_from_0_01_to_0_3_and_not_beyond() {
    for (weight, expected) in [
        (0.01, true),
        (0.02, true),
        (0.05, true),
        (0.15, true),
        (0.25, true),
        (0.3, true),
        (0.4, false),
        (0.7, false),
        (2.0, false),
    ] {
        let os = |prediction, control| {
            overshoot((prediction, control), weight, TARGET_RAD, SolverKind::ActiveSet)
        };
        let (p10, others) = (os(10, 3), [os(20, 4), os(30, 4), os(30, 5), os(30, 6)]);
        let ordered =
            os(30, 3) < os(20, 3) && os(20, 3) < p10 && others.iter().all(|other| p10 < *other);
        assert_eq!(ordered, expected, "r_w {weight}");
    }
}

#[test]
fn the_papers_own_method_swept_to_the_end_moves_the_vehicle_alike() {
    for horizon in [(20, 3), (30, 5)] {
        let [exact, swept] = [SolverKind::ActiveSet, SolverKind::HildrethConverged]
            .map(|solver| overshoot(horizon, 0.25, TARGET_RAD, solver));
        assert!((exact - swept).abs() <= 1e-4, "{horizon:?}: {exact} and {swept} %");
    }
}

#[test]
fn test_three_recovers_within_the_printed_time_and_deviates_less_the_larger_it_is() {
    let mut last = f64::INFINITY;
    for ((size, beta), recovered_s) in SIZES.into_iter().zip([0.05, 0.06, 0.06]) {
        let torque = Vector3::new(0.1, 0.1, 0.01);
        let experiment = Experiment {
            blow: Some((0.3, Blow::Torque(torque))),
            duration_s: 0.6,
            ..Experiment::paper(100.0, 0.05, beta)
        };
        let trajectory = experiment.run().unwrap();
        let path = &trajectory.gamma_rad;
        let recovery = recovery_s(path, &experiment.target_rad, 0.3).unwrap();
        assert!((recovery - recovered_s).abs() <= 1e-4, "{size}: {recovery} s");
        let deviation = deviation_rad(path, 0, TARGET_RAD, 0.3);
        assert!(deviation < last, "{size}: {deviation} rad after {last} rad");
        assert!(excess_nm(&trajectory) <= 1e-9);
        last = deviation;
    }
}

#[test]
fn bounds_on_u_and_its_increments_hold_in_every_sample_of_every_test() {
    for test in Test::ALL {
        let found = findings(test);
        for run in &found.runs {
            let excess = excess_nm(&run.trajectory);
            assert!(excess <= 1e-9, "{test:?}, {}: {excess} N m", run.name);
            assert_eq!(run.trajectory.unsolved, 0, "{test:?}, {}", run.name);
            let relaxed = run
                .trajectory
                .samples
                .iter()
                .any(|sample| sample.output.relaxation_nm.amax() > 0.0);
            assert!(!relaxed, "the size stays, so no bound gives way: {}", run.name);
        }
        assert!(report::holds(&[found]), "{test:?}");
    }
}

#[test]
fn runs_have_names_of_their_own_and_begin_at_the_start() {
    for test in Test::ALL {
        let found = findings(test);
        let mut names: Vec<&str> = found.runs.iter().map(|run| run.name.as_str()).collect();
        names.sort_unstable();
        let all = names.len();
        names.dedup();
        assert_eq!(names.len(), all, "{test:?}");
        assert!(found.runs.iter().all(|run| run.trajectory.samples[0].t_s == 0.0));
        assert!(found.figures.iter().all(|(_, figure)| {
            figure.panels.iter().all(|panel| !panel.curves.is_empty() || panel.bars.is_some())
        }));
    }
}

#[test]
fn the_linear_world_is_the_double_integrator_under_the_held_torque() {
    let trajectory = Experiment::paper(100.0, 0.25, MorphAngle::MEDIUM).run().unwrap();
    let inertia = vehicle::VehicleParameters::default().inertia_kg_m2(MorphAngle::MEDIUM);
    let (mut gamma, mut rate) = (Vector3::zeros(), Vector3::zeros());
    for sample in &trajectory.samples {
        assert!((sample.gamma_rad - gamma).amax() < 1e-12, "at {} s", sample.t_s);
        let acceleration = sample.output.torque_nm.component_div(&inertia);
        gamma += rate * 0.01 + acceleration * (0.5 * 0.01 * 0.01);
        rate += acceleration * 0.01;
    }
}

#[test]
fn rotors_without_lag_leave_a_small_roll_step_as_the_linear_model_has_it() {
    let mut experiment = Experiment::paper(100.0, 0.25, MorphAngle::MIN);
    experiment.target_rad = Vector3::x() * 1e-3;
    let linear = experiment.run().unwrap();
    experiment.world = World::PROMPT;
    let rotors = experiment.run().unwrap();
    // 0.1 ms of lag remain, a hundredth of a period.
    let pairs = linear.samples.iter().zip(&rotors.samples);
    let apart = pairs.map(|(a, b)| (a.gamma_rad - b.gamma_rad).amax()).fold(0.0, f64::max);
    assert!(apart < 3e-5, "{apart} rad");
}
