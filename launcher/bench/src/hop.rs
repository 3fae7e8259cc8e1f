//! `morphquad bench hop`: one sample from process to process, through the runtime's ports and through the
//! bare transport, in the same pair of processes.

use super::peer::hop::{ACKNOWLEDGED, BARE, BLOCK, Carrier, End, Hops, SENDER, Waiting};
use super::peer::{Peer, PeerRequest, Seat as ThreadSeat};
use super::place::{Place, Policy};
use super::{BenchError, run_id};
use crate::series::{Quantiles, Rank, Ratios, Series};
use figures::results::Table;
use protocol::control::runs::note_measurement;
use runtime::ipc::{Bus, ServiceKind};
use runtime::namespace::Membership;
use serde::Serialize;
use serde_json::{Value, json};
use shared_types::{Progress, Registry, Seat, StateEstimate, topics};
use std::path::Path;

/// A reader that sleeps gets a sample this often \[ns\].
const PERIOD_NS: u64 = 1_000_000;
/// Pairs of processes that measure a cell one after the other: where the memory of one pair comes to lie
/// decides about a fifth of a polled hop.
const COUPLES: u64 = 5;
/// Polled samples of a carrier in the time of one that a sleeper gets.
const POLLED_PER_PERIOD: u64 = 20;

/// What is measured, and where.
#[derive(Debug, Clone)]
pub struct HopPlan {
    /// How long each carrier is measured with a sleeping reader \[ns\].
    pub for_ns: u64,
    /// Policy and processors.
    pub place: Place,
}

/// One way of waiting on one choice of processors.
#[derive(Debug, Clone, Serialize)]
pub struct HopCell {
    /// How the reader waits.
    pub waiting: Waiting,
    /// Of sender and reader.
    pub cpus: [usize; 2],
    /// In effect.
    pub policy: Policy,
    /// Through the runtime's ports.
    pub ports: Quantiles,
    /// Through the bare transport.
    pub bare: Quantiles,
    /// Through the bare transport, woken by the run's pipe.
    pub bare_pipe: Option<Quantiles>,
    /// Ports over bare.
    pub ratio: Ratios,
    /// Ports over bare with the pipe.
    pub ratio_pipe: Option<Ratios>,
}

/// All of them.
#[derive(Debug, Clone, Serialize)]
pub struct HopReport {
    /// Topic whose sample is sent.
    pub payload: &'static str,
    /// Its size.
    pub payload_bytes: usize,
    /// What was measured.
    pub cells: Vec<HopCell>,
    /// What could not be.
    pub left_out: Vec<String>,
}

/// Measures every cell; `done` is called after each.
///
/// # Errors
/// [`BenchError`].
pub fn measure(plan: &HopPlan, done: &dyn Fn()) -> Result<HopReport, BenchError> {
    let run = Membership::found(&run_id())?;
    note_measurement(run.folder()).map_err(|source| BenchError::System {
        action: "write the run's folder".to_owned(),
        source,
    })?;
    let bus = Bus::join(&run.ipc_config(), "bench")?;
    let _topic = bus.create_topic(&topics::STATE_ESTIMATE)?;
    let _registry = bus.create_service::<Registry>(ServiceKind::Registry, 2)?;
    let _bare = bus.create_bare::<StateEstimate>(BARE, topics::STATE_ESTIMATE.info.history)?;
    let _acknowledged = bus.create_bare::<Progress>(ACKNOWLEDGED, 1)?;
    let _events = bus.create_bare_events(BARE)?;
    bus.create_wake(Seat::first(SENDER))?;
    let mut report = HopReport {
        payload: topics::STATE_ESTIMATE.info.name,
        payload_bytes: size_of::<StateEstimate>(),
        cells: Vec::new(),
        left_out: Vec::new(),
    };
    for waiting in [Waiting::Polled, Waiting::Blocking] {
        for pair in pairs(&plan.place.cpus) {
            report.cells.push(cell(plan, (&bus, run.folder()), waiting, pair)?);
            done();
        }
    }
    if plan.place.cpus.len() < 2 {
        report.left_out.push("two processors: this process may run on one only".to_owned());
    }
    Ok(report)
}

/// Processors of sender and reader: the same one, then two.
#[must_use]
pub fn pairs(cpus: &[usize]) -> Vec<[usize; 2]> {
    let mut pairs = Vec::new();
    if let Some(first) = cpus.first() {
        pairs.push([*first; 2]);
        pairs.extend(cpus.get(1).map(|second| [*first, *second]));
    }
    pairs
}

