//! Which commands the plant follows: flips, records that come too late, fail-over, the limiter.

use nalgebra::Vector3;
use plant::gate::{GateConfig, UnprovenRange};
use plant::ports::{Inputs, Outputs};
use plant::sensors::SensorConfigs;
use plant::{ModelKind, Motion, Plant, PlantConfig};
use runtime::graph::Edge;
use runtime::{InputSet as _, Service as _, Source};
use shared_types::{
    AppliedCommand, Flag, GateMode, Header, NO_SEAT, OwnerRecord, Quaternion, Reference, Role,
    StateEstimate, Trip, WrenchCommand, topics,
};
use vehicle::{MorphAngle, VehicleParameters};

const MS: u64 = 1_000_000;
const PERIOD_NS: u64 = 10 * MS;
const A: u32 = 1;
const B: u32 = 2;
/// Torque of B about x; A has none \[N m\].
const TORQUE_NM: f64 = 0.02;

struct Silent;

impl<T> Source<T> for Silent {
    fn receive(&mut self) -> Option<T> {
        None
    }
}

fn plant() -> Plant {
    plant_with(None)
}

fn plant_with(unproven: Option<UnprovenRange>) -> Plant {
    Plant::new(&PlantConfig {
        vehicle: VehicleParameters::default(),
        model: ModelKind::Linear,
        sensors: SensorConfigs::default(),
        gate: GateConfig::default(),
        unproven,
        position_w_m: Vector3::new(0.0, 0.0, 1.5),
        yaw_rad: 0.0,
        morph_angle: MorphAngle::MIN,
        motion: Motion::default(),
        seed: 1,
    })
    .expect("the default plant is possible")
}

fn inputs() -> Inputs {
    let mut inputs = Inputs::default();
    let edge = |topic| Some(Edge::unwaited(topic, Role::Plant));
    inputs.attitude_owner.connect(Box::new(Silent), edge(&topics::ATTITUDE_OWNER.info));
    inputs.wrench_command.connect(Box::new(Silent), edge(&topics::WRENCH_COMMAND.info));
    inputs.trip.connect(Box::new(Silent), edge(&topics::TRIP.info));
    inputs
}

/// What the laws of the slot may ask of the default vehicle, and a tilt.
fn range() -> UnprovenRange {
    let believed = VehicleParameters::default();
    let weight_n = believed.weight_n();
    UnprovenRange { believed, thrust_n: [0.2 * weight_n, 2.1 * weight_n], tilt_rad: 1.0 }
}

fn announce(inputs: &mut Inputs, epoch: u64, from_ns: u64, owner: u32, fallback: u32, other: bool) {
    inputs.attitude_owner.offer(record(epoch, from_ns, owner, fallback, other));
}

fn record(epoch: u64, from_ns: u64, owner: u32, fallback: u32, other: bool) -> OwnerRecord {
    OwnerRecord {
        header: Header { sequence: epoch, valid_ns: from_ns, ..Header::default() },
        epoch,
        period_ns: [0, PERIOD_NS, PERIOD_NS, 0],
        owner,
        fallback,
        slot: Role::Attitude,
        kind_changed: Flag::from(other),
        watched: Flag::Yes,
        ..OwnerRecord::default()
    }
}

/// Commands of one writer, one per period, effective from `from_ns` until before `until_ns`.
fn send(inputs: &mut Inputs, seat: u32, from_ns: u64, until_ns: u64, validity_ns: u64) {
    let torque_nm = if seat == B { TORQUE_NM } else { 0.0 };
    let mut valid_ns = from_ns;
    while valid_ns < until_ns {
        // Numbered by period, so that a sequence gives its instant.
        let sequence = valid_ns / PERIOD_NS + 1;
        let header = Header { sequence, release_ns: valid_ns, valid_ns, seat, ..Header::default() };
        inputs.wrench_command.offer(WrenchCommand {
            header,
            thrust_n: VehicleParameters::default().weight_n(),
            torque_b_nm: [torque_nm, 0.0, 0.0],
            validity_ns,
        });
        valid_ns += PERIOD_NS;
    }
}

