//! Both ends of the feed, on a socket of their own.

use super::feed::{Ending, Feed, Flying};
use super::live::{Listening, Message};
use super::{SOCKET, header, known, place, schema, unpack};
use crate::control::runs::Run;
use core::time::Duration;
use record::{Event, Severity, decode_log};
use runtime::clock::mono_now_ns;
use shared_types::{Header, Imu, Truth, topics};
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::os::unix::net::UnixStream;

const MOMENT: Duration = Duration::from_millis(20);

fn imu(sequence: u64) -> Imu {
    let header = Header { sequence, release_ns: sequence * 1000, ..Header::default() };
    Imu { header, ..Imu::default() }
}

struct Flight {
    folder: tempfile::TempDir,
    feed: Feed,
}

impl Flight {
    fn new() -> Self {
        let folder = tempfile::TempDir::new().unwrap();
        let feed = Feed::open(folder.path(), Flying::default()).unwrap();
        Self { folder, feed }
    }

    fn run(&self) -> Run {
        Run::at("x", self.folder.path())
    }

    fn listen(&self, names: &[&str]) -> Listening {
        let topics: Vec<_> = names.iter().map(|name| known(name).unwrap()).collect();
        Listening::to(&self.run(), &topics, false).unwrap()
    }
}

/// The next sample's topic and sequence.
fn next(listening: &mut Listening) -> (&'static str, u64) {
    for _ in 0..500 {
        match listening.next(MOMENT).unwrap() {
            Message::Sample(topic, packed) => {
                return (topic.name, header(&packed).unwrap().sequence);
            }
            Message::Nothing => {}
            word => panic!("{word:?}"),
        }
    }
    panic!("nothing came");
}

#[test]
fn a_listener_gets_the_topics_asked_for_in_order_and_nothing_else() {
    let flight = Flight::new();
    // No client listens: nothing is kept.
    flight.feed.offer(&topics::IMU, &imu(1));
    let (mut one, mut both) = (flight.listen(&["imu"]), flight.listen(&["truth", "imu"]));
    flight.feed.offer(&topics::IMU, &imu(2));
    flight.feed.offer(&topics::TRUTH, &Truth::default());
    flight.feed.offer(&topics::IMU, &imu(3));
    assert_eq!([next(&mut one), next(&mut one)], [("imu", 2), ("imu", 3)]);
    let received = [next(&mut both), next(&mut both), next(&mut both)];
    assert_eq!(received, [("imu", 2), ("truth", 0), ("imu", 3)]);
    assert!(matches!(one.next(MOMENT).unwrap(), Message::Nothing));
    drop(flight.feed);
    assert!(matches!(one.next(MOMENT).unwrap(), Message::Over));
    assert!(!flight.folder.path().join(SOCKET).exists());
}

#[test]
fn a_slow_client_loses_samples_gets_their_number_and_holds_up_no_other() {
    let flight = Flight::new();
    let mut slow = flight.listen(&["reference"]);
    let (sent, mut got, mut dropped) = (20_000, 0, 0);
    for _ in 0..sent {
        flight.feed.offer(&topics::REFERENCE, &shared_types::Reference::default());
    }
    while got + dropped < sent {
        match slow.next(Duration::from_secs(5)).unwrap() {
            Message::Sample(..) => got += 1,
            Message::Dropped(count) => dropped += count,
            word => panic!("{word:?} after {got} and {dropped} of {sent}"),
        }
    }
    assert!(dropped > 0, "a buffer without end");
    assert_eq!(got + dropped, sent);
}

#[test]
fn an_event_reaches_a_listener_that_has_lost_samples_by_then() {
    let flight = Flight::new();
    let mut slow = Listening::to_everything(&flight.run()).unwrap();
    // More than socket, buffer and queue hold, with an event now and then.
    let (rounds, mut events, mut dropped) = (60, 0, 0);
    // Longer than a sample, for which there may be room where there is none for it.
    let text = "gust ".repeat(200);
    for _ in 0..rounds {
        for sequence in 0..2000 {
            flight.feed.offer(&topics::IMU, &imu(sequence));
        }
        let (severity, source, text) = (Severity::Warning, "s", text.as_str());
        flight.feed.publish(&Event { logical_ns: 1, severity, source, text });
    }
    while events < rounds || dropped == 0 {
        match slow.next(Duration::from_secs(5)).unwrap() {
            Message::Log(_) => events += 1,
            Message::Dropped(count) => dropped += count,
            Message::Sample(..) => {}
            word => panic!("{word:?} after {events} of {rounds} and {dropped} dropped"),
        }
    }
}

#[test]
fn the_end_reaches_a_listener_that_is_far_behind_when_the_flight_is_over() {
    let flight = Flight::new();
    let mut slow = Listening::to_everything(&flight.run()).unwrap();
    // More than socket and buffer hold.
    for _ in 0..20_000 {
        flight.feed.offer(&topics::REFERENCE, &shared_types::Reference::default());
    }
    let ending = Ending { is_good: true, text: "flown".to_owned() };
    flight.feed.end(&ending);
    let closing = std::thread::spawn(move || drop(flight));
    let last = loop {
        match slow.next(Duration::from_secs(5)).unwrap() {
            Message::Sample(..) | Message::Dropped(_) => {}
            word => break word,
        }
    };
    assert!(matches!(&last, Message::Ended(ended) if *ended == ending), "{last:?}");
    closing.join().unwrap();
}

