//! A flight in which slots change hands, in one process: the protocol of the launcher, with loops for
//! processes.
//!
//! [`Director`] gives the slots their events and does what it wants done, at the instants at which the
//! launcher does it in lockstep: when everything that is allowed has been flown.

use super::InProcessError;
use super::loops::Loop;
use super::marks::FlightMarks;
use super::outside::ExitReport;
use super::posts::{InProcessHost, RestartOutcome, Seats, flying};
use runtime::Graph;
use runtime::graph::CREDIT_NS;
use scenario::Scenario;
use scenario::candidate::Candidate;
use scenario::orders::Planner;
use scenario::services::{self, Assignment};
use shared_types::{ClockMode, Role, Slot};
use slot::supervisor::Now;
use swap::{FlightError, Script, SlotContext, Slots, SwapReport};

/// Runs the script of a flight and the slots' state machines.
pub(super) struct Director {
    slots: Slots,
    script: Script,
    /// What orders make of the flight's plan.
    pub(super) orders: Planner,
    host: InProcessHost,
    /// Steps from here on have not been allowed \[ns\].
    pub(super) allowed_ns: u64,
    /// Everything before has been flown \[ns\].
    drained_ns: u64,
    /// Loops take time: one that is late is not waited for.
    loops_take_time: bool,
    /// What did not go as asked for.
    pub(super) notices: Vec<String>,
    /// Loops that had to be started again.
    pub(super) recovered: u64,
}

/// What of a script cannot be done within one process.
fn refuse_impossible(scenario: &Scenario) -> Result<(), InProcessError> {
    let swaps = scenario.settings().swap.iter().map(|swap| (swap.slot, &swap.to));
    let standbys = scenario.settings().standby.iter().map(|s| (s.slot, &s.name));
    for (slot, name) in swaps.chain(standbys) {
        Candidate::find(slot, name)
            .map_err(|no| InProcessError::Slots(format!("{}: {}", no.what, no.remedy)))?;
    }
    for fault in &scenario.settings().fault {
        let role = services::role_of(&fault.name);
        if role.is_none_or(|role| role.seats() == 1) {
            return Err(InProcessError::NoSlot { name: fault.name.clone() });
        }
    }
    Ok(())
}

impl Director {
    /// Takes over the slots of a flight whose `loops` are ready and have not stepped.
    pub(super) fn new(
        mut host: InProcessHost,
        graph: &Graph,
        loops: &[Loop],
    ) -> Result<Self, InProcessError> {
        let scenario = host.scenario.clone();
        refuse_impossible(&scenario)?;
        let assignment = Assignment::of(scenario.settings());
        let mut specs = Vec::new();
        for l in loops {
            if l.place.role.is_slot() {
                let name = assignment.name(l.node.role);
                specs.push((l.node.role, host.register_initial(l, name)));
            }
        }
        let settings = scenario.settings();
        Ok(Self {
            // A loop that is started here is waited for then and there, so none is late.
            slots: Slots::new(ClockMode::Lockstep, &specs, &scenario, u64::MAX),
            script: Script::new(settings, graph),
            orders: Planner::of(&scenario).map_err(|error| InProcessError::Component {
                role: Role::Pilot.label(),
                error: error.to_string(),
            })?,
            host,
            allowed_ns: 0,
            drained_ns: 0,
            loops_take_time: !settings.timing.is_empty(),
            notices: Vec::new(),
            recovered: 0,
        })
    }