/// Steps from one millisecond to another, both included.
fn fly(plant: &mut Plant, inputs: &mut Inputs, from_ms: u64, until_ms: u64) -> Outputs {
    let mut outputs = Outputs::default();
    for t_ms in from_ms..=until_ms {
        inputs.accept(t_ms * MS, t_ms.checked_sub(1).map(|t| t * MS));
        plant.step(t_ms * MS, inputs, &mut outputs);
    }
    outputs
}

fn applied(outputs: &Outputs) -> AppliedCommand {
    *outputs.applied_command.written().expect("every step tells")
}

fn roll_rate(outputs: &Outputs) -> f64 {
    outputs.truth.written().expect("every step tells").body_rate_b_rad_s[0]
}

/// ω = τ / I · t, exact on the linear vehicle \[rad/s\].
fn rate_after(time_s: f64) -> f64 {
    TORQUE_NM / VehicleParameters::default().inertia_kg_m2(MorphAngle::MIN).x * time_s
}

#[test]
fn at_a_flip_within_a_tick_the_new_owner_commands_from_that_instant_on() {
    let (mut plant, mut inputs) = (plant(), inputs());
    announce(&mut inputs, 1, 0, A, NO_SEAT, false);
    announce(&mut inputs, 2, 20 * MS + 300_000, B, A, false);
    send(&mut inputs, A, 300_000, 60 * MS, 2 * PERIOD_NS);
    send(&mut inputs, B, 300_000, 60 * MS, 2 * PERIOD_NS);
    let before = fly(&mut plant, &mut inputs, 0, 20);
    assert_eq!((applied(&before).epoch, applied(&before).seat), (1, A));
    assert!(roll_rate(&before).abs() < 1e-15);
    let after = fly(&mut plant, &mut inputs, 21, 23);
    assert_eq!((applied(&after).epoch, applied(&after).seat), (2, B));
    assert!((roll_rate(&after) - rate_after(2.7e-3)).abs() < 1e-9);
}

#[test]
fn a_record_for_a_past_instant_is_refused_and_reported_and_a_later_one_counts() {
    let (mut plant, mut inputs) = (plant(), inputs());
    announce(&mut inputs, 1, 0, A, NO_SEAT, false);
    send(&mut inputs, A, 300_000, 60 * MS, 2 * PERIOD_NS);
    send(&mut inputs, B, 300_000, 60 * MS, 2 * PERIOD_NS);
    fly(&mut plant, &mut inputs, 0, 25);
    // Nothing happened between 24 ms and 25 ms; they have been flown all the same.
    announce(&mut inputs, 2, 24 * MS + 500_000, B, NO_SEAT, false);
    let late = applied(&fly(&mut plant, &mut inputs, 26, 29));
    assert_eq!((late.refused_epoch, late.refused_records, late.epoch, late.seat), (2, 1, 1, A));
    announce(&mut inputs, 3, 29 * MS, B, NO_SEAT, false);
    let next = applied(&fly(&mut plant, &mut inputs, 30, 31));
    assert_eq!((next.refused_epoch, next.refused_records, next.epoch, next.seat), (2, 1, 3, B));
}

