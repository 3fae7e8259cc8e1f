//! One flight from founding its run to its last word.

use super::child::{ChildSpec, Launch};
use super::conductor::{Conductor, Patience};
use super::consumers::Consumers;
use super::disorder;
use super::live::{Live, View};
use super::metrics::Metrics;
use super::pilot_thread::{self, PilotEnd};
use super::services::{HeldServices, Wakers};
use super::setup::{
    RunError, RunOptions, allowed_processors, clock_of, facts, pinned_cpu, progress_bar,
    recording_path, require_processor, require_shared_memory, run_id, seconds, system,
};
use super::slots::{Means, Processes, Script, SlotWatch, Slots, largest_commands};
use super::summary::Summary;
use super::supervisor::{FlightError, RestartPolicy, Supervisor};
use super::tap::Tap;
use crate::components::Crew;
use crate::process::has_process;
use crate::record::{Event, Recording, Severity};
use runtime::Graph;
use runtime::clock::{mono_now_ns, sleep_until};
use runtime::ipc::{Bus, ServiceKind};
use runtime::namespace::{Membership, sweep_dead_runs};
use runtime::priority::may_take_fifo;
use runtime::watch::StopFlags;
use shared_types::{ClockMode, Hello, Role, RollEntry, Seat};
use slot::supervisor::Now;
use std::path::PathBuf;
use std::thread::JoinHandle;

/// Wall time between two looks around \[ns\].
const LOOK_EVERY_NS: u64 = 1_000_000;
/// How long processes may take to leave after the end of the flight \[ns\].
const LEAVE_LIMIT_NS: u64 = 5_000_000_000;
/// From the announcement of a realtime flight to its start \[ns\].
const COUNTDOWN_NS: u64 = 100_000_000;

/// Said once, since it explains misses.
const NO_PRIORITY: &str = "no right to realtime priority, other programs can make loops miss: raise \
    `ulimit -r`, give cap_sys_nice, or fly slower with --speed";

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
/// [`RunError`] if the flight never started; what happens in the air is in the summary.
pub fn run(options: &RunOptions) -> Result<Summary, RunError> {
    let stop = StopFlags::watch_signals().map_err(system("watch signals"))?;
    for folder in sweep_dead_runs() {
        eprintln!("morphquad: cleaned up after a dead run, {}", folder.display());
    }
    require_processor(options.pin)?;
    require_shared_memory()?;
    let id = run_id();
    let recording_path =
        options.record.as_deref().map(|dir| recording_path(dir, &id)).transpose()?;
    let recording = recording_path
        .as_deref()
        .map(|path| Recording::create(path, &facts(&id, options)))
        .transpose()?;
    // Declared before everything that uses the transport, so that it is dropped last and wipes.
    let membership = Membership::found(&id)?;
    let scenario_file = membership.folder().join("scenario.toml");
    std::fs::write(&scenario_file, options.scenario.to_toml())
        .map_err(system(format!("write {}", scenario_file.display())))?;
    let flight = options.scenario.flight().map_err(|error| RunError::Wiring(error.to_string()))?;
    flight
        .write(membership.folder())
        .map_err(system(format!("describe the flight in {}", membership.folder().display())))?;
    let name = &options.scenario.settings().scenario.name;
    let live = Live::open(membership.folder(), &id, name, recording_path.as_deref())?;
    let mut flight = Flight::prepare(options, &membership, stop, recording, live)?;
    let started = flight.start(&membership, options);
    let outcome = match started {
        Ok(()) => flight.fly(),
        Err(error) => {
            flight.abort();
            return Err(error);
        }
    };
    Ok(flight.conclude(outcome, options, &id, recording_path))
}

struct Flight {
    graph: Graph,
    supervisor: Supervisor,
    slots: Slots,
    script: Script,
    conductor: Conductor,
    tap: Tap,
    wakers: Wakers,
    pilot: Option<JoinHandle<PilotEnd>>,
    pilot_stop: StopFlags,
    stop: StopFlags,
    bus: Bus,
    live: Live,
    _services: HeldServices,
    stall_limit_ns: u64,
    lag_limit_ns: u64,
    progress_at: (u64, u64),
    drained_ns: u64,
    known_strays: usize,
    progress: Option<indicatif::ProgressBar>,
    notices: Vec<String>,
}

