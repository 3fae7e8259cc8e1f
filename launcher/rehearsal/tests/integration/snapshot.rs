//! Which samples a snapshot is made from, and which it must not be made from.

use core::convert::Infallible;
use rehearsal::{DRAWS, Snapshot, Watcher, draws};
use shared_types::topics::{self, TopicVisitor};
use shared_types::{
    ActuatorState, AppliedCommand, GuidanceOrder, Header, Quaternion, Sample, StateEstimate, Topic,
    Truth,
};
use vehicle::VehicleParameters;

const MS: u64 = 1_000_000;
const AT_NS: u64 = 1000 * MS;

fn header(valid_ns: u64) -> Header {
    Header { valid_ns, ..Header::default() }
}

/// One second of level flight with a force of `force_n` along world x, observed without missing samples.
fn hovering(force_n: f64) -> Watcher {
    let vehicle = VehicleParameters::default();
    let (mass_kg, weight_n) = (vehicle.mass_kg, vehicle.weight_n());
    let mut watcher = Watcher::new(&vehicle);
    for ms in 0..1000 {
        watcher.observe(&AppliedCommand {
            header: header(ms * MS),
            thrust_n: weight_n,
            rotor_thrust_n: [0.25 * weight_n; 4],
            ..AppliedCommand::default()
        });
        watcher.observe(&StateEstimate {
            header: header(ms * MS),
            position_w_m: [ms as f64, 2.0, 3.0],
            q_wb: Quaternion::IDENTITY,
            velocity_w_m_s: [0.5, 0.0, 0.0],
            // Level, so that the specific force is thrust along z, and force minus drag along x.
            specific_force_b_m_s2: [
                (force_n - vehicle.drag_n_s_m * 0.5) / mass_kg,
                0.0,
                weight_n / mass_kg,
            ],
            morph_angle_rad: 1.0,
            position_sigma_w_m: [0.01, 0.02, 0.03],
            velocity_sigma_w_m_s: [0.1; 3],
            attitude_sigma_b_rad: [0.001; 3],
            ..StateEstimate::default()
        });
    }
    watcher
}

fn snapshot() -> Snapshot {
    hovering(0.1).snapshot(AT_NS).expect("it has seen everything")
}

#[test]
fn a_snapshot_is_made_only_from_topics_that_a_real_vehicle_has() {
    struct Ask<'a>(&'a mut Watcher, Vec<&'static str>);
    impl TopicVisitor for Ask<'_> {
        type Error = Infallible;
        fn visit<T: Sample>(&mut self, topic: &'static Topic<T>) -> Result<(), Infallible> {
            if self.0.observe_any(&T::default()) {
                self.1.push(topic.info.name);
            }
            Ok(())
        }
    }
    let mut watcher = Watcher::new(&VehicleParameters::default());
    let mut ask = Ask(&mut watcher, Vec::new());
    let Ok(()) = topics::visit_all(&mut ask);
    let mut expected = Watcher::topics().to_vec();
    expected.sort_unstable();
    ask.1.sort_unstable();
    assert_eq!(ask.1, expected);
    for forbidden in [&topics::TRUTH.info, &topics::ACTUATOR_STATE.info, &topics::DISTURBANCE.info]
    {
        assert!(!Watcher::topics().contains(&forbidden.name), "{}", forbidden.name);
    }
}

#[test]
fn ground_truth_does_not_change_a_snapshot() {
    let mut watcher = hovering(0.1);
    let before = watcher.snapshot(AT_NS);
    assert!(!watcher.observe_any(&Truth { position_w_m: [9.0; 3], ..Truth::default() }));
    let actuators = ActuatorState { rotor_thrust_n: [9.0; 4], ..ActuatorState::default() };
    assert!(!watcher.observe_any(&actuators));
    assert_eq!(watcher.snapshot(AT_NS), before);
}

#[test]
fn later_samples_do_not_change_the_snapshot_of_an_instant() {
    let mut watcher = hovering(0.1);
    let before = watcher.snapshot(AT_NS).unwrap();
    assert!((before.position_w_m[0] - 999.0).abs() < 1e-12);
    watcher.observe(&StateEstimate { header: header(1001 * MS), ..StateEstimate::default() });
    let order = GuidanceOrder { header: header(1002 * MS), ..GuidanceOrder::default() };
    watcher.observe(&order);
    assert_eq!(watcher.snapshot(AT_NS), Some(before));
    assert_eq!(watcher.snapshot(500 * MS).unwrap().position_w_m[0].to_bits(), 500.0_f64.to_bits());
}

#[test]
fn the_external_force_is_the_specific_force_without_thrust_and_drag() {
    let [x, y, z] = snapshot().force_w_n;
    assert!((x - 0.1).abs() < 1e-9 && y.abs() < 1e-9 && z.abs() < 1e-9, "{x} {y} {z}");
}

#[test]
fn there_is_no_snapshot_before_the_first_estimate_and_command() {
    let watcher = Watcher::new(&VehicleParameters::default());
    assert_eq!(watcher.snapshot(AT_NS), None);
}

#[test]
fn a_snapshot_with_nan_or_without_a_unit_quaternion_is_not_usable() {
    assert!(snapshot().is_usable());
    assert!(!Snapshot { morph_angle_rad: f64::NAN, ..snapshot() }.is_usable());
    assert!(!Snapshot { q_wb: [0.0; 4], ..snapshot() }.is_usable());
    let json = serde_json::to_string(&snapshot()).unwrap();
    assert_eq!(serde_json::from_str::<Snapshot>(&json).unwrap(), snapshot());
}

#[test]
fn the_first_initial_state_is_the_mean_and_the_others_lie_within_one_sigma() {
    let snapshot = snapshot();
    let [mean, one, other] = draws(&snapshot, 7, 3);
    assert!(
        [mean.position_w_m, mean.attitude_b_rad].as_flattened().iter().all(|x| x.abs() < 1e-300)
    );
    for draw in [one, other] {
        assert!(draw.position_w_m.iter().any(|x| x.abs() > 0.0));
        for axis in 0..3 {
            assert!(draw.position_w_m[axis].abs() <= snapshot.position_sigma_w_m[axis]);
            assert!(draw.velocity_w_m_s[axis].abs() <= snapshot.velocity_sigma_w_m_s[axis]);
            assert!(draw.attitude_b_rad[axis].abs() <= snapshot.attitude_sigma_b_rad[axis]);
        }
    }
}

#[test]
fn the_draws_depend_only_on_the_seed_of_the_run_and_the_number_of_the_swap() {
    let snapshot = snapshot();
    let of = |seed, swap| draws(&snapshot, seed, swap);
    assert_eq!(of(7, 3), of(7, 3));
    let mut seeds: Vec<u64> = [(7, 3), (7, 4), (8, 3), (3, 7)]
        .into_iter()
        .flat_map(|(seed, swap)| of(seed, swap).map(|draw| draw.seed))
        .collect();
    assert!(seeds.iter().all(|seed| i64::try_from(*seed).is_ok()), "TOML has no larger numbers");
    seeds.sort_unstable();
    seeds.dedup();
    assert_eq!(seeds.len(), 4 * DRAWS);
}
