//! The two processes of a floor: threads that only sleep and look at the clock, and pings over the bare
//! transport.

use super::{Seat as ThreadSeat, Talk, not_answered};
use crate::BenchError;
use core::sync::atomic::{AtomicBool, Ordering};
use core::time::Duration;
use runtime::clock::{mono_now_ns, sleep_until};
use runtime::ipc::Bus;
use runtime::rate::Rate;
use serde::{Deserialize, Serialize};
use shared_types::{Header, Imu, Sample, StateEstimate, WrenchCommand};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Barrier};
use std::thread;

/// A blocked reader looks again after this.
const LOOK_AGAIN: Duration = Duration::from_millis(100);

/// A rate, and where in the flight's time its instants lie.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub struct Beat {
    /// Rate \[Hz\].
    pub rate_hz: f64,
    /// After the flight's instants \[ns\].
    pub phase_ns: u64,
    /// Priority of its threads.
    pub fifo: Option<u8>,
}

/// What a ping carries.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Payload {
    /// A sample of `imu`.
    Imu,
    /// A sample of `state_estimate`.
    StateEstimate,
    /// A sample of `wrench_command`.
    WrenchCommand,
}

#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Ping {
    /// Its name, and that of its services.
    pub name: String,
    /// What it carries.
    pub payload: Payload,
    /// When.
    pub beat: Beat,
}

/// What the first process is to do.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct FromOrder {
    /// Folder of the run.
    pub run: PathBuf,
    /// Of each thread.
    pub seat: ThreadSeat,
    pub timers: Vec<Beat>,
    /// What to send.
    pub pings: Vec<Ping>,
}

/// What the second process is to do.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct ToOrder {
    /// Folder of the run.
    pub run: PathBuf,
    /// Of each thread.
    pub seat: ThreadSeat,
    /// What to receive.
    pub pings: Vec<Ping>,
}

/// Instant \[ns\] and duration \[ns\] of each.
type Values = Vec<(u64, u64)>;
/// Of the first process: rate \[Hz\] and lateness of each timer.
pub type FromAnswer = Vec<(f64, Values)>;
/// Of the second process: name and hops of each ping.
pub type ToAnswer = Vec<(String, Values)>;

/// True until it is enough.
type Going = Arc<AtomicBool>;

fn goes_on(going: &Going) -> bool {
    going.load(Ordering::Relaxed)
}

/// Calls `act` at each instant of a beat with that instant \[ns\], until it is enough.
fn beat(beat: Beat, start_ns: u64, going: &Going, mut act: impl FnMut(u64)) {
    let Ok(rate) = Rate::from_hz(beat.rate_hz) else { return };
    let mut index = 0;
    while goes_on(going) {
        let due_ns = start_ns + beat.phase_ns + rate.release_ns(index);
        // Those that are late already come at once, each counted from its own instant.
        sleep_until(due_ns);
        act(due_ns);
        index += 1;
    }
}

/// Has the timers and sends the pings; the answer is how late the timers were.
///
/// # Errors
/// A port cannot be had.
pub fn send(order: &FromOrder, talk: &mut Talk) -> Result<String, BenchError> {
    let config = order.run.join("iceoryx2.toml");
    let bus = Bus::join(&config, "floor-from")?;
    let mut held: Vec<Box<dyn core::any::Any>> = Vec::new();
    for ping in &order.pings {
        held.push(match ping.payload {
            Payload::Imu => Box::new(bus.create_bare::<Imu>(&ping.name, 1)?),
            Payload::StateEstimate => Box::new(bus.create_bare::<StateEstimate>(&ping.name, 1)?),
            Payload::WrenchCommand => Box::new(bus.create_bare::<WrenchCommand>(&ping.name, 1)?),
        });
        held.push(Box::new(bus.create_bare_events(&ping.name)?));
    }
    talk.ready().map_err(not_answered)?;
    let Some(start_ns) = start(talk) else { return Ok("[]".to_owned()) };
    let (going, seat) = (Going::new(AtomicBool::new(true)), order.seat);
    let timers: Vec<_> = order
        .timers
        .iter()
        .map(|&timer| {
            let going = Arc::clone(&going);
            let seconds = 60.0 * timer.rate_hz;
            thread::spawn(move || {
                ThreadSeat { fifo: timer.fifo, ..seat }.take("floor-timer");
                let mut late = Values::with_capacity(room(seconds));
                beat(timer, start_ns, &going, |due_ns| {
                    late.push((due_ns, mono_now_ns().saturating_sub(due_ns)));
                });
                (timer.rate_hz, late)
            })
        })
        .collect();
    let senders: Vec<_> = order
        .pings
        .iter()
        .cloned()
        .map(|ping| {
            let (config, going) = (config.clone(), Arc::clone(&going));
            thread::spawn(move || {
                ThreadSeat { fifo: ping.beat.fifo, ..seat }.take("floor-ping");
                match ping.payload {
                    Payload::Imu => send_pings::<Imu>(&config, &ping, start_ns, &going),
                    Payload::StateEstimate => {
                        send_pings::<StateEstimate>(&config, &ping, start_ns, &going)
                    }
                    Payload::WrenchCommand => {
                        send_pings::<WrenchCommand>(&config, &ping, start_ns, &going)
                    }
                }
            })
        })
        .collect();
    wait_for_the_end(talk);
    going.store(false, Ordering::Relaxed);
    let late: FromAnswer = timers.into_iter().filter_map(|timer| timer.join().ok()).collect();
    for sender in senders {
        sender.join().map_err(|_| BenchError::Peer("died while it sent pings".to_owned()))??;
    }
    serde_json::to_string(&late).map_err(|error| not_answered(error.into()))
}

