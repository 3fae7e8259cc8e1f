//! The same contract over real shared memory.
//!
//! The transport's configuration is global to a process, so all tests here share one run; each
//! uses topics and roles of its own.

use core::time::Duration;
use runtime::ipc::{
    Bus, IpcSource, PortError, ServiceKind, TopicFactory, WakeListener, WakeNotifier,
};
use runtime::namespace::Membership;
use runtime::{Sink as _, Source as _};
use shared_types::wire::Wire;
use shared_types::{
    ClockRecord, Disturbance, Header, Hello, Imu, MorphAngle, Role, Sample, Seat, Truth, topics,
};
use std::sync::{Arc, Mutex, Weak, mpsc};
use std::thread;

static RUN: Mutex<Weak<Membership>> = Mutex::new(Weak::new());

/// A connection to the run of this test process, and the membership that outlives it. The run is
/// founded by the first test, again under the same name if all tests so far have left it.
struct Joined {
    bus: Bus,
    _stay: Stay,
}

/// Leaves under the lock: the last one wipes the run, and the next must not found it meanwhile.
struct Stay(Option<Arc<Membership>>);

impl Drop for Stay {
    fn drop(&mut self) {
        let _held = RUN.lock();
        self.0.take();
    }
}

fn join(name: &str) -> Joined {
    let mut run = RUN.lock().expect("no test panics while founding");
    let member = run.upgrade().unwrap_or_else(|| {
        let id = format!("test-ipc-{}", std::process::id());
        Arc::new(Membership::found(&id).expect("memory for a run"))
    });
    *run = Arc::downgrade(&member);
    let bus = Bus::join(&member.ipc_config(), name).expect("a connection");
    Joined { bus, _stay: Stay(Some(member)) }
}

/// What another build believes: the same names, other fields.
mod other_build {
    use shared_types::sample;

    sample! {
        /// As large as the real one, with two fields exchanged.
        pub struct ClockRecord {
            /// Second in the real one.
            pub end_ns: u64,
            /// First in the real one.
            pub allowed_ns: u64,
            /// As in the real one.
            pub start_mono_ns: u64,
            /// As in the real one.
            pub speed: f64,
            /// As in the real one, untyped.
            pub mode: u32,
            /// As in the real one, untyped.
            pub started: u32,
            /// As in the real one, untyped.
            pub may_leave: u32,
            /// As in the real one.
            #[padding]
            pub reserved: u32,
        }
    }
    sample! {
        /// Smaller than the real one.
        pub struct Hello {
            /// Process id.
            pub pid: u32,
        }
    }
}

/// A reader as deep as those in flight, of every writer.
fn flying<T: Sample>(factory: &TopicFactory<T>) -> IpcSource<T> {
    IpcSource::with_capacity(factory, runtime::graph::READER_CAPACITY).expect("a reader")
}

fn assert_refused<Theirs: Wire, Ours: Wire>(error: PortError, name: &str) {
    let text = error.to_string();
    let layout = |hash: u64| format!("{hash:016x}");
    let PortError::Layout { service, type_name, ours, theirs } = error else { panic!("{text}") };
    assert_eq!((service.as_str(), type_name), (name, Ours::SCHEMA.name));
    assert_eq!(ours, layout(Ours::SCHEMA.layout_hash));
    assert_eq!(theirs, layout(Theirs::SCHEMA.layout_hash));
    assert!(text.contains(name) && text.contains(&ours) && text.contains(&theirs), "{text}");
}

#[test]
fn two_builds_that_disagree_about_a_type_refuse_each_other() {
    let run = join("layouts");
    let _clock = run.bus.create_service::<ClockRecord>(ServiceKind::Clock, 4).unwrap();
    assert_eq!(size_of::<ClockRecord>(), size_of::<other_build::ClockRecord>());
    let error = run.bus.open_service::<other_build::ClockRecord>(ServiceKind::Clock).unwrap_err();
    assert_refused::<ClockRecord, other_build::ClockRecord>(error, "clock");
    let _hello = run.bus.create_service::<Hello>(ServiceKind::Hello, 4).unwrap();
    let error = run.bus.open_writer::<other_build::Hello>(ServiceKind::Hello).unwrap_err();
    assert_refused::<Hello, other_build::Hello>(error, "hello");
    run.bus.open_service::<ClockRecord>(ServiceKind::Clock).unwrap();
}

/// Ports of dead processes count until they are freed; here those of another connection.
#[test]
fn a_port_waits_until_its_full_service_admits_it() {
    let run = join("full");
    let _factory = run.bus.create_topic(&topics::POSE_FIX).unwrap();
    let (send_filled, filled) = mpsc::channel();
    let (send_leave, leave) = mpsc::channel::<()>();
    thread::scope(|scope| {
        scope.spawn(move || {
            let others = join("others");
            let writers = core::iter::from_fn(|| others.bus.writer(&topics::POSE_FIX).ok());
            let writers: Vec<_> = writers.collect();
            send_filled.send(writers.len()).expect("it is waited for");
            leave.recv().expect("it is asked to leave");
        });
        assert!(filled.recv().expect("it fills the service") > 0);
        let refused = run.bus.writer(&topics::POSE_FIX).expect_err("it is full");
        assert!(matches!(refused, PortError::Full { .. }), "{refused}");
        send_leave.send(()).expect("it waits");
        let Joined { bus, _stay } = join("waiting");
        bus.waiting_for_room().writer(&topics::POSE_FIX).expect("there is room again");
    });
}

