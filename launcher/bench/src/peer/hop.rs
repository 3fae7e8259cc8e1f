//! Two processes and one sample on its way from one to the other, again and again: through the runtime's
//! ports, and through the bare transport as its own documentation shows it.
//!
//! Kinds take turns in blocks, so that noise of the machine meets them alike. Each sample carries the
//! instant before it was handed to the port, and counts until the reader has read all of it: through the
//! runtime's ports once it is in effect, from the bare transport where it lies.

use super::{Seat as ThreadSeat, Talk, not_answered};
use crate::BenchError;
use core::hint::black_box;
use core::time::Duration;
use runtime::clock::{mono_now_ns, sleep_until};
use runtime::ipc::{Bus, ServiceKind, WakeListener, WakeNotifier};
use runtime::{Input, Output, Sink as _};
use rustix::process::{Signal, set_parent_process_death_signal};
use rustix::thread::sched_yield;
use serde::{Deserialize, Serialize};
use shared_types::{Header, Progress, Registry, Role, Seat, StateEstimate, topics};
use std::path::{Path, PathBuf};

/// Services of the measurement.
pub const BARE: &str = "bare/hop";
/// Service that reports the receiver's progress to the sender.
pub const ACKNOWLEDGED: &str = "bare/acknowledged";
/// The sender sits here.
pub const SENDER: Role = Role::Estimator;
/// Samples of a kind between two turns.
pub const BLOCK: u64 = 100;
/// Longest wait for one sample \[ns\].
const PATIENCE_NS: u64 = 30_000_000_000;
/// A blocked reader looks again after this.
const LOOK_AGAIN: Duration = Duration::from_millis(100);
/// Looks without a sample between two looks at the clock.
const LOOKS: u32 = 4096;
/// Logical time between two samples \[ns\].
const STEP_NS: u64 = 1_000_000;

/// What carries a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Carrier {
    /// [`Output`] and [`Input`], and the run's pipe for waking.
    Ports,
    /// A bare publisher and subscriber, and the transport's own events for waking.
    Bare,
    /// A bare publisher and subscriber with the run's pipe for waking.
    BarePipe,
}

/// How the reader waits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Waiting {
    /// Looks without pause; on one processor it lets the other one run in between.
    Polled,
    /// Sleeps until it is woken.
    Blocking,
}

impl Waiting {
    /// Carriers that differ.
    #[must_use]
    pub fn carriers(self) -> &'static [Carrier] {
        match self {
            Self::Polled => &[Carrier::Ports, Carrier::Bare],
            Self::Blocking => &[Carrier::Ports, Carrier::Bare, Carrier::BarePipe],
        }
    }

    /// As it is written.
    #[must_use]
    pub fn label(self) -> &'static str {
        match self {
            Self::Polled => "polled",
            Self::Blocking => "blocking",
        }
    }
}

/// One end of the measurement.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct End {
    /// Folder of the run.
    pub run: PathBuf,
    /// Where this end runs.
    pub seat: ThreadSeat,
    /// How the reader waits.
    pub waiting: Waiting,
    /// True if both ends share a processor.
    pub shared: bool,
    /// Blocks of each carrier.
    pub blocks: u64,
    /// From one sample to the next while the reader sleeps \[ns\].
    pub period_ns: u64,
}

/// Hops of each carrier \[ns\], in the order of [`Waiting::carriers`].
pub type Hops = Vec<Vec<u64>>;

impl End {
    fn join(&self, name: &str) -> Result<Bus, BenchError> {
        // While they measure they read no input, and would go on without the process that started them.
        let _ = set_parent_process_death_signal(Some(Signal::KILL));
        self.seat.take(name);
        Ok(Bus::join(&config(&self.run), name)?)
    }

    fn pause(&self) {
        if self.shared {
            sched_yield();
        } else {
            core::hint::spin_loop();
        }
    }
}

fn config(run: &Path) -> PathBuf {
    run.join("iceoryx2.toml")
}

fn mailbox() -> Seat {
    Seat::first(SENDER)
}

