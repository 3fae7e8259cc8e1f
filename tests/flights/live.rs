//! `run --live` and `live`: what viewers see and may do, and that the flight does not notice them. The page itself
//! is driven by `.ci/page`, the WebSocket by an independent client in `.ci/live`.

mod client;

use crate::common::held::{Held, fly_released};
use crate::common::processes::{Running, kill, left_in_shared_memory, make_executable};
use crate::common::time::wait_until;
use crate::common::{fly, judged, morphquad};
use client::{Live, flood_with_pings, stalling_viewer};
use rustix::process::Signal;
use serde_json::{Value, json};
use std::io::Write as _;
use std::net::{TcpListener, TcpStream};
use std::os::unix::process::CommandExt as _;
use std::process::Command;

#[test]
fn viewers_that_stall_or_order_nothing_leave_the_flight_as_it_is_unseen() {
    let flight = ["hover", "--for", "20s"];
    // It waits until all of them are there.
    let held = Held::start(&[&flight[..], &["--speed", "2"]].concat(), "1s");
    let live = Live::beside(held.running.id());
    let _stalling = stalling_viewer(&live.socket);
    // Asks for everything, again and again, and never reads an answer.
    let _deaf: Vec<TcpStream> = (0..40)
        .map(|_| {
            let mut stream = TcpStream::connect(&live.page).expect("the page listens");
            let ask = format!("GET /flight HTTP/1.1\r\nHost: {}\r\n\r\n", live.page);
            stream.write_all(ask.repeat(20).as_bytes()).expect("it reads");
            stream
        })
        .collect();
    let (code, body) = live.order("not-the-token", r#"{"request":"stop"}"#);
    assert_eq!(code, 403, "{body}");
    let flown = held.release();
    flown.assert_clean();
    assert_eq!(flown.hash(), fly_released(&flight, "1s").hash());
    wait_until("nothing is left", || left_in_shared_memory(flown.text("run")).is_empty());
}

#[test]
fn a_viewer_that_only_sends_pings_costs_bounded_memory_and_a_restart() {
    let mut running = Running::start_and_fly(&["hover", "--for", "600s", "--speed", "1"]);
    let mut live = Live::beside(running.id());
    let before = live.flight("");
    flood_with_pings(stalling_viewer(&live.socket));
    // The same process, at the same addresses and with the same token.
    wait_until("the page", || live.answers());
    assert!(live.child.try_wait().expect("a child").is_none());
    let after = live.flight("");
    assert_eq!(after["live"]["run"], before["live"]["run"]);
    assert_ne!(after["server"], before["server"], "a page that is open asks for everything");
    let (code, body) = live.order(&live.token, r#"{"request":"ps"}"#);
    assert_eq!(code, 200, "{body}");
    drop(stalling_viewer(&live.socket));
    assert!(peak_mb(live.child.id()) < 100, "the new one holds little");
    assert!(kill(running.launcher_pid(), Signal::INT));
    assert_eq!(running.wait().code, Some(130));
}

/// Most memory that a process has held since it began as this executable \[MB\].
fn peak_mb(pid: u32) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).expect("it is there");
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).expect("a peak");
    let kb: u64 = line.trim().trim_end_matches(" kB").parse().expect("a number");
    kb / 1024
}

/// The replies to a button of a demo.
fn tried(live: &Live, what: &str) -> Vec<Value> {
    let (code, body) = live.post("/demo", &live.token, what);
    assert_eq!(code, 200, "{body}");
    let answer: Value = serde_json::from_str(&body).expect("JSON");
    answer["replies"].as_array().expect("a list").clone()
}

