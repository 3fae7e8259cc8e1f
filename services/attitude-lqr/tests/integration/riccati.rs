//! The gains against a library that solves the same equation another way.

use attitude_lqr::settings::Settings;
use attitude_lqr::{GainTable, LqrConfig, STATES, Timing, doubling, gain};
use faer::linalg::solvers::Solve as _;
use faer::{Mat, c64};
use nalgebra::{SMatrix, SVector};
use vehicle::{MorphAngle, VehicleParameters};

type Square = SMatrix<f64, STATES, STATES>;

fn config(rate_hz: f64) -> LqrConfig {
    let around =
        Timing { period_s: 1.0 / rate_hz, latency_s: 1e-3, report_s: 1e-3, rotor_lag_s: 0.015 };
    Settings::default().law_config(around)
}

/// P by the stable invariant subspace of the symplectic matrix \[Laub\], eigenvectors from faer.
fn by_eigenvectors(a: &Square, b: &SVector<f64, STATES>, q: &Square, r: f64) -> Square {
    const N: usize = STATES;
    let transposed = a.transpose().try_inverse().unwrap();
    let g = b * b.transpose() / r;
    let blocks = [[a + g * transposed * q, -g * transposed], [-transposed * q, transposed]];
    let whole = Mat::from_fn(2 * N, 2 * N, |i, j| blocks[i / N][j / N][(i % N, j % N)]);
    let eigen = whole.eigen().unwrap();
    let (values, vectors) = (eigen.S(), eigen.U());
    let stable: Vec<usize> = (0..2 * N).filter(|i| values[*i].norm() < 1.0).collect();
    assert_eq!(stable.len(), N);
    let part = |from: usize| Mat::<c64>::from_fn(N, N, |i, j| vectors[(from + i, stable[j])]);
    // P = X₂ X₁⁻¹, that is Pᵀ from X₁ᵀ Pᵀ = X₂ᵀ.
    let p = part(0).transpose().partial_piv_lu().solve(part(N).transpose());
    Square::from_fn(|i, j| p[(j, i)].re)
}

#[test]
fn the_doubled_solution_is_that_of_the_eigenvectors_and_solves_the_equation() {
    for rate_hz in [50.0, 100.0, 500.0, 1000.0] {
        let config = config(rate_hz);
        for axis in 0..3 {
            for acceleration in [559.0, 94.0, 15.7] {
                let (a, b) = config.model(acceleration);
                let (q, r) = config.cost(axis);
                let p = doubling(&a, &b, &q, r).unwrap();
                let k = gain(&a, &b, &p, r);
                let residual = a.transpose() * p * (a - b * k.transpose()) + q - p;
                assert!(residual.amax() <= 1e-9 * p.amax(), "{rate_hz} Hz, axis {axis}");
                let other = gain(&a, &b, &by_eigenvectors(&a, &b, &q, r), r);
                let apart = (k - other).component_div(&k).amax();
                assert!(apart <= 1e-5, "{rate_hz} Hz, axis {axis}: {k} {other}");
            }
        }
    }
}

#[test]
fn between_its_nodes_the_table_is_as_good_as_the_equation_and_stable() {
    let vehicle = VehicleParameters::default();
    for rate_hz in [50.0, 100.0, 1000.0] {
        let config = config(rate_hz);
        let table = GainTable::new(&config, &vehicle).unwrap();
        for degrees in (450..=1600).step_by(23) {
            let beta = MorphAngle::from_degrees(f64::from(degrees) * 0.1).unwrap();
            for axis in 0..3 {
                let (k, exact) = (table.at(beta, axis), config.gain(&vehicle, beta, axis).unwrap());
                let apart = (k - exact).component_div(&exact).amax();
                assert!(apart <= 0.02, "{degrees}, axis {axis}: {apart}");
                let bound = vehicle.torque_bound_nm(beta, vehicle.weight_n())[axis];
                let (a, b) = config.model(bound / vehicle.inertia_kg_m2(beta)[axis]);
                let closed = a - b * k.transpose();
                let closed = Mat::from_fn(STATES, STATES, |i, j| closed[(i, j)]);
                let largest = closed.eigenvalues().unwrap();
                let largest = largest.iter().map(|value| value.norm()).fold(0.0, f64::max);
                assert!(largest < 1.0, "{degrees}, axis {axis}: {largest}");
            }
        }
    }
}
