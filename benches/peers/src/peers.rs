//! Starts the processes of a chain, lets them go together, and collects the figures they report.

use crate::chain::Node;
use crate::node::{Flown, Peer};
use crate::table::{Realtime, Table};
use crate::{Result, flights};
use clap::ValueEnum as _;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::os::unix::fs::MetadataExt as _;
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Stdio};
use tempfile::TempDir;

/// A process that is killed if it is not waited for.
struct Running {
    child: Child,
    out: BufReader<ChildStdout>,
}

impl Running {
    fn start(mut command: Command) -> Result<Self> {
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn()?;
        let out = child.stdout.take().ok_or("no output")?;
        let mut running = Self { child, out: BufReader::new(out) };
        let mut line = String::new();
        running.out.read_line(&mut line)?;
        if line.trim() == "ready" { Ok(running) } else { Err("a process did not start".into()) }
    }

    fn go(&mut self) -> Result<()> {
        Ok(self.child.stdin.as_mut().ok_or("no input")?.write_all(b"\n")?)
    }

    fn finish(mut self) -> Result<Flown> {
        let mut report = String::new();
        self.out.read_to_string(&mut report)?;
        if !self.child.wait()?.success() {
            return Err("a process ended early".into());
        }
        Ok(serde_json::from_str(&report)?)
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn fly(peer: Peer, folder: &Path, flight: &[String], records: bool) -> Result<Flown> {
    let start = |more: &[&str]| {
        let mut command = Command::new(std::env::current_exe()?);
        let peer = peer.to_possible_value().ok_or("a peer without a name")?;
        command.arg("node").arg("--peer").arg(peer.get_name());
        command.arg("--folder").arg(folder).args(flight).args(more);
        Running::start(command)
    };
    let mut all = Vec::new();
    if records && peer.has_processes() {
        all.push(start(&["--recorder"])?);
    }
    if peer.has_processes() {
        // The plant last: its answer is the flight's.
        for node in Node::ALL.into_iter().rev() {
            all.push(start(&["--node", node.name()])?);
        }
    } else {
        all.push(start(&[])?);
    }
    all.iter_mut().try_for_each(Running::go)?;
    let mut sum = Flown::default();
    for process in all {
        let flown = process.finish()?;
        sum = Flown { cpu_ns: sum.cpu_ns + flown.cpu_ns, ..flown };
    }
    Ok(sum)
}

/// Measures every peer once.
pub fn measure(table: &mut Table, realtime_s: u64, lockstep_s: u64) -> Result<()> {
    let cpu = rustix::thread::sched_getcpu().to_string();
    for peer in Peer::ALL {
        for fifo in [true, false] {
            let folder = TempDir::new()?;
            let ticks = (1000 * realtime_s).to_string();
            let mut flight = vec!["--ticks".to_owned(), ticks];
            flight.extend(fifo.then(|| "--fifo".to_owned()));
            let flown = fly(peer, folder.path(), &flight, false)?;
            table.add_realtime(peer.name(), fifo, &realtime_of(flown, realtime_s));
        }
        let folder = TempDir::new()?;
        let ticks = 1000 * lockstep_s;
        let flight =
            ["--ticks", &ticks.to_string(), "--in-lockstep", "--cpu", &cpu].map(str::to_owned);
        let flown = fly(peer, folder.path(), &flight, false)?;
        table.add_lockstep(peer.name(), lockstep_s as f64 / (flown.elapsed_ns as f64 * 1e-9), None);
        let folder = TempDir::new()?;
        let file = folder.path().join("recording.all");
        let mut flight = flight.to_vec();
        flight.extend(["--record".to_owned(), file.display().to_string()]);
        let flown = fly(peer, folder.path(), &flight, true)?;
        let bytes = size_of_all(folder.path())? as f64 / lockstep_s as f64;
        let speed = lockstep_s as f64 / (flown.elapsed_ns as f64 * 1e-9);
        table.add_lockstep(peer.name(), speed, Some(bytes));
    }
    Ok(())
}

fn realtime_of(mut flown: Flown, seconds: u64) -> Realtime {
    flown.latency_ns.sort_unstable();
    let at_us = |share: f64| {
        let at = (share * flown.latency_ns.len() as f64) as usize;
        let value = flown.latency_ns.get(at.min(flown.latency_ns.len().saturating_sub(1)));
        value.map_or(f64::NAN, |ns| *ns as f64 * 1e-3)
    };
    Realtime {
        p50_us: at_us(0.5),
        p99_us: at_us(0.99),
        cpu_ms: flown.cpu_ns as f64 * 1e-6 / seconds as f64,
        lost: (500 * seconds).saturating_sub(flown.latency_ns.len() as u64),
        late: Some(flown.late),
    }
}

/// Bytes that recordings take on the disk, however many files they are and whatever was set aside for them.
fn size_of_all(folder: &Path) -> Result<u64> {
    let mut bytes = 0;
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        let is_recording = entry.file_name().to_string_lossy().starts_with("recording");
        // Of a link it is the link.
        let metadata = entry.metadata()?;
        bytes += if is_recording && metadata.is_file() { 512 * metadata.blocks() } else { 0 };
    }
    Ok(bytes)
}

/// Measures flights of morphquad once.
pub fn measure_flights(
    table: &mut Table,
    morphquad: &Path,
    realtime_s: u64,
    lockstep_s: u64,
) -> Result<()> {
    for fifo in [true, false] {
        let flown = flights::realtime(morphquad, realtime_s, fifo)?;
        table.add_realtime(Table::PROCESSES, fifo, &flown);
    }
    for (name, in_process) in [(Table::PROCESSES, false), (Table::ONE_PROCESS, true)] {
        let folder = TempDir::new()?;
        let quiet = flights::lockstep(morphquad, lockstep_s, in_process, None)?;
        table.add_lockstep(name, quiet.speed, None);
        let recorded = flights::lockstep(morphquad, lockstep_s, in_process, Some(folder.path()))?;
        table.add_lockstep(name, recorded.speed, recorded.bytes_per_s);
        table.note_hashes([quiet.hash, recorded.hash]);
    }
    table.note_swap(flights::swap(morphquad)?);
    Ok(())
}
