//! Finished files, read back by the format's own reader.

use mcap::{MessageStream, Summary};
use record::{Clock, Event, Facts, Machine, RecordError, Recording, Severity};
use shared_types::{Header, Imu, Role, Truth, WrenchCommand, topics};
use std::collections::BTreeMap;
use std::fs;
use vehicle::VehicleParameters;

pub(super) const EPOCH_NS: u64 = 1_700_000_000_000_000_000;

pub(super) fn facts(clock: Clock) -> Facts {
    Facts {
        run_id: "test-run".to_owned(),
        scenario_name: "hover".to_owned(),
        scenario_toml: "seed = 7\n".to_owned(),
        seed: 7,
        clock,
        epoch_unix_ns: EPOCH_NS,
        machine: Machine { kernel: "6.1".to_owned(), cpu_model: "test".to_owned() },
        vehicle: VehicleParameters::default(),
        branch: None,
        continues: None,
    }
}

pub(super) fn imu(sequence: u64) -> Imu {
    let release_ns = sequence * 1_000_000;
    let header = Header { sequence, release_ns, publish_mono_ns: release_ns, ..Header::default() };
    Imu { header, gyro_b_rad_s: [sequence as f64, 0.0, -1.0], ..Imu::default() }
}

/// Viewers take the beginning of a flight from its chunks.
#[test]
fn no_chunk_begins_before_the_flight() -> Result<(), Box<dyn std::error::Error>> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("flight.mcap");
    let mut recording = Recording::create(&path, &facts(Clock::Lockstep))?;
    (0..10).try_for_each(|_| recording.flush())?;
    for sequence in 1..=50 {
        recording.write(&topics::IMU, &imu(sequence), 0)?;
        if sequence % 3 == 0 {
            recording.flush()?;
        }
    }
    recording.finish(&BTreeMap::new())?;
    let summary = Summary::read(&fs::read(&path)?)?.ok_or("no summary")?;
    assert!(summary.chunk_indexes.len() > 5, "{}", summary.chunk_indexes.len());
    for chunk in &summary.chunk_indexes {
        let (from_ns, to_ns) = (chunk.message_start_time, chunk.message_end_time);
        assert!(EPOCH_NS < from_ns && from_ns <= to_ns && to_ns <= EPOCH_NS + 50_000_000);
    }
    Ok(())
}

