//! One flight from founding its run to its end.
//!
//! `start.rs` starts it, `adopt.rs` takes it over while it flies, `finish.rs` ends it;
//! `watch.rs` is what the main loop looks at besides, `timed.rs` how one goes on whose clock it moves.

mod adopt;
mod described;
mod finish;
mod leftovers;
mod start;
mod timed;
mod watch;
mod watchdog;

pub use adopt::{AdoptError, AdoptOptions, adopt};

use super::checkpoint::{CheckpointWriter, Of};
use super::conductor::Conductor;
use super::grants::Grants;
use super::live::{Live, View};
use super::processes::Processes;
use super::rehearser::Rehearser;
use super::stall::Newcomers;
use super::supervisor::Supervisor;
use super::tap::Tap;
use super::viewer_process::ViewerProcess;
use described::Described;
use host::realtime::may_lock_memory;
use leftovers::Leftovers;
use observe::stopwatch::Stopwatch;
use protocol::control::protocol::{Done, Reply, Request};
use protocol::control::server::Answer;
use protocol::topic::feed::Flying;
use record::{Recorder, Severity};
use runtime::clock::{mono_now_ns, sleep_until};
use runtime::ipc::{Bus, LatestPort};
use runtime::namespace::{Membership, Reservation, sweep_dead_runs};
use runtime::watch::StopFlags;
use runtime::{Graph, MarkView as _};
use scenario::needs::MemoryNeed;
use scenario::orders::Planner;
use shared_types::time::ns_from_s;
use shared_types::{ClockMode, ClockRecord, Role, Seat};
use simulate::Summary;
use simulate::setup::{
    RunError, RunOptions, Unflown, clock_of, facts, pinned_cpu, require_descriptors,
    require_own_proc, require_processor, require_tasks, run_id, system,
};
use slot::supervisor::Now;
use std::collections::VecDeque;
use swap::services::{HeldServices, Wakers};
use swap::{FlightError, Script, SlotContext, Slots};
use timed::Timed;
use timing::Announcements;
use watchdog::Watchdog;

/// Wall time between two looks around \[ns\].
const LOOK_EVERY_NS: u64 = 1_000_000;
/// The same in realtime while no process joins: those that fly do not wait for the launcher, consumers move to a fallback
/// by themselves, and what is to be recorded waits in rings of half a second or more. At 1 kHz the launcher took a quarter
/// of a flight's processor time.
const REALTIME_LOOK_EVERY_NS: u64 = 4_000_000;
/// No swap is accepted while the monitor has not stepped for so many of its periods and for so much wall time \[s\]:
/// faster than the wall clock, or at a high rate, no machine keeps to three periods.
const MONITOR_PERIODS_MAX: u64 = 3;
const MIN_SILENCE_S: f64 = 0.03;
/// How long processes may take to leave after the end of the flight \[ns\].
const LEAVE_LIMIT_NS: u64 = 5_000_000_000;

/// How the flight's main loop ended.
enum Outcome {
    Flown,
    Interrupted,
    Killed,
    Lost(String),
}

/// Flies a scenario and returns what came of it.
///
/// # Errors
/// [`RunError`] if the flight never started; what happens in flight is in the summary.
pub fn run(options: &RunOptions) -> Result<Summary, RunError> {
    fly(options, None).map(|(summary, _)| summary)
}

/// As [`run`], and keeps the stamps of every sample.
///
/// # Errors
/// As [`run`].
pub fn run_measured(
    options: &RunOptions,
    stopwatch: Stopwatch,
) -> Result<(Summary, Stopwatch), RunError> {
    let (summary, stopwatch) = fly(options, Some(stopwatch))?;
    Ok((summary, stopwatch.unwrap_or_default()))
}

fn cpu_of(options: &RunOptions) -> Option<usize> {
    pinned_cpu(options.pin, clock_of(&options.scenario))
}

