//! The screen as people see it, cell by cell, and what is measured for it.

use super::draw::{Palette, Talk, draw, plain};
use super::gauges::{Gauge, Gauges, Spread, wanted};
use super::screen::begun;
use super::snapshot::Usage;
use super::{Row, Snapshot};
use protocol::control::status::{ProcessState, ProcessStatus, RunStatus, SlotStatus};
use ratatui::Terminal;
use ratatui::backend::TestBackend;
use shared_types::wire::Value as _;
use shared_types::{Header, Imu, LoopStats, Role, WrenchCommand, topics};

fn process(name: &str, role: Role, seat: u32, state: ProcessState) -> ProcessStatus {
    ProcessStatus {
        name: name.to_owned(),
        role: role.label().to_owned(),
        pid: Some(std::process::id()),
        seat,
        generation: 1,
        rate_hz: 100.0,
        state,
        mark_s: 12.0,
        mark_age_s: 0.001,
    }
}

fn status() -> RunStatus {
    RunStatus {
        run: "785359bad9".to_owned(),
        scenario: "figure8-morph".to_owned(),
        clock: "realtime".to_owned(),
        started: true,
        flown_s: 12.0,
        end_s: 20.0,
        launcher_pid: 1,
        recording: None,
        processes: vec![
            process("plant", Role::Plant, 0, ProcessState::Running),
            process("estimator", Role::Estimator, 0, ProcessState::Running),
            process("position-mpc", Role::Position, 0, ProcessState::Owner),
            process("attitude-mpc", Role::Attitude, 0, ProcessState::Fallback),
            process("attitude-lqr", Role::Attitude, 1, ProcessState::Owner),
            process("disturbance-injector", Role::Disturbance, 0, ProcessState::Restarting),
            process("pilot", Role::Pilot, 0, ProcessState::Running),
        ],
        slots: vec![
            SlotStatus {
                slot: "attitude".to_owned(),
                epoch: 3,
                owner: Some("attitude-lqr".to_owned()),
                fallback: Some("attitude-mpc".to_owned()),
                watched: true,
                stage: "window".to_owned(),
                candidate: Some("attitude-lqr@1".to_owned()),
                until_s: Some(4.5),
            },
            SlotStatus {
                slot: "position".to_owned(),
                epoch: 1,
                owner: Some("position-mpc".to_owned()),
                fallback: None,
                watched: false,
                stage: "steady".to_owned(),
                candidate: None,
                until_s: None,
            },
        ],
    }
}

fn snapshot() -> Snapshot {
    let mut snapshot = Snapshot::of(status(), &Gauges::default(), &mut Usage::default(), 0.0, 0);
    let spread = |median_us| Some(Spread { median_us, max_us: 1e5 });
    for row in &mut snapshot.loops {
        row.gauge = Gauge {
            hz: Some(1000.0),
            lateness: spread(12.34),
            compute: spread(1234.5),
            input_age: spread(123_456.7),
            missed: 12_345,
            late_samples: 0,
        };
        (row.queue, row.cpu_percent, row.rss_bytes) = (123, Some(99.9), Some(1234 << 20));
    }
    snapshot
}

fn screen(width: u16, height: u16, snapshot: &Snapshot, talk: &Talk) -> Vec<String> {
    let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
    terminal.draw(|frame| draw(frame, snapshot, talk, Palette::plain())).unwrap();
    let buffer = terminal.backend().buffer();
    let line = |y| (0..width).map(|x| buffer[(x, y)].symbol()).collect::<String>();
    (0..height).map(|y| line(y).trim_end().to_owned()).collect()
}

#[test]
fn everything_is_on_80_by_24_even_where_all_numbers_are_wide() {
    let talk = Talk {
        lines: vec!["> goto 0 0 2".to_owned(), "goto 0 0 2 m: from 12.3 s on".to_owned()],
        ..Talk::default()
    };
    let lines = screen(80, 24, &snapshot(), &talk);
    let text = lines.join("\n");
    assert!(lines[0].starts_with("run 785359bad9  figure8-morph, realtime, running"), "{text}");
    assert!(lines[1].ends_with("] 12.0 of 20.0 s"), "{text}");
    let heading = lines.iter().position(|line| line.starts_with("LOOP")).expect("a table");
    for (row, line) in snapshot().loops.iter().zip(&lines[heading + 1..]) {
        let cells: Vec<&str> = line.split_whitespace().collect();
        assert!(line.len() <= 79, "{line}");
        assert_eq!(cells.len(), 12, "no two cells touch: {line}");
        assert!(cells[0].starts_with(&row.name[..10.min(row.name.len())]), "{line}");
        assert_eq!(cells[1], row.state.label());
        assert_eq!(cells[4..], ["1000", "12.3u", "1234u", "123m", "12k", "123", "99.9", "1234"]);
    }
    assert!(text.contains("attitude  epoch 3    owner attitude-lqr"), "{text}");
    assert!(text.contains("goto 0 0 2 m: from 12.3 s on"), "{text}");
    assert!(lines[23].contains("s swap") && lines[23].contains("q quit"), "{text}");
}

