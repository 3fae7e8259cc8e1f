//! The page of a flight: what stands in it is what the recording has, and no bad file gets a page.
//! What a browser makes of it is tested by `.ci/page`.

use crate::common::{fly, morphquad};
use serde_json::Value;
use std::fs;
use std::io::{Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::Output;

fn view(file: &Path, arguments: &[&str]) -> Output {
    morphquad(["view"]).arg(file).args(arguments).output().expect("the executable starts")
}

/// The page's text, and the flight in it.
fn page_of(recording: &Path, folder: &Path) -> (String, Value) {
    let out = folder.join("page.html");
    let output = view(recording, &["--out", &out.display().to_string()]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let page = fs::read_to_string(out).expect("the page is written");
    let (_, rest) = page.split_once("type=\"application/json\">").expect("the flight's element");
    let (flight, _) = rest.split_once("</script>").expect("its end");
    let flight = serde_json::from_str(flight).expect("JSON");
    (page, flight)
}

/// Numbers as `launcher/viewers/assets/data.js` reads them.
fn numbers(letters: &Value) -> Vec<f32> {
    const ALPHABET: &[u8] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let letters = letters.as_str().expect("letters").trim_end_matches('=');
    let bits = letters.bytes().flat_map(|letter| {
        let place = ALPHABET.iter().position(|known| *known == letter).expect("in the alphabet");
        (0..6).rev().map(move |bit| u8::try_from(place >> bit & 1).expect("a bit"))
    });
    let bits: Vec<u8> = bits.collect();
    let bytes: Vec<u8> =
        bits.chunks_exact(8).map(|byte| byte.iter().fold(0, |sum, bit| sum << 1 | bit)).collect();
    let four = |four: &[u8]| f32::from_le_bytes([four[0], four[1], four[2], four[3]]);
    bytes.chunks_exact(4).map(four).collect()
}

fn series<'a>(flight: &'a Value, chart: &str, name: &str) -> &'a Value {
    let find = |list: &'a Value, key: &str, wanted: &str| {
        let mut list = list.as_array().expect("a list").iter();
        list.find(|one| one[key] == wanted).unwrap_or_else(|| panic!("no {wanted}"))
    };
    find(&find(&flight["charts"], "title", chart)["series"], "name", name)
}

#[test]
fn the_page_holds_what_the_recording_has_and_loads_nothing() {
    let swap = ["--swap", "attitude=attitude-lqr@1s,shadow=1s,rollback=0.5s"];
    let flown = fly(&[&["figure8-morph", "--for", "4s"], &swap[..]].concat());
    let folder = tempfile::tempdir().expect("a folder");
    let (page, flight) = page_of(&flown.recording_path(), folder.path());
    for foreign in ["http://", "https://", "src=", "@import", "<!--", "url("] {
        let outside = page.split("type=\"application/json\">").next().expect("the head");
        assert!(!outside.contains(foreign), "{foreign}");
    }
    let recorded = flown.recording().series("truth", &["morph_angle_rad"]);
    let beta = numbers(&series(&flight, "Deployable angle β", "β")["least"]);
    assert_eq!(beta.len(), recorded.len());
    for (shown, row) in beta.iter().zip(&recorded) {
        let exact = row.values[0].to_degrees();
        assert!((f64::from(*shown) - exact).abs() < 1e-4, "{shown} is not {exact}");
    }
    let max = flown.number("position_max_m");
    let errors: Vec<Vec<f32>> = ["x", "y", "z"]
        .map(|axis| numbers(&series(&flight, "Position error", axis)["least"]))
        .to_vec();
    let square = |value: f32| f64::from(value) * f64::from(value);
    let norm = |i: usize| errors.iter().map(|axis| square(axis[i])).sum::<f64>().sqrt();
    let worst = (0..errors[0].len()).map(norm).fold(0.0, f64::max);
    assert!((worst * 1e-3 - max).abs() < 1e-5, "{worst} mm, {max} m");
    let events = flight["events"].as_array().expect("events");
    let flips = events.iter().filter(|event| event["kind"] == "swap" && event["is_mark"] == true);
    let flips: Vec<f64> = flips.map(|flip| flip["at_s"].as_f64().expect("a time")).collect();
    assert_eq!(flips.len(), 1, "{events:?}");
    assert!((2.0..2.1).contains(&flips[0]), "{flips:?}");
    assert_eq!(flight["outcome"]["is_good"], true, "{}", flight["outcome"]);
}

#[test]
fn a_cut_file_is_shown_as_far_as_it_goes_and_marked_as_cut() {
    let flown = fly(&["hover", "--for", "3s"]);
    let folder = tempfile::tempdir().expect("a folder");
    let bytes = fs::read(flown.recording_path()).expect("the recording");
    let cut = folder.path().join("cut.mcap");
    fs::write(&cut, &bytes[..bytes.len() * 2 / 3]).expect("a disk with room");
    let (_, flight) = page_of(&cut, folder.path());
    assert_eq!(flight["outcome"]["is_good"], false);
    let outcome = flight["outcome"]["text"].as_str().expect("a sentence");
    assert!(outcome.contains("the file ends at") && outcome.contains("it is cut"), "{outcome}");
    let to_s = flight["to_s"].as_f64().expect("a time");
    assert!(to_s > 0.5 && to_s < 2.9, "{to_s}");
}

