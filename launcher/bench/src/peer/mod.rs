//! The other processes of a measurement: this executable again, with an order on its standard input.
//!
//! An order is a line of JSON. A peer prints `ready`, receives the start time, and answers with one line. It
//! leaves when its input ends, or, where it reads none while it measures, with the process that started it.

pub mod floor;
pub mod hop;
pub mod load;

use super::BenchError;
use host::realtime::Setup;
use host::{exit, name_thread};
use load::{LoadOrder, be_load};
use runtime::priority::Schedule;
use scenario::process::OWN_EXECUTABLE;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::io::{self, BufRead, BufReader, Write};
use std::os::unix::process::CommandExt as _;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

/// What a peer is to do.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PeerRequest {
    /// Send samples, by turns through the ports and through the bare transport.
    HopFrom(hop::End),
    /// Receive them.
    HopTo(hop::End),
    /// Measure the machine's timers, and send pings.
    FloorFrom(floor::FromOrder),
    /// Receive pings.
    FloorTo(floor::ToOrder),
    /// Keep a processor busy.
    Load(LoadOrder),
}

/// Processor and priority of a thread.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub struct Seat {
    /// The only processor; any if none.
    pub cpu: Option<usize>,
    /// `SCHED_FIFO` of this priority; none for the usual policy.
    pub fifo: Option<u8>,
    /// With timers and memory as the loops of a flight have them.
    pub like_a_loop: bool,
}

impl Seat {
    /// Lets the calling thread run there.
    pub fn take(self, name: &str) {
        name_thread(name);
        let setup = Setup {
            schedule: self.fifo.map(Schedule::Fifo),
            cpus: self.cpu.into_iter().collect(),
            lock_memory: self.like_a_loop,
            timer_slack_ns: if self.like_a_loop { TIMER_SLACK_NS } else { 0 },
        };
        // Permissions were checked before; the rest is set as for the loops, which report failures.
        let _ = setup.apply();
    }
}

/// Default slack of the loops' timers \[ns\].
const TIMER_SLACK_NS: u64 = 1000;

/// A peer that has been started.
#[derive(Debug)]
pub struct Peer {
    child: Child,
    orders: Option<ChildStdin>,
    answers: BufReader<ChildStdout>,
}

impl Peer {
    /// Starts a peer and waits until it is ready.
    ///
    /// # Errors
    /// It cannot be started, or ends before.
    pub fn start(order: &PeerRequest) -> Result<Self, BenchError> {
        let failed = |source| BenchError::System { action: "start a peer".to_owned(), source };
        let mut child = Command::new(OWN_EXECUTABLE)
            .arg("bench-peer")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            // A Ctrl-C at the terminal reaches only the process that started it.
            .process_group(0)
            .spawn()
            .map_err(failed)?;
        let orders = child.stdin.take();
        let answers = child.stdout.take().ok_or(BenchError::Peer("has no output".to_owned()))?;
        let mut peer = Self { child, orders, answers: BufReader::new(answers) };
        let order = serde_json::to_string(order).map_err(|error| failed(error.into()))?;
        peer.send_line(&order)?;
        let reply = peer.read_line()?;
        if reply != READY {
            return Err(BenchError::Peer(format!("answered `{reply}` instead of `{READY}`")));
        }
        Ok(peer)
    }

    /// Sends it one line.
    ///
    /// # Errors
    /// It has gone.
    pub fn send_line(&mut self, line: &str) -> Result<(), BenchError> {
        let sent = self.orders.as_mut().map(|orders| writeln!(orders, "{line}"));
        match sent {
            Some(Ok(())) => Ok(()),
            _ => Err(BenchError::Peer("does not listen any more".to_owned())),
        }
    }

    fn read_line(&mut self) -> Result<String, BenchError> {
        let mut line = String::new();
        match self.answers.read_line(&mut line) {
            Ok(count) if count > 0 => Ok(line.trim_end().to_owned()),
            _ => Err(BenchError::Peer("ended without an answer".to_owned())),
        }
    }

    /// Lets it end by itself, and takes its answer.
    ///
    /// # Errors
    /// It gives none, or one of another build.
    pub fn answer<T: DeserializeOwned>(&mut self) -> Result<T, BenchError> {
        let reply = self.read_line()?;
        serde_json::from_str(&reply).map_err(|error| {
            BenchError::Peer(format!("gave an answer that means nothing: {error}"))
        })
    }

    /// Closes its input, which ends its work, and takes its answer.
    ///
    /// # Errors
    /// As [`answer`](Self::answer).
    pub fn stop<T: DeserializeOwned>(&mut self) -> Result<T, BenchError> {
        self.orders = None;
        self.answer()
    }

    /// Its process.
    #[must_use]
    pub fn pid(&self) -> u32 {
        self.child.id()
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// What a peer prints once it is ready to begin.
const READY: &str = "ready";

/// The peer's end of the conversation.
#[derive(Debug)]
pub struct Talk {
    orders: io::Lines<io::StdinLock<'static>>,
}

impl Talk {
    /// Prints that everything is open.
    ///
    /// # Errors
    /// No process listens any more.
    pub fn ready(&self) -> io::Result<()> {
        write_line(READY)
    }

    /// The next line; none once the input has ended.
    pub fn next_line(&mut self) -> Option<String> {
        self.orders.next()?.ok()
    }
}

fn write_line(line: &str) -> io::Result<()> {
    let mut out = io::stdout().lock();
    writeln!(out, "{line}")?;
    out.flush()
}

/// Is a peer, from its order to its answer.
#[must_use]
pub fn be_peer() -> u8 {
    let mut talk = Talk { orders: io::stdin().lines() };
    let order = talk.next_line().and_then(|line| serde_json::from_str::<PeerRequest>(&line).ok());
    let done = match order {
        Some(PeerRequest::HopFrom(end)) => hop::send(&end, &mut talk),
        Some(PeerRequest::HopTo(end)) => hop::receive(&end, &mut talk),
        Some(PeerRequest::FloorFrom(order)) => floor::send(&order, &mut talk),
        Some(PeerRequest::FloorTo(order)) => floor::receive(&order, &mut talk),
        Some(PeerRequest::Load(order)) => be_load(&order, &mut talk),
        None => {
            Err(BenchError::Peer("got no order: it is started by `morphquad bench`".to_owned()))
        }
    };
    match done.and_then(|answer| write_line(&answer).map_err(not_answered)) {
        Ok(()) => exit::PASS,
        Err(error) => {
            let _ = writeln!(io::stderr(), "morphquad bench-peer: {error}");
            error.exit_code()
        }
    }
}

pub(super) fn not_answered(source: io::Error) -> BenchError {
    BenchError::System { action: "give an answer".to_owned(), source }
}