#[test]
fn a_command_is_typed_where_the_keys_were_and_what_is_over_is_marked() {
    let typed = "swap attitude --to attitude-mpc".to_owned();
    let talk = Talk { typing: Some(typed.clone()), over: Some("ended"), ..Talk::default() };
    let lines = screen(80, 24, &snapshot(), &talk);
    assert_eq!(lines[23], format!("> {typed}"));
    assert!(lines[0].ends_with("ended"), "{}", lines[0]);
    // A small terminal shows less and breaks nothing.
    for (width, height) in [(20, 5), (1, 1), (200, 60)] {
        screen(width, height, &snapshot(), &talk);
    }
    let long = Talk { typing: Some("x".repeat(200) + "end"), ..Talk::default() };
    assert!(screen(80, 24, &snapshot(), &long)[23].ends_with("end"));
}

#[test]
fn a_pipe_gets_the_same_lines_without_escapes() {
    let text = plain(&snapshot());
    assert!(!text.contains('\u{1b}') && text.contains("attitude-lqr@1  owner"), "{text}");
    assert!(text.lines().all(|line| line.len() <= 80), "{text}");
}

#[test]
fn keys_begin_the_commands_that_they_stand_for() {
    let status = status();
    for (key, command) in [
        ('s', "swap attitude --to "),
        ('r', "rollback attitude"),
        ('d', "disturb "),
        ('m', "morph "),
    ] {
        let begun = begun(key, &status).expect("a command");
        assert!(begun.starts_with(command), "{begun}");
    }
    assert_eq!(begun('x', &status), None);
}

#[test]
fn stamps_give_rate_lateness_compute_time_and_age_of_the_sample_behind_a_step() {
    let mut gauges = Gauges::default();
    let mut packed = vec![0; Imu::PACKED_SIZE];
    for k in 1..=2000_u64 {
        let at_ns = k * 1_000_000;
        let header = Header {
            sequence: k,
            release_ns: at_ns,
            release_mono_ns: at_ns,
            start_mono_ns: at_ns + 2_000,
            publish_mono_ns: at_ns + 5_000,
            ..Header::default()
        };
        Imu { header, ..Imu::default() }.pack(&mut packed);
        gauges.take(&topics::IMU.info, &packed);
        if k.is_multiple_of(10) {
            let header = Header {
                sequence: k / 10,
                cause_sequence: k,
                start_mono_ns: at_ns + 45_000,
                publish_mono_ns: at_ns + 55_000,
                seat: 1,
                ..header
            };
            let mut packed = vec![0; WrenchCommand::PACKED_SIZE];
            WrenchCommand { header, ..WrenchCommand::default() }.pack(&mut packed);
            gauges.take(&topics::WRENCH_COMMAND.info, &packed);
        }
    }
    let stats = LoopStats {
        header: Header { seat: 8 + 3, ..Header::default() },
        role: Role::Attitude,
        skipped: 2,
        input_deadline_misses: 3,
        ..LoopStats::default()
    };
    let mut packed = vec![0; LoopStats::PACKED_SIZE];
    stats.pack(&mut packed);
    gauges.take(&topics::LOOP_STATS.info, &packed);
    let gauge = gauges.of(Role::Attitude, 1);
    let near = |a: f64, b: f64| (a - b).abs() < 1e-6;
    assert!(near(gauge.hz.unwrap(), 100.0) && near(gauges.of(Role::Plant, 0).hz.unwrap(), 1000.0));
    assert!(near(gauge.lateness.unwrap().median_us, 45.0));
    assert!(near(gauge.compute.unwrap().max_us, 10.0));
    // Started 45 us after the release, and the inertial sample came 5 us after it.
    assert!(near(gauge.input_age.unwrap().median_us, 40.0));
    assert_eq!(gauge.missed, 5);
    assert_eq!(gauges.of(Role::Attitude, 0), Gauge::default());
    assert_eq!(wanted().len(), 7);
}

#[test]
fn a_loop_behind_the_plant_has_a_queue() {
    let mut status = status();
    status.processes[3].mark_s = 11.955;
    let snapshot = Snapshot::of(status, &Gauges::default(), &mut Usage::default(), 0.0, 0);
    let queued: Vec<u64> = snapshot.loops.iter().map(|row: &Row| row.queue).collect();
    assert_eq!(queued, [0, 0, 0, 4, 0, 0, 0]);
    assert!(snapshot.loops[0].rss_bytes > Some(1 << 18));
}
