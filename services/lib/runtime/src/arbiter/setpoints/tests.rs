use super::*;
use shared_types::Header;

const MS: u64 = 1_000_000;

fn report(valid_ns: u64, seat: u32) -> AppliedSetpoint {
    let header = Header { sequence: valid_ns + 1, valid_ns, seat, ..Header::default() };
    AppliedSetpoint { header, ..AppliedSetpoint::default() }
}

fn in_command(samples: &[(u64, u32)], plant: Option<&AppliedCommand>) -> Option<(u64, u32)> {
    let (mut records, mut setpoints) = (Input::default(), Input::default());
    for (epoch, valid_ns, owner, fallback) in [(1, 0, 0, 1), (2, 50, 2, 0)] {
        records.offer(OwnerRecord {
            header: Header { sequence: epoch, valid_ns, ..Header::default() },
            epoch,
            owner,
            fallback,
            period_ns: [10; 4],
            ..OwnerRecord::default()
        });
    }
    for &(valid_ns, seat) in samples {
        setpoints.offer(report(valid_ns, seat));
    }
    records.accept(100, None);
    setpoints.accept(100, None);
    setpoints.in_command(&records, plant).map(|s| (s.header.valid_ns, s.header.seat))
}

#[test]
fn the_owners_command_counts_and_the_fallbacks_only_without_it() {
    assert_eq!(in_command(&[(10, 0), (20, 0), (20, 1), (30, 3)], None), Some((20, 0)));
    assert_eq!(in_command(&[(10, 1), (20, 1), (20, 3)], None), Some((20, 1)));
    assert_eq!(in_command(&[(10, 0), (60, 2), (70, 0)], None), Some((60, 2)));
    assert_eq!(in_command(&[(10, 3), (60, 1)], None), None);
}

#[test]
fn an_owner_that_the_plant_does_not_follow_any_more_is_not_believed() {
    let plant = |epoch: u64, failed_over: bool| AppliedCommand {
        epoch,
        failed_over: Flag::from(failed_over),
        ..AppliedCommand::default()
    };
    let tripped = AppliedCommand { tripped: Flag::Yes, ..plant(2, false) };
    let followed = AppliedCommand { command_sequence: 7, ..tripped };
    let both = [(60, 2), (60, 0)];
    assert_eq!(in_command(&both, Some(&plant(2, false))), Some((60, 2)));
    assert_eq!(in_command(&both, Some(&plant(2, true))), Some((60, 0)));
    assert_eq!(in_command(&both[..1], Some(&plant(2, true))), None);
    assert_eq!(in_command(&both, Some(&plant(1, true))), Some((60, 2)), "of an epoch that is over");
    assert_eq!(in_command(&both, Some(&tripped)), Some((60, 0)));
    assert_eq!(in_command(&both[..1], Some(&tripped)), None, "also without a fallback");
    assert_eq!(in_command(&both[..1], Some(&followed)), Some((60, 2)), "followed again");
}

#[test]
fn a_set_point_that_is_not_finite_is_its_writers_silence() {
    let (mut records, mut setpoints) = (Input::default(), Input::default());
    records.offer(OwnerRecord { epoch: 1, period_ns: [10, 0, 0, 0], ..OwnerRecord::default() });
    records.accept(0, None);
    let mut slot = SetpointSlot::new(1.0, 9.81);
    let mut take = |now_ns: u64, roll_rad: Option<f64>| {
        if let Some(roll_rad) = roll_rad {
            let header = Header { sequence: now_ns + 1, valid_ns: now_ns, ..Header::default() };
            setpoints.offer(AttitudeSetpoint { header, roll_rad, ..Default::default() });
        }
        setpoints.accept(now_ns, None);
        slot.take(
            now_ns,
            &records,
            &setpoints,
            &Input::default(),
            (&Input::default(), &Input::default()),
        )
        .map(|command| command.sequence)
    };
    assert_eq!(take(5, Some(0.1)), Some(6));
    assert_eq!(take(15, Some(f64::NAN)), Some(6), "two periods are not over");
    assert_eq!(take(25, None), None);
    assert_eq!(take(30, Some(0.1)), Some(31));
    assert_eq!(slot.refused(), 1);
}

