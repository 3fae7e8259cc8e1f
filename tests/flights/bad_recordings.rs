//! Files that are no recordings, parts of one, or made to do harm, given to every command that reads one: each
//! is named, none makes a command panic, hang or fill the memory.

use crate::common::recording::{CHUNK, middle_of_a_chunk, places, record_at};
use crate::common::{fly, morphquad};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Exit codes.
const USAGE: i32 = 2;
/// Most address space that a command may take [kB]; the executable alone maps little of it.
const MAX_KB: u32 = 1_500_000;
/// Begin and end of a file of this format.
const MAGIC: &[u8] = b"\x89MCAP0\r\n";

/// Every command that reads a recording, with `FILE` for it and `OUT` for something to write to.
const COMMANDS: [&str; 11] = [
    "report FILE",
    "report FILE --format json --html OUT",
    "view FILE --out OUT",
    "trace FILE",
    "recover FILE --out OUT",
    "topic info FILE",
    "topic echo truth FILE",
    "topic export FILE --csv --out OUT",
    "replay FILE --verify",
    "replay FILE --hash",
    "replay FILE --branch @1s",
];

/// Runs a command on a file with little memory: exit code, and stdout and stderr in one line.
fn run_command(command: &str, file: &Path) -> (Option<i32>, String) {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out");
    let arguments = command.split(' ').map(|argument| match argument {
        "FILE" => file.as_os_str().to_owned(),
        "OUT" => out.as_os_str().to_owned(),
        argument => argument.into(),
    });
    let script = format!("ulimit -v {MAX_KB}; exec \"$0\" \"$@\"");
    let mut shell = Command::new("bash");
    shell.args(["-c", &script, env!("CARGO_BIN_EXE_morphquad")]).args(arguments);
    let output = shell.current_dir(folder.path()).output().expect("bash is there");
    let text = [output.stdout, output.stderr].concat();
    let text = String::from_utf8_lossy(&text).replace(['│', '\n'], " ");
    (output.status.code(), text.split_whitespace().collect::<Vec<_>>().join(" "))
}

/// Every command refuses the file as a wrong argument, by name, with the message `expected`.
fn assert_refused(file: &Path, expected: &str) {
    let name = file.file_name().expect("a name").to_string_lossy();
    for command in COMMANDS {
        let (code, output_text) = run_command(command, file);
        assert_eq!(code, Some(USAGE), "{command} {name}: {output_text}");
        assert!(
            output_text.contains(&*name) && !output_text.contains("panicked"),
            "{command} {name}: {output_text}"
        );
        // Long lines are broken, also within a name.
        let (output_text, expected) = (output_text.replace(' ', ""), expected.replace(' ', ""));
        assert!(
            output_text.contains(&expected),
            "{command} {name}: no `{expected}` in {output_text}"
        );
    }
}

const METADATA: u8 = 0x0c;
const ATTACHMENT: u8 = 0x09;

fn written(folder: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.join(name);
    fs::write(&path, bytes).expect("a disk with room");
    path
}

fn foreign(folder: &Path, name: &str, topic: &str, encoding: &str) -> PathBuf {
    let path = folder.join(name);
    let mut writer = mcap::Writer::new(fs::File::create(&path).expect("a file")).expect("a writer");
    let id = writer
        .add_schema("Pose", encoding, b"{}")
        .and_then(|schema| writer.add_channel(schema, topic, "json", &BTreeMap::new()));
    let header = mcap::records::MessageHeader {
        channel_id: id.expect("a channel"),
        sequence: 1,
        log_time: 1,
        publish_time: 1,
    };
    writer.write_to_known_channel(&header, b"{\"x\": 1}").expect("room");
    writer.finish().expect("room");
    path
}

#[test]
fn what_is_no_recording_is_refused_by_every_command_in_the_same_way() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    assert_refused(&folder.join("none.mcap"), "cannot read");
    assert_refused(&written(folder, "empty.mcap", b""), "is empty");
    assert_refused(
        &written(folder, "text.mcap", b"seed = 7\n"),
        "does not begin like an MCAP file",
    );
    assert_refused(&written(folder, "magic.mcap", MAGIC), "is cut in its head");
    assert_refused(
        &foreign(folder, "foreign.mcap", "/events", "jsonschema"),
        "no morphquad recording",
    );
    assert_refused(
        &foreign(folder, "named.mcap", "/truth", "jsonschema"),
        "no morphquad recording",
    );
    let inner = folder.join("folder.mcap");
    fs::create_dir(&inner).expect("a folder");
    for command in COMMANDS.iter().filter(|command| !command.starts_with("report")) {
        let (code, output_text) = run_command(command, &inner);
        assert_eq!(code, Some(USAGE), "{command}: {output_text}");
        assert!(
            output_text.replace(' ', "").contains("notafilebutafolder"),
            "{command}: {output_text}"
        );
    }
}

