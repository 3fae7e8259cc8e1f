//! What orders make of a plan: smooth, within limits, and there in the end.

#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss,
    reason = "small numbers"
)]

use super::{Calm, Disturb, Goto, Load, Morph, Order, Planner, RefusedOrder, Sent};
use crate::{Override, Plan, Scenario};
use ::pilot::{MorphSchedule, Trajectory, diversion, divert};
use shared_types::{DISTURBANCE_ORDERS, DisturbanceKind, GuidanceOrder};

const MS: u64 = 1_000_000;

fn scenario(text: &str) -> Scenario {
    Scenario::from_text("x.toml", text, &[]).unwrap()
}

/// A figure eight along whose path the nose points, and sweeps as fast as the servo allows.
fn lively() -> Scenario {
    scenario(
        "[pilot]\nkind = \"figure8\"\nyaw = \"along-path\"\nperiod_s = 5.0\n\
         morph = [[1.0, 45.0], [1.3, 160.0], [2.0, 160.0], [3.0, 94.5], [3.5, 45.0]]\n\
         [scenario]\nduration_s = 60.0\n",
    )
}

struct Flown {
    trajectory: Trajectory,
    schedule: MorphSchedule,
    planner: Planner,
    order: Option<GuidanceOrder>,
}

impl Flown {
    fn of(scenario: &Scenario) -> Self {
        let Plan::Flight(config) = scenario.plan() else { panic!("no rig") };
        let limit = scenario.modelled_vehicle().servo_rate_limit_rad_s;
        Self {
            trajectory: Trajectory::new(&config.trajectory).unwrap(),
            schedule: MorphSchedule::new(&config.morph, limit).unwrap(),
            planner: Planner::of(scenario).unwrap(),
            order: None,
        }
    }

    fn give(&mut self, order: Order, at_ns: u64) -> Result<f64, RefusedOrder> {
        let planned = self.planner.order(&order, (at_ns, at_ns), false)?;
        let Sent::Guidance(sent) = planned.sent else { panic!("for the pilot") };
        assert_eq!(sent.header.valid_ns, at_ns);
        self.order = Some(sent);
        Ok(planned.report.done_s.unwrap())
    }

    fn position(&self, t_ns: u64) -> [f64; 3] {
        diversion::point(&self.trajectory, self.order.as_ref(), t_ns).position_w_m
    }

    fn point(&self, t_ns: u64) -> ::pilot::TrajectoryPoint {
        diversion::point(&self.trajectory, self.order.as_ref(), t_ns)
    }

    fn yaw(&self, t_ns: u64) -> f64 {
        self.point(t_ns).yaw_rad
    }

    fn angle(&self, t_ns: u64) -> f64 {
        diversion::angle_rad(&self.schedule, self.order.as_ref(), t_ns)
    }
}

fn goto(position_w_m: [f64; 3], yaw_deg: Option<f64>) -> Order {
    Order::Goto(Goto { position_w_m, yaw_deg })
}

fn morph(angle_deg: f64, over_s: f64) -> Order {
    Order::Morph(Morph { angle_deg, over_s })
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}

/// Backward and forward differences of a function of time meet as closely as its next derivative,
/// at most `bound`, lets them.
fn assert_meets(f: impl Fn(u64) -> f64, g: impl Fn(u64) -> f64, at_ns: u64, bound: f64) {
    let step_s = 1e-3;
    let (before, at) = (f(at_ns - MS), f(at_ns));
    let (at_after, after) = (g(at_ns), g(at_ns + MS));
    assert!((at - at_after).abs() < 1e-9, "a step of {}", at - at_after);
    let (was, is) = ((at - before) / step_s, (after - at_after) / step_s);
    assert!((was - is).abs() < bound * step_s + 1e-6, "a kink from {was} to {is}");
}

#[test]
fn a_landing_takes_as_long_as_from_the_highest_place_planned_or_ordered() {
    let low = scenario("[start]\nposition_w_m = [0.0, 0.0, 1.0]\n[pilot]\nkind = \"hover\"\n");
    let planned = low.flight().unwrap().landing_s;
    assert!((planned - (2.0 + 1.0 / 0.5 + 2.0)).abs() < 1e-9, "{planned}");
    let high = scenario("[start]\nposition_w_m = [0.0, 0.0, 5.0]\n[pilot]\nkind = \"hover\"\n");
    assert!((high.flight().unwrap().landing_s - planned - 4.0 / 0.5).abs() < 1e-9);
    let mut flown = Flown::of(&low);
    for (height_m, highest_m) in [(0.5, 1.0), (4.0, 4.0), (2.0, 4.0)] {
        flown.give(goto([0.0, 0.0, height_m], None), 1000 * MS).unwrap();
        let landing_s = flown.planner.landing_s();
        assert!((landing_s - planned - (highest_m - 1.0) / 0.5).abs() < 1e-9, "{landing_s}");
    }
}

