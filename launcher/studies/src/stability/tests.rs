use super::*;
use attitude_mpc::AttitudeLaw;
use nalgebra::{DMatrix, Matrix3, Vector3};

/// The paper's small vehicle at 100 Hz.
fn bench() -> Bench {
    let vehicle = VehicleParameters::default();
    Bench { rate_hz: 100.0, morph_angle: MorphAngle::MIN, vehicle }
}

/// Limits at the weight of the paper's reproduction.
fn at_a_quarter(model: Model, quantity: Quantity) -> Limits {
    limits(&bench(), model, 0.25, quantity).unwrap()
}

fn assert_near(range: Range, from: f64, to: f64, relative: f64) {
    for (edge, expected) in [(range.from, from), (range.to, to)] {
        if expected > 0.0 {
            let edge = edge.unwrap();
            assert!((edge / expected - 1.0).abs() <= relative, "{edge} and not {expected}");
        } else {
            assert_eq!(edge, None);
        }
    }
}

#[test]
fn the_bare_law_bears_under_2_ms_of_lag_and_a_quarter_less_or_twice_the_inertia() {
    let lag = at_a_quarter(Model::Bare, Quantity::Lag);
    assert_near(lag.linear, 0.0, 1.7e-3, 0.03);
    assert_near(lag.simulated, 0.0, 1.7e-3, 0.1);
    let inertia = at_a_quarter(Model::Bare, Quantity::Inertia);
    assert_near(inertia.linear, 0.76, 2.1, 0.015);
    assert_near(inertia.simulated, 0.76, 2.1, 0.08);
}

#[test]
fn the_bare_law_is_unstable_with_one_sample_of_delay_and_already_with_a_fifth_of_it() {
    let delay = at_a_quarter(Model::Bare, Quantity::Delay);
    assert_near(delay.linear, 0.0, 0.157, 0.03);
    assert_near(delay.simulated, 0.0, 0.157, 0.1);
    let one = bench().world(Model::Bare, Quantity::Delay, 1.0);
    let law = bench().law(Model::Bare, 0.25);
    assert!(LinearLoop::new(&bench(), &law).unwrap().spectral_radius(&one).unwrap() > 1.5);
}

#[test]
fn with_lag_and_delay_modelled_8_to_25_ms_of_lag_and_0_7_to_2_times_inertia_fly() {
    let lag = at_a_quarter(Model::LagAndDelay, Quantity::Lag);
    assert_near(lag.linear, 8e-3, 25e-3, 0.03);
    assert_near(lag.simulated, 8e-3, 25e-3, 0.05);
    let inertia = at_a_quarter(Model::LagAndDelay, Quantity::Inertia);
    assert_near(inertia.linear, 0.68, 2.3, 0.02);
    assert_near(inertia.simulated, 0.68, 2.3, 0.05);
}

#[test]
fn a_larger_weight_widens_every_margin() {
    for quantity in QUANTITIES {
        let [small, large] = [0.25, 5.0]
            .map(|weight| limits(&bench(), Model::LagAndDelay, weight, quantity).unwrap().linear);
        assert!(large.to > small.to, "{quantity:?}");
        assert!(small.from.is_none() || large.from < small.from, "{quantity:?}");
    }
}

#[test]
fn on_the_modelled_vehicle_lag_makes_it_settle_and_modelled_delay_makes_it_quicker() {
    let settling = |model| {
        let law = bench().law(model, 0.25);
        answer(&bench(), &law, &bench().vehicle_as_it_is(model)).unwrap()
    };
    assert!(!settling(Model::Bare).is_stable());
    let Answer::Settled(lag_s) = settling(Model::Lag) else { panic!("{:?}", settling(Model::Lag)) };
    let Answer::Settled(both_s) = settling(Model::LagAndDelay) else { panic!("does not settle") };
    assert!(both_s <= 0.07 && lag_s > 1.2 * both_s, "{lag_s} {both_s}");
}

/// (11) and (16) written out for one axis of the bare law, the bounds left away.
#[test]
fn the_laws_matrix_holds_the_gain_of_the_normal_equations() {
    let law = bench().law(Model::Bare, 0.25);
    let inertia = bench().vehicle.inertia_kg_m2(MorphAngle::MIN).x;
    let dt = 0.01;
    let a = Matrix3::new(1.0, dt, 0.0, 0.0, 1.0, 0.0, 1.0, dt, 1.0);
    let b = Vector3::new(0.5 * dt * dt, dt, 0.5 * dt * dt) / inertia;
    let power = |n: usize| a.pow(u32::try_from(n).unwrap());
    let free = DMatrix::from_fn(20, 3, |i, j| power(i + 1)[(2, j)]);
    let forced = DMatrix::from_fn(20, 3, |i, j| if i < j { 0.0 } else { (power(i - j) * b)[2] });
    let hessian = forced.tr_mul(&forced) + DMatrix::identity(3, 3) * 0.25;
    let gain = hessian.lu().solve(&forced.tr_mul(&free)).unwrap();
    let matrix = LinearLoop::new(&bench(), &law).unwrap().command_row();
    // Δx spans this sample and the last one; y is this angle.
    let expected = [gain[(0, 0)], gain[(0, 1)], -gain[(0, 0)] - gain[(0, 2)], -gain[(0, 1)]];
    for (column, expected) in [0, 1, 7, 8].into_iter().zip(expected) {
        let found = matrix[column];
        assert!((found - expected).abs() < 1e-7 * expected.abs(), "{column}: {found} {expected}");
    }
    assert!((matrix[6] - 1.0).abs() < 1e-9, "u(k) = u(k-1) + ..");
}

#[test]
fn a_law_that_is_impossible_is_refused_and_not_mapped() {
    let too_fast = Bench { rate_hz: 5000.0, ..bench() };
    let error = run(&too_fast, &Grid::quick(), &[0.25], &|| ()).unwrap_err();
    assert!(error.to_string().contains("rate_hz = 5000"), "{error}");
    assert!(AttitudeLaw::new(too_fast.law(Model::Bare, 1.0), &too_fast.vehicle).is_err());
}

#[test]
fn a_map_holds_every_point_of_its_grid_and_the_methods_agree_on_nearly_all() {
    let grid = Grid::quick();
    let study = run(&bench(), &grid, &[0.25], &|| ()).unwrap();
    assert_eq!(study.points.len(), grid.points());
    let differ = |p: &&Point| (p.spectral_radius < 1.0) != p.answer.is_stable();
    let count = study.points.iter().filter(differ).count();
    assert!(count <= grid.points() / 40, "{count} of {}", grid.points());
}