fn send_pings<T: Sample + 'static>(
    config: &Path,
    ping: &Ping,
    start_ns: u64,
    going: &Going,
) -> Result<(), BenchError> {
    let bus = Bus::join(config, "floor-ping")?;
    let (writer, notifier) = (bus.bare_writer::<T>(&ping.name)?, bus.bare_notifier(&ping.name)?);
    beat(ping.beat, start_ns, going, |due_ns| {
        let mut sample = T::default();
        let publish_mono_ns = mono_now_ns();
        *sample.header_mut() =
            Header { release_mono_ns: due_ns, publish_mono_ns, ..Header::default() };
        writer.send(&sample);
        notifier.notify();
    });
    Ok(())
}

/// Receives the pings; the answer is how long each took.
///
/// # Errors
/// A port cannot be had.
pub fn receive(order: &ToOrder, talk: &mut Talk) -> Result<String, BenchError> {
    let config = order.run.join("iceoryx2.toml");
    let (going, seat) = (Going::new(AtomicBool::new(true)), order.seat);
    let open = Arc::new(Barrier::new(order.pings.len() + 1));
    let readers: Vec<_> = order
        .pings
        .iter()
        .cloned()
        .map(|ping| {
            let (config, going, open) = (config.clone(), Arc::clone(&going), Arc::clone(&open));
            thread::spawn(move || {
                ThreadSeat { fifo: ping.beat.fifo, ..seat }.take("floor-pong");
                let hops = match ping.payload {
                    Payload::Imu => receive_pings::<Imu>(&config, &ping, &going, &open),
                    Payload::StateEstimate => {
                        receive_pings::<StateEstimate>(&config, &ping, &going, &open)
                    }
                    Payload::WrenchCommand => {
                        receive_pings::<WrenchCommand>(&config, &ping, &going, &open)
                    }
                };
                hops.map(|hops| (ping.name, hops))
            })
        })
        .collect();
    open.wait();
    talk.ready().map_err(not_answered)?;
    wait_for_the_end(talk);
    going.store(false, Ordering::Relaxed);
    let mut hops = ToAnswer::new();
    for reader in readers {
        hops.push(reader.join().map_err(|_| BenchError::Peer("died".to_owned()))??);
    }
    serde_json::to_string(&hops).map_err(|error| not_answered(error.into()))
}

fn receive_pings<T: Sample + 'static>(
    config: &Path,
    ping: &Ping,
    going: &Going,
    open: &Barrier,
) -> Result<Values, BenchError> {
    let ports = || -> Result<_, BenchError> {
        let bus = Bus::join(config, "floor-pong")?;
        let ports = (bus.bare_reader::<T>(&ping.name)?, bus.bare_listener(&ping.name)?);
        Ok((bus, ports))
    };
    let ports = ports();
    // Also a thread that has none lets the others begin.
    open.wait();
    let (_bus, (reader, listener)) = ports?;
    let mut hops = Values::with_capacity(room(60.0 * ping.beat.rate_hz));
    while goes_on(going) {
        let _ = listener.wait(LOOK_AGAIN);
        while let Some(sent_ns) = reader.receive(|sample| sample.header().publish_mono_ns) {
            hops.push((sent_ns, mono_now_ns().saturating_sub(sent_ns)));
        }
    }
    Ok(hops)
}

fn start(talk: &mut Talk) -> Option<u64> {
    talk.next_line()?.parse().ok()
}

fn wait_for_the_end(talk: &mut Talk) {
    while talk.next_line().is_some() {}
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few thousand")]
fn room(values: f64) -> usize {
    values.clamp(0.0, 1e7) as usize
}