#[test]
fn what_is_no_recording_is_named_with_the_remedy_and_gets_no_page() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("page.html");
    let write = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        fs::write(&path, bytes).expect("a disk with room");
        path
    };
    let bad = [
        (write("empty.mcap", b""), "empty"),
        (write("text.mcap", b"not a recording at all\n"), "no morphquad recording"),
        (write("magic.mcap", b"\x89MCAP0\r\n"), "cut in its head"),
        (folder.path().join("none.mcap"), "cannot read"),
        (folder.path().to_owned(), "not a file but a folder"),
    ];
    for (path, expected) in bad {
        let output = view(&path, &["--out", &out.display().to_string()]);
        let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{stderr}");
        assert!(
            stderr.contains(expected) && stderr.contains(&*path.display().to_string()),
            "{stderr}"
        );
        assert!(!out.exists());
    }
}

#[test]
fn a_command_that_names_no_flight_lists_which_there_are() {
    let folder = tempfile::tempdir().expect("a folder");
    let recordings = folder.path().join("recordings");
    fs::create_dir(&recordings).expect("room");
    fs::write(recordings.join("7f3a55.mcap"), b"").expect("room");
    fs::write(folder.path().join("mine.toml"), "[scenario]\nname = \"mine\"\n").expect("room");
    for (named, expected) in [
        ("unknown", &["recordings here: recordings/7f3a55.mcap", "`figure8-morph`"][..]),
        ("none.toml", &["recordings here: recordings/7f3a55.mcap", "`figure8-morph`"]),
        ("hovver", &["did you mean `hover`?"]),
        ("7f3a", &["recordings/7f3a55.mcap"]),
        ("latest", &["recordings/7f3a55.mcap"]),
        ("recordings", &["recordings in it: recordings/7f3a55.mcap"]),
        ("mine.toml", &["`morphquad run mine.toml`"]),
    ] {
        let output = morphquad(["view", named, "--no-open"]).current_dir(folder.path()).output();
        let output = output.expect("the executable starts");
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{named}: {stderr}");
        for part in expected {
            assert!(stderr.contains(part), "{named}: no `{part}` in: {stderr}");
        }
        let is_found = ["7f3a", "latest"].contains(&named);
        assert!(!(is_found && stderr.contains("did you mean")), "{named}: {stderr}");
    }
}

#[test]
fn the_page_is_served_to_this_machine_alone_until_it_is_stopped() {
    let flown = fly(&["hover", "--for", "1s"]);
    let taken = TcpListener::bind("127.0.0.1:0").expect("a free port");
    let port = taken.local_addr().expect("an address").port();
    let refused = view(&flown.recording_path(), &["--port", &port.to_string(), "--no-open"]);
    let stderr = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert_eq!(refused.status.code(), Some(2), "{stderr}");
    assert!(stderr.contains(&port.to_string()) && stderr.contains("--port"), "{stderr}");

    let mut server = morphquad(["view", "--no-open"])
        .arg(flown.recording_path())
        .spawn()
        .expect("the executable starts");
    let mut line = [0; 64];
    let read = server.stdout.as_mut().expect("a pipe").read(&mut line).expect("an address");
    let line = String::from_utf8_lossy(&line[..read]).into_owned();
    let address = line.split(['/', ' ']).nth(2).expect("host and port").to_owned();
    let ask = |host: &str, request: &str| {
        let mut stream = TcpStream::connect(&address).expect("the server listens");
        let head = format!("{request} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n");
        stream.write_all(head.as_bytes()).expect("the server reads");
        let mut answer = String::new();
        stream.read_to_string(&mut answer).expect("the server answers");
        answer
    };
    let page = ask(&address, "GET /");
    assert!(page.starts_with("HTTP/1.1 200") && page.contains("id=\"flight\""), "{page:.200}");
    assert!(ask(&address, "GET /other").starts_with("HTTP/1.1 404"));
    assert!(ask(&address, "POST /").starts_with("HTTP/1.1 405"));
    assert!(ask("somewhere.example", "GET /").starts_with("HTTP/1.1 403"));
    let pid = rustix::process::Pid::from_child(&server);
    rustix::process::kill_process(pid, rustix::process::Signal::INT).expect("it is ours");
    assert_eq!(server.wait().expect("it ends").code(), Some(0));
}

#[test]
fn a_page_never_replaces_a_recording() {
    let flown = fly(&["hover", "--for", "500ms"]);
    let path = flown.recording_path();
    let before = std::fs::read(&path).expect("the recording");
    let file = path.to_str().expect("text");
    for arguments in [["view", file, "--out", file], ["report", file, "--html", file]] {
        let output = morphquad(arguments).output().expect("it starts");
        let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{stderr}");
        assert!(stderr.contains(file) && stderr.contains("is a recording"), "{stderr}");
    }
    assert!(std::fs::read(&path).expect("the recording") == before);
}
