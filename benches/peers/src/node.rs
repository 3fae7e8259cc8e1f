//! A process of a chain: its place on the machine, the start together with the others, and its report.

use crate::chain::{Law, Node, Port, fly_lockstep, fly_realtime, now_ns, react, recorded_samples};
use crate::{Result, copper, record, sockets, threads, transport};
use clap::{Args, ValueEnum};
use nix::sys::resource::{UsageWho, getrusage};
use rustix::mm::{MlockAllFlags, mlockall};
use rustix::thread::{ClockId, CpuSet, clock_nanosleep_absolute, sched_setaffinity};
use rustix::time::Timespec;
use serde::{Deserialize, Serialize};
use std::io::{BufRead as _, Write as _};
use std::path::PathBuf;
use thread_priority::{
    RealtimeThreadSchedulePolicy, ThreadPriority, ThreadSchedulePolicy,
    set_thread_priority_and_policy, thread_native_id,
};

/// What carries a chain.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Peer {
    Iceoryx2,
    Sockets,
    Threads,
    Copper,
}

impl Peer {
    pub const ALL: [Self; 4] = [Self::Iceoryx2, Self::Sockets, Self::Threads, Self::Copper];

    pub fn name(self) -> &'static str {
        match self {
            Self::Iceoryx2 => "iceoryx2 0.10.0, five processes",
            Self::Sockets => "unix sockets, five processes",
            Self::Threads => "crossbeam 0.5.15, five threads",
            Self::Copper => "copper-rs 1.3.1, one thread",
        }
    }

    pub fn has_processes(self) -> bool {
        matches!(self, Self::Iceoryx2 | Self::Sockets)
    }
}

/// A flight, as its processes are configured for it.
#[derive(Debug, Clone, Args)]
pub struct Flight {
    /// Ticks of 1 ms, a multiple of ten.
    #[arg(long)]
    pub ticks: u64,
    /// As fast as the nodes answer, instead of by the wall clock.
    #[arg(long)]
    pub in_lockstep: bool,
    /// Where everything is recorded.
    #[arg(long)]
    pub record: Option<PathBuf>,
    /// Under SCHED_FIFO, with memory locked.
    #[arg(long)]
    pub fifo: bool,
    /// The processor that all nodes share.
    #[arg(long)]
    pub cpu: Option<usize>,
}

/// A process of a flight.
#[derive(Debug, Args)]
pub struct Process {
    #[arg(long)]
    pub peer: Peer,
    /// The node; none for a peer that flies all of them in one process.
    #[arg(long)]
    pub node: Option<Node>,
    /// The recorder of a peer with processes.
    #[arg(long)]
    pub recorder: bool,
    /// Where the processes meet.
    #[arg(long)]
    pub folder: PathBuf,
    #[command(flatten)]
    pub flight: Flight,
}

/// What a process reports about its flight.
#[derive(Debug, Default, Serialize, Deserialize)]
pub struct Flown {
    /// From reading the sensor to the command's arrival at the motor \[ns\]; of the plant.
    pub latency_ns: Vec<u64>,
    /// Ticks at which the plant was more than half a tick late.
    pub late: u64,
    /// Wall time of all ticks \[ns\]; of the plant.
    pub elapsed_ns: u64,
    /// Processor time, user and system, from the start on \[ns\].
    pub cpu_ns: u64,
}

/// Processor time of this process \[ns\].
pub fn cpu_ns() -> u64 {
    let usage = getrusage(UsageWho::RUSAGE_SELF);
    usage.map_or(0, |usage| {
        let time_us = |time: nix::sys::time::TimeVal| {
            (time.tv_sec() * 1_000_000 + time.tv_usec()).unsigned_abs()
        };
        1000 * (time_us(usage.user_time()) + time_us(usage.system_time()))
    })
}

fn timespec(ns: u64) -> Timespec {
    Timespec {
        tv_sec: i64::try_from(ns / 1_000_000_000).unwrap_or(i64::MAX),
        tv_nsec: i64::try_from(ns % 1_000_000_000).unwrap_or(0),
    }
}

/// What is left until an instant of `CLOCK_MONOTONIC`.
pub fn left_until(due_ns: u64) -> Timespec {
    timespec(due_ns.saturating_sub(now_ns()))
}

