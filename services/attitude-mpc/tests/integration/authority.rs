//! Which set points the attitude loop tracks: flips, records that come too late, fail-over, the
//! limiter, and continuing from a memory amid them.

use attitude_mpc::{AttitudeLawConfig, AttitudeMpc};
use controller::attitude::{Inputs, Outputs};
use runtime::graph::Edge;
use runtime::{InputSet as _, Service as _, Source};
use shared_types::{
    AppliedSetpoint, AttitudeSetpoint, Flag, Header, NO_SEAT, OwnerRecord, Role, StateEstimate,
    Trip, topics,
};
use vehicle::VehicleParameters;

const MS: u64 = 1_000_000;
/// Of the attitude loop and of both writers of set points.
const STEP_MS: u64 = 10;
const PERIOD_NS: u64 = 20 * MS;
const A: u32 = 0;
const B: u32 = 1;
/// Roll that B asks for; A asks for none \[rad\].
const ROLL_RAD: f64 = 0.2;

struct Silent;

impl<T> Source<T> for Silent {
    fn receive(&mut self) -> Option<T> {
        None
    }
}

fn controller() -> AttitudeMpc {
    let vehicle = VehicleParameters::default();
    AttitudeMpc::new(AttitudeLawConfig::flight(100.0), &vehicle, 0.0).expect("the default flies")
}

fn inputs() -> Inputs {
    let mut inputs = Inputs::default();
    let edge = |topic| Some(Edge::unwaited(topic, Role::Attitude));
    inputs.position_owner.connect(Box::new(Silent), edge(&topics::POSITION_OWNER.info));
    inputs.attitude_setpoint.connect(Box::new(Silent), edge(&topics::ATTITUDE_SETPOINT.info));
    inputs.state_estimate.connect(Box::new(Silent), edge(&topics::STATE_ESTIMATE.info));
    inputs.trip.connect(Box::new(Silent), edge(&topics::TRIP.info));
    inputs
}

fn announce(inputs: &mut Inputs, epoch: u64, from_ms: u64, owner: u32, fallback: u32, other: bool) {
    inputs.position_owner.offer(OwnerRecord {
        header: Header { sequence: epoch, valid_ns: from_ms * MS, ..Header::default() },
        epoch,
        period_ns: [PERIOD_NS, PERIOD_NS, 0, 0],
        owner,
        fallback,
        slot: Role::Position,
        kind_changed: Flag::from(other),
        watched: Flag::Yes,
        ..OwnerRecord::default()
    });
}

/// Set points of one writer, one per period, effective from `from_ms` until before `until_ms`.
fn send(inputs: &mut Inputs, seat: u32, from_ms: u64, until_ms: u64) {
    let step_ms = usize::try_from(PERIOD_NS / MS).expect("small");
    for ms in (from_ms..until_ms).step_by(step_ms) {
        inputs.attitude_setpoint.offer(AttitudeSetpoint {
            header: Header {
                sequence: ms + 1,
                release_ns: ms * MS,
                valid_ns: ms * MS,
                seat,
                ..Header::default()
            },
            thrust_n: VehicleParameters::default().weight_n(),
            roll_rad: if seat == B { ROLL_RAD } else { 0.0 },
            pitch_rad: 0.0,
            yaw_rad: if seat == B { 3.0 } else { -3.0 },
        });
    }
}

/// Steps from one instant to another, both included; what the last one tracks.
fn fly(loop_: &mut AttitudeMpc, inputs: &mut Inputs, from_ms: u64, until_ms: u64) -> Outputs {
    let mut outputs = Outputs::default();
    for ms in (from_ms..=until_ms).step_by(usize::try_from(STEP_MS).expect("small")) {
        inputs.state_estimate.offer(StateEstimate {
            header: Header { sequence: ms + 1, valid_ns: ms * MS, ..Header::default() },
            described_ns: ms * MS,
            q_wb: shared_types::Quaternion::IDENTITY,
            morph_angle_rad: 1.5,
            ..StateEstimate::default()
        });
        inputs.accept(ms * MS, ms.checked_sub(STEP_MS).map(|before| before * MS));
        loop_.step(ms * MS, inputs, &mut outputs);
    }
    outputs
}