    /// Once all that is allowed has been flown: does what is due, and allows more. False if there is
    /// no more.
    pub(super) fn go_on(
        &mut self,
        graph: &Graph,
        loops: &mut Vec<Loop>,
        marks: &mut FlightMarks,
        end_ns: u64,
    ) -> Result<bool, InProcessError> {
        let slowest_ns = loops.iter().filter(|l| l.flies()).map(|l| l.stepper.next_ns()).min();
        let slowest_ns = slowest_ns.unwrap_or(u64::MAX);
        if slowest_ns < self.allowed_ns.min(end_ns) && !self.loops_take_time {
            return Ok(false);
        }
        let flown_ns = if self.loops_take_time { self.allowed_ns } else { slowest_ns };
        self.drained_ns = flown_ns.max(self.drained_ns);
        if let FlightMarks::Seats(marks) = marks {
            for slot in Slot::ALL {
                marks.book(slot.role()).into_iter().for_each(|book| {
                    book.forget_before(self.drained_ns.min(slowest_ns));
                });
            }
        }
        self.act(graph, loops, marks, end_ns, Slots::tend)?;
        loop {
            if self.reap(graph, loops, marks, end_ns)? {
                continue;
            }
            if self.script.is_due(&self.slots, self.now()) {
                let mut script = core::mem::take(&mut self.script);
                let run =
                    |slots: &mut Slots, context: &mut SlotContext<'_>| script.run(slots, context);
                let done = self.act(graph, loops, marks, end_ns, run);
                self.script = script;
                done?;
            } else if !self.host.start_all(graph, loops, marks) && !self.host.has_news() {
                break;
            }
            self.act(graph, loops, marks, end_ns, Slots::tend)?;
        }
        let cap_ns = self.slots.cap_ns(self.allowed_ns).min(self.script.next_ns()).min(end_ns);
        let before_ns = self.allowed_ns;
        self.allowed_ns = self.drained_ns.saturating_add(CREDIT_NS).min(cap_ns).max(before_ns);
        Ok(self.allowed_ns > before_ns)
    }

    /// Where the flight is: what is to be done between two releases is done once time ends there.
    fn now(&self) -> Now {
        Now { logical_ns: self.drained_ns.min(self.allowed_ns), allowed_ns: self.allowed_ns }
    }

    fn act(
        &mut self,
        graph: &Graph,
        loops: &mut Vec<Loop>,
        marks: &mut FlightMarks,
        end_ns: u64,
        act: impl FnOnce(&mut Slots, &mut SlotContext<'_>) -> Result<(), FlightError>,
    ) -> Result<(), InProcessError> {
        let now = self.now();
        let recovered = &mut self.recovered;
        let mut seats = Seats { loops, marks, host: &mut self.host, recovered };
        let mut context = SlotContext {
            posts: &mut seats,
            graph,
            orders: &mut self.orders,
            now,
            now_mono_ns: 0,
            is_over: self.drained_ns >= end_ns,
            monitor_silent_ns: None,
        };
        let done = act(&mut self.slots, &mut context);
        for news in core::mem::take(&mut self.slots.news) {
            self.host.wires.observer().note(now.logical_ns, news.warning, &news.text);
            self.notices.extend(news.warning.then_some(news.text));
        }
        done.map_err(|error| InProcessError::Slots(error.to_string()))
    }

    /// Deals with processes that have failed, once no loop may step: one that commands, or may have to,
    /// is started again in place, and the others are reported to the slots. False if there are none.
    pub(super) fn reap(
        &mut self,
        graph: &Graph,
        loops: &mut Vec<Loop>,
        marks: &mut FlightMarks,
        end_ns: u64,
    ) -> Result<bool, InProcessError> {
        let Some(at) = loops.iter().position(|l| l.stepper.has_failed()) else { return Ok(false) };
        let failed = loops.remove(at);
        let instances = flying(loops);
        match self.host.restart(graph, failed, &instances, marks)? {
            RestartOutcome::Restarted(l, text) => {
                loops.insert(at, l);
                self.recovered += 1;
                self.host.wires.observer().note(self.drained_ns, true, &text);
                self.notices.push(text);
            }
            RestartOutcome::Gone(failed) => {
                self.host.reap(failed, marks);
                let slowest_ns = instances.iter().map(|instance| instance.mark_ns).min();
                self.drained_ns = slowest_ns.unwrap_or(0).max(self.drained_ns);
                self.act(graph, loops, marks, end_ns, Slots::tend)?;
            }
        }
        Ok(true)
    }

    /// What has become of processes that failed.
    pub(super) fn exits(&mut self) -> &mut Vec<ExitReport> {
        &mut self.host.exits
    }

    /// Loops that no longer own their seat leave in order.
    pub(super) fn retire(&mut self, loops: &mut Vec<Loop>, marks: &mut FlightMarks) -> bool {
        let over = |l: &Loop| l.flies() && l.stepper.next_ns() >= l.leave_ns;
        let Some(at) = loops.iter().position(over) else { return false };
        let mut l = loops.remove(at);
        // As it was published, without the totals of the end.
        self.host.keep_state(&mut l);
        l.stepper.finish();
        self.host.reap(l, marks);
        true
    }

    /// What came of each swap; the flight is over.
    pub(super) fn reports(&mut self) -> Vec<SwapReport> {
        self.slots.finish();
        core::mem::take(&mut self.slots.reports)
    }
}