#[test]
fn a_flight_is_read_back_message_for_message() -> Result<(), Box<dyn std::error::Error>> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("flight.mcap");
    let mut recording = Recording::create(&path, &facts(Clock::Lockstep))?;
    // Two lost, then two repeated by a restarted producer.
    for sequence in (1..=50).chain(53..=60).chain(59..=70) {
        recording.write(&topics::IMU, &imu(sequence), 0)?;
        if sequence % 3 == 0 {
            recording.flush()?;
        }
    }
    for seat in [2, 0] {
        let header = Header { sequence: 5, seat, ..Header::default() };
        recording.write(
            &topics::WRENCH_COMMAND,
            &WrenchCommand { header, ..Default::default() },
            0,
        )?;
    }
    let header = Header { sequence: 1, release_ns: 3_000_000, ..Header::default() };
    recording.write_state(Role::Estimator, &header, 99, &[1, 2, 3], 0)?;
    let event = Event { logical_ns: 5, severity: Severity::Warning, source: "pilot", text: "gust" };
    recording.write_event(&event)?;
    let audit = recording.finish(&BTreeMap::from([("verdict".to_owned(), "ok".to_owned())]))?;

    let bytes = fs::read(&path)?;
    let messages = MessageStream::new(&bytes)?.collect::<mcap::McapResult<Vec<_>>>()?;
    let of = |topic: &str| messages.iter().filter(|m| m.channel.topic == topic).collect::<Vec<_>>();
    let expected: Vec<u32> = (1..=50).chain(53..=70).collect();
    assert_eq!(of("/imu").iter().map(|m| m.sequence).collect::<Vec<_>>(), expected);
    for message in of("/imu") {
        let stamp_ns = EPOCH_NS + u64::from(message.sequence) * 1_000_000;
        assert_eq!((message.log_time, message.publish_time), (stamp_ns, stamp_ns));
    }
    assert_eq!(of("/wrench_command").len(), 2);
    assert_eq!(of("/state/estimator").len(), 1);
    assert_eq!(of("/events")[0].log_time, EPOCH_NS + 5);

    let summary = Summary::read(&bytes)?.ok_or("no summary")?;
    let statistics = summary.stats.as_ref().ok_or("no statistics")?;
    assert_eq!(statistics.message_count, messages.len() as u64);
    for info in topics::all() {
        let topic = format!("/{}", info.name);
        let channel = summary.channels.values().find(|c| c.topic == topic).ok_or(topic)?;
        assert_eq!(channel.schema.as_ref().map(|s| s.encoding.as_str()), Some("protobuf"));
    }
    let attachment = mcap::read::attachment(&bytes, &summary.attachment_indexes[0])?;
    assert_eq!(
        (attachment.name.as_str(), &*attachment.data),
        ("scenario.toml", &b"seed = 7\n"[..])
    );
    let metadata: BTreeMap<_, _> = summary
        .metadata_indexes
        .iter()
        .map(|index| mcap::read::metadata(&bytes, index).map(|m| (m.name, m.metadata)))
        .collect::<Result<_, _>>()?;
    assert_eq!(metadata["run"]["seed"], "7");
    assert_eq!(metadata["summary"]["verdict"], "ok");
    assert_eq!(metadata["audit"], audit.to_metadata());
    let imu_audit =
        r#"{"count":68,"first":1,"last":70,"gaps":2,"repeated":2,"renumbered":0,"writers":1}"#;
    assert_eq!(metadata["audit"]["/imu#0"], imu_audit);
    assert!(metadata["audit"].contains_key("/wrench_command#2"));
    Ok(())
}

#[test]
fn in_realtime_a_sample_is_stamped_with_host_time_of_its_publication()
-> Result<(), Box<dyn std::error::Error>> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("flight.mcap");
    let mut recording = Recording::create(&path, &facts(Clock::Realtime { speed: 2.0 }))?;
    recording.set_start(10_000);
    // The third carries no stamp, as the launcher's own samples do not.
    for (sequence, publish_mono_ns, receipt_mono_ns) in
        [(1, 10_500, 10_900), (2, 11_500, 11_000), (3, 0, 12_000)]
    {
        let header = Header { sequence, publish_mono_ns, ..Header::default() };
        recording.write(
            &topics::TRUTH,
            &Truth { header, ..Default::default() },
            receipt_mono_ns,
        )?;
    }
    let event = Event { logical_ns: 800, severity: Severity::Info, source: "pilot", text: "" };
    recording.write_event(&event)?;
    recording.finish(&BTreeMap::new())?;

    let bytes = fs::read(&path)?;
    let mut stamps = Vec::new();
    for message in MessageStream::new(&bytes)? {
        let message = message?;
        if message.channel.metadata.contains_key("derived_from") {
            continue;
        }
        stamps.push((message.log_time - EPOCH_NS, message.publish_time - EPOCH_NS));
    }
    assert_eq!(stamps, [(500, 500), (1500, 1500), (2000, 2000), (400, 400)]);
    Ok(())
}

#[test]
fn an_existing_recording_is_never_overwritten() -> Result<(), Box<dyn std::error::Error>> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("flight.mcap");
    fs::write(&path, "precious")?;
    let error = Recording::create(&path, &facts(Clock::Lockstep)).err().ok_or("was created")?;
    assert!(matches!(error, RecordError::Create { .. }));
    assert!(error.to_string().contains("flight.mcap"), "{error}");
    assert_eq!(fs::read_to_string(&path)?, "precious");
    Ok(())
}