#[test]
fn a_vehicle_in_motion_is_led_to_rest_at_the_goal_without_a_step_and_within_limits() {
    let goals = [[0.0, 0.0, 1.5], [1.0, -2.0, 2.5], [-30.0, 4.0, 0.5], [0.2, 0.1, 1.4]];
    for at_ms in [0, 300, 1700, 4321, 8000, 11_111, 16_000] {
        for goal in goals {
            let at_ns = at_ms * MS;
            let mut flown = Flown::of(&lively());
            let before = Flown::of(&lively());
            let done_s = flown.give(goto(goal, None), at_ns).unwrap();
            if at_ns > 0 {
                for axis in 0..3 {
                    let was = |t_ns| before.position(t_ns)[axis];
                    let is = |t_ns| flown.position(t_ns)[axis];
                    assert_meets(was, is, at_ns, 8.0);
                    let was = |t_ns| before.point(t_ns).velocity_w_m_s[axis];
                    let is = |t_ns| flown.point(t_ns).velocity_w_m_s[axis];
                    assert_meets(was, is, at_ns, 60.0);
                }
                assert_meets(|t| before.yaw(t), |t| flown.yaw(t), at_ns, 20.0);
            }
            let start = before.point(at_ns);
            let own = distance(start.velocity_w_m_s, [0.0; 3]);
            let pull = distance(start.acceleration_w_m_s2, [0.0; 3]);
            let done_ns = at_ns + ((done_s * 1e9) as u64 - at_ns);
            for t_ns in (at_ns..done_ns + 100 * MS).step_by(5_000_000) {
                let point = flown.point(t_ns);
                let speed = distance(point.velocity_w_m_s, [0.0; 3]);
                assert!(speed <= 1.002 * own.max(divert::SPEED_LIMIT_M_S), "{speed} m/s");
                let bound = pull.max(divert::ACCELERATION_LIMIT_M_S2);
                let acceleration = distance(point.acceleration_w_m_s2, [0.0; 3]);
                assert!(acceleration <= 1.002 * bound, "{acceleration} m/s2 of {bound}");
            }
            let end = flown.point(done_ns + MS);
            assert!(distance(end.position_w_m, goal) < 1e-9, "{end:?}");
            assert!(distance(end.velocity_w_m_s, [0.0; 3]) < 1e-9);
        }
    }
}

#[test]
fn velocity_and_acceleration_of_a_diversion_are_the_derivatives_of_its_position() {
    let mut flown = Flown::of(&lively());
    flown.give(goto([3.0, -1.0, 2.0], Some(120.0)), 4321 * MS).unwrap();
    for t_ns in (4400 * MS..12_000 * MS).step_by(37_000_000) {
        let (before, at, after) =
            (flown.point(t_ns - MS / 10), flown.point(t_ns), flown.point(t_ns + MS / 10));
        for axis in 0..3 {
            let slope = |f: fn(&::pilot::TrajectoryPoint) -> [f64; 3]| {
                (f(&after)[axis] - f(&before)[axis]) / 2e-4
            };
            assert!((slope(|p| p.position_w_m) - at.velocity_w_m_s[axis]).abs() < 1e-6);
            assert!((slope(|p| p.velocity_w_m_s) - at.acceleration_w_m_s2[axis]).abs() < 1e-5);
        }
    }
}

#[test]
fn a_way_that_is_long_is_straight_and_does_not_swing_out_sideways() {
    let mut flown = Flown::of(&lively());
    let start = flown.position(4000 * MS);
    flown.give(goto([80.0, start[1], start[2]], None), 4000 * MS).unwrap();
    for t_ns in (4000 * MS..59_000 * MS).step_by(100_000_000) {
        let [_, y, z] = flown.position(t_ns);
        assert!((y - start[1]).abs() < 1.5 && (z - start[2]).abs() < 1.5, "{y} {z}");
    }
}

#[test]
fn a_turn_at_hand_dies_out_and_does_not_spin_up() {
    for at_ms in [300, 1700, 4000, 4321, 8000, 11_111] {
        let (before, mut flown) = (Flown::of(&lively()), Flown::of(&lively()));
        let rate = |flown: &Flown, t_ns| (flown.yaw(t_ns + MS) - flown.yaw(t_ns)).abs() / 1e-3;
        let at_hand = rate(&before, at_ms * MS - MS);
        flown.give(goto([5.0, 0.0, 2.0], None), at_ms * MS).unwrap();
        for t_ns in (at_ms * MS..50_000 * MS).step_by(10_000_000) {
            let now = rate(&flown, t_ns);
            assert!(now < 1.6 * at_hand.max(0.8), "{now} rad/s of {at_hand}, ordered at {at_ms}");
        }
    }
}