#[test]
fn the_last_set_point_fades_when_its_end_is_two_periods_past() {
    let (mut records, mut setpoints) = (Input::default(), Input::default());
    let (mut estimates, mut references) = (Input::default(), Input::default());
    records.offer(OwnerRecord { epoch: 1, period_ns: [20 * MS, 0, 0, 0], ..Default::default() });
    records.accept(0, None);
    // To the left of a reference that rests at the origin and looks to the north: what stands in tilts by 0.1 rad.
    let left_m = 0.981 / (2.2 * 5.5);
    estimates.offer(StateEstimate { position_w_m: [0.0, left_m, 0.0], ..Default::default() });
    estimates.accept(0, None);
    let mut reference = Reference { count: 1, ..Reference::default() };
    reference.points[0].yaw_rad = 1.5;
    references.offer(reference);
    references.accept(0, None);
    let mut slot = SetpointSlot::new(2.0, 9.81);
    let (mut taken, mut headings) = (Vec::new(), Vec::new());
    for now_ms in (0..=3200).step_by(10) {
        if [0, 3200].contains(&now_ms) {
            let valid_ns = now_ms * MS;
            let header = Header { sequence: now_ms + 1, valid_ns, ..Header::default() };
            setpoints.offer(AttitudeSetpoint { header, roll_rad: 0.3, ..Default::default() });
        }
        setpoints.accept(now_ms * MS, None);
        let none = Input::default();
        let command =
            slot.take(now_ms * MS, &records, &setpoints, &none, (&estimates, &references));
        taken.push(command.map(|command| (command.sequence, command.value[1])));
        headings.extend(command.map(|command| command.value[3]));
        if now_ms == 500 {
            let memory = slot.memory();
            slot = SetpointSlot::new(2.0, 9.81);
            slot.restore(&memory);
        }
    }
    assert_eq!(taken[3], Some((1, 0.3)));
    assert_eq!(taken[4..8], [None; 4]);
    assert_eq!(taken[8], Some((0, 0.3)));
    let roll_rad: Vec<f64> = taken[8..320].iter().flatten().map(|(_, roll)| *roll).collect();
    assert!(roll_rad.is_sorted_by(|a, b| a > b) && roll_rad.len() == 312);
    // A fifth of a radian, times exp(-1).
    assert!((roll_rad[50] - 0.1 - 0.073_576).abs() < 1e-3, "{}", roll_rad[50]);
    assert!((roll_rad[311] - 0.1).abs() < 1e-3, "{}", roll_rad[311]);
    assert_eq!(taken[320], Some((3201, 0.3)));
    assert_eq!(
        (headings[0], headings[10]),
        (0.0, 1.5),
        "the reference's, once the set point fades"
    );
}

#[test]
fn after_a_trip_the_backup_law_flies_until_the_fallback_has_seen_it_for_two_periods() {
    let (mut records, mut setpoints) = (Input::default(), Input::default());
    let mut trips = Input::default();
    records.offer(OwnerRecord {
        epoch: 1,
        owner: 0,
        fallback: 1,
        watched: Flag::Yes,
        slot: Role::Position,
        period_ns: [10, 10, 0, 0],
        ..OwnerRecord::default()
    });
    records.accept(0, None);
    trips.offer(Trip {
        header: Header { sequence: 1, valid_ns: 30, ..Header::default() },
        epoch: 1,
        slot: Role::Position,
        instance: 0,
        ..Trip::default()
    });
    let mut slot = SetpointSlot::new(2.0, 9.81);
    let mut taken = Vec::new();
    for now_ns in (0..80).step_by(10) {
        for seat in 0..2 {
            let sequence = now_ns + 1;
            let header = Header { sequence, valid_ns: now_ns, seat, ..Header::default() };
            let roll_rad = if seat == 0 { 0.3 } else { 0.1 };
            setpoints.offer(AttitudeSetpoint { header, roll_rad, ..Default::default() });
        }
        setpoints.accept(now_ns, None);
        trips.accept(now_ns, None);
        let command = slot
            .take(now_ns, &records, &setpoints, &trips, (&Input::default(), &Input::default()))
            .expect("a set point");
        let is_reported = slot.applied().tripped.is_set();
        taken.push((command.sequence, command.value[1], is_reported));
    }
    let owners = [1, 11, 21].map(|sequence| (sequence, 0.3, false));
    let fallbacks = [51, 61, 71].map(|sequence| (sequence, 0.1, true));
    assert_eq!(taken[..3], owners);
    assert_eq!(taken[3..5], [(0, 0.0, true); 2]);
    assert_eq!(taken[5..], fallbacks);
}

#[test]
fn a_tripped_owners_set_point_is_not_carried_over_to_the_next_owner() {
    let (mut records, mut setpoints) = (Input::default(), Input::default());
    let mut trips = Input::default();
    let record = |epoch: u64, valid_ns: u64, owner: u32| OwnerRecord {
        header: Header { sequence: epoch, valid_ns, ..Header::default() },
        epoch,
        owner,
        fallback: 1,
        watched: Flag::from(owner == 0),
        slot: Role::Position,
        period_ns: [20, 20, 20, 0],
        ..OwnerRecord::default()
    };
    records.offer(record(1, 0, 0));
    trips.offer(Trip {
        header: Header { sequence: 1, valid_ns: 10, ..Header::default() },
        epoch: 1,
        slot: Role::Position,
        ..Trip::default()
    });
    let mut slot = SetpointSlot::new(2.0, 9.81);
    let mut taken = Vec::new();
    for now_ns in [0, 10, 20, 30] {
        if now_ns == 0 {
            let header = Header { sequence: 1, ..Header::default() };
            setpoints.offer(AttitudeSetpoint { header, roll_rad: 0.3, ..Default::default() });
        }
        if now_ns == 20 {
            records.offer(record(2, 20, 2));
        }
        records.accept(now_ns, None);
        setpoints.accept(now_ns, None);
        trips.accept(now_ns, None);
        let command =
            slot.take(now_ns, &records, &setpoints, &trips, (&Input::default(), &Input::default()));
        taken.push(command.map(|command| command.value[1]));
    }
    // The owner of the second record has published nothing yet: the backup law flies on, level without an estimate.
    assert_eq!(taken, [Some(0.3), Some(0.0), Some(0.0), Some(0.0)]);
}