/// The process that commands the attitude, as its launcher reports it; nothing while there is none.
fn owner(live: &Live) -> Value {
    let (code, body) = live.order(&live.token, r#"{"request":"ps"}"#);
    assert_eq!(code, 200, "{body}");
    let answer: Value = serde_json::from_str(&body).expect("JSON");
    let processes = answer["replies"][0]["processes"].as_array().cloned().unwrap_or_default();
    let is_owner = |it: &Value| it["role"] == "attitude" && it["state"] == "owner";
    processes.into_iter().find(is_owner).unwrap_or_default()
}

#[test]
fn a_demo_refuses_a_bad_controller_shows_why_and_survives_the_death_of_a_good_one() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut command = morphquad(["demo", "--no-open", "--listen", "127.0.0.1:0", "--for", "600s"]);
    command.args(judged(&[])).current_dir(folder.path());
    let child = command.spawn().expect("it starts");
    let (mut live, stderr) = Live::of(child);
    assert!(live.get("/").1.contains("\"demo\":true"));
    for (token, what, code) in [("wrong", "bad", 403), (&live.token, "worse", 400)] {
        assert_eq!(live.post("/demo", token, what).0, code, "{what}");
    }
    wait_until("the flight has begun", || owner(&live)["mark_s"].as_f64() > Some(1.0));
    let replies = tried(&live, "bad");
    let lost = replies.iter().find(|reply| reply["step"] == "fails");
    let lost = lost.unwrap_or_else(|| panic!("{replies:?}"));
    let course = lost["course"].as_array().expect("a course");
    let height_m = |posture: &Value| posture[3].as_f64().expect("a height");
    assert!(course.len() > 5 && course.iter().all(|posture| height_m(posture) > -0.1), "{lost}");
    let last = replies.last().expect("a last word");
    assert_eq!(
        (&last["reply"], &last["reason"]),
        (&json!("refused"), &json!("rehearsal")),
        "{last}"
    );
    let killed = tried(&live, "kill");
    assert_eq!(killed[0]["outcome"], "killed", "{killed:?}");
    wait_until("its successor commands", || owner(&live)["generation"] == 1);
    let (code, body) = live.order(&live.token, r#"{"request":"stop"}"#);
    assert_eq!(code, 200, "{body}");
    let ended = live.child.wait().expect("it ends");
    let stderr = stderr.join().expect("its output");
    assert_eq!(ended.code(), Some(130), "{stderr}");
    let recordings = std::fs::read_dir(folder.path().join("recordings")).expect("a folder");
    assert_eq!(recordings.count(), 1);
}

#[test]
fn a_page_gets_everything_then_what_is_new_and_at_last_the_end() {
    let mut running = Running::start_and_fly(&["hover", "--for", "600s", "--speed", "2"]);
    let live = Live::beside(running.id());
    let (code, page) = live.get("/");
    assert!(code == 200 && page.contains("connect-src 'self'"), "{code}");
    assert!(!page.contains(&live.token), "only the address has the token");
    for (path, code) in
        [("/none", 404), ("/control", 405), ("/demo", 405), ("/flight?since_s=x", 400)]
    {
        assert_eq!(live.get(path).0, code, "{path}");
    }
    let mut whole = Value::Null;
    wait_until("something is flown", || {
        whole = live.flight("");
        whole["to_s"].as_f64() > whole["from_s"].as_f64().map(|from_s| from_s + 2.0)
    });
    assert_eq!((&whole["format"], &whole["is_over"]), (&json!(1), &json!(false)));
    let charts = whole["charts"].as_array().expect("charts").len();
    let to_s = whole["to_s"].as_f64().expect("a time");
    let mut news = Value::Null;
    wait_until("more is flown", || {
        news = live.flight(&format!("?since_s={to_s}&events=0"));
        news["to_s"].as_f64() > Some(to_s + 1.0)
    });
    let count = |flight: &Value, key: &str| flight["frames"][key].as_u64().expect("a count");
    // A second before what is known is sent again, in frames of 10 ms.
    let (first, known) = (count(&news, "first"), count(&whole, "count"));
    assert!(first > 0 && first <= known && known - first <= 101, "{first} of {known}");
    assert_eq!(news["charts"].as_array().map(Vec::len), Some(charts));
    let height = news["charts"][0]["series"][0]["first"].as_u64();
    assert!(height > Some(0), "{height:?}");
    wait_until("the launcher is asked who flies", || {
        let status = &live.flight("?since_s=1e9")["status"];
        status["processes"].as_array().is_some_and(|processes| processes.len() == 7)
    });
    assert!(kill(running.launcher_pid(), Signal::INT));
    let mut last = Value::Null;
    wait_until("the end is reported", || {
        // Without what is known by now.
        last = live.flight("?since_s=1e9");
        last["is_over"] == true
    });
    let flown = running.wait();
    flown.assert_undisturbed();
    assert!(flown.text("line").starts_with("INCOMPLETE  hover: "), "{}", flown.output_text());
    assert_eq!(last["outcome"], json!({ "is_good": false, "text": flown.text("line") }));
}

#[test]
fn a_client_that_has_the_token_orders_and_no_other() {
    let mut running = Running::start_and_fly(&["hover", "--for", "60s", "--speed", "2"]);
    let live = Live::beside(running.id());
    let stop = r#"{"request":"stop"}"#;
    for token in ["", "0", &live.token[..31], &live.token.to_uppercase().repeat(2)] {
        let (code, body) = live.order(token, stop);
        assert!(code == 403 && body.contains("token"), "{token}: {body}");
    }
    let foreign = format!(
        "POST /control HTTP/1.1\r\nHost: evil.example\r\nAuthorization: Bearer {}\r\n\
         Content-Length: {}\r\nConnection: close\r\n\r\n{stop}",
        live.token,
        stop.len()
    );
    assert_eq!(live.ask(&foreign).0, 403, "a page elsewhere that has given its name our address");
    for (garbage, expected) in [
        ("{}", "not an order"),
        (r#"{"request":"swap","slot":"attitude","to":"/bin/sh"}"#, "by name"),
        (&"x".repeat(20_000), "at most"),
    ] {
        let (code, text) = live.order(&live.token, garbage);
        assert!(code == 400 && text.contains(expected), "{text}");
    }
    let replies = |body: &str| -> Value {
        let (code, text) = live.order(&live.token, body);
        assert_eq!(code, 200, "{text}");
        serde_json::from_str::<Value>(&text).expect("JSON")["replies"].take()
    };
    let morph = r#"{"request":"order","order":{"morph":{"angle_deg":150.0,"over_s":1.0}}}"#;
    assert_eq!(replies(morph)[0]["reply"], "ordered");
    let refused = replies(r#"{"request":"order","order":{"morph":{"angle_deg":500.0}}}"#);
    assert_eq!(refused[0]["reply"], "refused", "{refused}");
    let swap = r#"{"request":"swap","slot":"attitude","to":"attitude-lqr","shadow_ns":500000000}"#;
    let swapped = replies(swap);
    let last = swapped.as_array().and_then(|replies| replies.last()).expect("a reply");
    assert_eq!(
        (&last["reply"], &last["outcome"]),
        (&json!("done"), &json!("swapped")),
        "{swapped}"
    );
    wait_until("the new owner is reported", || {
        let owner = &live.flight("?since_s=0")["status"]["slots"][0]["owner"];
        owner.as_str().is_some_and(|owner| owner.starts_with("attitude-lqr"))
    });
    // Events come on another way than the status, by which they may be overtaken.
    wait_until("the swap and the order are events", || {
        let flight = live.flight("");
        let events = flight["events"].as_array().expect("events");
        let is_swap = |event: &Value| event["kind"] == "swap" && event["is_mark"] == true;
        events.iter().any(is_swap) && events.iter().any(|event| event["kind"] == "order")
    });
    assert_eq!(replies(stop)[0]["outcome"], "stopping");
    let flown = running.wait();
    assert_eq!(flown.code, Some(130), "{}", flown.output_text());
    assert_eq!(flown.summary()["missed_ticks"], 0);
}

#[test]
fn a_port_that_is_taken_ends_the_run_before_it_begins() {
    let taken = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = taken.local_addr().expect("an address").to_string();
    let live = format!("--live={address}");
    let flown = fly(&["hover", "--for", "1s", &live, "--no-open"]);
    assert_eq!(flown.code, Some(2), "{}", flown.output_text());
    assert!(
        flown.stderr.contains(&address) && flown.stderr.contains("--live="),
        "{}",
        flown.stderr
    );
    for (bad, expected) in [
        (["hover", "--live=elsewhere:8765"], "127.0.0.1:8765"),
        (["hover", "--no-open"], "--live"),
        (["--live", "8765"], "--live=8765"),
    ] {
        let output = morphquad([&["run"], &bad[..]].concat()).output().expect("it starts");
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() == Some(2) && stderr.contains(expected), "{bad:?}: {stderr}");
    }
    let none = morphquad(["live", "--run", "no-such-run"]).output().expect("it starts");
    assert_eq!(none.status.code(), Some(2));
}

#[test]
fn a_live_run_has_the_pace_of_the_clock_and_the_hash_of_any_other() {
    let flown = fly(&["hover", "--for", "1s", "--live=127.0.0.1:0", "--no-open"]);
    flown.assert_clean();
    assert!(flown.stderr.contains("live  http://127.0.0.1:"), "{}", flown.stderr);
    assert!(flown.stderr.contains("live  ws://127.0.0.1:"), "{}", flown.stderr);
    assert!(flown.number("real_time_factor") < 1.2, "{}", flown.output_text());
    assert_eq!(flown.hash(), fly(&["hover", "--for", "1s", "--no-record"]).hash());
}

#[test]
fn a_live_run_is_as_fast_as_can_be_only_if_asked_and_prints_what_follows() {
    let fast = ["--live=localhost:0", "--no-open", "--speed", "max"];
    let flown = fly(&[&["hover", "--for", "60s"][..], &fast].concat());
    flown.assert_clean();
    assert!(flown.stderr.contains("may be over before its page is open"), "{}", flown.stderr);
    // A second or two, of which a busy machine may make ten. At the clock's pace it would be a minute.
    assert!(flown.number("real_time_factor") > 1.2, "{}", flown.output_text());
}

/// A folder for PATH with `env` alone, through which the tests start everything.
fn nearly_empty_path() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    std::os::unix::fs::symlink("/usr/bin/env", folder.path().join("env")).expect("room");
    folder
}

#[test]
fn a_browser_is_started_with_an_address_that_is_of_no_use_to_another_user() {
    const OTHER: u32 = 65534;
    let folder = nearly_empty_path();
    let opened = folder.path().join("opened");
    let browser =
        format!("#!/bin/sh\necho \"$1\" >{0}.new && /bin/mv {0}.new {0}\n", opened.display());
    make_executable(&folder.path().join("xdg-open"), browser.as_bytes());
    let arguments = ["run", "hover", "--for", "600s", "--no-record", "--live=127.0.0.1:0"];
    let mut run = morphquad(arguments);
    run.args(judged(&[])).env("DISPLAY", ":99").env("PATH", folder.path());
    let (mut live, stderr) = Live::of(run.spawn().expect("the executable starts"));
    wait_until("the browser is started", || opened.exists());
    let address = std::fs::read_to_string(&opened).expect("an address");
    assert!(!address.contains(&live.token), "{address}");
    let (page, token) = (live.page.clone(), live.token.clone());
    let path = address.trim().strip_prefix(&format!("http://{page}")).expect("the page's server");
    let answer = |path: &str, user: Option<u32>| {
        let (host, port) = page.split_once(':').expect("a port");
        let script = format!(
            "exec 3<>/dev/tcp/{host}/{port}; \
             printf 'GET {path} HTTP/1.1\\r\\nHost: {page}\\r\\nConnection: close\\r\\n\\r\\n' >&3; cat <&3"
        );
        let mut shell = Command::new("bash");
        shell.args(["-c", &script]);
        if let Some(user) = user {
            shell.uid(user);
        }
        String::from_utf8(shell.output().expect("a shell").stdout).expect("text")
    };
    let own = answer(path, None);
    assert!(own.starts_with("HTTP/1.1 303") && own.contains(&format!("/#token={token}")), "{own}");
    let mut refused = vec![answer(&format!("{path}0"), None)];
    // Where the tests run as root, they can ask as another user.
    if rustix::process::geteuid().is_root() {
        refused.push(answer(path, Some(OTHER)));
    }
    for answer in refused {
        assert!(answer.starts_with("HTTP/1.1 403") && !answer.contains(&token), "{answer}");
    }
    assert_eq!(live.order(&token, r#"{"request":"stop"}"#).0, 200);
    live.child.wait().expect("it ends");
    stderr.join().expect("its output");
}

#[test]
fn a_stop_that_comes_before_the_flight_has_started_is_answered() {
    let arguments =
        ["run", "hover", "--for", "600s", "--no-record", "--live=127.0.0.1:0", "--no-open"];
    let (mut live, stderr) = Live::of(morphquad(arguments).spawn().expect("the executable starts"));
    // Its address is printed before its processes are started.
    assert_eq!(live.order(&live.token, r#"{"request":"stop"}"#).0, 200);
    assert_eq!(live.child.wait().expect("it ends").code(), Some(130));
    stderr.join().expect("its output");
}

#[test]
fn a_page_on_all_addresses_is_found_and_a_missing_browser_is_reported() {
    let mut run = morphquad(["run", "hover", "--for", "1s", "--no-record", "--live=0.0.0.0:0"]);
    // A screen, and nothing that could open a browser on it.
    let folder = nearly_empty_path();
    let output = run.args(judged(&[])).env("DISPLAY", ":99").env("PATH", folder.path()).output();
    let output = output.expect("the executable starts");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{stderr}");
    assert!(stderr.contains("all who reach this address can watch"), "{stderr}");
    for address in stderr.lines().filter_map(|line| line.split_once("on other machines  ")) {
        let named = address.1.contains("127.0.0.1") || address.1.contains("0.0.0.0");
        assert!(!named, "{stderr}");
    }
    let opened = stderr.lines().find(|line| line.contains("no browser could be started"));
    assert!(opened.is_some_and(|line| line.contains("http://127.0.0.1:")), "{stderr}");
    assert!(opened.is_some_and(|line| line.contains("/#token=")), "{stderr}");
}
