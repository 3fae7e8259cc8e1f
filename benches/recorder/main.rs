//! What a sample and a state cost the recorder, compression and file included, how much of a disk a flight
//! takes, and what the recorder takes through shared memory: a flight's samples at 200 000 a second, and in
//! bursts that fill the rings.

#[path = "../../tests/burst/mod.rs"]
#[allow(dead_code, reason = "each user takes its own part")]
mod burst;
mod offered;
#[path = "../tape/mod.rs"]
#[allow(dead_code, reason = "each bench uses its own part")]
mod tape;

use core::time::Duration;
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use offered::RecorderPlan;
use record::{Clock, Facts, Machine, Recording};
use runtime::clock::mono_now_ns;
use scenario::{Override, Scenario};
use shared_types::{Header, Role};
use std::io::Write as _;
use std::path::Path;
use tape::Flight;

const SCENARIO: &str = "figure8-morph";
/// As large as the attitude MPC's.
const STATE: [u8; 2048] = [0x5a; 2048];

fn open(path: &Path) -> Recording {
    let scenario = Scenario::load(SCENARIO, &[]).expect("it is shipped");
    let facts = Facts {
        run_id: "bench".to_owned(),
        scenario_name: SCENARIO.to_owned(),
        scenario_toml: scenario.to_toml().to_owned(),
        seed: 1,
        clock: Clock::Lockstep,
        epoch_unix_ns: 0,
        machine: Machine::read(),
        vehicle: scenario.real_vehicle(),
        branch: None,
        continues: None,
    };
    Recording::create(path, &facts).expect("room for a recording")
}

/// Through shared memory, before anything else: a process can do this once, as its first use of the transport.
fn offered(_: &mut Criterion) {
    let duration = Override::duration(Duration::from_secs(2));
    let plan = RecorderPlan {
        scenario: Scenario::load(SCENARIO, &[duration]).expect("it is shipped"),
        per_s: 200_000,
        for_ns: 2_000_000_000,
    };
    let folder = tempfile::tempdir().expect("a folder");
    let report = offered::measure(&plan, folder.path()).expect("room for its rings");
    let _ = writeln!(std::io::stdout(), "{report}");
    assert!(report.holds(), "{report:?}");
}

fn recorder(criterion: &mut Criterion) {
    let flight = Flight::fly(SCENARIO).expect("a shipped scenario flies");
    let folder = tempfile::tempdir().expect("a folder");
    let mut files = 0;
    let mut new_file = || {
        files += 1;
        open(&folder.path().join(format!("{files}.mcap")))
    };
    // A whole flight, once: its size and its rate.
    let mut recording = new_file();
    let start_ns = mono_now_ns();
    let samples = flight.write_to(&mut recording);
    let spent_ns = mono_now_ns() - start_ns;
    drop(recording);
    let bytes = std::fs::metadata(folder.path().join("1.mcap")).map_or(0, |file| file.len());
    let flown_s = flight.duration_s();
    let _ = writeln!(
        std::io::stdout(),
        "{SCENARIO}: {samples} samples of {flown_s} s, {} ns each or {} a second, {:.2} MB of file per second flown",
        spent_ns / samples.max(1),
        (samples * 1_000_000_000).checked_div(spent_ns).unwrap_or(0),
        bytes as f64 * 1e-6 / flown_s
    );
    let mut group = criterion.benchmark_group("recorder");
    group.throughput(Throughput::Elements(samples)).sample_size(10);
    group.bench_function("flight", |b| {
        b.iter_custom(|rounds| {
            let mut spent_ns = 0;
            for _ in 0..rounds {
                let mut recording = new_file();
                let start_ns = mono_now_ns();
                flight.write_to(&mut recording);
                spent_ns += mono_now_ns() - start_ns;
            }
            Duration::from_nanos(spent_ns)
        });
    });
    group.throughput(Throughput::Bytes(STATE.len() as u64)).sample_size(50);
    let mut recording = open(&folder.path().join("states.mcap"));
    let mut sequence = 0;
    group.bench_function("state", |b| {
        b.iter(|| {
            sequence += 1;
            let header = Header { sequence, release_ns: sequence * 1000, ..Header::default() };
            recording.write_state(Role::Attitude, &header, 7, &STATE, 0)
        });
    });
    group.finish();
}

criterion_group!(benches, offered, recorder);
criterion_main!(benches);
