//! Recordings as they were written, cut, damaged, foreign and from other builds.

use components::state_layouts;
use mcap::Writer;
use rand::{RngExt as _, SeedableRng};
use rand_chacha::ChaCha8Rng;
use record::read::{
    ReadError, RecordVisitor, RecordedEvent, RecordedFlight, RecoverError, recover,
};
use record::{Branched, Clock, Continued, Event, Facts, Machine, Recording, Severity};
use scenario::Scenario;
use shared_types::wire::Value as _;
use shared_types::{Header, Imu, Role, Sample, Topic, Truth, topics};
use std::any::Any;
use std::collections::BTreeMap;
use std::error::Error;
use std::fs;
use std::path::Path;

type Outcome = Result<(), Box<dyn Error>>;

fn imu(sequence: u64) -> Imu {
    let release_ns = (sequence - 1) * 1_000_000;
    let header = Header { sequence, release_ns, valid_ns: release_ns, ..Header::default() };
    let mut imu = Imu { header, ..Imu::default() };
    imu.gyro_b_rad_s = [sequence as f64, -0.0, f64::from_bits(0x7ff0_0000_0000_0001 + sequence)];
    imu
}

fn packed(imu: &Imu) -> Vec<u8> {
    let mut bytes = vec![0; Imu::PACKED_SIZE];
    imu.pack(&mut bytes);
    bytes
}

fn layout_of(role: Role) -> Result<u64, Box<dyn Error>> {
    let layouts = state_layouts(&Scenario::load("hover", &[])?)?;
    Ok(layouts.iter().find(|l| l.role == role).ok_or("no such role")?.hash)
}

fn continued() -> Continued {
    Continued { file: "7f3a.mcap".to_owned(), from_ns: 1_500_000_000 }
}

fn branched() -> Branched {
    let (parent_run, changes) = ("parent".to_owned(), "--seed 9".to_owned());
    Branched { parent_run, at_ns: 40_000_000, changes }
}

/// A recording of `count` inertial samples with two states and an event.
fn record(path: &Path, count: u64, layout: u64) -> Outcome {
    let facts = Facts {
        run_id: "test-run".to_owned(),
        scenario_name: "hover".to_owned(),
        scenario_toml: Scenario::load("hover", &[])?.to_toml().to_owned(),
        seed: 7,
        clock: Clock::Realtime { speed: 0.5 },
        epoch_unix_ns: 1_700_000_000_000_000_000,
        machine: Machine { kernel: "6.1".to_owned(), cpu_model: "test".to_owned() },
        vehicle: vehicle::VehicleParameters::default(),
        branch: Some(branched()),
        continues: Some(continued()),
    };
    let mut recording = Recording::create(path, &facts)?;
    for sequence in 1..=count {
        recording.write(&topics::IMU, &imu(sequence), 0)?;
        if sequence % 3 == 0 {
            recording.flush()?;
        }
    }
    for sequence in [1, 2] {
        let header = Header { sequence, generation: 3, release_ns: sequence, ..Header::default() };
        recording.write_state(Role::Attitude, &header, layout, &[9, 8, 7], 0)?;
    }
    let event = Event { logical_ns: 5, severity: Severity::Warning, source: "pilot", text: "gust" };
    recording.write_event(&event)?;
    recording.finish(&BTreeMap::from([("hash".to_owned(), "abc".to_owned())]))?;
    Ok(())
}

#[derive(Default)]
struct Everything {
    imu: Vec<Vec<u8>>,
    others: usize,
    states: Vec<(Role, u64, u32, Vec<u8>)>,
    events: Vec<RecordedEvent>,
}

impl RecordVisitor for Everything {
    fn sample<T: Sample>(&mut self, _topic: &'static Topic<T>, sample: &T) {
        match (sample as &dyn Any).downcast_ref::<Imu>() {
            Some(imu) => self.imu.push(packed(imu)),
            None => self.others += 1,
        }
    }
    fn state(&mut self, role: Role, header: &Header, state: &[u8]) {
        self.states.push((role, header.sequence, header.generation, state.to_vec()));
    }
    fn event(&mut self, event: RecordedEvent) {
        self.events.push(event);
    }
}

