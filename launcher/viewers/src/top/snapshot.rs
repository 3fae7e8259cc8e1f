//! A run at an instant: what its launcher reports beside what its loops do.

use super::gauges::{Gauge, Gauges};
use protocol::control::load::Load;
use protocol::control::status::{ProcessState, ProcessStatus, RunStatus};
use serde::Serialize;
use shared_types::Role;
use std::collections::BTreeMap;

/// One loop.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// What it is in the data flow.
    pub role: String,
    /// Service or executable.
    pub name: String,
    /// Place among those that could fill the role.
    pub seat: u32,
    /// Restarts so far.
    pub generation: u32,
    /// What it is doing.
    pub state: ProcessState,
    /// Epoch of its slot, if it has one.
    pub epoch: Option<u64>,
    /// What is measured of it.
    #[serde(flatten)]
    pub gauge: Gauge,
    /// Releases that the plant has passed and it has not published.
    pub queue: u64,
    /// Its process, if there is one now.
    pub pid: Option<u32>,
    /// Processor time since the last look \[% of one processor\].
    pub cpu_percent: Option<f64>,
    /// Resident memory, with what it shares with others \[bytes\].
    pub rss_bytes: Option<u64>,
}

/// Everything on the screen.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Snapshot {
    /// What the launcher reports.
    #[serde(skip)]
    pub status: RunStatus,
    /// Every loop, in data-flow order.
    pub loops: Vec<Row>,
    /// Samples that were not handed on, because `top` did not read fast enough.
    pub dropped: u64,
}

/// Processor time of each process at an instant of the wall clock \[s\].
#[derive(Debug, Clone, Default)]
pub struct Usage {
    at_s: f64,
    used_s: BTreeMap<u32, f64>,
}

impl Snapshot {
    /// Puts together what is known at `now_s` of the wall clock.
    #[must_use]
    pub fn of(
        status: RunStatus,
        gauges: &Gauges,
        usage: &mut Usage,
        now_s: f64,
        dropped: u64,
    ) -> Self {
        let before = core::mem::take(usage);
        usage.at_s = now_s;
        let plant = status.processes.iter().find(|process| process.role == Role::Plant.label());
        let plant_s = plant.map_or(0.0, |plant| plant.mark_s);
        let row = |process: &ProcessStatus| {
            let load = process.pid.and_then(Load::of);
            let cpu_percent = process.pid.zip(load).map(|(pid, load)| {
                usage.used_s.insert(pid, load.used_s);
                let over_s = now_s - before.at_s;
                let since = before.used_s.get(&pid).filter(|_| over_s > 0.0);
                since.map_or(load.cpu_percent, |used_s| 100.0 * (load.used_s - used_s) / over_s)
            });
            let role = Role::STEPPING.into_iter().find(|role| role.label() == process.role);
            let slot = status.slots.iter().find(|slot| slot.slot == process.role);
            Row {
                role: process.role.clone(),
                name: process.name.clone(),
                seat: process.seat,
                generation: process.generation,
                state: process.state,
                epoch: slot.map(|slot| slot.epoch),
                gauge: role.map_or_else(Gauge::default, |role| gauges.of(role, process.seat)),
                queue: behind(process, plant_s),
                pid: process.pid,
                cpu_percent,
                rss_bytes: load.map(|load| load.rss_bytes),
            }
        };
        let loops = status.processes.iter().map(row).collect();
        Self { status, loops, dropped }
    }
}

/// Whole periods by which a loop's mark is behind the plant's.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "positive; saturates")]
fn behind(process: &ProcessStatus, plant_s: f64) -> u64 {
    ((plant_s - process.mark_s) * process.rate_hz).max(0.0) as u64
}