#[test]
fn the_fallback_commands_two_periods_after_the_owners_last_until_the_next_epoch() {
    let (mut plant, mut inputs) = (plant(), inputs());
    announce(&mut inputs, 1, 0, A, B, false);
    send(&mut inputs, A, 300_000, 50 * MS, 2 * PERIOD_NS);
    // Its newest command is older than the owner's last one, and between the plant's ticks nothing
    // else happens when it begins to count.
    send(&mut inputs, B, 5 * MS, 40 * MS, 6 * PERIOD_NS);
    let before = fly(&mut plant, &mut inputs, 0, 60);
    assert_eq!((applied(&before).seat, applied(&before).fail_overs), (A, 0));
    let outputs = fly(&mut plant, &mut inputs, 61, 63);
    let after = applied(&outputs);
    assert_eq!((after.seat, after.fail_overs, after.epoch), (B, 1, 1));
    assert_eq!((after.failed_over, after.command_sequence), (Flag::Yes, 4));
    assert!((roll_rate(&outputs) - rate_after(2.7e-3)).abs() < 1e-9, "from 60.3 ms on");

    send(&mut inputs, A, 70 * MS, 140 * MS, 2 * PERIOD_NS);
    let latched = applied(&fly(&mut plant, &mut inputs, 64, 90));
    assert_eq!((latched.seat, latched.failed_over), (B, Flag::Yes));
    announce(&mut inputs, 2, 92 * MS, A, NO_SEAT, false);
    let back = applied(&fly(&mut plant, &mut inputs, 91, 130));
    assert_eq!((back.seat, back.failed_over, back.epoch), (A, Flag::No, 2));
    assert!(back.torque_b_nm[0].abs() < 1e-15);
    assert_eq!((back.mode, back.safe_mode_episodes), (GateMode::Normal, 0));
    assert_eq!(back.refused_out_of_range + back.refused_wrong_owner, 0);
}

#[test]
fn an_owner_whose_commands_are_garbage_is_silent() {
    let (mut plant, mut inputs) = (plant(), inputs());
    announce(&mut inputs, 1, 0, A, B, false);
    send(&mut inputs, B, 0, 90 * MS, 2 * PERIOD_NS);
    send(&mut inputs, A, 0, 30 * MS, 2 * PERIOD_NS);
    for k in 3..9 {
        inputs.wrench_command.offer(WrenchCommand {
            header: Header {
                sequence: k + 1,
                release_ns: k * PERIOD_NS,
                valid_ns: k * PERIOD_NS,
                seat: A,
                ..Header::default()
            },
            thrust_n: f64::NAN,
            validity_ns: 2 * PERIOD_NS,
            ..WrenchCommand::default()
        });
    }
    let before = applied(&fly(&mut plant, &mut inputs, 0, 40));
    assert_eq!((before.seat, before.fail_overs), (A, 0));
    let after = applied(&fly(&mut plant, &mut inputs, 41, 80));
    assert_eq!((after.seat, after.fail_overs, after.refused_not_finite), (B, 1, 5));
    assert_eq!((after.mode, after.safe_mode_episodes), (GateMode::Normal, 0));
}

#[test]
fn an_unproven_owners_commands_are_reduced_to_its_range_and_a_fallbacks_are_not() {
    let believed = VehicleParameters::default();
    let weight_n = believed.weight_n();
    let lawful_nm = believed.torque_bound_nm(MorphAngle::MIN, weight_n).x;
    let asked_nm = 1.5 * lawful_nm;
    // By seat, and whether the plant knows a range: the torque that is applied.
    let torque_nm = |seat: u32, unproven: Option<UnprovenRange>| {
        let (mut plant, mut inputs) = (plant_with(unproven), inputs());
        announce(&mut inputs, 1, 0, A, B, false);
        inputs.wrench_command.offer(WrenchCommand {
            header: Header { sequence: 1, seat, ..Header::default() },
            thrust_n: weight_n,
            torque_b_nm: [asked_nm, 0.0, 0.0],
            validity_ns: 2 * PERIOD_NS,
        });
        let applied = applied(&fly(&mut plant, &mut inputs, 0, 1));
        (applied.torque_b_nm[0] / lawful_nm, applied.reduced)
    };
    let (reduced, count) = torque_nm(A, Some(range()));
    assert!((reduced - 1.05).abs() < 1e-3 && count == 1, "{reduced} {count}");
    for (seat, unproven) in [(A, None), (B, Some(range()))] {
        let (kept, count) = torque_nm(seat, unproven);
        assert!((kept - 1.5).abs() < 1e-9 && count == 0, "{kept} {count}");
    }
}