#[test]
fn what_was_recorded_is_read_bit_for_bit() -> Outcome {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("flight.mcap");
    record(&path, 500, layout_of(Role::Attitude)?)?;
    let flight = RecordedFlight::open(&path)?;
    assert_eq!(flight.clock(), Clock::Realtime { speed: 0.5 });
    assert_eq!(flight.facts()["run_id"], "test-run");
    assert_eq!(flight.branched(), Some(&branched()));
    assert_eq!(flight.continued(), Some(continued()));
    assert_eq!(flight.scenario().settings().scenario.name, "hover");
    let mut seen = Everything::default();
    let closing = flight.visit(&mut seen)?;
    assert!(closing.complete);
    assert_eq!(closing.summary["hash"], "abc");
    assert!(closing.audit["/imu#0"].contains("\"count\":500"), "{:?}", closing.audit);
    assert_eq!(seen.imu, (1..=500).map(|s| packed(&imu(s))).collect::<Vec<_>>());
    let state = |sequence| (Role::Attitude, sequence, 3, vec![9, 8, 7]);
    assert_eq!(seen.states, [state(1), state(2)]);
    let event = &seen.events[0];
    assert_eq!((event.level, event.source.as_str(), event.text.as_str()), (3, "pilot", "gust"));
    // Logical time runs at half of the wall's.
    assert_eq!(event.stamp_ns, 1_700_000_000_000_000_010);
    assert_eq!(flight.samples(&topics::IMU)?.len(), 500);
    assert_eq!(flight.samples::<Truth>(&topics::TRUTH)?.len(), 0);
    assert_eq!(flight.states(Role::Attitude)?.len(), 2);
    Ok(())
}

#[test]
fn a_file_cut_anywhere_reads_up_to_the_cut_or_reports_what_its_head_lacks() -> Outcome {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("flight.mcap");
    record(&path, 300, layout_of(Role::Attitude)?)?;
    let whole = fs::read(&path)?;
    let cut = folder.path().join("cut.mcap");
    let (mut heads, mut most) = (0, 0);
    for length in (1..whole.len()).step_by(whole.len() / 40) {
        fs::write(&cut, &whole[..length])?;
        match RecordedFlight::open(&cut) {
            Err(error @ ReadError::CutHead { .. }) => {
                heads += 1;
                let text = error.to_string();
                assert!(text.contains("cut.mcap") && text.contains(&length.to_string()), "{text}");
                assert_eq!(most, 0, "the head comes first");
            }
            Err(error) => return Err(error.into()),
            Ok(flight) => {
                let mut seen = Everything::default();
                assert!(!flight.visit(&mut seen)?.complete);
                assert!(seen.imu.len() >= most, "a longer prefix holds no less");
                most = seen.imu.len();
                let expected: Vec<_> = (1..=most as u64).map(|s| packed(&imu(s))).collect();
                assert_eq!(seen.imu, expected);
            }
        }
    }
    assert!(heads > 2 && most == 300, "{heads} {most}");
    Ok(())
}