/// More than a request may have, and never a line: refused, and not read for ever.
fn flood_without_end(flight: &Flight) {
    let mut stream = UnixStream::connect(flight.folder.path().join(SOCKET)).unwrap();
    stream.set_write_timeout(Some(Duration::from_secs(10))).unwrap();
    let chunk = vec![b'x'; 1 << 16];
    let refused = (0..10_000).find_map(|_| stream.write_all(&chunk).err());
    let error = refused.expect("600 MB without a line are taken");
    let kind = error.kind();
    let hung_up = [std::io::ErrorKind::BrokenPipe, std::io::ErrorKind::ConnectionReset];
    assert!(hung_up.contains(&kind), "{error}");
}

#[test]
fn unknown_peers_are_refused_with_a_message_and_cost_nothing() {
    let flight = Flight::new();
    let send = |text: &[u8]| {
        let mut stream = UnixStream::connect(flight.folder.path().join(SOCKET)).unwrap();
        // A client without a place is answered before it has sent anything, and hung up on.
        let _ = stream.write_all(text);
        let mut answer = String::new();
        BufReader::new(&stream).read_line(&mut answer).unwrap();
        let mut rest = Vec::new();
        let _ = stream.read_to_end(&mut rest);
        answer
    };
    assert!(send(b"hello\n").contains("not a request"));
    assert!(send(b"{\"listen\":[]}\n").contains("no topic"));
    assert!(send(b"{\"listen\":[[\"imus\",\"0\"]]}\n").contains("no topic imus"));
    assert!(send(b"{\"listen\":[[\"imu\",\"0\"]]}\n").contains("laid out otherwise"));
    assert!(send(&vec![b'x'; 20_000]).contains("at most"));
    flood_without_end(&flight);
    // A place for each of those that send nothing, and none for long.
    let connect = || UnixStream::connect(flight.folder.path().join(SOCKET)).unwrap();
    let silent: Vec<_> = (0..8).map(|_| connect()).collect();
    assert!(send(b"{\"listen\":[]}\n").contains("others are listening"));
    let give_up_ns = mono_now_ns() + 60_000_000_000;
    while send(b"{\"listen\":[]}\n").contains("others are listening") {
        assert!(mono_now_ns() < give_up_ns, "the silent keep all places");
    }
    drop(silent);
    let mut still = flight.listen(&["imu"]);
    flight.feed.offer(&topics::IMU, &imu(5));
    assert_eq!(next(&mut still), ("imu", 5));
}

#[test]
fn a_packed_sample_is_taken_apart_by_its_topic_and_only_if_it_fits() {
    use shared_types::wire::Value as _;
    let mut packed = vec![0; Imu::PACKED_SIZE];
    imu(9).pack(&mut packed);
    let topic = known("/imu").unwrap();
    let (header, fields) = unpack(topic, &packed).unwrap();
    assert_eq!((header.sequence, fields["header"]["sequence"].as_u64()), (9, Some(9)));
    assert!(unpack(topic, &packed[1..]).is_none());
    assert_eq!(place(topic), 0);
    assert_eq!(schema(topic).unwrap().name, "Imu");
    assert!(known("imus").is_none());
}

#[test]
fn events_and_the_end_come_only_to_clients_that_want_everything() {
    let folder = tempfile::TempDir::new().unwrap();
    let flying = Flying { epoch_unix_ns: 1_000_000_000, speed: Some(0.5) };
    let feed = Feed::open(folder.path(), flying).unwrap();
    let run = Run::at("x", folder.path());
    let mut all = Listening::to_everything(&run).unwrap();
    let mut some = Listening::to(&run, &[known("imu").unwrap()], false).unwrap();
    assert_eq!((all.flying(), some.flying()), (flying, flying));
    let event =
        Event { logical_ns: 2_000_000_000, severity: Severity::Warning, source: "s", text: "gust" };
    feed.publish(&event);
    feed.offer(&topics::IMU, &imu(1));
    let ending = Ending { is_good: true, text: "flown".to_owned() };
    feed.end(&ending);
    let mut received = Vec::new();
    while received.len() < 3 {
        match all.next(MOMENT).unwrap() {
            Message::Nothing => {}
            word => received.push(word),
        }
    }
    let [Message::Log(log), Message::Sample(topic, _), Message::Ended(ended)] = &received[..]
    else {
        panic!("{received:?}");
    };
    assert_eq!((topic.name, ended), ("imu", &ending));
    // At half speed, two seconds of flight are four on the wall.
    let (stamp_ns, level, text, source) = decode_log(log).unwrap();
    assert_eq!((stamp_ns, level, &*text, &*source), (5_000_000_000, 3, "gust", "s"));
    assert_eq!(next(&mut some), ("imu", 1));
    drop(feed);
    loop {
        match some.next(MOMENT).unwrap() {
            Message::Nothing => {}
            Message::Over => break,
            word => panic!("{word:?}"),
        }
    }
}