impl Flight {
    fn prepare(
        options: &RunOptions,
        membership: &Membership,
        stop: StopFlags,
        recording: Option<Recording>,
        live: Live,
    ) -> Result<Self, RunError> {
        let scenario = &options.scenario;
        let graph = scenario.graph().map_err(|error| RunError::Wiring(format!("{error}")))?;
        let bus = Bus::join(&membership.ipc_config(), "launcher")?;
        let services = HeldServices::create(&bus)?;
        let roles: Vec<Role> = graph.nodes().iter().map(|n| n.role).collect();
        let hello = bus.open_service::<Hello>(ServiceKind::Hello)?;
        let executable = std::env::current_exe().map_err(system("find the own executable"))?;
        let cpu = pinned_cpu(options.pin, clock_of(scenario));
        let crew = Crew::of(scenario.settings());
        let spec = |role: Role| {
            let (name, executable) = (crew.name(role)?.to_owned(), executable.clone());
            let launch = Launch::Service { config: None };
            Some((role, ChildSpec { name, executable, launch, cpu, nice: None, pause_ns: 0 }))
        };
        let processes = roles.iter().filter(|role| has_process(**role));
        let mut specs: Vec<_> = processes.filter_map(|&role| spec(role)).collect();
        if let Some(seed) = options.disorder {
            disorder::shuffle(&mut specs, seed, &allowed_processors()?);
        }
        let patience = &scenario.settings().launcher;
        let policy = RestartPolicy {
            backoff_ns: seconds(patience.restart_backoff_s),
            backoff_max_ns: seconds(patience.restart_backoff_max_s),
            limit: patience.restart_limit as usize,
        };
        let slots = Slots::new(clock_of(scenario), &specs, largest_commands(scenario));
        let supervisor =
            Supervisor::new(&bus, membership.folder().to_path_buf(), specs, &hello, policy)?;
        let mut consumers = Consumers::new(&roles, Metrics::of(scenario), recording);
        consumers.slot_watch = Some(SlotWatch::default());
        let duration_ns = scenario.duration_ns();
        Ok(Self {
            tap: Tap::open(&bus, &graph, consumers)?,
            conductor: Conductor::new(
                &bus,
                clock_of(scenario),
                options.speed,
                duration_ns,
                &graph,
            )?,
            wakers: Wakers::open(&bus, &roles)?,
            supervisor,
            slots,
            script: Script::new(&scenario.settings().swap, &scenario.settings().fault),
            graph,
            pilot: None,
            pilot_stop: StopFlags::default(),
            stop,
            bus,
            live,
            _services: services,
            stall_limit_ns: seconds(scenario.settings().launcher.stall_timeout_s),
            lag_limit_ns: seconds(scenario.settings().launcher.lag_timeout_s),
            progress_at: (0, 0),
            drained_ns: 0,
            known_strays: 0,
            progress: options.progress.then(|| progress_bar(duration_ns)),
            notices: Vec::new(),
        })
    }

    /// Starts everybody and waits until all are ready, then starts the clock.
    fn start(&mut self, membership: &Membership, options: &RunOptions) -> Result<(), RunError> {
        let scenario = &options.scenario;
        let not_ready = |error: FlightError| RunError::NotReady(error.to_string());
        self.supervisor.start_all().map_err(not_ready)?;
        let pilot = pilot_thread::start(
            scenario.clone(),
            self.graph.clone(),
            &membership.ipc_config(),
            self.pilot_stop.clone(),
            pinned_cpu(options.pin, clock_of(scenario)),
        );
        self.pilot = Some(pilot.map_err(system("start the pilot"))?);
        if scenario.fifo_priority().is_some_and(|priority| !may_take_fifo(priority)) {
            self.notice(NO_PRIORITY);
        }
        let limit_s = scenario.settings().launcher.startup_timeout_s;
        let deadline_ns = mono_now_ns() + seconds(limit_s);
        loop {
            let ready = self.supervisor.await_ready(&self.graph, &mut self.tap);
            let ready = ready.map_err(not_ready)?;
            self.tend_slots(mono_now_ns()).map_err(not_ready)?;
            if ready && self.supervisor.owners_known() {
                break;
            }
            if self.stop.signalled() {
                return Err(RunError::Interrupted);
            }
            if mono_now_ns() > deadline_ns {
                let names = self.supervisor.not_ready();
                return Err(not_ready(FlightError::StartupTimeout { names, limit_s }));
            }
            self.answer(mono_now_ns()).map_err(not_ready)?;
            sleep_until(mono_now_ns() + LOOK_EVERY_NS);
        }
        let realtime = self.conductor.mode() == ClockMode::Realtime;
        let start_ns = mono_now_ns() + if realtime { COUNTDOWN_NS } else { 0 };
        if let Some(recording) = &mut self.tap.consumers.recording {
            recording.set_start(start_ns);
        }
        let cap_ns = self.cap_ns(u64::MAX);
        self.conductor.start(start_ns, cap_ns);
        self.wakers.wake_all();
        self.progress_at = (mono_now_ns(), 0);
        Ok(())
    }

