//! The rehearsal on shipped scenarios: its initial condition, and which controllers it refuses and accepts.
#![expect(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::float_cmp,
    reason = "what fails here fails the test; instants are small, and bits are what is compared"
)]

use catalogue::swapped::config_of;
use catalogue::{Altering, Entry, Fault, Spoiler, entries};
use observe::Observer;
use scenario::services::names_for;
use scenario::{Override, Scenario};
use shared_types::{MorphCommand, PerSlot, Reference, Sample, Slot, Topic, Truth};
use simulate::in_process::{InProcess, StateSource};
use simulate::rehearse::{Rehearsal, RehearsalRefusal, Role, Verdict, verdict, watch};
use std::any::Any;
use swap::RehearsalSpec;
use vehicle::MorphAngle;

fn load(name: &str, set: &[&str]) -> Scenario {
    let edits: Vec<Override> = set.iter().map(|set| Override::set(set).unwrap()).collect();
    Scenario::load(name, &edits).unwrap()
}

fn spec(scenario: &Scenario, at_s: f64, slot: Slot, candidate: &str) -> RehearsalSpec {
    let at_ns = (at_s * 1e9) as u64;
    RehearsalSpec {
        scenario: scenario.to_toml().to_owned(),
        snapshot: watch::snapshot_of(scenario, at_ns).unwrap().unwrap(),
        slot,
        owners: PerSlot::default(),
        owner: None,
        candidate: candidate.to_owned(),
        config: None,
        seed: 1,
        swap: 1,
    }
}

/// Samples of a flight that are compared.
#[derive(Default)]
struct Ends {
    truths: Vec<Truth>,
    references: Vec<Reference>,
    morphs: Vec<MorphCommand>,
}

impl Observer for Ends {
    fn observe<T: Sample>(&mut self, _topic: &'static Topic<T>, sample: &T) {
        let any: &dyn Any = sample;
        self.truths.extend(any.downcast_ref::<Truth>());
        self.references.extend(any.downcast_ref::<Reference>());
        self.morphs.extend(any.downcast_ref::<MorphCommand>());
    }
}

fn flown(scenario: &Scenario, until_s: f64) -> Ends {
    let mut flight = InProcess::new(scenario, StateSource::Estimator, Ends::default()).unwrap();
    flight.fly_until((until_s * 1e9) as u64).unwrap();
    flight.seen(core::mem::take)
}

fn rehearsed(spec: RehearsalSpec, entry: &Entry) -> Verdict {
    let (slot, law) = (spec.slot, spec.candidate.clone());
    let scenario = Scenario::from_text("flown", &spec.scenario, &[]).unwrap();
    let vehicle = scenario.modelled_vehicle();
    let beta = MorphAngle::saturating_from_rad(spec.snapshot.morph_angle_rad).unwrap();
    let tilt = scenario.position_law().unwrap().tilt_max_rad;
    let largest = match slot {
        Slot::Attitude => vehicle.largest_wrench(beta),
        Slot::Position => [vehicle.weight_n(), tilt, tilt, tilt],
    };
    let rehearsal = Rehearsal::prepare(spec).unwrap();
    let altering = || Altering::new(slot, Spoiler::new(entry.clone(), largest));
    Verdict::of(&law, &rehearsal.owner(), rehearsal.fly_with(&mut || true, altering))
}