#[test]
fn a_second_order_leaves_the_first_as_smoothly_and_a_morph_does_not_touch_the_way() {
    let mut flown = Flown::of(&lively());
    flown.give(goto([5.0, 0.0, 2.0], Some(-170.0)), 4000 * MS).unwrap();
    let mut second = Flown::of(&lively());
    second.give(goto([5.0, 0.0, 2.0], Some(-170.0)), 4000 * MS).unwrap();
    second.give(goto([-2.0, 1.0, 1.0], Some(170.0)), 5500 * MS).unwrap();
    for axis in 0..3 {
        let (was, is) = (|t_ns| flown.position(t_ns)[axis], |t_ns| second.position(t_ns)[axis]);
        assert_meets(was, is, 5500 * MS, 8.0);
    }
    assert_meets(|t| flown.yaw(t), |t| second.yaw(t), 5500 * MS, 20.0);
    // The shorter way round, through 180°.
    let turned = libm::fmod(second.yaw(59_000 * MS).to_degrees() + 720.0, 360.0);
    assert!((turned - 170.0).abs() < 1e-6, "{turned}");
    let there = second.position(59_000 * MS);
    second.give(morph(100.0, 1.0), 8000 * MS).unwrap();
    assert!(distance(second.position(59_000 * MS), there) < 1e-12);
    assert!((second.angle(10_000 * MS).to_degrees() - 100.0).abs() < 1e-9);
}

#[test]
fn arms_leave_any_sweep_smoothly_within_range_and_rate_and_are_there_in_time() {
    let limit = 700.0_f64.to_radians();
    for at_ms in [500, 1050, 1150, 1280, 1500, 2500, 3250, 5000] {
        for goal_deg in [45.0, 100.0, 160.0] {
            let at_ns = at_ms * MS;
            let (before, mut flown) = (Flown::of(&lively()), Flown::of(&lively()));
            let done_s = flown.give(morph(goal_deg, 0.9), at_ns).unwrap();
            assert!(done_s <= at_ms as f64 / 1e3 + 0.9 + 1e-9);
            assert_meets(|t| before.angle(t), |t| flown.angle(t), at_ns, 1000.0);
            for t_ns in (at_ns..at_ns + 1000 * MS).step_by(1_000_000) {
                let angle_deg = flown.angle(t_ns).to_degrees();
                assert!((45.0 - 1e-6..=160.0 + 1e-6).contains(&angle_deg), "{angle_deg}");
                let rate = (flown.angle(t_ns + MS) - flown.angle(t_ns)) / 1e-3;
                assert!(rate.abs() <= limit * 1.001, "{} deg/s", rate.to_degrees());
            }
            let end_deg = flown.angle(at_ns + 901 * MS).to_degrees();
            assert!((end_deg - goal_deg).abs() < 1e-9, "{end_deg}");
        }
    }
}

#[test]
fn a_sweep_that_the_servo_cannot_do_is_refused_with_a_time_that_it_can() {
    let mut flown = Flown::of(&scenario("[scenario]\nduration_s = 60.0\n"));
    let refused = flown.give(morph(160.0, 0.1), 1000 * MS).unwrap_err();
    let RefusedOrder::TooFast { shortest_s, .. } = refused else { panic!("{refused}") };
    // Peak over mean rate is 1.5: 115° at 700°/s.
    assert!((0.2464..0.26).contains(&shortest_s), "{shortest_s}");
    assert!(flown.give(morph(160.0, shortest_s), 1000 * MS).is_ok());
    // And in the middle of a fast sweep the other way.
    let mut flown = Flown::of(&lively());
    let refused = flown.give(morph(45.0, 0.05), 1150 * MS).unwrap_err();
    let RefusedOrder::TooFast { shortest_s, .. } = refused else { panic!("{refused}") };
    assert!(flown.give(morph(45.0, shortest_s), 1150 * MS).is_ok());
}

