use super::*;
use runtime::InputSet as _;
use shared_types::Flag;

fn monitor() -> Monitor {
    let config = MonitorConfig {
        limits: Limits::default(),
        period_s: 0.01,
        latency_s: 0.001,
        landing: Landing::default(),
        keeps_to_rotors: true,
    };
    Monitor::new(&config, &VehicleParameters::default())
}

#[test]
fn a_watched_owner_that_the_gate_keeps_from_overturning_the_vehicle_trips() {
    let trip = |mode: GateMode, tripped: bool| {
        let mut inputs = Inputs::default();
        let watched = Flag::from(true);
        inputs.attitude_owner.offer(OwnerRecord { epoch: 1, watched, ..Default::default() });
        inputs.attitude_owner.accept(0, None);
        inputs.position_owner.offer(OwnerRecord { epoch: 1, ..Default::default() });
        inputs.position_owner.accept(0, None);
        inputs.applied_command.offer(AppliedCommand {
            header: Header { sequence: 1, ..Header::default() },
            epoch: 1,
            mode,
            tripped: Flag::from(tripped),
            ..AppliedCommand::default()
        });
        inputs.applied_command.accept(0, None);
        let mut outputs = Outputs::default();
        monitor().step(0, &inputs, &mut outputs);
        outputs.trip.written().map(|trip| (trip.slot, trip.cause, trip.angle_limit_rad))
    };
    let limit_rad = Limits::default().tilt_rad;
    let overturns = (Role::Attitude, TripCause::Overturns, limit_rad);
    assert_eq!(trip(GateMode::Recover, false), Some(overturns), "without any estimate");
    assert_eq!(trip(GateMode::Recover, true), None, "the gate answers a trip");
    assert_eq!(trip(GateMode::Normal, false), None);
}

#[test]
fn an_owner_that_a_later_record_names_again_trips_again_at_once() {
    let mut monitor = monitor();
    let mut inputs = Inputs::default();
    inputs.position_owner.offer(OwnerRecord { epoch: 1, ..Default::default() });
    inputs.position_owner.accept(0, None);
    let name = |inputs: &mut Inputs, epoch: u64, hands: [u32; 2], at_ns: u64| {
        let header = Header { sequence: epoch, valid_ns: at_ns, ..Header::default() };
        let ([owner, fallback], watched, period_ns) = (hands, Flag::Yes, [10; 4]);
        let record = OwnerRecord {
            header,
            epoch,
            owner,
            fallback,
            watched,
            period_ns,
            ..Default::default()
        };
        inputs.attitude_owner.offer(record);
        inputs.attitude_owner.accept(at_ns, at_ns.checked_sub(1));
    };
    let mut step = |inputs: &Inputs, now_ns: u64| {
        let mut outputs = Outputs::default();
        monitor.step(now_ns, inputs, &mut outputs);
        outputs.trip.written().map(|trip| (trip.epoch, trip.instance, trip.cause))
    };
    let overturns = |epoch: u64| Some((epoch, 2, TripCause::Overturns));
    for (epoch, hands, trip) in [
        (1, [2, 0], overturns(1)),
        // The trip holds by this record too.
        (2, [2, 0], None),
        // The fallback has died, and this was written before the trip was known.
        (3, [2, NO_SEAT], overturns(3)),
        (4, [2, NO_SEAT], overturns(4)),
        (5, [1, NO_SEAT], None),
        // It has been another one's meanwhile.
        (6, [2, NO_SEAT], None),
    ] {
        let at_ns = 20 * (epoch - 1);
        name(&mut inputs, epoch, hands, at_ns);
        inputs.applied_command.offer(AppliedCommand {
            header: Header { sequence: epoch, valid_ns: at_ns, ..Header::default() },
            epoch,
            mode: if epoch == 1 { GateMode::Recover } else { GateMode::Normal },
            ..AppliedCommand::default()
        });
        inputs.applied_command.accept(at_ns, at_ns.checked_sub(1));
        assert_eq!(step(&inputs, at_ns), trip, "epoch {epoch}");
        assert_eq!(step(&inputs, at_ns + 10), None, "once in an epoch");
    }
}

#[test]
fn a_report_of_an_epoch_that_is_over_replaces_no_owner_of_the_next() {
    let hands = |of_epoch: u64| {
        let mut inputs = Inputs::default();
        let watched = Flag::from(true);
        inputs.attitude_owner.offer(OwnerRecord { epoch: 2, watched, ..Default::default() });
        inputs.attitude_owner.accept(0, None);
        let failed_over = Flag::from(true);
        inputs.applied_command.offer(AppliedCommand {
            header: Header { sequence: 1, ..Header::default() },
            epoch: of_epoch,
            failed_over,
            ..AppliedCommand::default()
        });
        inputs.applied_command.accept(0, None);
        monitor().hands(0, &inputs)
    };
    assert!(matches!(hands(1), [Hands::Watched(Watched { epoch: 2, .. }), Hands::Proven]));
    assert!(matches!(hands(2), [Hands::Replaced, Hands::Proven]));
}