fn fly(
    options: &RunOptions,
    stopwatch: Option<Stopwatch>,
) -> Result<(Summary, Option<Stopwatch>), RunError> {
    let stop = StopFlags::watch_signals().map_err(system("watch signals"))?;
    for folder in sweep_dead_runs() {
        eprintln!("morphquad: cleaned up after a dead run, {}", folder.display());
    }
    require_own_proc()?;
    require_processor(options.pin)?;
    let need = MemoryNeed::of_flight(options.scenario.settings(), may_lock_memory());
    need.look(0).map_err(RunError::from)?;
    require_descriptors()?;
    require_tasks()?;
    let described = Described::flight(options)?;
    let grants = Grants::ask(&options.scenario, &described)?;
    let id = run_id();
    // Declared before everything that uses the transport, so that it is dropped last and wipes; and before the
    // recording, whose file name would reveal the run's id to other users before it is claimed.
    let membership = Membership::found(&id)?;
    let recording_path = options.recording_path(&id)?;
    let facts = facts(&id, options);
    let recording =
        recording_path.as_deref().map(|path| Recorder::create(path, &facts)).transpose()?;
    let unflown = Unflown::of(recording_path.as_deref());
    let described = Described::leave(membership.folder(), options, described)?;
    let name = &options.scenario.settings().scenario.name;
    let flying = Flying::new(facts.epoch_unix_ns, facts.clock);
    let live = Live::open(membership.folder(), &id, name, recording_path.as_deref(), flying)?;
    let viewers = options.live.as_ref().map(|live| ViewerProcess::open(live, &id, cpu_of(options)));
    let viewers = viewers.transpose()?;
    let of = Of::begun(&id, recording_path.as_deref(), facts.epoch_unix_ns);
    let checkpoint_writer =
        CheckpointWriter::open(membership.folder(), of, clock_of(&options.scenario));
    let mut flight = Flight::prepare(
        options,
        &membership,
        stop,
        recording,
        (live, checkpoint_writer, described),
    )?;
    flight.tap.sinks.stopwatch = stopwatch;
    let outcome = flight.start(options, &grants).map(|()| {
        unflown.begins();
        flight.fly()
    });
    if let Some(viewers) = &viewers {
        viewers.flight_is_over();
    }
    let concluded = match outcome {
        Ok(outcome) => Ok(flight.conclude(outcome, options, &id, recording_path)),
        Err(error) => {
            flight.abort(&error);
            Err(error)
        }
    };
    if let Some(viewers) = viewers {
        viewers.leave();
    }
    concluded
}

struct Flight {
    graph: Graph,
    supervisor: Supervisor,
    slots: Slots,
    script: Script,
    orders: Planner,
    conductor: Conductor,
    /// Of a flight whose clock this launcher moves.
    timed: Option<Timed>,
    /// Of a script of times.
    announcements: Announcements,
    /// Orders of clients that have not been carried out.
    asked: Vec<(Request, Answer)>,
    tap: Tap,
    wakers: Wakers,
    stop: StopFlags,
    bus: Bus,
    live: Live,
    services: HeldServices,
    /// Logical and host instant from which on this launcher leads \[ns\].
    begun: (u64, u64),
    stall_limit_ns: u64,
    lag_limit_ns: u64,
    progress_at: (u64, u64),
    newcomers: Newcomers,
    drained_ns: u64,
    /// How far any monitor has got while this launcher led \[ns\]: one that is started again begins below that.
    monitored_ns: u64,
    rehearser: Rehearser,
    known_strays: usize,
    /// When this launcher looked last, by `CLOCK_MONOTONIC` \[ns\].
    looked_ns: Option<u64>,
    /// When to look again at all files of the run in shared memory \[ns\].
    next_file_look_ns: u64,
    /// How often services were put back, and how often they could not be.
    removals: (u32, u32),
    /// When a process had joined last as memory was reserved, by `CLOCK_MONOTONIC` \[ns\].
    reserved_after_ns: u64,
    described: Described,
    /// Of the launcher before this one, until it is freed.
    leftovers: Option<Leftovers>,
    /// Takes the memory of what has been made since, where none is locked.
    reservation: Option<Reservation>,
    /// The clock as the run's processes read it.
    clock_reader: LatestPort<ClockRecord>,
    progress: Option<indicatif::ProgressBar>,
    notices: Vec<String>,
    /// It has been asked to end before its time.
    is_interrupted: bool,
    /// What standard error has not taken yet.
    unshown: VecDeque<Vec<u8>>,
}