#[test]
fn refused_orders_change_nothing_and_name_what_would_do() {
    let mut planner = Planner::of(&lively()).unwrap();
    let mut refused = |order, begin_ms: u64| {
        planner.order(&order, (0, begin_ms * MS), false).unwrap_err().to_string()
    };
    let at_z = |z| goto([0.0, 0.0, z], None);
    for (order, expected) in [
        (at_z(0.1), "z 0.1 is out of range: give a number from 0.2 to 100 m"),
        (at_z(f64::NAN), "from 0.2 to 100 m"),
        (goto([0.0, -101.0, 1.0], None), "y -101"),
        (goto([0.0, 0.0, 1.0], Some(400.0)), "from -360 to 360 deg"),
        (morph(44.9, 2.0), "from 45 to 160 deg"),
        (morph(90.0, -1.0), "from 0.001 to 3600 s"),
        (morph(90.0, 0.0), "from 0.001 to 3600 s"),
    ] {
        let message = refused(order, 1000);
        assert!(message.contains(expected), "{message}");
    }
    assert!(refused(at_z(1.0), 60_000).contains("flight ends at 60 s"));
    let disturb = |load| Order::Disturb(Disturb { load, in_s: 0.0, for_s: None });
    let wind = |sigma| Load::Wind { mean_w_m_s: [0.0; 3], sigma_w_m_s: [sigma; 3] };
    for (load, expected) in [
        (Load::ForceWN([0.0, 200.0, 0.0]), "force.y 200"),
        (wind(-1.0), "gust -1"),
        (Load::PayloadKg(-0.1), "from 0 to 10 kg"),
        (Load::Rotor { rotor: 5, efficiency: 0.5 }, "rotor 5"),
        (Load::Rotor { rotor: 1, efficiency: 1.5 }, "efficiency 1.5"),
    ] {
        let message = refused(disturb(load), 1000);
        assert!(message.contains(expected), "{message}");
    }
    assert!(planner.reports.is_empty());
}

#[test]
fn eight_disturbances_hold_at_a_time_and_make_room_when_they_are_over_or_ended() {
    let mut planner = Planner::of(&lively()).unwrap();
    let push = |for_s| {
        let load = Load::ForceWN([0.1, 0.0, 0.0]);
        Order::Disturb(Disturb { load, in_s: 0.5, for_s: Some(for_s) })
    };
    let mut give = |order, at_ms: u64| {
        planner.order(&order, (at_ms * MS, at_ms * MS), false).map(|planned| planned.sent)
    };
    for k in 0..DISTURBANCE_ORDERS as u64 {
        let Ok(Sent::Disturbance(sent)) = give(push(1.0), 1000) else { panic!("there is room") };
        assert_eq!((sent.count, sent.header.sequence), (k + 1, k + 1));
        let last = sent.entries[k as usize];
        assert_eq!((last.number, last.kind), (k + 1, DisturbanceKind::Force));
        assert_eq!((last.begin_ns, last.until_ns), (1500 * MS, 2500 * MS));
    }
    assert_eq!(give(push(1.0), 1000).unwrap_err(), RefusedOrder::TooMany);
    // Over for a second.
    let Ok(Sent::Disturbance(sent)) = give(push(1.0), 3600) else { panic!("there is room") };
    assert_eq!((sent.count, sent.entries[0].number), (1, 9));
    let Ok(Sent::Disturbance(sent)) = give(Order::Calm(Calm { script: true }), 3700) else {
        panic!("it can always be calm")
    };
    assert_eq!((sent.count, sent.script_off.is_set()), (0, true));
    // Whatever has ended, and whichever launcher goes on, no number comes again.
    let mut next = Planner::of(&lively()).unwrap();
    next.go_on(&GuidanceOrder::default(), &sent);
    for planner in [&mut planner, &mut next] {
        let order = planner.order(&push(1.0), (4000 * MS, 4000 * MS), false);
        let Ok(Sent::Disturbance(sent)) = order.map(|planned| planned.sent) else {
            panic!("there is room")
        };
        assert_eq!(sent.entries[0].number, 11);
    }
}

#[test]
fn an_order_is_the_same_after_its_way_through_json() {
    for order in [
        goto([1.0, 2.0, 3.0], Some(90.0)),
        morph(120.0, 1.5),
        Order::Disturb(Disturb { load: Load::PayloadKg(0.1), in_s: 0.5, for_s: None }),
        Order::Calm(Calm { script: true }),
    ] {
        let text = serde_json::to_string(&order).unwrap();
        assert_eq!(serde_json::from_str::<Order>(&text).unwrap(), order, "{text}");
    }
    let short = r#"{"disturb":{"load":{"wind":{"mean_w_m_s":[3,0,0]}}}}"#;
    assert!(serde_json::from_str::<Order>(short).is_ok());
    assert!(serde_json::from_str::<Order>(r#"{"goto":{"position":[1,2,3]}}"#).is_err());
}

#[test]
fn flags_of_a_run_are_orders_of_its_script() {
    let flags = [Override::goto("1,0,2@3s").unwrap(), Override::morph("120@4s").unwrap()];
    let scenario = Scenario::load("hover", &flags).unwrap();
    let mut planner = Planner::of(&scenario).unwrap();
    for settings in &scenario.settings().order {
        let at_ns = (settings.at_s * 1e9) as u64;
        planner.order(&settings.order().unwrap(), (at_ns, at_ns), true).unwrap();
    }
    let orders: Vec<&str> = planner.reports.iter().map(|r| r.order.as_str()).collect();
    assert_eq!(orders, ["goto 1 0 2 m", "morph 120 deg over 2 s"]);
}