#[test]
fn a_topic_that_was_not_created_is_refused_by_name() {
    let run = join("missing");
    let text = run.bus.writer(&topics::REFERENCE).unwrap_err().to_string();
    assert!(text.contains("reference") && text.contains("no such topic"), "{text}");
}

#[test]
fn a_late_reader_gets_the_history_once_the_writer_looks() {
    let run = join("history");
    let factory = run.bus.create_topic(&topics::IMU).unwrap();
    let mut writer = run.bus.writer(&topics::IMU).unwrap();
    for sequence in 1..=200 {
        let header = Header { sequence, ..Header::default() };
        writer.send(&Imu { header, ..Imu::default() });
    }
    let mut reader = flying(&factory);
    assert!(reader.receive().is_none());
    writer.serve_late_joiners();
    let seen: Vec<_> =
        core::iter::from_fn(|| reader.receive()).map(|s| s.header.sequence).collect();
    let kept = topics::IMU.info.history as u64;
    assert_eq!(seen, (201 - kept..=200).collect::<Vec<_>>());
    writer.serve_late_joiners();
    assert!(reader.receive().is_none(), "history comes once");
}

#[test]
fn a_stopped_reader_loses_the_oldest_and_never_stops_the_writer() {
    let run = join("overflow");
    let factory = run.bus.create_topic(&topics::MORPH_ANGLE).unwrap();
    let mut reader = flying(&factory);
    let mut writer = run.bus.writer(&topics::MORPH_ANGLE).unwrap();
    for sequence in 1..=3_000 {
        let header = Header { sequence, ..Header::default() };
        writer.send(&MorphAngle { header, ..MorphAngle::default() });
    }
    let seen: Vec<_> =
        core::iter::from_fn(|| reader.receive()).map(|s| s.header.sequence).collect();
    assert_eq!(seen.len(), runtime::graph::READER_CAPACITY);
    assert_eq!(seen.last(), Some(&3_000));
}

#[test]
fn what_a_writer_sent_before_it_left_still_arrives_at_a_connected_reader() {
    let run = join("leaving");
    let factory = run.bus.create_topic(&topics::DISTURBANCE).unwrap();
    let mut reader = flying(&factory);
    let mut writer = run.bus.writer(&topics::DISTURBANCE).unwrap();
    let send = |writer: &mut runtime::ipc::IpcSink<Disturbance>, sequence| {
        let header = Header { sequence, ..Header::default() };
        writer.send(&Disturbance { header, ..Disturbance::default() });
    };
    send(&mut writer, 1);
    assert_eq!(reader.receive().map(|s| s.header.sequence), Some(1));
    send(&mut writer, 2);
    send(&mut writer, 3);
    drop(writer);
    let mut successor = run.bus.writer(&topics::DISTURBANCE).unwrap();
    send(&mut successor, 4);
    let mut seen: Vec<_> =
        core::iter::from_fn(|| reader.receive()).map(|s| s.header.sequence).collect();
    seen.sort_unstable();
    assert_eq!(seen, [2, 3, 4]);
}

#[test]
fn a_listener_wakes_remembers_a_wake_up_and_gives_up() {
    let run = join("wake");
    run.bus.create_wake(Seat::first(Role::Attitude)).unwrap();
    let listener = WakeListener::open(&run.bus, Seat::first(Role::Attitude)).unwrap();
    let notifier = WakeNotifier::open(&run.bus, Seat::first(Role::Attitude)).unwrap();
    assert!(!listener.wait(Duration::from_millis(1)));
    notifier.wake();
    notifier.wake();
    assert!(listener.wait(Duration::from_secs(10)));
    assert!(!listener.wait(Duration::from_millis(1)), "two wake-ups are one");
}

#[test]
fn a_wake_up_reaches_a_thread_that_is_already_waiting() {
    let run = join("waiting");
    run.bus.create_wake(Seat::first(Role::Plant)).unwrap();
    let (ready, started) = std::sync::mpsc::channel();
    let waiter = std::thread::spawn(move || {
        let run = join("waiter");
        let listener = WakeListener::open(&run.bus, Seat::first(Role::Plant)).expect("a listener");
        ready.send(()).expect("the test waits");
        listener.wait(Duration::from_secs(10))
    });
    started.recv().unwrap();
    WakeNotifier::open(&run.bus, Seat::first(Role::Plant)).unwrap().wake();
    assert!(waiter.join().unwrap());
}

#[test]
fn readers_of_chosen_depth_keep_the_newest() {
    let run = join("depth");
    let factory = run.bus.create_topic(&topics::TRUTH).unwrap();
    let mut reader = IpcSource::with_capacity(&factory, 2).unwrap();
    let mut writer = run.bus.writer(&topics::TRUTH).unwrap();
    for sequence in 1..=9 {
        let header = Header { sequence, ..Header::default() };
        writer.send(&Truth { header, ..Truth::default() });
    }
    let seen: Vec<_> =
        core::iter::from_fn(|| reader.receive()).map(|s| s.header.sequence).collect();
    assert_eq!(seen, [8, 9]);
}
