//! The end of a flight and its summary.

use super::{Flight, Outcome};
use observe::stopwatch::Stopwatch;
use protocol::topic::feed::Ending;
use runtime::clock::mono_now_ns;
use simulate::Summary;
use simulate::setup::{RunError, RunOptions};
use std::path::PathBuf;

impl Flight {
    /// Ends a flight that never started. Viewers get the end of it as of any other, and with it the time to answer a client
    /// that has ordered it to stop.
    pub(super) fn abort(mut self, error: &RunError) {
        self.supervisor.kill_all();
        if let Some(feed) = &self.tap.sinks.feed {
            feed.end(&Ending { is_good: false, text: error.to_string() });
        }
        self.show_rest();
    }

    pub(super) fn conclude(
        mut self,
        outcome: Outcome,
        options: &RunOptions,
        id: &str,
        recording_path: Option<PathBuf>,
    ) -> (Summary, Option<Stopwatch>) {
        let (from_ns, begun_mono_ns) = self.begun;
        let wall_ns = mono_now_ns().saturating_sub(begun_mono_ns);
        if matches!(outcome, Outcome::Killed | Outcome::Lost(_)) {
            self.supervisor.kill_all();
        }
        // All have left. What they leave behind goes with the run, which is wiped whole.
        self.tap.drain(mono_now_ns());
        self.supervisor.finish_sweep();
        if let Some(leftovers) = self.leftovers.take() {
            leftovers.finish();
        }
        let flown_ns = self.drained_ns().max(from_ns).min(self.conductor.end_ns());
        self.tap.sinks.metrics.finish();
        self.script.refuse_waiting(flown_ns, &mut self.slots.reports);
        self.slots.finish();
        let ignored: u64 = self.bus.strays().iter().map(|stray| stray.samples).sum();
        if ignored > 0 {
            self.notice(&format!("ignored {ignored} samples from unregistered publishers"));
        }
        let mut summary = Summary {
            run_id: id.to_owned(),
            scenario: options.scenario.settings().scenario.name.clone(),
            clock: self.conductor.mode(),
            seed: options.scenario.settings().scenario.seed,
            from_ns,
            flown_ns,
            planned_ns: options.scenario.duration_ns(),
            wall_ns,
            processes: self.graph.nodes().iter().map(|n| (n.role, n.rate.hz())).collect(),
            hash: self.tap.sinks.hash.hex(),
            log_hash: self.tap.sinks.log_hash.hex(),
            metrics: core::mem::take(&mut self.tap.sinks.metrics),
            audit: self.tap.sinks.audit.clone(),
            recovered: self.supervisor.recovered,
            swaps: core::mem::take(&mut self.slots.reports),
            orders: core::mem::take(&mut self.orders.reports),
            notices: core::mem::take(&mut self.notices),
            lost: None,
            interrupted: false,
            cut_short: self.conductor.is_cut_short(),
            recording: recording_path,
            recording_error: self.tap.sinks.recording_error.take(),
        };
        match outcome {
            Outcome::Flown => {}
            Outcome::Interrupted | Outcome::Killed => summary.interrupted = true,
            Outcome::Lost(reason) => summary.lost = Some(reason),
        }
        self.tap.sinks.finish(&mut summary);
        self.show_rest();
        (summary, self.tap.sinks.stopwatch.take())
    }
}