impl Flight {
    /// The launcher's main loop: drain, conduct, look after all processes.
    fn fly(&mut self) -> Outcome {
        let mut leave_by_ns = u64::MAX;
        let watchdog = Watchdog::of(self.supervisor.folder().to_owned());
        loop {
            let now_ns = mono_now_ns();
            watchdog.kick(now_ns);
            self.tap.drain(now_ns);
            let drained = self.drained_ns();
            self.name_standstill(now_ns);
            let looked_after = self.look_after(now_ns).and_then(|()| self.follow_script(now_ns));
            self.publish_notices(drained);
            self.name_strays();
            if let Err(error) = looked_after {
                return Outcome::Lost(error.to_string());
            }
            let cap_ns = self.cap_ns(self.conductor.allowed_ns());
            if self.timed.is_none() && self.conductor.extend(drained, cap_ns, now_ns) {
                self.wakers.wake_all();
            }
            self.conductor.serve_late_joiners();
            if self.supervisor.all_finished() {
                self.tap.drain(mono_now_ns());
                return if self.is_interrupted { Outcome::Interrupted } else { Outcome::Flown };
            }
            if self.stop.take_signal() {
                if self.is_interrupted {
                    return Outcome::Killed;
                }
                self.is_interrupted = true;
                leave_by_ns = now_ns + LEAVE_LIMIT_NS;
                self.end_early(now_ns);
            }
            if drained >= self.conductor.end_ns() && self.conductor.let_leave() {
                self.wakers.wake_all();
                leave_by_ns = leave_by_ns.min(now_ns + LEAVE_LIMIT_NS);
            }
            if leave_by_ns != u64::MAX && self.supervisor.is_restarting() {
                // One that was being restarted leaves once it has caught up.
                leave_by_ns = leave_by_ns.max(now_ns + LEAVE_LIMIT_NS);
            } else if leave_by_ns != u64::MAX
                && self.conductor.mode() == ClockMode::Lockstep
                && drained < self.conductor.end_ns()
            {
                // All fly up to the end, which takes as long as the slowest of them makes it.
                leave_by_ns = leave_by_ns.max(self.progress_at.0.saturating_add(LEAVE_LIMIT_NS));
            }
            if now_ns > leave_by_ns {
                let names = self.supervisor.unfinished().join(", ");
                return Outcome::Lost(format!("{names} did not leave after the end of the flight"));
            }
            if let Err(error) = self.watch_progress(drained, now_ns) {
                return Outcome::Lost(error.to_string());
            }
            self.look_at_processes(now_ns);
            if let Err(error) = self.answer(mono_now_ns()) {
                return Outcome::Lost(error.to_string());
            }
            self.look_at_files(now_ns);
            self.pass_time(now_ns);
        }
    }

    /// Lets the flight go on until it is time to look around again.
    fn pass_time(&mut self, now_ns: u64) {
        if self.timed.is_some() {
            self.give_turns(now_ns);
        } else {
            self.announce_until(self.drained_ns);
            sleep_until(now_ns + self.look_every_ns());
        }
    }

    /// Until the next look around \[ns\]: soon if a process waits for one, which joins or is to be started again.
    fn look_every_ns(&self) -> u64 {
        let is_realtime = self.conductor.mode() == ClockMode::Realtime;
        let is_patient = is_realtime && !self.supervisor.has_arrivals();
        if is_patient { REALTIME_LOOK_EVERY_NS } else { LOOK_EVERY_NS }
    }

    /// Answers the clients that ask from outside.
    fn answer(&mut self, now_ns: u64) -> Result<(), FlightError> {
        let (graph, supervisor, conductor) = (&self.graph, &self.supervisor, &self.conductor);
        let (marks, drained_ns) = (&self.tap.marks, self.drained_ns);
        let slots = &self.slots;
        let view = View { graph, supervisor, slots, conductor, marks, drained_ns };
        let mut orders = self.live.serve(&view, now_ns);
        orders.retain(|(request, answer)| {
            let goes_on = *request != Request::Stop;
            if !goes_on {
                // A second one does not kill what leaves in order, as a second signal does.
                if !self.is_interrupted {
                    self.stop.request();
                }
                answer.send(Reply::Done(Done::stopping()));
            }
            goes_on
        });
        self.asked.extend(orders);
        if self.asked.is_empty() || self.is_amid_a_stretch() {
            return Ok(());
        }
        let orders = core::mem::take(&mut self.asked);
        self.with_slots(now_ns, |slots, context| {
            orders.into_iter().try_for_each(|(order, answer)| slots.order(&order, answer, context))
        })
    }

    /// Looks after processes, then slots.
    fn look_after(&mut self, now_ns: u64) -> Result<(), FlightError> {
        let slots = &self.slots;
        let keeps = |seat: Seat| slots.keeps(seat);
        self.supervisor.look_after(&self.bus, &mut self.tap, &keeps, now_ns)?;
        if self.is_amid_a_stretch() { Ok(()) } else { self.tend_slots(now_ns) }
    }

    /// Gives the slots what has happened, and passes on what they report.
    fn tend_slots(&mut self, now_mono_ns: u64) -> Result<(), FlightError> {
        self.with_slots(now_mono_ns, Slots::tend)
    }

    /// Does what the script has for now; a process that dies of it is reaped before time goes on.
    fn follow_script(&mut self, now_mono_ns: u64) -> Result<(), FlightError> {
        let is_due = self.script.is_due(&self.slots, self.logical_now(now_mono_ns));
        if !is_due || self.is_amid_a_stretch() {
            return Ok(());
        }
        let is_lockstep = self.conductor.mode() == ClockMode::Lockstep;
        if is_lockstep && !self.supervisor.has_served(&self.tap, now_mono_ns) {
            return Ok(());
        }
        let mut script = core::mem::take(&mut self.script);
        let done = self.with_slots(now_mono_ns, |slots, context| script.run(slots, context));
        self.script = script;
        done.and_then(|()| self.look_after(now_mono_ns))
    }