/// Sends; the answer is how many.
///
/// # Errors
/// A port cannot be had, or no process receives.
pub fn send(end: &End, talk: &mut Talk) -> Result<String, BenchError> {
    let bus = end.join("hop-from")?;
    bus.lead()?;
    let mut registry = bus.open_writer::<Registry>(ServiceKind::Registry)?;
    let mut entries = Registry { count: 1, ..Registry::default() };
    entries.entries[0].node = bus.identity();
    entries.entries[0].role = SENDER;
    registry.send(&entries);
    let mut output = Output::<StateEstimate>::default();
    output.connect(Box::new(bus.writer(&topics::STATE_ESTIMATE)?), 0);
    let bare = bus.bare_writer::<StateEstimate>(BARE)?;
    let (pipe, events) = (WakeNotifier::open(&bus, mailbox())?, bus.bare_notifier(BARE)?);
    let acknowledged = bus.bare_reader::<Progress>(ACKNOWLEDGED)?;
    talk.ready().map_err(not_answered)?;
    if talk.next_line().is_none() {
        return Err(BenchError::Peer("was left before it began".to_owned()));
    }
    let blocking = end.waiting == Waiting::Blocking;
    let (mut sent, mut due_ns) = (0, mono_now_ns());
    for _ in 0..end.blocks {
        for carrier in end.waiting.carriers() {
            for _ in 0..BLOCK {
                sent += 1;
                if blocking {
                    due_ns += end.period_ns;
                    sleep_until(due_ns);
                }
                let release_ns = sent * STEP_NS;
                let payload = StateEstimate::default();
                let publish_mono_ns = mono_now_ns();
                let header = Header { release_ns, publish_mono_ns, ..Header::default() };
                if *carrier == Carrier::Ports {
                    output.write(payload);
                    output.flush(&header);
                } else {
                    let header = Header { sequence: sent, ..header };
                    bare.send(&StateEstimate { header, ..payload });
                }
                match carrier {
                    _ if !blocking => {}
                    Carrier::Bare => events.notify(),
                    Carrier::Ports | Carrier::BarePipe => pipe.wake(),
                }
                let patience_ns = mono_now_ns() + PATIENCE_NS;
                let mut looks = 0_u32;
                while acknowledged.receive(|progress| progress.steps) != Some(sent) {
                    looks = looks.wrapping_add(1);
                    let look = blocking || looks.is_multiple_of(LOOKS);
                    if look && mono_now_ns() > patience_ns {
                        return Err(BenchError::Peer(format!("lost sample {sent}")));
                    }
                    if blocking {
                        sleep_until(mono_now_ns() + end.period_ns / 8);
                    } else {
                        end.pause();
                    }
                }
            }
        }
    }
    Ok(sent.to_string())
}

/// When the sample that is in effect from now on was sent, if there is a new one \[ns\].
fn taken(
    input: &mut Input<StateEstimate>,
    release_ns: u64,
    previous_ns: Option<u64>,
) -> Option<u64> {
    input.receive();
    if input.waiting() == 0 {
        return None;
    }
    input.accept(release_ns, previous_ns);
    input.fresh().last().map(read)
}

/// When a sample was sent \[ns\], after a look at every byte of it.
fn read(sample: &StateEstimate) -> u64 {
    black_box(*sample).header.publish_mono_ns
}

/// Receives; the answer is how long each sample took.
///
/// # Errors
/// A port cannot be had, or nothing comes.
pub fn receive(end: &End, talk: &mut Talk) -> Result<String, BenchError> {
    let bus = end.join("hop-to")?;
    let mut input = Input::<StateEstimate>::default();
    input.connect(Box::new(bus.reader(&topics::STATE_ESTIMATE, SENDER)?), None);
    let bare = bus.bare_reader::<StateEstimate>(BARE)?;
    let (pipe, events) = (WakeListener::open(&bus, mailbox())?, bus.bare_listener(BARE)?);
    let acknowledge = bus.bare_writer::<Progress>(ACKNOWLEDGED)?;
    talk.ready().map_err(not_answered)?;
    let carriers = end.waiting.carriers();
    let room = usize::try_from(end.blocks * BLOCK).unwrap_or(0);
    let mut hops: Hops = carriers.iter().map(|_| Vec::with_capacity(room)).collect();
    let blocking = end.waiting == Waiting::Blocking;
    let (mut steps, mut previous_ns) = (0, None);
    for _ in 0..end.blocks {
        for (carrier, hops) in carriers.iter().zip(&mut hops) {
            for _ in 0..BLOCK {
                steps += 1;
                let release_ns = steps * STEP_NS;
                let patience_ns = mono_now_ns() + PATIENCE_NS;
                let mut looks = 0_u32;
                let sent_ns = loop {
                    let found = if *carrier == Carrier::Ports {
                        taken(&mut input, release_ns, previous_ns)
                    } else {
                        bare.receive(read)
                    };
                    if let Some(sent_ns) = found {
                        break sent_ns;
                    }
                    match (end.waiting, carrier) {
                        (Waiting::Polled, _) => end.pause(),
                        (Waiting::Blocking, Carrier::Bare) => drop(events.wait(LOOK_AGAIN)),
                        (Waiting::Blocking, _) => drop(pipe.wait(LOOK_AGAIN)),
                    }
                    // The clock is not part of what is measured.
                    looks = looks.wrapping_add(1);
                    let look = blocking || looks.is_multiple_of(LOOKS);
                    if look && mono_now_ns() > patience_ns {
                        return Err(BenchError::Peer(format!("never got sample {steps}")));
                    }
                };
                hops.push(mono_now_ns().saturating_sub(sent_ns));
                previous_ns = Some(release_ns);
                acknowledge.send(&Progress { steps, ..Progress::default() });
            }
        }
    }
    serde_json::to_string(&hops).map_err(|error| not_answered(error.into()))
}