    /// The launcher's main loop: drain, conduct, look after everybody.
    fn fly(&mut self) -> Outcome {
        let mut interrupted = false;
        let mut leave_by_ns = u64::MAX;
        loop {
            let now_ns = mono_now_ns();
            self.tap.drain(now_ns);
            let drained = self.drained_ns();
            let looked_after = self.look_after(now_ns).and_then(|()| self.follow_script(now_ns));
            self.publish_notices(drained);
            self.name_strays();
            if let Err(error) = looked_after {
                return Outcome::Lost(error.to_string());
            }
            let cap_ns = self.cap_ns(self.conductor.allowed_ns());
            if self.conductor.extend(drained, cap_ns, now_ns) {
                self.wakers.wake_all();
            }
            self.conductor.serve_late_joiners();
            if self.supervisor.all_finished() {
                self.tap.drain(mono_now_ns());
                return if interrupted { Outcome::Interrupted } else { Outcome::Flown };
            }
            if self.stop.take_signal() {
                if interrupted {
                    return Outcome::Killed;
                }
                interrupted = true;
                leave_by_ns = now_ns + LEAVE_LIMIT_NS;
                self.end_early(now_ns);
            }
            if drained >= self.conductor.end_ns() && self.conductor.let_leave() {
                self.wakers.wake_all();
                leave_by_ns = leave_by_ns.min(now_ns + LEAVE_LIMIT_NS);
            }
            if now_ns > leave_by_ns {
                let names = self.supervisor.unfinished().join(", ");
                return Outcome::Lost(format!("{names} did not leave after the end of the flight"));
            }
            self.watch_progress(drained, now_ns);
            if let Err(error) = self.answer(now_ns) {
                return Outcome::Lost(error.to_string());
            }
            sleep_until(now_ns + LOOK_EVERY_NS);
        }
    }

    /// Answers whoever asks from outside.
    fn answer(&mut self, now_ns: u64) -> Result<(), FlightError> {
        let (graph, supervisor, conductor) = (&self.graph, &self.supervisor, &self.conductor);
        let (marks, drained_ns) = (&self.tap.marks, self.drained_ns);
        let view = View { graph, supervisor, conductor, marks, drained_ns };
        let orders = self.live.serve(&view, now_ns);
        if orders.is_empty() {
            return Ok(());
        }
        self.with_slots(now_ns, |slots, means| {
            orders.into_iter().try_for_each(|(order, answer)| slots.order(&order, answer, means))
        })
    }

    /// Looks after processes, then slots.
    fn look_after(&mut self, now_ns: u64) -> Result<(), FlightError> {
        let slots = &self.slots;
        let keeps = |seat: Seat| slots.keeps(seat);
        self.supervisor.look_after(&self.bus, &mut self.tap, &keeps, now_ns)?;
        self.tend_slots(now_ns)
    }

    /// Gives the slots what has happened, and passes on what they say.
    fn tend_slots(&mut self, now_mono_ns: u64) -> Result<(), FlightError> {
        self.with_slots(now_mono_ns, Slots::tend)
    }

