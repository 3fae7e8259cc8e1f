//! The report: tables for people, the same figures for machines.

use crate::budget::Budget;
use crate::flights::{Flown, InProcess, PINNED};
use crate::floor::Floor;
use crate::{Plan, Rounds};
use core::fmt::{Error, Write as _};
use serde_json::{Value, json};

/// Everything that was measured.
pub(crate) struct Report {
    pub(crate) floors: Vec<Floor>,
    pub(crate) flown: Vec<Flown>,
    pub(crate) in_process: Vec<InProcess>,
    pub(crate) budgets: Vec<Budget>,
}

/// Median and range.
fn with_range(rounds: &Rounds, digits: usize) -> String {
    let [least, most] = rounds.range();
    format!("{:.digits$} ({least:.digits$} to {most:.digits$})", rounds.median())
}

fn recorder(records: bool) -> &'static str {
    if records { "recording" } else { "no recording" }
}

/// Real-time factor of a network that only passes samples round, as often as this plan does.
fn floor_factor(flown: &Flown, floor: &Floor) -> f64 {
    1e3 / (flown.sleeps.median() * floor.hop_us.median())
}

impl Report {
    /// Flight from which a plan's switches are taken: one core, no recorder beside it.
    fn reference(&self, plan: Plan) -> Option<&Flown> {
        self.flown.iter().find(|f| f.plan == plan && !f.records && f.flag == PINNED)
    }

    /// The same flight without a recorder.
    fn without_recorder(&self, flown: &Flown) -> Option<&Flown> {
        let is_same = |f: &&Flown| f.plan == flown.plan && f.flag == flown.flag && !f.records;
        self.flown.iter().find(is_same)
    }

    fn hop_us(&self) -> f64 {
        let one_core = self.floors.iter().filter(|f| f.cpus.len() == 1);
        one_core.map(|f| f.hop_us.median()).fold(f64::INFINITY, f64::min)
    }

    pub(crate) fn text(&self) -> Result<String, Error> {
        let mut out = String::new();
        let o = &mut out;
        writeln!(o, "bare ring of five processes, us per hop: median (range)")?;
        for floor in &self.floors {
            let hop = with_range(&floor.hop_us, 2);
            let cores = if floor.cpus.len() == 1 { "one core" } else { "two cores" };
            writeln!(o, "  {:<22}{cores:<12}{hop}", floor.waking.name())?;
        }
        writeln!(o, "\nflights of the executable, times real time: median (range)")?;
        for f in &self.flown {
            let (name, how) = (f.plan.name(), recorder(f.records));
            let factor = with_range(&f.factor, 1);
            write!(o, "  {name:<32}{how:<15}{:<14}{factor}", f.flag)?;
            if f.records {
                write!(o, ", {:.2} MB a second", f.recorded_mb.median())?;
                if let Some(without) = self.without_recorder(f) {
                    let share = f.factor.median() / without.factor.median();
                    write!(o, ", {share:.2} of the speed without")?;
                }
            }
            writeln!(o)?;
        }
        writeln!(o, "\nloops in this thread, no recording, times real time: median (range)")?;
        for f in &self.in_process {
            let hash = if f.hashes { "with flight hash" } else { "" };
            writeln!(o, "  {:<32}{hash:<20}{}", f.plan.name(), with_range(&f.factor, 0))?;
        }
        for budget in &self.budgets {
            self.write_budget(o, budget)?;
        }
        Ok(out)
    }

