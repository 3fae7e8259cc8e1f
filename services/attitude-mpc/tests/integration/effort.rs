//! Programs too large for their rate: every step ends, and reports how.

use crate::rig::{Flight, MS};
use attitude_mpc::{
    AttitudeLaw, AttitudeLawConfig, Horizon, HorizonChoice, Input, LawStatus, Output, QpStatus,
    Setpoint, SolverKind, TorqueBound,
};
use nalgebra::Vector3;
use vehicle::{MorphAngle, VehicleParameters, Wrench, euler_from_quaternion};

/// Np 200, Nc 50, rotor bounds, rate bounds that the step cannot keep: 950 rows, 150 unknowns.
fn largest(solver: SolverKind, soft: bool) -> AttitudeLawConfig {
    AttitudeLawConfig {
        horizon: HorizonChoice::Samples(Horizon { prediction: 200, control: 50 }),
        torque_bound: TorqueBound::RotorThrusts,
        rate_max_rad_s: Some(1.0),
        state_penalty: soft.then_some(1.0),
        solver,
        ..AttitudeLawConfig::flight(1000.0)
    }
}

/// Steps of a flight to a set point far away; a law that restored the first one's memory half way
/// must give the same.
fn fly(config: &AttitudeLawConfig, steps: usize) -> (Vec<Output>, AttitudeLaw) {
    let vehicle = VehicleParameters::default();
    let mut law = AttitudeLaw::new(*config, &vehicle).unwrap();
    let mut successor: Option<AttitudeLaw> = None;
    let mut flight = Flight::hover(vehicle, MorphAngle::MIN);
    let mut outputs = Vec::new();
    for k in 0..steps {
        flight.advance(k as u64 * MS);
        let (state, applied) = flight.sampled();
        let gamma_rad = Vector3::new(0.3, -0.3, 0.5) * f64::from(u8::from(k > 2));
        let input = Input {
            gamma_rad: euler_from_quaternion(&state.q_wb),
            body_rate_rad_s: state.omega_b,
            age_s: 0.0,
            morph_angle: state.beta,
            setpoint: Setpoint { gamma_rad, thrust_n: vehicle.weight_n() },
            applied_torque_nm: Some(applied),
        };
        let output = law.step(&input);
        if let Some(successor) = &mut successor {
            assert_eq!(successor.step(&input), output, "step {k}");
        }
        if k == steps / 2 {
            let mut other = AttitudeLaw::new(*config, &vehicle).unwrap();
            other.restore(law.memory()).unwrap();
            successor = Some(other);
        }
        flight.command(Wrench { thrust_n: output.thrust_n, torque_b_nm: output.torque_nm });
        outputs.push(output);
    }
    (outputs, law)
}

#[test]
fn a_step_that_takes_too_long_is_cut_off_at_the_same_place_everywhere_and_counted() {
    for (solver, soft, steps) in [
        (SolverKind::ActiveSet, true, 24),
        // It takes a while until the rate is more than can be braked.
        (SolverKind::ActiveSet, false, 60),
        (SolverKind::HildrethConverged, true, 10),
        (SolverKind::HildrethConverged, false, 10),
    ] {
        let (outputs, law) = fly(&largest(solver, soft), steps);
        let cut = outputs.iter().filter(|output| output.status != LawStatus::Solved).count();
        let limited = LawStatus::Fallback(QpStatus::IterationLimit);
        let case = format!("{solver:?}, soft {soft}: {cut}");
        let statuses: Vec<_> = outputs.iter().map(|output| output.status).collect();
        // What is hard and impossible may be recognised in time.
        let impossible = LawStatus::Fallback(QpStatus::Infeasible);
        let verdict = if soft { limited } else { impossible };
        let is_reported = statuses.contains(&limited) || statuses.contains(&verdict);
        assert!(is_reported, "{case}: {statuses:?}");
        assert_eq!(law.memory().counters.fallbacks, cut as u64, "{case}");
        for output in &outputs {
            let excess = output.torque_nm.abs() - output.torque_bound_nm;
            assert!(excess.max() <= 0.0, "{case}: {output:?}");
            // Some thousands would be needed.
            assert!(output.iterations < 700, "{case}: {output:?}");
        }
    }
}

#[test]
fn a_soft_bound_that_gives_way_is_reported_and_a_hard_one_never_does() {
    let config = |state_penalty: Option<f64>, rate_max_rad_s: f64| AttitudeLawConfig {
        rate_max_rad_s: Some(rate_max_rad_s),
        state_penalty,
        horizon: HorizonChoice::Samples(Horizon { prediction: 20, control: 3 }),
        ..largest(SolverKind::ActiveSet, true)
    };
    let yielded = |config: AttitudeLawConfig| {
        fly(&config, 24).0.iter().filter(|output| output.yielded > 0).count()
    };
    assert!(yielded(config(Some(1e-3), 0.5)) > 0);
    assert_eq!(yielded(config(Some(1e-3), 500.0)), 0);
    assert_eq!(yielded(config(None, 500.0)), 0);
}