#[test]
fn the_gate_levels_before_an_unproven_owner_overturns_the_vehicle() {
    for (unproven, watched, levels) in
        [(Some(range()), true, true), (Some(range()), false, false), (None, true, false)]
    {
        let (mut plant, mut inputs) = (plant_with(unproven), inputs());
        let record = OwnerRecord { watched: Flag::from(watched), ..record(1, 0, B, A, false) };
        inputs.attitude_owner.offer(record);
        send(&mut inputs, B, 0, 150 * MS, 2 * PERIOD_NS);
        let first = (0..150).find_map(|t_ms| {
            let now = applied(&fly(&mut plant, &mut inputs, t_ms, t_ms));
            (now.mode == GateMode::Recover).then_some((t_ms, now))
        });
        assert_eq!(first.is_some(), levels, "{watched}");
        if let Some((t_ms, now)) = first {
            assert!(!now.tripped.is_set() && now.torque_b_nm[0] < 0.0, "{now:?}");
            // 200 rad/s² make 57° in 100 ms; braked with 559 rad/s² they must be stopped well before.
            assert!((40..95).contains(&t_ms), "{t_ms}");
        }
    }
}

#[test]
fn the_gate_brakes_a_vehicle_whose_position_owner_trips_beside_an_unproven_owner() {
    // Whether the attitude owner is watched, and how fast the vehicle leaves its place.
    for (watched, leaving_m_s, brakes) in
        [(true, 0.8, true), (false, 0.8, false), (true, 0.0, false)]
    {
        let (mut plant, mut inputs) = (plant_with(Some(range())), inputs());
        let edge = |topic| Some(Edge::unwaited(topic, Role::Plant));
        inputs.state_estimate.connect(Box::new(Silent), edge(&topics::STATE_ESTIMATE.info));
        inputs.reference.connect(Box::new(Silent), edge(&topics::REFERENCE.info));
        let record = OwnerRecord { watched: Flag::from(watched), ..record(1, 0, A, B, false) };
        inputs.attitude_owner.offer(record);
        send(&mut inputs, A, 0, 600 * MS, 2 * PERIOD_NS);
        let header = Header { sequence: 1, valid_ns: 20 * MS, ..Header::default() };
        let mut reference = Reference { header, count: 1, ..Reference::default() };
        reference.points[0].position_w_m = [0.0, 0.0, 1.5];
        inputs.reference.offer(reference);
        inputs.state_estimate.offer(StateEstimate {
            header,
            described_ns: 20 * MS,
            position_w_m: [0.2, 0.0, 1.5],
            velocity_w_m_s: [leaving_m_s, 0.0, 0.0],
            q_wb: Quaternion::IDENTITY,
            ..StateEstimate::default()
        });
        let header = Header { sequence: 1, valid_ns: 30 * MS, ..Header::default() };
        inputs.trip.offer(Trip { header, epoch: 1, slot: Role::Position, ..Trip::default() });
        let braked = applied(&fly(&mut plant, &mut inputs, 0, 35));
        assert_eq!(braked.mode == GateMode::Recover, brakes, "{braked:?}");
        assert_eq!(braked.torque_b_nm[1] < 0.0, brakes, "it leans to where it comes from");
        let later = applied(&fly(&mut plant, &mut inputs, 36, 500));
        assert_eq!((later.mode, later.command_seat), (GateMode::Normal, A));
    }
}

/// Torque about x over the tick that ends at each of these milliseconds, with a flip at 20 ms.
fn torques_after_a_flip(kind_changed: bool, at_ms: [u64; 3]) -> [f64; 3] {
    let (mut plant, mut inputs) = (plant(), inputs());
    announce(&mut inputs, 1, 0, A, NO_SEAT, false);
    announce(&mut inputs, 2, 20 * MS, B, A, kind_changed);
    send(&mut inputs, A, 0, 130 * MS, 2 * PERIOD_NS);
    send(&mut inputs, B, 0, 130 * MS, 2 * PERIOD_NS);
    let mut from_ms = 0;
    at_ms.map(|until_ms| {
        let outputs = fly(&mut plant, &mut inputs, from_ms, until_ms);
        from_ms = until_ms + 1;
        applied(&outputs).torque_b_nm[0]
    })
}