fn cell(
    plan: &HopPlan,
    (bus, run): (&Bus, &Path),
    waiting: Waiting,
    cpus: [usize; 2],
) -> Result<HopCell, BenchError> {
    // A process that polls ahead of all others is stopped by the system for a twentieth of each second.
    let fifo = plan.place.fifo().filter(|_| waiting == Waiting::Blocking);
    let count = plan.for_ns / PERIOD_NS;
    let count = if waiting == Waiting::Polled { count * POLLED_PER_PERIOD } else { count };
    let count = count / COUPLES;
    let end = |cpu| End {
        run: run.to_path_buf(),
        seat: ThreadSeat { cpu: Some(cpu), fifo, like_a_loop: true },
        waiting,
        shared: cpus[0] == cpus[1],
        blocks: count.div_ceil(BLOCK).max(1),
        period_ns: PERIOD_NS,
    };
    let mut hops: Hops = vec![Vec::new(); waiting.carriers().len()];
    for _ in 0..COUPLES {
        let mut reader = Peer::start(&PeerRequest::HopTo(end(cpus[1])))?;
        let mut sender = Peer::start(&PeerRequest::HopFrom(end(cpus[0])))?;
        reader.send_line("go")?;
        sender.send_line("go")?;
        let more: Hops = reader.answer()?;
        let _: u64 = sender.answer()?;
        hops.iter_mut().zip(more).for_each(|(all, more)| all.extend(more));
        bus.sweep_dead_processes(&mut || ());
    }
    let of = |carrier: Carrier| {
        let at = waiting.carriers().iter().position(|c| *c == carrier);
        let hops = at.and_then(|at| hops.get(at))?;
        hops.iter().copied().collect::<Series>().quantiles()
    };
    let nothing = || BenchError::Peer("measured nothing".to_owned());
    let (ports, bare) =
        (of(Carrier::Ports).ok_or_else(nothing)?, of(Carrier::Bare).ok_or_else(nothing)?);
    let bare_pipe = of(Carrier::BarePipe);
    Ok(HopCell {
        waiting,
        cpus,
        policy: if fifo.is_some() { Policy::Fifo } else { Policy::Other },
        ratio: ports.over(&bare),
        ratio_pipe: bare_pipe.as_ref().map(|bare| ports.over(bare)),
        ports,
        bare,
        bare_pipe,
    })
}

impl HopReport {
    /// The largest ratio of medians to the bare transport.
    #[must_use]
    pub fn worst_ratio(&self) -> Option<f64> {
        self.cells.iter().filter_map(|cell| cell.ratio.p50).reduce(f64::max)
    }

    /// For machines.
    #[must_use]
    pub fn to_json(&self) -> Value {
        json!(self)
    }

    /// For people.
    #[must_use]
    pub fn table(&self) -> Table {
        let headings = ["reader", "cpus", "policy", "carrier", "n"].map(String::from);
        let ranks = Rank::ALL.map(|rank| rank.label().to_owned());
        let ratios = ["p50 x", "p99 x"].map(String::from);
        let mut table = Table::new(headings.into_iter().chain(ranks).chain(ratios));
        for cell in &self.cells {
            let rows = [
                ("ports", Some(cell.ports), Some(cell.ratio)),
                ("iceoryx2", Some(cell.bare), None),
                ("iceoryx2 + our pipe", cell.bare_pipe, None),
            ];
            for (carrier, quantiles, ratio) in rows {
                let Some(quantiles) = quantiles else { continue };
                let cpus = format!("{}>{}", cell.cpus[0], cell.cpus[1]);
                let mut row = vec![
                    cell.waiting.label().to_owned(),
                    cpus,
                    cell.policy.label().to_owned(),
                    carrier.to_owned(),
                    quantiles.n.to_string(),
                ];
                row.extend(Rank::ALL.map(|rank| super::us(quantiles.at(rank))));
                for rank in [Rank::P50, Rank::P99] {
                    row.push(super::ratio(ratio.and_then(|ratio| ratio.at(rank))));
                }
                table.push(row);
            }
        }
        table
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_processor_makes_one_pair_and_more_make_two() {
        assert_eq!(pairs(&[3]), [[3, 3]]);
        assert_eq!(pairs(&[0, 2, 3]), [[0, 0], [0, 2]]);
        assert!(pairs(&[]).is_empty());
    }
}