fn applied(outputs: &Outputs) -> AppliedSetpoint {
    *outputs.applied_setpoint.written().expect("every step tells")
}

fn assert_roll(applied: &AppliedSetpoint, roll_rad: f64) {
    assert!((applied.roll_rad - roll_rad).abs() < 1e-12, "{applied:?}");
}

#[test]
fn a_flip_counts_from_its_instant_on_and_a_late_one_is_refused_and_reported() {
    let (mut attitude, mut inputs) = (controller(), inputs());
    let unowned = applied(&fly(&mut attitude, &mut inputs, 0, 0));
    assert_eq!((unowned.epoch, unowned.seat), (0, NO_SEAT));
    announce(&mut inputs, 1, 1, A, NO_SEAT, false);
    announce(&mut inputs, 2, 45, B, A, false);
    send(&mut inputs, A, 5, 200);
    send(&mut inputs, B, 5, 200);
    let before = applied(&fly(&mut attitude, &mut inputs, 10, 40));
    assert_eq!((before.epoch, before.seat, before.setpoint_sequence), (1, A, 26));
    assert_roll(&before, 0.0);
    let after = applied(&fly(&mut attitude, &mut inputs, 50, 60));
    assert_eq!((after.epoch, after.seat, after.setpoint_sequence), (2, B, 46));
    assert_roll(&after, ROLL_RAD);
    announce(&mut inputs, 3, 60, A, NO_SEAT, false);
    let late = applied(&fly(&mut attitude, &mut inputs, 70, 70));
    assert_eq!((late.epoch, late.seat, late.refused_epoch), (2, B, 3));
    announce(&mut inputs, 4, 71, A, NO_SEAT, false);
    let next = applied(&fly(&mut attitude, &mut inputs, 80, 90));
    assert_eq!((next.epoch, next.seat, next.refused_epoch), (4, A, 3));
}

#[test]
fn a_consumer_that_joins_late_and_gets_the_fallback_first_does_not_fail_over() {
    let (mut attitude, mut inputs) = (controller(), inputs());
    announce(&mut inputs, 1, 0, A, B, false);
    send(&mut inputs, B, 45, 200);
    send(&mut inputs, A, 65, 200);
    // Its history holds only the fallback's set point of 45 ms.
    inputs.accept(45 * MS, None);
    let first = applied(&fly(&mut attitude, &mut inputs, 50, 60));
    assert_eq!((first.seat, first.failed_over, first.setpoint_sequence), (A, Flag::No, 46));
    let next = applied(&fly(&mut attitude, &mut inputs, 70, 70));
    assert_eq!((next.seat, next.failed_over, next.setpoint_sequence), (A, Flag::No, 66));
    assert_roll(&next, 0.0);
}

#[test]
fn the_fallbacks_set_points_count_two_periods_after_the_owners_last_one() {
    let (mut attitude, mut inputs) = (controller(), inputs());
    announce(&mut inputs, 1, 0, A, B, false);
    send(&mut inputs, A, 0, 70);
    send(&mut inputs, B, 0, 130);
    // A's last set point is of 60 ms.
    let before = applied(&fly(&mut attitude, &mut inputs, 0, 90));
    assert_eq!((before.seat, before.failed_over), (A, Flag::No));
    let after = applied(&fly(&mut attitude, &mut inputs, 100, 100));
    assert_eq!((after.seat, after.failed_over, after.epoch), (B, Flag::Yes, 1));
    assert_roll(&after, ROLL_RAD);
    send(&mut inputs, A, 110, 200);
    let held = applied(&fly(&mut attitude, &mut inputs, 110, 190));
    assert_eq!((held.seat, held.setpoint_sequence), (B, 121), "its last one, long after its end");
    assert_roll(&held, ROLL_RAD);
    announce(&mut inputs, 2, 191, A, NO_SEAT, false);
    let back = applied(&fly(&mut attitude, &mut inputs, 200, 200));
    assert_eq!((back.seat, back.failed_over, back.setpoint_sequence), (A, Flag::No, 191));
}