    /// Does what the script has for now; whoever dies of it is buried before time goes on.
    fn follow_script(&mut self, now_mono_ns: u64) -> Result<(), FlightError> {
        if self.script.next_ns() > self.logical_now(now_mono_ns).logical_ns {
            return Ok(());
        }
        let mut script = core::mem::take(&mut self.script);
        let done = self.with_slots(now_mono_ns, |slots, means| script.run(slots, means));
        self.script = script;
        done.and_then(|()| self.look_after(now_mono_ns))
    }

    fn with_slots(
        &mut self,
        now_mono_ns: u64,
        act: impl FnOnce(&mut Slots, &mut Means<'_>) -> Result<(), FlightError>,
    ) -> Result<(), FlightError> {
        let now = self.logical_now(now_mono_ns);
        let mut posts = Processes {
            bus: &self.bus,
            supervisor: &mut self.supervisor,
            tap: &mut self.tap,
            now_mono_ns,
        };
        let mut means = Means {
            posts: &mut posts,
            graph: &self.graph,
            now,
            now_mono_ns,
            is_over: self.drained_ns >= self.conductor.end_ns(),
        };
        let done = act(&mut self.slots, &mut means);
        self.pass_on_news(now.logical_ns);
        done
    }

    /// Where the flight is, for whoever decides about instants.
    fn logical_now(&self, now_mono_ns: u64) -> Now {
        if self.conductor.mode() == ClockMode::Lockstep {
            Now { logical_ns: self.drained_ns, allowed_ns: self.conductor.allowed_ns() }
        } else {
            let started = self.conductor.has_started();
            let wall_ns = if started { self.conductor.wall_ns(now_mono_ns) } else { 0 };
            Now { logical_ns: wall_ns, allowed_ns: wall_ns }
        }
    }

    fn pass_on_news(&mut self, logical_ns: u64) {
        for news in core::mem::take(&mut self.slots.news) {
            let severity = if news.warning { Severity::Warning } else { Severity::Info };
            self.tap.consumers.note(logical_ns, severity, &news.text);
            if news.warning {
                self.notice(&news.text);
            }
        }
    }

    /// Names whoever writes on the flight's topics without a seat; nobody listens to it.
    fn name_strays(&mut self) {
        let strays = self.bus.strays();
        for stray in strays.iter().skip(self.known_strays) {
            let comm = std::fs::read_to_string(format!("/proc/{}/comm", stray.pid));
            let name = comm.as_deref().map_or("gone by now", str::trim);
            self.notice(&format!(
                "process {} ({name}) writes on {} without a seat: every sample of it is ignored",
                stray.pid, stray.service
            ));
        }
        self.known_strays = strays.len();
    }

    fn end_early(&mut self, now_ns: u64) {
        self.notice("interrupted: ending the flight in order (once more to stop at once)");
        let elapsed_ns = now_ns.saturating_sub(self.conductor.start_mono_ns());
        self.conductor.end_early(elapsed_ns);
        self.wakers.wake_all();
    }

    /// Lockstep: where time has to stop for slots and script \[ns\].
    fn cap_ns(&self, allowed_ns: u64) -> u64 {
        self.slots.cap_ns(allowed_ns).min(self.script.next_ns())
    }

    fn mark_of(&self, entry: &RollEntry) -> u64 {
        let seat = Seat { role: entry.role, index: entry.seat };
        self.tap.marks.of_seat(seat, entry.generation)
    }

    /// Instant through which everybody is final and drained \[ns\].
    fn drained_ns(&mut self) -> u64 {
        let slowest_ns = self.supervisor.present().map(|entry| self.mark_of(entry)).min();
        // Whoever goes on from a predecessor's state begins below what has long been drained.
        self.drained_ns = slowest_ns.unwrap_or(0).max(self.drained_ns);
        self.drained_ns
    }

    /// Kills whoever could step and has not for too long.
    fn watch_progress(&mut self, drained: u64, now_ns: u64) {
        if let Some(bar) = &self.progress {
            bar.set_position(drained.min(self.conductor.end_ns()) / 1_000_000);
        }
        let present: Vec<RollEntry> = self.supervisor.present().copied().collect();
        let total = present.iter().fold(0_u64, |sum, entry| sum.wrapping_add(self.mark_of(entry)));
        let realtime = self.conductor.mode() == ClockMode::Realtime;
        let (since_ns, last_total) = self.progress_at;
        if !realtime && total != last_total {
            self.progress_at = (now_ns, total);
        }
        // In realtime a successor gets as long to catch up as it may then lag.
        let patience_ns = if realtime { 2 * self.lag_limit_ns } else { self.stall_limit_ns };
        if now_ns.saturating_sub(since_ns) > patience_ns {
            let patience = Patience {
                now_mono_ns: now_ns,
                stall_ns: self.stall_limit_ns,
                lag_ns: self.lag_limit_ns,
            };
            let marks = &self.tap.marks;
            let stalled = self.conductor.stalled(&self.graph, &present, marks, patience);
            if !stalled.is_empty() {
                self.progress_at.0 = now_ns;
                self.supervisor.kill_stalled(&stalled, &self.tap);
            }
        }
    }

    fn publish_notices(&mut self, logical_ns: u64) {
        for notice in core::mem::take(&mut self.supervisor.notices) {
            if let Some(recording) = &mut self.tap.consumers.recording {
                let event = Event {
                    logical_ns,
                    severity: Severity::Warning,
                    source: &notice.source,
                    text: &notice.text,
                };
                if let Err(error) = recording.write_event(&event) {
                    self.tap.consumers.fail_recording(&error.to_string());
                }
            }
            self.notice(&notice.text);
        }
    }

    fn notice(&mut self, text: &str) {
        match &self.progress {
            Some(bar) => bar.suspend(|| eprintln!("morphquad: {text}")),
            None => eprintln!("morphquad: {text}"),
        }
        self.notices.push(text.to_owned());
    }

    /// Stops a flight that never started.
    fn abort(&mut self) {
        self.supervisor.kill_all();
        self.stop_pilot();
    }

    fn stop_pilot(&mut self) -> Option<String> {
        self.pilot_stop.request();
        let ended = self.pilot.take()?.join();
        match ended {
            Ok(Ok(_)) => None,
            Ok(Err(error)) => Some(format!("pilot: {error}")),
            Err(_) => Some("pilot: panicked".to_owned()),
        }
    }

    fn conclude(
        mut self,
        outcome: Outcome,
        options: &RunOptions,
        id: &str,
        recording_path: Option<PathBuf>,
    ) -> Summary {
        let wall_ns = mono_now_ns().saturating_sub(self.conductor.start_mono_ns());
        if matches!(outcome, Outcome::Killed | Outcome::Lost(_)) {
            self.supervisor.kill_all();
        }
        let pilot_error = self.stop_pilot();
        self.tap.drain(mono_now_ns());
        self.bus.sweep_dead_processes();
        if let Some(bar) = &self.progress {
            bar.finish_and_clear();
        }
        let flown_ns = self.drained_ns().min(self.conductor.end_ns());
        self.tap.consumers.metrics.finish();
        self.slots.finish();
        let ignored: u64 = self.bus.strays().iter().map(|stray| stray.samples).sum();
        if ignored > 0 {
            self.notice(&format!("{ignored} samples of strangers ignored"));
        }
        let mut summary = Summary {
            run_id: id.to_owned(),
            scenario: options.scenario.settings().scenario.name.clone(),
            clock: self.conductor.mode(),
            seed: options.scenario.settings().scenario.seed,
            from_ns: 0,
            flown_ns,
            planned_ns: options.scenario.duration_ns(),
            wall_ns,
            processes: self.graph.nodes().iter().map(|n| (n.role, n.rate.hz())).collect(),
            hash: self.tap.consumers.hash.hex(),
            log_hash: self.tap.consumers.log_hash.hex(),
            metrics: core::mem::take(&mut self.tap.consumers.metrics),
            audit: self.tap.consumers.audit.clone(),
            recovered: self.supervisor.recovered,
            swaps: core::mem::take(&mut self.slots.reports),
            notices: core::mem::take(&mut self.notices),
            lost: pilot_error,
            interrupted: false,
            cut_short: self.conductor.is_cut_short(),
            recording: recording_path,
            recording_error: self.tap.consumers.recording_error.take(),
        };
        match outcome {
            Outcome::Flown => {}
            Outcome::Interrupted | Outcome::Killed => summary.interrupted = true,
            Outcome::Lost(reason) => summary.lost = Some(reason),
        }
        self.tap.consumers.finish_recording(&mut summary);
        summary
    }
}