#[test]
fn a_rehearsed_flight_begins_at_the_state_of_the_vehicle_and_follows_its_plan() {
    let edits = [Override::goto("0.5,-0.5,1.2@5.2s").unwrap()];
    let scenario = Scenario::load("figure8-morph", &edits).unwrap();
    let spec = spec(&scenario, 6.0, Slot::Attitude, "attitude-lqr");
    let snapshot = spec.snapshot;
    assert!(snapshot.guidance.position.is_some(), "an order is in effect");
    let rehearsal = Rehearsal::prepare(spec).unwrap();
    let derived = rehearsal.scenario(0, Role::Owner).unwrap();
    let again = Scenario::from_text("again", derived.to_toml(), &[]).unwrap();
    let (there, here) = (flown(&scenario, 7.2), flown(&again, 0.5));
    let at = |ends: &Ends, t_ns: u64| {
        *ends.references.iter().find(|r| r.header.valid_ns == t_ns).expect("a reference")
    };
    let sweeps = |ends: &Ends, t_ns: u64| {
        ends.morphs.iter().find(|m| m.header.valid_ns == t_ns).expect("a command").angle_rad
    };
    for ms in [0, 100, 400] {
        let (planned, flown) = (at(&there, (6000 + ms) * 1_000_000), at(&here, ms * 1_000_000));
        assert_eq!(planned.points[0].position_w_m, flown.points[0].position_w_m);
        assert_eq!(planned.points[0].velocity_w_m_s, flown.points[0].velocity_w_m_s);
        let (planned, flown) =
            (sweeps(&there, (6000 + ms) * 1_000_000), sweeps(&here, ms * 1_000_000));
        assert_eq!(planned.to_bits(), flown.to_bits());
    }
    let first = here.truths.first().expect("a truth");
    for axis in 0..3 {
        assert!((first.position_w_m[axis] - snapshot.position_w_m[axis]).abs() < 1e-9);
        assert!((first.velocity_w_m_s[axis] - snapshot.velocity_w_m_s[axis]).abs() < 1e-6);
        assert!((first.body_rate_b_rad_s[axis] - snapshot.body_rate_b_rad_s[axis]).abs() < 1e-6);
    }
    let q = &first.q_wb;
    let product = q.w * snapshot.q_wb[0]
        + q.x * snapshot.q_wb[1]
        + q.y * snapshot.q_wb[2]
        + q.z * snapshot.q_wb[3];
    assert!(product.abs() > 1.0 - 1e-9, "{product}");
    assert!((first.morph_angle_rad - snapshot.morph_angle_rad).abs() < 1e-6);
}

#[test]
fn a_rehearsal_of_the_same_swap_is_the_same_to_the_last_bit() {
    let scenario = load("figure8-morph", &[]);
    let rehearse = || {
        let spec = spec(&scenario, 9.1, Slot::Attitude, "attitude-lqr");
        serde_json::to_string(&verdict(spec, &mut || true)).unwrap()
    };
    let first = rehearse();
    assert_eq!(first, rehearse());
    let other = RehearsalSpec { swap: 2, ..spec(&scenario, 9.1, Slot::Attitude, "attitude-lqr") };
    let other = serde_json::to_string(&verdict(other, &mut || true)).unwrap();
    assert_ne!(first, other, "another swap draws other starts");
}

#[test]
fn every_shipped_controller_may_replace_every_other() {
    for (flight, at_s) in [("hover", 2.0), ("figure8-morph", 5.3)] {
        for slot in Slot::ALL {
            for owner in names_for(slot.role()) {
                let assignment =
                    Override::controller(&format!("{}={owner}", slot.label())).unwrap();
                let scenario = Scenario::load(flight, &[assignment]).unwrap();
                for candidate in names_for(slot.role()) {
                    let result = verdict(spec(&scenario, at_s, slot, candidate), &mut || true);
                    assert!(result.accepted, "{flight}, {owner}: {}", result.message);
                }
            }
        }
    }
}

#[test]
fn a_rehearsal_refuses_controllers_that_would_lose_the_vehicle() {
    let scenario = load("hover", &["pilot.morph=[[0.0,45.0],[8.0,45.0],[8.5,160.0]]"]);
    for slot in Slot::ALL {
        let law = names_for(slot.role()).next().unwrap();
        for entry in entries(slot) {
            let fatal = match entry.fault {
                Fault::WrongSign
                | Fault::Exchanged
                | Fault::Frozen
                | Fault::NotANumber
                | Fault::UntilMorph => true,
                Fault::Gain => entry.amount > 5.0,
                Fault::Delay => entry.amount > 0.05 && slot == Slot::Attitude,
                _ => false,
            };
            if !fatal {
                continue;
            }
            let result = rehearsed(spec(&scenario, 2.0, slot, law), &entry);
            assert!(!result.accepted, "{} {}: {}", slot.label(), entry.name(), result.message);
            assert!(result.message.contains("after "), "{}", result.message);
        }
    }
}

/// Whether a trip of the position slot's owner is executed is up to the attitude controller.
#[test]
fn a_rehearsal_refuses_an_attitude_controller_that_ignores_trips() {
    let scenario = load("hover", &[]);
    let folder = tempfile::TempDir::new().unwrap();
    let config = folder.path().join("entry.toml");
    let flown_with = |fault: Fault| {
        std::fs::write(&config, config_of(&Entry { fault, ..Entry::default() })).unwrap();
        let spec = spec(&scenario, 2.0, Slot::Attitude, env!("CARGO_BIN_EXE_catalogue"));
        verdict(RehearsalSpec { config: Some(config.clone()), ..spec }, &mut || true)
    };
    let bad = flown_with(Fault::IgnoresTrips);
    assert!(matches!(bad.refusal, Some(RehearsalRefusal::TripIgnored { .. })), "{}", bad.message);
    let good = flown_with(Fault::Nothing);
    assert!(good.accepted, "{}", good.message);

    // The one that flies may be an executable too.
    let spec = spec(&scenario, 2.0, Slot::Attitude, "attitude-mpc");
    let owner = Some((env!("CARGO_BIN_EXE_catalogue").to_owned(), Some(config.clone())));
    let result = verdict(RehearsalSpec { owner, ..spec }, &mut || true);
    assert!(
        result.message.starts_with("attitude-mpc can fly in place of catalogue"),
        "{}",
        result.message
    );
}