/// Lengths that stand for more than there is, in every kind of record that has one.
#[test]
fn a_false_length_fills_no_memory_and_keeps_no_command_from_its_report() {
    let flown = fly(&["hover", "--for", "1s", "--in-process"]);
    let whole = fs::read(flown.recording_path()).expect("the recording");
    let folder = tempfile::tempdir().expect("a folder");
    let chunk = places(&whole, CHUNK)[0];
    // Begin, end, size uncompressed, checksum, name of the compression, size compressed.
    let size_at = chunk + 9 + 16;
    let packed_at = size_at + 8 + 4 + 4 + 3;
    let metadata = places(&whole, METADATA)[0];
    let attachment = places(&whole, ATTACHMENT)[0];
    let giants: [(&str, usize, &[u8]); 8] = [
        ("record.mcap", chunk + 1, &(1_u64 << 60).to_le_bytes()),
        ("unpacked.mcap", size_at, &(1_u64 << 40).to_le_bytes()),
        ("packed.mcap", packed_at, &(1_u64 << 40).to_le_bytes()),
        ("codec.mcap", size_at + 8 + 4 + 4, b"zip"),
        ("metadata.mcap", metadata + 9, &u32::MAX.to_le_bytes()),
        ("key.mcap", metadata + 9 + 4 + 3 + 4, &u32::MAX.to_le_bytes()),
        ("pairs.mcap", metadata + 9 + 4 + 3, &u32::MAX.to_le_bytes()),
        ("attachment.mcap", attachment + 9 + 16, &u32::MAX.to_le_bytes()),
    ];
    for (name, at, lie) in giants {
        let mut bytes = whole.clone();
        bytes[at..at + lie.len()].copy_from_slice(lie);
        let path = written(folder.path(), name, &bytes);
        for command in COMMANDS {
            let (code, output_text) = run_command(command, &path);
            // Around a record that lies, what is behind it is saved; not around lengths that hide where that
            // is, and not without the facts of the flight.
            let around = ["unpacked.mcap", "packed.mcap", "codec.mcap", "attachment.mcap"];
            let saved = command.starts_with("recover") && around.contains(&name);
            let expected = if saved { 0 } else { USAGE };
            assert_eq!(code, Some(expected), "{command} {name}: {output_text}");
            assert!(
                output_text.contains(name) && !output_text.contains("panicked"),
                "{command} {name}: {output_text}"
            );
        }
    }
}

/// Behind the head, a part of a recording is reported as far as it goes.
#[test]
fn a_recording_cut_or_damaged_anywhere_is_read_so_far_or_refused_by_name() {
    let flown = fly(&["hover", "--for", "2s", "--in-process"]);
    let whole = fs::read(flown.recording_path()).expect("the recording");
    let folder = tempfile::tempdir().expect("a folder");
    let chunks = places(&whole, CHUNK);
    let first = chunks[0];
    let last = chunks[chunks.len() - 1];
    assert_refused(&written(folder.path(), "head.mcap", &whole[..first / 2]), "is cut in its head");
    // In a chunk's head, in its data, between two, before the index, and in the end's magic.
    let behind = last + record_at(&whole, last);
    for (i, cut) in [
        chunks[2] + 5,
        chunks[3] + 40,
        chunks[3] + 3000,
        last,
        behind,
        behind + 30,
        whole.len() - 4,
    ]
    .into_iter()
    .enumerate()
    {
        let path = written(folder.path(), &format!("cut{i}.mcap"), &whole[..cut]);
        for command in COMMANDS {
            // Before its last bytes, the outcome of the flight is not in it, which these two ask for.
            let expected = match command.split(' ').next() {
                Some("report") if cut + MAGIC.len() > whole.len() => vec![0],
                Some("report" | "trace") => vec![1],
                Some("replay") => vec![0, 1, USAGE],
                _ => vec![0],
            };
            let (code, output_text) = run_command(command, &path);
            let code = code.expect("no signal ends it");
            assert!(expected.contains(&code), "{command} cut at {cut}: {code} {output_text}");
            assert!(!output_text.contains("panicked"), "{command} cut at {cut}: {output_text}");
        }
        let (_, output_text) = run_command("report FILE", &path);
        assert!(output_text.contains("it is cut: its recorder was killed"), "{output_text}");
    }
    let mut damaged = whole.clone();
    damaged[chunks[4] + 2000] ^= 0x55;
    let path = written(folder.path(), "damaged.mcap", &damaged);
    for command in COMMANDS {
        let expected = if command.starts_with("recover") { 0 } else { USAGE };
        let (code, output_text) = run_command(command, &path);
        assert_eq!(code, Some(expected), "{command}: {output_text}");
        assert!(output_text.contains("is damaged near byte"), "{command}: {output_text}");
    }
}

