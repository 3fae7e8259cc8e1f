//! Laguerre functions in flight.

use crate::rig::{Flight, SIZES, fly, settling};
use attitude_mpc::{AttitudeLaw, AttitudeLawConfig, Basis, Setpoint, TorqueBound};
use nalgebra::Vector3;
use vehicle::VehicleParameters;

#[test]
fn functions_that_decay_slowly_settle_too_because_their_bounds_last_as_long() {
    for torque_bound in [TorqueBound::Rotors, TorqueBound::RotorThrusts] {
        for (pole, terms) in [(0.5, 3), (0.8, 1), (0.8, 3), (0.9, 3)] {
            for beta in SIZES {
                let vehicle = VehicleParameters::default();
                let config = AttitudeLawConfig {
                    torque_bound,
                    laguerre: Some([Basis::Laguerre { pole, terms }; 3]),
                    ..AttitudeLawConfig::flight(100.0)
                };
                let mut law = AttitudeLaw::new(config, &vehicle).unwrap();
                let mut flight = Flight::hover(vehicle, beta);
                let trace = fly(&mut flight, &mut law, 100.0, 1.5, |t, _| Setpoint {
                    gamma_rad: Vector3::repeat(if t > 0.1 { 0.2 } else { 0.0 }),
                    thrust_n: vehicle.weight_n(),
                });
                for axis in 0..3 {
                    let settled_s = settling(&trace, axis, 0.2, 0.1);
                    let case = format!("{torque_bound:?}, a {pole}, N {terms}, {beta:?}, {axis}");
                    assert!(settled_s < 1.0, "{case}: {settled_s} s");
                }
            }
        }
    }
}