#[test]
fn after_a_trip_without_a_fallback_the_owner_is_not_followed_again() {
    let (mut attitude, mut inputs) = (controller(), inputs());
    announce(&mut inputs, 1, 0, B, NO_SEAT, false);
    send(&mut inputs, B, 0, 1600);
    inputs.trip.offer(Trip {
        header: Header { sequence: 1, valid_ns: 100 * MS, ..Header::default() },
        epoch: 1,
        slot: Role::Position,
        instance: B,
        ..Trip::default()
    });
    let before = applied(&fly(&mut attitude, &mut inputs, 0, 90));
    assert_roll(&before, ROLL_RAD);
    // Without a reference, level.
    for (from_ms, until_ms) in [(100, 100), (110, 1590), (1600, 1600)] {
        let level = applied(&fly(&mut attitude, &mut inputs, from_ms, until_ms));
        assert_eq!((level.setpoint_sequence, level.seat, level.tripped), (0, B, Flag::Yes));
        assert_roll(&level, 0.0);
        let weight_n = VehicleParameters::default().weight_n();
        let off = [level.thrust_n - weight_n, level.yaw_rad - 3.0].map(f64::abs);
        assert!(off.iter().all(|off| *off < 1e-12), "{level:?}");
    }
}

#[test]
fn only_a_change_of_kind_is_limited_and_the_heading_never_is() {
    for (other, share) in [(false, 1.0), (true, 0.035 / ROLL_RAD)] {
        let (mut attitude, mut inputs) = (controller(), inputs());
        announce(&mut inputs, 1, 0, A, NO_SEAT, false);
        announce(&mut inputs, 2, 40, B, A, other);
        send(&mut inputs, A, 0, 200);
        send(&mut inputs, B, 0, 200);
        let at_once = applied(&fly(&mut attitude, &mut inputs, 0, 40));
        assert_roll(&at_once, share * ROLL_RAD);
        assert_eq!(at_once.yaw_rad.to_bits(), 3.0_f64.to_bits());
        let halfway = applied(&fly(&mut attitude, &mut inputs, 50, 90));
        assert_roll(&halfway, 0.5 * (1.0 + share) * ROLL_RAD);
        let after = applied(&fly(&mut attitude, &mut inputs, 100, 140));
        assert_eq!(after.roll_rad.to_bits(), ROLL_RAD.to_bits());
    }
}

#[test]
fn a_loop_restored_amid_flips_and_fail_over_continues_bit_for_bit() {
    let eventful = || {
        let mut inputs = inputs();
        announce(&mut inputs, 1, 0, A, NO_SEAT, false);
        announce(&mut inputs, 2, 45, B, A, true);
        announce(&mut inputs, 3, 175, B, NO_SEAT, true);
        send(&mut inputs, A, 5, 300);
        send(&mut inputs, B, 5, 80);
        send(&mut inputs, B, 155, 300);
        inputs
    };
    for restored_ms in [40, 50, 70, 110, 120, 170, 180, 200] {
        let (mut first, mut first_inputs) = (controller(), eventful());
        fly(&mut first, &mut first_inputs, 0, restored_ms);
        let (mut second, mut second_inputs) = (controller(), eventful());
        second.restore(&first.memory()).expect("the same controller");
        second_inputs.accept(restored_ms * MS, None);
        let first = fly(&mut first, &mut first_inputs, restored_ms + STEP_MS, 260);
        let second = fly(&mut second, &mut second_inputs, restored_ms + STEP_MS, 260);
        let shown = |o: &Outputs| {
            format!("{:?} {:?}", o.wrench_command.written(), o.applied_setpoint.written())
        };
        assert_eq!(shown(&first), shown(&second), "{restored_ms} ms");
        assert_eq!((applied(&first).epoch, applied(&first).seat), (3, B));
    }
}
