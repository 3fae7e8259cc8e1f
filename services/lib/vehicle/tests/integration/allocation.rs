//! Control allocation against brute force over the box of possible thrusts.

use nalgebra::Vector3;
use proptest::prelude::*;
use vehicle::{Allocator, MorphAngle, VehicleParameters, Wrench};

const F_MAX: f64 = 0.12 * 9.81;

fn allocator(degrees: f64) -> Allocator {
    let beta = MorphAngle::from_degrees(degrees).expect("the tests stay inside the range");
    VehicleParameters::default().allocator(beta)
}

fn distance(a: &Wrench, b: &Wrench) -> f64 {
    (a.thrust_n - b.thrust_n).abs() + (a.torque_b_nm - b.torque_b_nm).norm()
}

/// Any command, from well inside to far beyond the rotors.
fn any_wrench() -> impl Strategy<Value = Wrench> {
    (-2.0..8.0, -0.3..0.3, -0.3..0.3, -0.08..0.08)
        .prop_map(|(thrust_n, x, y, z)| Wrench { thrust_n, torque_b_nm: Vector3::new(x, y, z) })
}

#[test]
fn each_rotor_pushes_by_equation_1() {
    let a = allocator(94.5);
    let l = a.arm_length_m;
    let front = a.wrench(&[1.0, 0.0, 0.0, 0.0]);
    let left = a.wrench(&[0.0, 1.0, 0.0, 0.0]);
    assert!((front.torque_b_nm - Vector3::new(0.0, -l, -0.016)).norm() < 1e-15);
    assert!((left.torque_b_nm - Vector3::new(l, 0.0, 0.016)).norm() < 1e-15);
}

#[test]
fn a_command_that_is_not_finite_has_no_allocation() {
    let a = allocator(45.0);
    assert_eq!(a.allocate(&Wrench::thrust(f64::NAN)), None);
    for axis in 0..3 {
        let mut wrench = Wrench::thrust(1.0);
        wrench.torque_b_nm[axis] = f64::INFINITY;
        assert_eq!(a.allocate(&wrench), None);
    }
    for bad in [f64::NAN, 0.0, -1.0] {
        let broken = Allocator { thrust_max_n: bad, ..a };
        assert_eq!(broken.allocate(&Wrench::thrust(1.0)), None);
    }
}

#[test]
fn yaw_is_given_up_before_thrust_and_thrust_before_roll() {
    let a = allocator(45.0);
    let l = a.arm_length_m;
    let most_yaw = Wrench { thrust_n: F_MAX, torque_b_nm: Vector3::new(0.0, 0.0, 0.1) };
    let yaw = a.allocate(&most_yaw).unwrap();
    assert!(yaw.clipped);
    assert!((yaw.achieved.thrust_n - F_MAX).abs() < 1e-14);
    assert!((yaw.achieved.torque_b_nm.z - 0.016 * F_MAX).abs() < 1e-14);
    // Full roll needs one rotor full and its opposite off: thrust must move to 2 F_max.
    let most_roll = Wrench { thrust_n: F_MAX, torque_b_nm: Vector3::new(l * F_MAX, 0.0, 0.0) };
    let roll = a.allocate(&most_roll).unwrap();
    assert!((roll.achieved.torque_b_nm - most_roll.torque_b_nm).norm() < 1e-14);
    assert!((roll.achieved.thrust_n - 2.0 * F_MAX).abs() < 1e-14);
}

proptest! {
    #[test]
    fn thrusts_inside_the_limits_survive_wrench_and_allocation(
        f in prop::array::uniform4(0.01 * F_MAX..0.99 * F_MAX), degrees in 45.0..160.0,
    ) {
        let a = allocator(degrees);
        let allocation = a.allocate(&a.wrench(&f)).unwrap();
        prop_assert!(!allocation.clipped);
        for (back, thrust) in allocation.rotor_thrust_n.iter().zip(f) {
            prop_assert!((back - thrust).abs() < 1e-14);
        }
        prop_assert!(distance(&allocation.achieved, &a.wrench(&f)) < 1e-14);
    }

    #[test]
    fn the_unlimited_inverse_is_the_inverse_of_m(w in any_wrench(), degrees in 45.0..160.0) {
        let a = allocator(degrees);
        prop_assert!(distance(&a.wrench(&a.unlimited_thrusts(&w)), &w) < 1e-13);
    }

    #[test]
    fn thrusts_stay_within_limits_and_the_flag_tells_the_truth(
        w in any_wrench(), degrees in 45.0..160.0,
    ) {
        let a = allocator(degrees);
        let allocation = a.allocate(&w).unwrap();
        prop_assert!(allocation.rotor_thrust_n.iter().all(|f| (0.0..=F_MAX).contains(f)));
        prop_assert_eq!(allocation.achieved, a.wrench(&allocation.rotor_thrust_n));
        prop_assert_eq!(allocation.clipped, distance(&allocation.achieved, &w) > 1e-12);
        let inside = a.unlimited_thrusts(&w).iter().all(|f| (0.0..=F_MAX).contains(f));
        prop_assert_eq!(allocation.clipped, !inside);
    }

    #[test]
    fn roll_and_pitch_survive_whenever_any_thrusts_can_make_them(
        w in any_wrench(), degrees in 45.0..160.0,
    ) {
        let a = allocator(degrees);
        let got = a.allocate(&w).unwrap().achieved.torque_b_nm;
        // F2 − F4 and F3 − F1 each cover [−F_max, F_max], independently of one another.
        let reach = a.arm_length_m * F_MAX;
        prop_assert!((got.x - w.torque_b_nm.x.clamp(-reach, reach)).abs() < 1e-14);
        prop_assert!((got.y - w.torque_b_nm.y.clamp(-reach, reach)).abs() < 1e-14);
        // No yaw that was not asked for: between zero and the command.
        let yaw = w.torque_b_nm.z;
        prop_assert!((yaw.min(0.0) - 1e-15..=yaw.max(0.0) + 1e-15).contains(&got.z));
    }

    #[test]
    fn no_other_thrusts_keep_roll_and_pitch_and_come_nearer(
        w in any_wrench(), degrees in 45.0..160.0,
    ) {
        let a = allocator(degrees);
        let best = a.allocate(&w).unwrap().achieved;
        let reach = a.arm_length_m * F_MAX;
        for yaw_step in 0..=40 {
            for thrust_step in 0..=80 {
                let candidate = Wrench {
                    thrust_n: 4.0 * F_MAX * f64::from(thrust_step) / 80.0,
                    torque_b_nm: Vector3::new(
                        w.torque_b_nm.x.clamp(-reach, reach),
                        w.torque_b_nm.y.clamp(-reach, reach),
                        w.torque_b_nm.z * f64::from(yaw_step) / 40.0,
                    ),
                };
                if a.unlimited_thrusts(&candidate).iter().any(|f| !(0.0..=F_MAX).contains(f)) {
                    continue;
                }
                let miss = |x: &Wrench| (x.thrust_n - w.thrust_n).abs();
                let yaw_miss = |x: &Wrench| (x.torque_b_nm.z - w.torque_b_nm.z).abs();
                prop_assert!(miss(&candidate) > miss(&best) - 1e-12);
                // At the best thrust itself, no grid yaw is nearer either.
                let here = Wrench { thrust_n: best.thrust_n, ..candidate };
                let fits = a.unlimited_thrusts(&here).iter().all(|f| (0.0..=F_MAX).contains(f));
                prop_assert!(!fits || yaw_miss(&here) > yaw_miss(&best) - 1e-12);
            }
        }
    }
}