#[test]
fn the_limiter_acts_only_on_a_change_of_kind_and_lets_go_over_a_tenth_of_a_second() {
    let at_ms = [21, 71, 121];
    for torque_nm in torques_after_a_flip(false, at_ms) {
        assert_eq!(torque_nm.to_bits(), TORQUE_NM.to_bits());
    }
    let vehicle = VehicleParameters::default();
    // Half of the weight on one arm.
    let most_nm = 0.5 * vehicle.weight_n() * vehicle.geometry.arm_length_m(MorphAngle::MIN);
    let limit_nm = 0.1 * most_nm;
    assert!(limit_nm < 0.5 * TORQUE_NM, "{limit_nm}");
    let [at_once, halfway, after] = torques_after_a_flip(true, at_ms);
    assert!((at_once - limit_nm).abs() < 1e-6, "{at_once} {limit_nm}");
    assert!((halfway - 0.5 * (limit_nm + TORQUE_NM)).abs() < 1e-6, "{halfway}");
    assert_eq!(after.to_bits(), TORQUE_NM.to_bits());
}

/// A flip of kind at 40.3 ms; the new owner is silent from 60 ms to 101 ms and owns again from 120.7 ms.
fn eventful() -> Inputs {
    let mut inputs = inputs();
    announce(&mut inputs, 1, 0, A, NO_SEAT, false);
    announce(&mut inputs, 2, 40 * MS + 300_000, B, A, true);
    announce(&mut inputs, 3, 120 * MS + 700_000, B, NO_SEAT, true);
    send(&mut inputs, A, 300_000, 170 * MS, 2 * PERIOD_NS);
    send(&mut inputs, B, 300_000, 61 * MS, 2 * PERIOD_NS);
    send(&mut inputs, B, 101 * MS, 170 * MS, 2 * PERIOD_NS);
    inputs
}

#[test]
fn a_plant_restored_amid_flips_and_fail_over_continues_bit_for_bit() {
    let mut ends = Vec::new();
    for restored_ms in [39, 40, 47, 79, 82, 121, 130] {
        let (mut first, mut first_inputs) = (plant(), eventful());
        fly(&mut first, &mut first_inputs, 0, restored_ms);
        let mut second = plant();
        second.restore(&first.memory()).expect("the same plant");
        // The successor has the latches of the first, and what is pending comes again.
        let mut second_inputs = eventful();
        second_inputs.accept(restored_ms * MS, None);
        let first = fly(&mut first, &mut first_inputs, restored_ms + 1, 165);
        let second = fly(&mut second, &mut second_inputs, restored_ms + 1, 165);
        let shown =
            |o: &Outputs| format!("{:?} {:?}", o.truth.written(), o.applied_command.written());
        assert_eq!(shown(&first), shown(&second), "{restored_ms} ms");
        assert_eq!((applied(&first).fail_overs, applied(&first).epoch), (1, 3));
        ends.push(shown(&first));
    }
    assert!(ends.windows(2).all(|pair| pair[0] == pair[1]));
}

/// The owner of an epoch trips.
fn trip(inputs: &mut Inputs, epoch: u64, instance: u32, at_ns: u64) {
    inputs.trip.offer(Trip {
        header: Header { sequence: epoch, valid_ns: at_ns, ..Header::default() },
        epoch,
        slot: Role::Attitude,
        instance,
        ..Trip::default()
    });
}