#[test]
fn what_a_cut_file_has_is_recovered_into_a_complete_one_that_is_marked() -> Outcome {
    let folder = tempfile::tempdir()?;
    let [path, cut, new] = ["flight", "cut", "new"].map(|name| folder.path().join(name));
    record(&path, 300, layout_of(Role::Attitude)?)?;
    assert!(matches!(recover(&path, &new), Err(RecoverError::Complete { .. })));
    assert!(!new.exists());
    let whole = fs::read(&path)?;
    let mut most = 0;
    for length in (1..whole.len()).step_by(whole.len() / 20) {
        fs::write(&cut, &whole[..length])?;
        let recovered = recover(&cut, &new);
        if matches!(recovered, Err(RecoverError::Read(ReadError::CutHead { .. }))) {
            assert!(!new.exists() && most == 0);
            continue;
        }
        let (mut old, mut seen) = (Everything::default(), Everything::default());
        RecordedFlight::open(&cut)?.visit(&mut old)?;
        let closing = RecordedFlight::open(&new)?.visit(&mut seen)?;
        assert!(!closing.complete && seen.imu == old.imu && seen.states == old.states);
        most = seen.imu.len();
        assert!(closing.audit["/imu#0"].contains(&format!("\"count\":{most},")));
        let recovered = recovered?;
        assert_eq!((recovered.gaps, recovered.damage), (0, None));
        let bytes = fs::read(&new)?;
        let summary = mcap::Summary::read(&bytes)?.ok_or("no summary")?;
        let statistics = summary.stats.ok_or("no statistics")?;
        assert_eq!(statistics.message_count, recovered.messages);
        let held = most + seen.states.len() + seen.events.len();
        assert_eq!(recovered.messages, held as u64);
        assert!(matches!(recover(&cut, &new), Err(RecoverError::Exists { .. })), "overwritten");
        fs::remove_file(&new)?;
    }
    assert_eq!(most, 300);
    // What a power cut leaves behind the last bytes that reached the disk.
    let mut zeroed = whole;
    let half = zeroed.len() * 3 / 4;
    zeroed[half..].fill(0);
    fs::write(&cut, &zeroed)?;
    let recovered = recover(&cut, &new)?;
    assert!(recovered.messages > 10, "{recovered:?}");
    assert!(RecordedFlight::open(&new)?.samples(&topics::IMU)?.len() > 10);
    Ok(())
}

#[test]
fn around_a_damaged_chunk_everything_else_is_recovered_and_the_hole_is_reported() -> Outcome {
    let folder = tempfile::tempdir()?;
    let [path, bad, new] = ["flight", "bad", "new"].map(|name| folder.path().join(name));
    record(&path, 300, layout_of(Role::Attitude)?)?;
    let whole = fs::read(&path)?;
    let summary = mcap::Summary::read(&whole)?.ok_or("no summary")?;
    let chunks = &summary.chunk_indexes;
    assert!(chunks.len() > 3, "{}", chunks.len());
    let total = summary.stats.as_ref().ok_or("no statistics")?.message_count;
    // The first defines the channels, which only the end of the file defines once more.
    for chunk in [&chunks[0], &chunks[chunks.len() / 2]] {
        let held = summary.stream_chunk(&whole, chunk)?.count() as u64;
        let middle = usize::try_from(chunk.chunk_start_offset + chunk.chunk_length / 2)?;
        let mut damaged = whole.clone();
        damaged[middle] ^= 0x10;
        fs::write(&bad, &damaged)?;
        let recovered = recover(&bad, &new)?;
        assert_eq!(recovered.messages, total - held);
        let damage = recovered.damage.ok_or("no damage")?;
        assert_eq!((damage.left_out, damage.unknown, damage.end), (1, 0, None));
        assert!(damage.first.contains("near byte"), "{}", damage.first);

        let mut seen = Everything::default();
        let closing = RecordedFlight::open(&new)?.visit(&mut seen)?;
        assert!(!closing.complete && held > 0);
        let count = seen.imu.len() + seen.states.len() + seen.events.len();
        assert_eq!(count as u64, total - held);
        let before_it = chunk.chunk_start_offset > chunks[0].chunk_start_offset;
        assert!(recovered.gaps == held || !before_it, "{} of {held}", recovered.gaps);
        let refused = closing.require_no_holes(&new).err().ok_or("flown again")?.to_string();
        assert!(refused.contains("1 parts are missing in the middle"), "{refused}");
        fs::remove_file(&new)?;
    }
    // Behind the last chunk is nothing to recover: no hole, and what there is can be flown again.
    let last = usize::try_from(chunks[chunks.len() - 1].chunk_start_offset)?;
    let mut damaged = whole.clone();
    damaged[last + 100] ^= 0x10;
    fs::write(&bad, &damaged)?;
    let damage = recover(&bad, &new)?.damage.ok_or("no damage")?;
    assert!(damage.left_out == 0 && damage.end.is_some(), "{damage:?}");
    let closing = RecordedFlight::open(&new)?.visit(&mut Everything::default())?;
    assert!(!closing.complete && closing.require_no_holes(&new).is_ok());
    fs::remove_file(&new)?;
    // Where one record ends and the next begins is lost: what comes before is kept.
    let mut damaged = whole.clone();
    let middle = usize::try_from(chunks[chunks.len() / 2].chunk_start_offset)?;
    damaged[middle + 6] ^= 0x40;
    fs::write(&bad, &damaged)?;
    let recovered = recover(&bad, &new)?;
    let end = recovered.damage.and_then(|damage| damage.end).ok_or("it went on")?;
    assert!(recovered.messages > total / 4 && end.contains("near byte"), "{end}");
    Ok(())
}