/// Sleeps until an instant of `CLOCK_MONOTONIC`.
pub fn sleep_until(due_ns: u64) {
    let due = timespec(due_ns);
    while now_ns() < due_ns {
        let _ = clock_nanosleep_absolute(ClockId::Monotonic, &due);
    }
}

/// Gives the calling thread the processor and the priority that the flight has for its node.
pub fn take_place(node: Node, flight: &Flight) {
    if let Some(cpu) = flight.cpu {
        let mut set = CpuSet::new();
        set.set(cpu);
        let _ = sched_setaffinity(None, &set);
    }
    if flight.fifo {
        let priority =
            ThreadPriority::Crossplatform(node.priority().try_into().expect("below 100"));
        let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
        if set_thread_priority_and_policy(thread_native_id(), priority, policy).is_err() {
            eprintln!("peers: no right to SCHED_FIFO, its figures are those of the usual policy");
        }
        let _ = mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE);
    }
}

/// Prints that everything is open, and waits until all processes are ready.
pub fn await_start() -> Result<()> {
    println!("ready");
    std::io::stdout().flush()?;
    std::io::stdin().lock().read_line(&mut String::new())?;
    Ok(())
}

/// Flies the plant of a flight that has started.
pub fn fly_plant(port: &mut dyn Port, flight: &Flight) -> Result<Flown> {
    let before_ns = cpu_ns();
    let seen = if flight.in_lockstep {
        fly_lockstep(port, flight.ticks)?
    } else {
        fly_realtime(port, flight.ticks)?
    };
    let cpu_ns = cpu_ns() - before_ns;
    let crate::chain::Seen { latency_ns, late, elapsed_ns } = seen;
    Ok(Flown { latency_ns, late, elapsed_ns, cpu_ns })
}

fn fly_node(port: &mut dyn Port, node: Node, flight: &Flight) -> Result<Flown> {
    take_place(node, flight);
    await_start()?;
    if node == Node::Plant {
        return fly_plant(port, flight);
    }
    let before_ns = cpu_ns();
    react(&mut Law::new(node, flight.in_lockstep), port)?;
    Ok(Flown { cpu_ns: cpu_ns() - before_ns, ..Flown::default() })
}

/// Runs the process that the arguments describe; the result is reported to the driver.
pub fn be(process: &Process) -> Result<Flown> {
    let Process { peer, node, folder, flight, .. } = process;
    let records = flight.record.is_some();
    if process.recorder {
        let file = flight.record.as_deref().ok_or("a recorder needs --record")?;
        return match peer {
            Peer::Iceoryx2 => {
                let mut inbox = transport::Inbox::open(folder)?;
                keep(file, flight.ticks, || inbox.next())
            }
            _ => {
                let inbox = sockets::Inbox::open(folder)?;
                keep(file, flight.ticks, || inbox.next())
            }
        };
    }
    match (peer, node) {
        (Peer::Iceoryx2, Some(node)) => {
            fly_node(&mut transport::Ports::open(folder, *node, records)?, *node, flight)
        }
        (Peer::Sockets, Some(node)) => {
            fly_node(&mut sockets::Sockets::open(folder, *node, records)?, *node, flight)
        }
        (Peer::Threads, _) => threads::fly(flight),
        (Peer::Copper, _) => copper::fly(flight, folder),
        (_, None) => Err("--node is missing".into()),
    }
}

fn keep(
    file: &std::path::Path,
    ticks: u64,
    mut next: impl FnMut() -> Result<crate::chain::Sample>,
) -> Result<Flown> {
    record::leave_pinned_processor();
    let mut recording = record::Recording::create(file)?;
    await_start()?;
    for _ in 0..recorded_samples(ticks) {
        recording.write(&next()?)?;
    }
    recording.finish()?;
    Ok(Flown::default())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_versions_that_a_table_names_are_those_that_are_pinned() {
        let manifest = include_str!("../Cargo.toml");
        for (peer, pin) in [
            (Peer::Iceoryx2, "iceoryx2 = \"="),
            (Peer::Threads, "crossbeam-channel = \"="),
            (Peer::Copper, "cu29 = \"="),
        ] {
            let (_, after) = manifest.split_once(pin).unwrap();
            let version = after.split('"').next().unwrap();
            assert!(peer.name().contains(&format!(" {version},")), "{}: {version}", peer.name());
        }
    }
}