#[test]
fn a_trip_within_a_tick_gives_the_slot_to_the_fallback_from_that_instant_on() {
    let (mut plant, mut inputs) = (plant(), inputs());
    announce(&mut inputs, 1, 0, A, B, false);
    send(&mut inputs, A, 300_000, 60 * MS, 2 * PERIOD_NS);
    send(&mut inputs, B, 300_000, 60 * MS, 2 * PERIOD_NS);
    trip(&mut inputs, 1, A, 20 * MS + 300_000);
    let before = applied(&fly(&mut plant, &mut inputs, 0, 20));
    assert_eq!((before.seat, before.tripped.is_set()), (A, false));
    let after = fly(&mut plant, &mut inputs, 21, 23);
    let command = applied(&after);
    assert_eq!((command.epoch, command.seat, command.mode), (1, B, GateMode::Normal));
    assert!(command.tripped.is_set() && command.failed_over.is_set());
    assert!((roll_rate(&after) - rate_after(2.7e-3)).abs() < 1e-9);
}

#[test]
fn a_trip_in_a_fast_turn_is_answered_by_the_gate_and_then_by_the_fallback() {
    let (mut plant, mut inputs) = (plant(), inputs());
    // B turns the vehicle; A holds still and stands by.
    announce(&mut inputs, 1, 0, B, A, false);
    send(&mut inputs, A, 0, 400 * MS, 2 * PERIOD_NS);
    send(&mut inputs, B, 0, 400 * MS, 2 * PERIOD_NS);
    trip(&mut inputs, 1, B, 40 * MS);
    let turning = fly(&mut plant, &mut inputs, 0, 40);
    assert!(roll_rate(&turning) > 4.0, "{}", roll_rate(&turning));
    let recovering = applied(&fly(&mut plant, &mut inputs, 41, 60));
    assert_eq!((recovering.mode, recovering.seat), (GateMode::Recover, A));
    assert!(recovering.torque_b_nm[0] < 0.0);
    let mut calm = fly(&mut plant, &mut inputs, 61, 61);
    for t_ms in 62..400 {
        calm = fly(&mut plant, &mut inputs, t_ms, t_ms);
        if applied(&calm).mode == GateMode::Normal {
            break;
        }
    }
    assert_eq!((applied(&calm).mode, applied(&calm).command_seat), (GateMode::Normal, A));
    let GateConfig { recovered_rate_rad_s, .. } = GateConfig::default();
    assert!(roll_rate(&calm).abs() < recovered_rate_rad_s + 0.1, "{}", roll_rate(&calm));
}

#[test]
fn without_a_fallback_the_gate_levels_and_gives_the_slot_back_to_the_owner_at_last() {
    // Tripped as it turns fast, and before it has turned much.
    for (trip_ms, first) in [(40, GateMode::Recover), (10, GateMode::Level)] {
        let (mut plant, mut inputs) = (plant(), inputs());
        announce(&mut inputs, 1, 0, B, NO_SEAT, false);
        send(&mut inputs, B, 0, 1700 * MS, 2 * PERIOD_NS);
        trip(&mut inputs, 1, B, trip_ms * MS);
        fly(&mut plant, &mut inputs, 0, trip_ms);
        let levels = applied(&fly(&mut plant, &mut inputs, trip_ms + 1, trip_ms + 3));
        assert_eq!((levels.mode, levels.seat), (first, B));
        assert!(levels.tripped.is_set() && !levels.failed_over.is_set());
        assert!(levels.torque_b_nm[0] < 0.0, "it turns back");
        for t_ms in trip_ms + 4..=trip_ms + 1500 {
            let mode = applied(&fly(&mut plant, &mut inputs, t_ms, t_ms)).mode;
            assert!(matches!(mode, GateMode::Recover | GateMode::Level), "{mode:?} at {t_ms} ms");
        }
        let now = applied(&fly(&mut plant, &mut inputs, trip_ms + 1501, trip_ms + 1510));
        assert_eq!((now.mode, now.command_seat), (GateMode::Normal, B), "better than none");
    }
}