#[test]
fn it_is_quiet_until_the_first_watched_record_that_it_knows_of() {
    let record = |epoch: u64, at_ns: u64, watched: bool| OwnerRecord {
        header: Header { sequence: epoch, valid_ns: at_ns, ..Header::default() },
        epoch,
        watched: Flag::from(watched),
        ..Default::default()
    };
    let mut inputs = Inputs::default();
    let quiet_until_ns = |inputs: &Inputs, from_ns| monitor().quiet_until_ns(from_ns, 90, inputs);
    assert_eq!(quiet_until_ns(&inputs, 10), 90, "as far as all records are known");
    for (epoch, at_ns, watched) in [(1, 0, false), (2, 60, true), (3, 80, false)] {
        inputs.position_owner.offer(record(epoch, at_ns, watched));
    }
    inputs.position_owner.accept(0, None);
    assert_eq!(quiet_until_ns(&inputs, 10), 60);
    inputs.attitude_owner.offer(record(1, 40, true));
    assert_eq!(quiet_until_ns(&inputs, 10), 40, "by the slot that is watched first");
    inputs.attitude_owner.accept(40, Some(0));
    assert_eq!(quiet_until_ns(&inputs, 50), 50, "not while an owner is watched");
    inputs.attitude_owner.offer(record(2, 55, false));
    inputs.attitude_owner.accept(55, Some(40));
    assert_eq!(quiet_until_ns(&inputs, 56), 60);
    inputs.position_owner.accept(80, Some(55));
    assert_eq!(quiet_until_ns(&inputs, 81), 90);
    assert_eq!(quiet_until_ns(&inputs, 95), 95, "what is not known promises nothing");
}

/// What a watched attitude owner trips for while the vehicle leaves its hover at 2 m/s, seen for 600 ms, of which the
/// position slot's owner, which has proven itself, asks for level flight until `asked_until_ns`.
fn blamed_for_a_vehicle_that_leaves(
    mut monitor: Monitor,
    period_ns: u64,
    asked_until_ns: u64,
) -> Option<TripCause> {
    const MS: u64 = 1_000_000;
    let (mut inputs, mut found) = (Inputs::default(), None);
    let owner = |watched: bool| OwnerRecord {
        epoch: 1,
        fallback: NO_SEAT,
        watched: Flag::from(watched),
        period_ns: [20 * MS; 4],
        ..Default::default()
    };
    inputs.attitude_owner.offer(owner(true));
    inputs.position_owner.offer(owner(false));
    let mut at_ns = 0;
    while at_ns < 600 * MS {
        let header = Header {
            sequence: 1 + at_ns / period_ns,
            release_ns: at_ns,
            valid_ns: at_ns,
            ..Header::default()
        };
        let away_m = if at_ns < 200 * MS { 0.0 } else { 2e-9 * (at_ns - 200 * MS) as f64 };
        inputs.state_estimate.offer(StateEstimate {
            header,
            described_ns: at_ns,
            q_wb: shared_types::Quaternion::IDENTITY,
            position_w_m: [away_m, 0.0, 1.5],
            velocity_w_m_s: [if away_m > 0.0 { 2.0 } else { 0.0 }, 0.0, 0.0],
            morph_angle_rad: MorphAngle::MAX.rad(),
            ..StateEstimate::default()
        });
        let mut reference = Reference { header, count: 1, ..Reference::default() };
        reference.points[0].position_w_m = [0.0, 0.0, 1.5];
        inputs.reference.offer(reference);
        if at_ns <= asked_until_ns {
            let thrust_n = VehicleParameters::default().weight_n();
            inputs.attitude_setpoint.offer(AttitudeSetpoint {
                header,
                thrust_n,
                ..AttitudeSetpoint::default()
            });
        }
        let previous_ns = at_ns.checked_sub(period_ns);
        inputs.accept(at_ns, previous_ns);
        let mut outputs = Outputs::default();
        monitor.step(at_ns, &inputs, &mut outputs);
        found = found.or(outputs.trip.written().map(|trip| trip.cause));
        at_ns += period_ns;
    }
    found
}

#[test]
fn where_a_vehicle_goes_that_nothing_steers_is_no_attitude_owners_doing() {
    let blamed = |asked_until_ns: u64| {
        blamed_for_a_vehicle_that_leaves(monitor(), 10_000_000, asked_until_ns)
    };
    assert_eq!(blamed(u64::MAX), Some(TripCause::PositionDeparts), "it is asked to stay");
    assert_eq!(blamed(60_000_000), None);
}

#[test]
fn a_slow_monitor_sees_where_the_vehicle_goes() {
    let config = MonitorConfig {
        limits: Limits::default(),
        period_s: 0.2,
        latency_s: 0.001,
        landing: Landing::default(),
        keeps_to_rotors: true,
    };
    let slow = Monitor::new(&config, &VehicleParameters::default());
    let cause = blamed_for_a_vehicle_that_leaves(slow, 200_000_000, u64::MAX);
    assert_eq!(cause, Some(TripCause::PositionDeparts));
}