    fn with_slots(
        &mut self,
        now_mono_ns: u64,
        act: impl FnOnce(&mut Slots, &mut SlotContext<'_>) -> Result<(), FlightError>,
    ) -> Result<(), FlightError> {
        let now = self.logical_now(now_mono_ns);
        let monitor_silent_ns = self.monitor_silent_ns();
        let mut posts = Processes {
            bus: &self.bus,
            supervisor: &mut self.supervisor,
            tap: &mut self.tap,
            rehearser: &mut self.rehearser,
            now_mono_ns,
        };
        let mut context = SlotContext {
            posts: &mut posts,
            graph: &self.graph,
            orders: &mut self.orders,
            now,
            now_mono_ns,
            is_over: self.drained_ns >= self.conductor.end_ns(),
            monitor_silent_ns,
        };
        let done = act(&mut self.slots, &mut context);
        self.pass_on_news(now.logical_ns);
        self.note_landing();
        done
    }

    /// By the wall clock: for how long the monitor has not stepped, if that is longer than [`MONITOR_PERIODS_MAX`] and
    /// [`MIN_SILENCE_S`] allow \[ns\]. It is judged by the plant, which a machine that stands still as a whole stops
    /// too.
    fn monitor_silent_ns(&mut self) -> Option<u64> {
        let monitor = self.graph.node(Role::Monitor)?;
        let record = self.conductor.record();
        let marks = &self.tap.marks;
        let reported_ns = marks.of_role(Role::Monitor).max(self.begun.0);
        self.monitored_ns = self.monitored_ns.max(reported_ns);
        let plant_ns = marks.of_role(Role::Plant).min(self.conductor.end_ns());
        let silent_ns = plant_ns.saturating_sub(self.monitored_ns);
        let periods_ns = MONITOR_PERIODS_MAX * monitor.rate.period_ns();
        let is_too_long = silent_ns > periods_ns.max(ns_from_s(MIN_SILENCE_S * record.speed));
        (is_too_long && self.conductor.mode() == ClockMode::Realtime).then_some(silent_ns)
    }

    /// Where the flight is, for decisions about instants.
    fn logical_now(&self, now_mono_ns: u64) -> Now {
        if self.conductor.mode() == ClockMode::Lockstep {
            // A flight held to a pace has drained up to the next release when its time ends between
            // two: what is to be done there waits until time has come so far.
            let allowed_ns = self.conductor.allowed_ns();
            // There is no time after the end, however long the last processes take to leave.
            let logical_ns = self.drained_ns.min(allowed_ns).min(self.conductor.end_ns());
            Now { logical_ns, allowed_ns }
        } else {
            let started = self.conductor.has_started();
            let wall_ns = if started { self.conductor.wall_ns(now_mono_ns) } else { 0 };
            Now { logical_ns: wall_ns, allowed_ns: wall_ns }
        }
    }

    fn pass_on_news(&mut self, logical_ns: u64) {
        for news in core::mem::take(&mut self.slots.news) {
            let severity = if news.warning { Severity::Warning } else { Severity::Info };
            self.tap.sinks.note(logical_ns, severity, "launcher", &news.text);
            if news.warning {
                self.notice(&news.text);
            }
        }
    }

    fn end_early(&mut self, now_ns: u64) {
        self.notice("interrupted: stopping in order; press Ctrl-C again to stop at once");
        self.conductor.end_early(self.conductor.wall_ns(now_ns));
        self.timed.iter_mut().for_each(Timed::resume);
        self.supervisor.note_clock(self.conductor.record());
        self.wakers.wake_all();
    }

    /// Lockstep: where time has to stop for slots and script \[ns\].
    fn cap_ns(&self, allowed_ns: u64) -> u64 {
        self.slots.cap_ns(allowed_ns).min(self.script.next_ns())
    }

    /// Instant through which all processes are final and drained \[ns\].
    fn drained_ns(&mut self) -> u64 {
        if self.timed.is_some() {
            if !self.is_amid_a_stretch() {
                self.drained_ns = self.drained_ns.max(self.conductor.allowed_ns());
            }
            return self.drained_ns;
        }
        let slowest_ns = self.supervisor.present().map(|entry| self.mark_of(entry)).min();
        // A process that goes on from a predecessor's state begins below what has long been drained.
        self.drained_ns = slowest_ns.unwrap_or(0).max(self.drained_ns);
        self.drained_ns
    }
}