#[test]
fn a_changed_byte_is_found_wherever_it_is() -> Outcome {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("flight.mcap");
    record(&path, 300, layout_of(Role::Attitude)?)?;
    let whole = fs::read(&path)?;
    let bad = folder.path().join("bad.mcap");
    let mut random = ChaCha8Rng::seed_from_u64(4);
    for round in 0..200 {
        // The head is the smaller part of the file but has the most ways to go wrong.
        let reach = if round % 2 == 0 { whole.len() } else { 3000 };
        let (at, flip) = (random.random_range(0..reach), random.random_range(1..=255));
        let mut changed = whole.clone();
        changed[at] ^= flip;
        fs::write(&bad, &changed)?;
        let mut seen = Everything::default();
        let read = RecordedFlight::open(&bad).and_then(|flight| flight.visit(&mut seen));
        match read {
            Err(error) => assert!(error.to_string().contains("bad.mcap"), "{error}"),
            // With its last bytes changed the file looks cut, and is reported as such.
            Ok(closing) => assert!(!closing.complete && at + 8 >= whole.len(), "byte {at}"),
        }
    }
    Ok(())
}

#[test]
fn what_is_no_recording_is_refused_by_name() -> Outcome {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("strange");
    let refusal = |path: &Path| {
        RecordedFlight::open(path).map_or_else(|error| error.to_string(), |_| "opened".to_owned())
    };
    assert!(refusal(&path).contains("cannot read"), "{}", refusal(&path));
    assert!(refusal(folder.path()).contains("is not a file"), "{}", refusal(folder.path()));
    fs::write(&path, "")?;
    assert!(refusal(&path).contains("is empty"), "{}", refusal(&path));
    fs::write(&path, "seed = 7\n")?;
    assert!(refusal(&path).contains("does not begin like an MCAP file"), "{}", refusal(&path));
    let mut writer = Writer::new(fs::File::create(&path)?)?;
    let schema = writer.add_schema("Pose", "jsonschema", b"{}")?;
    writer.add_channel(schema, "/events", "json", &BTreeMap::new())?;
    writer.finish()?;
    assert!(refusal(&path).contains("metadata `run` is missing"), "{}", refusal(&path));
    Ok(())
}

#[test]
fn a_state_of_another_build_is_refused_and_its_type_is_named() -> Outcome {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("state.mcap");
    record(&path, 3, 0xdead)?;
    let error = RecordedFlight::open(&path)?.states(Role::Attitude).err().ok_or("was read")?;
    let (text, ours) = (error.to_string(), format!("{:016x}", layout_of(Role::Attitude)?));
    for part in ["state.mcap", "/state/attitude", "ComponentMemory", "000000000000dead", &ours] {
        assert!(text.contains(part), "{text}");
    }
    Ok(())
}

/// What a controller remembers may change, and its recordings are looked at as before.
#[test]
fn a_state_of_another_build_keeps_nothing_else_from_being_read() -> Outcome {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("state.mcap");
    record(&path, 3, 0xdead)?;
    let mut seen = Everything::default();
    let closing = RecordedFlight::open(&path)?.visit(&mut seen)?;
    assert!(closing.complete);
    assert_eq!((seen.imu.len(), seen.events.len(), seen.states.len()), (3, 1, 2));
    Ok(())
}