    fn write_budget(&self, o: &mut String, budget: &Budget) -> Result<(), Error> {
        let name = budget.plan.name();
        writeln!(o, "\nbudget of a simulated millisecond: {name}, one core, no recording")?;
        for l in &budget.loops {
            let (role, us) = (l.role.label(), l.step_us.median());
            let steps = format!("{:.2} steps of {us:.2} us", l.steps_per_ms);
            writeln!(o, "  {role:<14}{steps:<36}{:6.2} us", us * l.steps_per_ms)?;
        }
        let Some(flown) = self.reference(budget.plan) else { return Ok(()) };
        let sleeps = flown.sleeps.median();
        let hops_us = sleeps * self.hop_us();
        let hops = format!("{sleeps:.2} hops of {:.2} us", self.hop_us());
        writeln!(o, "  {:<14}{hops:<36}{hops_us:6.2} us", "wakes")?;
        let published = budget.samples_per_ms + budget.states_per_ms;
        let more = (published - sleeps).max(0.0);
        let more_us = more * budget.sample_us;
        let text = format!("{more:.2} more of {:.2} us", budget.sample_us);
        writeln!(o, "  {:<14}{text:<36}{more_us:6.2} us", "samples")?;
        let whole_us = 1e3 / flown.factor.median();
        let rest_us = whole_us - budget.compute_us() - hops_us - more_us;
        writeln!(o, "  {:<50}{rest_us:6.2} us", "marks, permissions, clock, the rest")?;
        writeln!(o, "  {:<50}{whole_us:6.2} us", "together")?;
        writeln!(
            o,
            "  counts: {:.2} samples ({:.0} bytes) published, {:.2} received by loops, {:.2} states ({:.0} bytes);\n          {sleeps:.2} sleeps, {:.2} displaced; {:.1} us of all processors",
            budget.samples_per_ms,
            budget.bytes_per_ms,
            budget.readings_per_ms,
            budget.states_per_ms,
            budget.state_bytes_per_ms,
            flown.displaced.median(),
            flown.cpu_us.median(),
        )?;
        for floor in &self.floors {
            let cores = if floor.cpus.len() == 1 { "one core" } else { "two cores" };
            writeln!(
                o,
                "  bare ring with as many hops, {} on {cores}: {:.0} times real time",
                floor.waking.name(),
                floor_factor(flown, floor)
            )?;
        }
        Ok(())
    }

    pub(crate) fn json(&self) -> String {
        let rounds = |r: &Rounds| json!({ "median": r.median(), "range": r.range() });
        let floors = self.floors.iter().map(|f| {
            json!({ "waking": f.waking.name(), "cores": f.cpus.len(), "hop_us": rounds(&f.hop_us) })
        });
        let flown = self.flown.iter().map(|f| {
            json!({
                "plan": f.plan.name(), "recording": f.records, "flag": f.flag,
                "real_time_factor": rounds(&f.factor), "recorded_mb_per_s": rounds(&f.recorded_mb),
                "cpu_us_per_ms": rounds(&f.cpu_us),
                "sleeps_per_ms": rounds(&f.sleeps), "displaced_per_ms": rounds(&f.displaced),
            })
        });
        let in_process = self.in_process.iter().map(|f| {
            let factor = rounds(&f.factor);
            json!({ "plan": f.plan.name(), "flight_hash": f.hashes, "real_time_factor": factor })
        });
        let budgets = self.budgets.iter().map(|b| {
            let loops = b.loops.iter().map(|l| {
                json!({
                    "role": l.role.label(), "steps_per_ms": l.steps_per_ms,
                    "step_us": rounds(&l.step_us),
                })
            });
            json!({
                "plan": b.plan.name(), "loops": loops.collect::<Value>(),
                "compute_us_per_ms": b.compute_us(), "samples_per_ms": b.samples_per_ms,
                "bytes_per_ms": b.bytes_per_ms, "readings_per_ms": b.readings_per_ms,
                "states_per_ms": b.states_per_ms, "state_bytes_per_ms": b.state_bytes_per_ms,
                "sample_us": b.sample_us,
            })
        });
        let report = json!({
            "floor": floors.collect::<Value>(), "processes": flown.collect::<Value>(),
            "in_process": in_process.collect::<Value>(), "budget": budgets.collect::<Value>(),
        });
        format!("{report}\n")
    }
}