#[test]
fn a_spoiler_without_a_fault_does_not_change_the_verdict() {
    let scenario = load("hover", &[]);
    let plain = verdict(spec(&scenario, 2.0, Slot::Attitude, "attitude-pid"), &mut || true);
    let spoiled =
        rehearsed(spec(&scenario, 2.0, Slot::Attitude, "attitude-pid"), &Entry::default());
    assert_eq!(plain, spoiled);
}

#[test]
fn a_rehearsal_that_runs_out_of_time_is_reported_as_not_rehearsed() {
    let scenario = load("hover", &[]);
    let mut looks = 0;
    let mut go_on = || {
        looks += 1;
        looks < 5
    };
    let result = verdict(spec(&scenario, 2.0, Slot::Attitude, "attitude-lqr"), &mut go_on);
    assert!(!result.accepted, "{}", result.message);
    assert!(
        matches!(result.refusal, Some(RehearsalRefusal::NotRehearsed { .. })),
        "{}",
        result.message
    );
    assert!(result.message.contains("not rehearsed") && result.message.contains("wall_max_s"));
}

#[test]
fn a_vehicle_under_the_actuation_guard_is_not_rehearsed() {
    let scenario = load("hover", &[]);
    let mut held = spec(&scenario, 2.0, Slot::Attitude, "attitude-lqr");
    held.snapshot.commanded = false;
    let result = verdict(held, &mut || true);
    assert!(
        matches!(result.refusal, Some(RehearsalRefusal::NotRehearsed { .. })),
        "{}",
        result.message
    );
}

#[test]
fn invalid_settings_of_start_and_rehearsal_are_rejected_with_key_and_remedy() {
    for (set, key) in [
        ("start.rotor_thrust_n=[0.3,9.0,0.3,0.3]", "start.rotor_thrust_n[1]"),
        ("start.velocity_w_m_s=[0.0,1e9,0.0]", "start.velocity_w_m_s[1]"),
        ("start.pitch_deg=90", "start.pitch_deg"),
        ("start.body_rate_b_rad_s=[0.0,nan,0.0]", "start.body_rate_b_rad_s[1]"),
        ("rehearsal.owner_scale=0.5", "rehearsal.owner_scale"),
        ("rehearsal.duration=3", "rehearsal.duration"),
    ] {
        let error = Scenario::load("hover", &[Override::set(set).unwrap()]).unwrap_err();
        let problem = error.problems().next().expect("a problem");
        assert!(problem.key().starts_with(key), "{set}: {problem}");
        assert!(!problem.remedy().is_empty(), "{set}");
    }
}

#[test]
fn a_derived_flight_without_challenges_follows_the_original_one() {
    let scenario = load("figure8-morph", &["disturbance_injector.script=[]"]);
    let spec = spec(&scenario, 5.3, Slot::Attitude, "attitude-lqr");
    let rehearsal = Rehearsal::prepare(spec).unwrap();
    let mut text: String = rehearsal.scenario(0, Role::Owner).unwrap().to_toml().to_owned();
    // Without challenges it differs from the original only by its noise and by controllers that start anew.
    text = Scenario::from_text(
        "calm",
        &text,
        &[
            Override::set("disturbance_injector.script=[]").unwrap(),
            Override::set("order=[]").unwrap(),
        ],
    )
    .unwrap()
    .to_toml()
    .to_owned();
    let derived = Scenario::from_text("calm", &text, &[]).unwrap();
    let (there, here) = (flown(&scenario, 7.3), flown(&derived, 2.0));
    let at = |ends: &Ends, t_ns: u64| {
        ends.truths.iter().find(|t| t.header.valid_ns == t_ns).expect("a truth").position_w_m
    };
    for ms in [200_u64, 1000, 1900] {
        let (a, b) = (at(&there, (5300 + ms) * 1_000_000), at(&here, ms * 1_000_000));
        let distance: f64 = (0..3).map(|i| (a[i] - b[i]) * (a[i] - b[i])).sum::<f64>().sqrt();
        assert!(distance < 0.06, "{distance} m apart after {ms} ms");
    }
}
