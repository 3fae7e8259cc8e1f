//! Rings of bare processes, on one core and across two.

use crate::ring::{self, Held, NODES, Waking};
use crate::{Result, Rounds};
use runtime::ipc::Bus;
use runtime::namespace::Membership;
use std::io::{BufRead as _, BufReader, Write as _};
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Stdio};

/// Laps of one round.
const LAPS: u64 = 5_000;

/// A ring and what a hop in it costs.
#[derive(Debug)]
pub(crate) struct Floor {
    pub(crate) waking: Waking,
    /// Processors that its members take in turn.
    pub(crate) cpus: Vec<usize>,
    pub(crate) hop_us: Rounds,
}

impl Floor {
    /// Every ring that this machine can turn.
    pub(crate) fn all() -> Vec<Self> {
        let cpus = allowed_cpus();
        let shares = if cpus.len() > 1 { vec![1, 2] } else { vec![1] };
        [Waking::Events, Waking::Runtime]
            .into_iter()
            .flat_map(|waking| shares.iter().map(move |&share| (waking, share)))
            .map(|(waking, share)| Self {
                waking,
                cpus: cpus[..share].to_vec(),
                hop_us: Rounds::default(),
            })
            .collect()
    }

    pub(crate) fn measure(&mut self, ground: &Ground) -> Result<()> {
        self.hop_us.add(turn(ground.run.folder(), self.waking, &self.cpus)?);
        Ok(())
    }
}

/// The run in which all rings turn, one after the other.
pub(crate) struct Ground {
    // In the order of dropping: ports, connection, folder.
    _held: Held,
    pub(crate) bus: Bus,
    run: Membership,
}

impl Ground {
    pub(crate) fn lay() -> Result<Self> {
        let run = Membership::found(&format!("bench{:x}", std::process::id()))?;
        let bus = Bus::join(&run.ipc_config(), "bench")?;
        Ok(Self { _held: ring::create(&bus)?, bus, run })
    }
}

/// Processors that this process may use, from the last: the first serves interrupts.
pub(crate) fn allowed_cpus() -> Vec<usize> {
    let set = rustix::thread::sched_getaffinity(None).unwrap_or_default();
    let max = rustix::thread::CpuSet::MAX_CPU;
    (0..max).rev().filter(|&cpu| set.is_set(cpu)).collect()
}

struct Member {
    child: Child,
    stdout: BufReader<ChildStdout>,
}

impl Member {
    fn start(place: usize, folder: &Path, waking: Waking, cpu: usize) -> Result<Self> {
        let mut child = Command::new(std::env::current_exe()?)
            .arg("--ring-node")
            .arg(place.to_string())
            .arg(folder)
            .args([waking.name(), &LAPS.to_string(), &cpu.to_string()])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()?;
        let stdout = child.stdout.take().ok_or("no output")?;
        Ok(Self { child, stdout: BufReader::new(stdout) })
    }

    fn read_reply(&mut self) -> Result<String> {
        let mut line = String::new();
        if self.stdout.read_line(&mut line)? == 0 {
            return Err("a process of the ring died".into());
        }
        Ok(line.trim().to_owned())
    }

    fn go_on(&mut self) -> Result<()> {
        let input = self.child.stdin.as_mut().ok_or("no input")?;
        Ok(input.write_all(b"\n")?)
    }
}

impl Drop for Member {
    fn drop(&mut self) {
        // After a failure it may wait for ever for its predecessor.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Time of one hop [us].
fn turn(folder: &Path, waking: Waking, cpus: &[usize]) -> Result<f64> {
    let members =
        (0..NODES).map(|place| Member::start(place, folder, waking, cpus[place % cpus.len()]));
    let mut members = members.collect::<Result<Vec<_>>>()?;
    for member in &mut members {
        member.read_reply()?;
    }
    for member in members.iter_mut().rev() {
        member.go_on()?;
    }
    let mut lap_ns = 0.0;
    for (place, member) in members.iter_mut().enumerate() {
        let ns: f64 = member.read_reply()?.parse()?;
        if place == 0 {
            lap_ns = ns / LAPS as f64;
        }
    }
    for member in &mut members {
        member.go_on()?;
        member.child.wait()?;
    }
    Ok(lap_ns * 1e-3 / NODES as f64)
}
