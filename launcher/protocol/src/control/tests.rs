//! The launcher's end of the socket against clients that do all they should not.

use super::protocol::{Reason, Reply, Request};
use super::server::{Asked, ControlServer, Limits};
use super::status::RunStatus;
use super::{Refusal, SOCKET};
use runtime::clock::{mono_now_ns, sleep_until};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::fs;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::os::unix::fs::PermissionsExt as _;
use std::os::unix::net::UnixStream;
use std::path::Path;
use tempfile::TempDir;

/// Long enough for anything that should happen at all \[ns\].
const VAIN_NS: u64 = 20_000_000_000;
/// Patience with clients \[ns\].
const SHORT_NS: u64 = 1_000_000_000;

fn server(limits: Limits) -> (TempDir, ControlServer) {
    let folder = TempDir::new().unwrap();
    let server = ControlServer::open(folder.path(), limits).unwrap();
    (folder, server)
}

fn impatient() -> Limits {
    Limits { patience_ns: SHORT_NS, ..Limits::default() }
}

fn connect(folder: &Path) -> BufReader<UnixStream> {
    let stream = UnixStream::connect(folder.join(SOCKET)).unwrap();
    stream.set_read_timeout(Some(core::time::Duration::from_nanos(VAIN_NS))).unwrap();
    BufReader::new(stream)
}

fn send(client: &mut BufReader<UnixStream>, bytes: &[u8]) {
    // A server that has read enough hangs up in the middle of the rest.
    let _ = client.get_mut().write_all(bytes);
}

fn receive(client: &mut BufReader<UnixStream>) -> Option<Reply> {
    let mut line = String::new();
    // A client that has not been let in yet is reset when the server leaves.
    let _ = client.read_line(&mut line);
    (!line.is_empty()).then(|| serde_json::from_str(&line).unwrap())
}

/// The next request that reaches the main loop.
fn asked(server: &ControlServer) -> Asked {
    let until_ns = mono_now_ns() + VAIN_NS;
    loop {
        if let Some(asked) = server.take() {
            return asked;
        }
        assert!(mono_now_ns() < until_ns, "waited in vain for a request");
        sleep_until(mono_now_ns() + 1_000_000);
    }
}

fn status(run: &str) -> Reply {
    Reply::Status(RunStatus {
        run: run.to_owned(),
        scenario: "hover".to_owned(),
        clock: "lockstep".to_owned(),
        started: true,
        flown_s: 0.1 + 0.2,
        end_s: 20.0,
        launcher_pid: 7,
        recording: None,
        processes: Vec::new(),
        slots: Vec::new(),
    })
}

/// The refusal that ends the conversation.
fn last_refusal(client: &mut BufReader<UnixStream>) -> Refusal {
    let Some(Reply::Refused(refusal)) = receive(client) else { panic!("no refusal") };
    // Whatever has not been read makes the end a reset instead of an end of file.
    let mut rest = Vec::new();
    let _ = client.read_to_end(&mut rest);
    assert!(rest.is_empty(), "{rest:?}");
    refusal
}

/// Waits, without reading anything, until the server has closed its end.
fn wait_until_hung_up(client: &BufReader<UnixStream>) {
    let limit = Timespec { tv_sec: i64::try_from(VAIN_NS).unwrap() / 1_000_000_000, tv_nsec: 0 };
    let mut ends = [PollFd::new(client.get_ref(), PollFlags::empty())];
    assert_eq!(poll(&mut ends, Some(&limit)), Ok(1), "the server does not hang up");
    assert!(ends[0].revents().contains(PollFlags::HUP), "{:?}", ends[0].revents());
}

/// Asks and is answered, which shows that the server is well.
fn assert_serves(folder: &Path, server: &ControlServer) {
    let mut client = connect(folder);
    send(&mut client, b"{\"request\":\"ps\"}\n");
    let asked = asked(server);
    assert_eq!(asked.request, Request::Ps);
    asked.answer.send(status("well"));
    assert_eq!(receive(&mut client), Some(status("well")));
}

#[test]
fn the_socket_is_its_users_alone_and_goes_with_the_server() {
    let (folder, server) = server(Limits::default());
    let path = folder.path().join(SOCKET);
    assert_eq!(fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o600);
    let mut waiting = connect(folder.path());
    drop(server);
    assert!(!path.exists());
    assert_eq!(receive(&mut waiting), None);
}

#[test]
fn requests_of_one_client_are_answered_in_turn_and_of_several_in_any_order() {
    let (folder, server) = server(Limits::default());
    let mut first = connect(folder.path());
    let mut second = connect(folder.path());
    // Two lines at once: the second is not looked at before the first is answered.
    send(&mut first, b"{\"request\":\"ps\"}\n{\"request\":\"ps\"}\n");
    let of_first = asked(&server);
    send(&mut second, b"{\"request\":\"ps\"}\n");
    let of_second = asked(&server);
    of_second.answer.send(status("second"));
    assert_eq!(receive(&mut second), Some(status("second")));
    of_first.answer.send(status("first"));
    assert_eq!(receive(&mut first), Some(status("first")));
    asked(&server).answer.send(status("again"));
    assert_eq!(receive(&mut first), Some(status("again")));
}

#[test]
fn a_client_that_closes_its_half_after_its_request_still_gets_its_answer() {
    let (folder, server) = server(Limits::default());
    let mut client = connect(folder.path());
    send(&mut client, b"{\"request\":\"ps\"}\n");
    client.get_ref().shutdown(std::net::Shutdown::Write).unwrap();
    asked(&server).answer.send(status("late"));
    assert_eq!(receive(&mut client), Some(status("late")));
    assert_eq!(receive(&mut client), None);
}