/// What is recovered is read by every command, and reported as recovered.
#[test]
fn a_recovered_recording_is_opened_like_any_other_and_lists_what_it_lacks() {
    let orders = ["--goto", "1,0,2@1s", "--morph", "120@1s,over=1s"];
    let flown = fly(&[&["figure8-morph", "--for", "6s"], &orders[..]].concat());
    let whole = fs::read(flown.recording_path()).expect("the recording");
    let folder = tempfile::tempdir().expect("a folder");
    let cut = written(folder.path(), "cut.mcap", &whole[..whole.len() * 3 / 4]);
    let recovered = folder.path().join("recovered.mcap");
    let output = morphquad(["recover"]).arg(&cut).arg("--out").arg(&recovered).output();
    assert_eq!(output.expect("it starts").status.code(), Some(0));
    for command in COMMANDS {
        let expected: &[i32] = match command.split(' ').next() {
            Some("report" | "trace") => &[1],
            Some("recover") => &[USAGE],
            Some("replay") => &[0, 1, USAGE],
            _ => &[0],
        };
        let (code, output_text) = run_command(command, &recovered);
        assert!(
            code.is_some_and(|code| expected.contains(&code)),
            "{command}: {code:?} {output_text}"
        );
    }
    let (_, output_text) = run_command("report FILE", &recovered);
    for part in [
        "it is recovered from cut.mcap",
        "every number here is computed from the samples",
        "go to (1.000, 0.000, 2.000) m",
        "deployable angle 120.0°",
        "within 1.00° from",
    ] {
        assert!(output_text.contains(part), "{part}: {output_text}");
    }
    let (_, output_text) = run_command("topic info FILE", &recovered);
    assert!(output_text.contains("INCOMPLETE: it is recovered from cut.mcap"), "{output_text}");
}

/// What lies behind damage is not lost; only the commands that would fly it again refuse it.
#[test]
fn around_damage_everything_is_recovered_and_readers_report_the_holes() {
    let flown = fly(&["figure8-morph", "--for", "4s"]);
    let mut bytes = fs::read(flown.recording_path()).expect("the recording");
    // Many bytes: one may decode to the same samples.
    let middle = middle_of_a_chunk(&bytes);
    bytes[middle..middle + 64].iter_mut().for_each(|byte| *byte ^= 0x55);
    let folder = tempfile::tempdir().expect("a folder");
    let damaged = written(folder.path(), "damaged.mcap", &bytes);
    let recovered = folder.path().join("recovered.mcap");
    let output = morphquad(["recover"]).arg(&damaged).arg("--out").arg(&recovered).output();
    let output = output.expect("it starts");
    let stdout = String::from_utf8_lossy(&output.stdout);
    assert_eq!(output.status.code(), Some(0), "{stdout}");
    for part in ["messages up to 4.000 s", "damaged.mcap is damaged near byte", "left out: 1 "] {
        assert!(stdout.contains(part), "{part}: {stdout}");
    }
    for command in COMMANDS {
        let (code, output_text) = run_command(command, &recovered);
        let (expected, part) = match command {
            "report FILE" => (1, "The file has holes: it is recovered from damaged.mcap"),
            "trace FILE" | "report FILE --format json --html OUT" => (1, ""),
            "replay FILE --verify" | "replay FILE --branch @1s" => (USAGE, "missing in the middle"),
            "replay FILE --hash" => continue,
            command if command.starts_with("recover") => (USAGE, "is complete"),
            command if command.starts_with("topic info") => (0, "recovered from damaged.mcap"),
            _ => (0, ""),
        };
        assert_eq!(code, Some(expected), "{command}: {output_text}");
        assert!(output_text.contains(part), "{command}: {output_text}");
    }
}