#[test]
fn garbage_is_refused_with_what_is_wrong_and_the_next_client_is_served() {
    let (folder, server) = server(Limits::default());
    let garbage: [&[u8]; 7] = [
        b"\n",
        b"hello\n",
        b"\xff\xfe\x00\n",
        b"{\"request\":\"explode\"}\n",
        b"{\"request\":7}\n",
        b"[[[[[[[[[[[[[[[[[[[[[[\n",
        b"{\"request\":\"ps\"} and more\n",
    ];
    for bytes in garbage {
        let mut client = connect(folder.path());
        send(&mut client, bytes);
        let refusal = last_refusal(&mut client);
        assert_eq!((refusal.reason, refusal.exit_code), (Reason::BadRequest, 2));
        assert!(refusal.text.contains("not a request"), "{refusal}");
        assert!(refusal.text.contains(r#"{"request":"ps"}"#), "{refusal}");
    }
    let mut client = connect(folder.path());
    send(&mut client, b"{\"request\":\"ps\"}");
    client.get_ref().shutdown(std::net::Shutdown::Write).unwrap();
    assert!(last_refusal(&mut client).text.contains("line feed"));
    assert!(server.take().is_none());
    assert_serves(folder.path(), &server);
}

#[test]
fn a_request_beyond_the_bound_is_refused_however_it_comes() {
    let limits = Limits { request_bytes: 100, ..Limits::default() };
    let (folder, server) = server(limits);
    let padded = |length: usize| {
        let mut line = b"{\"request\":\"ps\"}".to_vec();
        line.resize(length, b' ');
        line
    };
    let flood = vec![b'x'; 1_000_000];
    for tail in [&b""[..], b"\n", &flood] {
        let mut client = connect(folder.path());
        send(&mut client, &padded(101));
        send(&mut client, tail);
        let refusal = last_refusal(&mut client);
        assert!(refusal.text.contains("at most 100 bytes"), "{refusal}");
    }
    let mut client = connect(folder.path());
    send(&mut client, &padded(100));
    send(&mut client, b"\n");
    asked(&server).answer.send(status("just"));
    assert_eq!(receive(&mut client), Some(status("just")));
}

#[test]
fn a_client_that_stalls_within_a_request_is_dropped_and_blocks_no_other() {
    let (folder, server) = server(impatient());
    let mut stalled = connect(folder.path());
    let mut silent = connect(folder.path());
    send(&mut stalled, b"{\"requ");
    assert_serves(folder.path(), &server);
    for client in [&mut stalled, &mut silent] {
        let refusal = last_refusal(client);
        assert!(refusal.text.contains("no whole request within 1 s"), "{refusal}");
    }
    assert_serves(folder.path(), &server);
}

#[test]
fn a_launcher_that_takes_its_time_exhausts_no_patience() {
    let (folder, server) = server(impatient());
    let mut client = connect(folder.path());
    send(&mut client, b"{\"request\":\"ps\"}\n");
    let asked = asked(&server);
    sleep_until(mono_now_ns() + 2 * SHORT_NS);
    asked.answer.send(status("slow"));
    assert_eq!(receive(&mut client), Some(status("slow")));
}

#[test]
fn a_client_that_does_not_read_is_dropped_and_one_that_has_gone_is_forgotten() {
    let limits = Limits { unread_bytes: 1 << 20, ..impatient() };
    let (folder, server) = server(limits);
    let mut deaf = connect(folder.path());
    let long = status(&"x".repeat(900_000));
    send(&mut deaf, b"{\"request\":\"ps\"}\n");
    asked(&server).answer.send(long.clone());
    let mut gone = connect(folder.path());
    send(&mut gone, b"{\"request\":\"ps\"}\n");
    let to_gone = asked(&server).answer;
    drop(gone);
    to_gone.send(long);
    assert_serves(folder.path(), &server);
    wait_until_hung_up(&deaf);
    let mut received = Vec::new();
    let _ = deaf.read_to_end(&mut received);
    assert!(!received.is_empty() && received.len() < 900_000, "{} bytes", received.len());
    assert_serves(folder.path(), &server);
}

#[test]
fn one_client_too_many_is_refused_and_has_room_once_another_leaves() {
    let limits = Limits { clients: 2, idle_ns: u64::MAX, ..Limits::default() };
    let (folder, server) = server(limits);
    let first = connect(folder.path());
    let _second = connect(folder.path());
    let refusal = last_refusal(&mut connect(folder.path()));
    assert_eq!((refusal.reason, refusal.exit_code), (Reason::TooMany, 3));
    drop(first);
    assert_serves(folder.path(), &server);
}

#[test]
fn a_silent_client_makes_room_for_one_that_asks() {
    let limits = Limits { clients: 2, idle_ns: 0, ..Limits::default() };
    let (folder, server) = server(limits);
    let mut busy = connect(folder.path());
    send(&mut busy, b"{\"request\":\"ps\"}\n");
    let to_busy = asked(&server).answer;
    let mut silent = connect(folder.path());
    assert_serves(folder.path(), &server);
    wait_until_hung_up(&silent);
    assert_eq!(last_refusal(&mut silent).reason, Reason::TooMany);
    to_busy.send(status("hover"));
    assert!(matches!(receive(&mut busy), Some(Reply::Status(_))));
}
