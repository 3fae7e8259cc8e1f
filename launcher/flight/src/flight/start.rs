//! How a flight starts.

use super::described::Described;
use super::timed::Timed;
use super::{Flight, LOOK_EVERY_NS};
use crate::checkpoint::CheckpointWriter;
use crate::conductor::Conductor;
use crate::disorder;
use crate::grants::Grants;
use crate::live::Live;
use crate::rehearser::Rehearser;
use crate::stall::Newcomers;
use crate::supervisor::{RestartPolicy, Supervisor};
use crate::tap::Tap;
use crate::turns::Turns;
use host::realtime::may_lock_memory;
use observe::Metrics;
use record::Recorder;
use runtime::Graph;
use runtime::clock::{mono_now_ns, sleep_until};
use runtime::ipc::{Bus, LatestPort, ServiceKind};
use runtime::namespace::{BASE, Membership};
use runtime::timed::START_MONO_NS;
use runtime::watch::StopFlags;
use scenario::Scenario;
use scenario::needs::{MemoryNeed, locks};
use scenario::orders::Planner;
use scenario::process::OWN_EXECUTABLE;
use scenario::services::Assignment;
use scenario::settings::Clock;
use shared_types::time::ns_from_s;
use shared_types::{ClockMode, Hello, Role};
use simulate::Sinks;
use simulate::setup::{
    Pin, RunError, RunOptions, allowed_processors, clock_of, pinned_cpu, progress_bar,
};
use std::collections::VecDeque;
use swap::child::{ChildSpec, Launch};
use swap::services::{HeldServices, Wakers};
use swap::{FlightError, Script, SlotWatch, Slots};

/// From the announcement of a realtime flight to its start \[ns\].
const COUNTDOWN_NS: u64 = 100_000_000;

/// A flight's processes and what they are led with.
pub(super) struct Prepared {
    pub(super) graph: Graph,
    pub(super) bus: Bus,
    pub(super) services: HeldServices,
    pub(super) supervisor: Supervisor,
    pub(super) slots: Slots,
    pub(super) conductor: Conductor,
    pub(super) recording: Option<Recorder>,
    pub(super) live: Live,
    pub(super) stop: StopFlags,
    /// Of [`takes_all_memory`].
    pub(super) takes_all: bool,
    pub(super) timed: Option<Timed>,
    pub(super) described: Described,
}

/// What a scenario prescribes for crashes.
pub(super) fn restart_policy(scenario: &Scenario, takes_all: bool) -> RestartPolicy {
    let settings = scenario.settings();
    let launcher = &settings.launcher;
    RestartPolicy {
        backoff_ns: ns_from_s(launcher.restart_backoff_s),
        backoff_max_ns: ns_from_s(launcher.restart_backoff_max_s),
        limit: launcher.restart_limit as usize,
        room: MemoryNeed::of_instance(settings, takes_all),
        frees_meanwhile: settings.scenario.clock == Clock::Realtime && settings.timing.is_empty(),
    }
}

/// True of a realtime flight whose shared memory is taken before it is touched: locked, or else reserved if there is so
/// much, of which a flight that goes on has `taken_mb` already.
pub(super) fn takes_all_memory(scenario: &Scenario, taken_mb: u64) -> bool {
    let has_room = || MemoryNeed::RESERVED.look(taken_mb).is_ok();
    clock_of(scenario) == ClockMode::Realtime
        && (locks(scenario.settings(), may_lock_memory()) || has_room())
}

pub(super) fn graph_of(scenario: &Scenario) -> Result<Graph, RunError> {
    scenario.graph().map_err(|error| RunError::Wiring(error.to_string()))
}

/// What takes the samples of a flight.
fn sinks_of(scenario: &Scenario, roles: &[Role], recording: Option<Recorder>) -> Sinks {
    let mut sinks = Sinks::new(roles, Metrics::of(scenario), recording);
    let watch = SlotWatch::new(&scenario.modelled_vehicle());
    let is_lockstep = clock_of(scenario) == ClockMode::Lockstep;
    sinks.slot_watch = Some(if is_lockstep { watch } else { watch.by_the_wall() });
    sinks
}

impl Flight {
    pub(super) fn prepare(
        options: &RunOptions,
        membership: &Membership,
        stop: StopFlags,
        recording: Option<Recorder>,
        (live, checkpoint_writer, described): (Live, CheckpointWriter, Described),
    ) -> Result<Self, RunError> {
        let scenario = &options.scenario;
        let graph = graph_of(scenario)?;
        // Asked once, before any of it is taken.
        let takes_all = takes_all_memory(scenario, 0);
        let bus = Bus::join(&membership.ipc_config(), "launcher")?;
        bus.lead()?;
        let services = HeldServices::create(&bus)?;
        let script = scenario.timing().filter(|_| clock_of(scenario) == ClockMode::Lockstep);
        let turns = script.map(|script| Turns::create(&bus, script)).transpose()?;
        let timed = turns.map(Timed::new);
        let roles: Vec<Role> = graph.nodes().iter().map(|n| n.role).collect();
        let hello = bus.open_service::<Hello>(ServiceKind::Hello)?;
        let cpu = pinned_cpu(options.pin, clock_of(scenario));
        let assignment = Assignment::of(scenario.settings());
        let spec = |role: Role| {
            let (name, executable) = (assignment.name(role).to_owned(), OWN_EXECUTABLE.into());
            let launch = Launch::Service { config: None };
            // Loops that take turns do so fastest on one processor. One that is quiet flies beside them, unless the
            // recorder needs what else there is.
            let may_be_quiet = graph.quiet_limit_ns(role) > 0;
            let is_free = options.pin == Pin::Auto && may_be_quiet && recording.is_none();
            let cpu = cpu.filter(|_| !is_free);
            (role, ChildSpec { name, executable, launch, cpu, nice: None, pause_ns: 0 })
        };
        let mut specs: Vec<_> = roles.iter().map(|&role| spec(role)).collect();
        if let Some(seed) = options.disorder {
            disorder::shuffle(&mut specs, seed, &allowed_processors()?);
        }
        let startup_ns = ns_from_s(scenario.settings().launcher.startup_timeout_s);
        let slots = Slots::new(clock_of(scenario), &specs, scenario, startup_ns);
        let folder = membership.folder().to_path_buf();
        let policy = restart_policy(scenario, takes_all);
        let supervisor = Supervisor::new(&bus, folder, specs, &hello, policy, checkpoint_writer)?;
        let (mode, end_ns) = (clock_of(scenario), scenario.duration_ns());
        let conductor = Conductor::new(&bus, mode, options.speed, end_ns, &graph)?;
        let prepared = Prepared {
            graph,
            bus,
            services,
            supervisor,
            slots,
            conductor,
            recording,
            live,
            stop,
            takes_all,
            timed,
            described,
        };
        Self::of(prepared, options)
    }

    /// The flight around its processes, before anything has been drained.
    pub(super) fn of(prepared: Prepared, options: &RunOptions) -> Result<Self, RunError> {
        let Prepared {
            graph,
            bus,
            services,
            supervisor,
            slots,
            conductor,
            recording,
            mut live,
            stop,
            takes_all,
            timed,
            described,
        } = prepared;
        let settings = options.scenario.settings();
        let roles: Vec<Role> = graph.nodes().iter().map(|n| n.role).collect();
        let mut sinks = sinks_of(&options.scenario, &roles, recording);
        sinks.feed = live.take_feed();
        let clock_reader = LatestPort::clock(&bus)?;
        let is_reserved = takes_all && !locks(settings, may_lock_memory());
        let reservation = is_reserved.then(|| bus.reservation());
        Ok(Self {
            tap: Tap::open(&bus, &graph, sinks)?,
            conductor,
            timed,
            announcements: options.scenario.timing().unwrap_or_default().announcements(),
            asked: Vec::new(),
            wakers: Wakers::open(&bus, &roles)?,
            supervisor,
            slots,
            script: Script::new(settings, &graph),
            orders: Planner::of(&options.scenario)
                .map_err(|error| RunError::NotReady(format!("pilot: {error}")))?,
            graph,
            stop,
            bus,
            live,
            services,
            described,
            begun: (0, 0),
            stall_limit_ns: ns_from_s(settings.launcher.stall_timeout_s),
            lag_limit_ns: ns_from_s(settings.launcher.lag_timeout_s),
            progress_at: (0, 0),
            newcomers: Newcomers::default(),
            rehearser: Rehearser::new(clock_of(&options.scenario) == ClockMode::Realtime),
            drained_ns: 0,
            monitored_ns: 0,
            known_strays: 0,
            looked_ns: None,
            next_file_look_ns: 0,
            removals: (0, 0),
            reserved_after_ns: 0,
            leftovers: None,
            reservation,
            clock_reader,
            progress: options.progress.then(|| progress_bar(options.scenario.duration_ns())),
            notices: Vec::new(),
            is_interrupted: false,
            unshown: VecDeque::new(),
        })
    }

    fn start_clock(&mut self, start_ns: u64) {
        if self.timed.is_some() {
            self.conductor.start(START_MONO_NS, 0);
            self.conductor.pace_from(start_ns);
        } else {
            let cap_ns = self.cap_ns(u64::MAX);
            self.conductor.start(start_ns, cap_ns);
        }
    }

    /// Starts all processes and waits until they are ready, then starts the clock.
    pub(super) fn start(&mut self, options: &RunOptions, grants: &Grants) -> Result<(), RunError> {
        let scenario = &options.scenario;
        let not_ready = |error: FlightError| RunError::NotReady(error.to_string());
        self.supervisor.start_all().map_err(not_ready)?;
        if let Some(lacking) = grants.lacking() {
            self.notice(&lacking);
        } else if let Some(granted) = grants.granted() {
            self.print(&granted);
        }
        let limit_s = scenario.settings().launcher.startup_timeout_s;
        let deadline_ns = mono_now_ns() + ns_from_s(limit_s);
        loop {
            let ready = self.supervisor.await_ready(&self.bus, &self.graph, &mut self.tap);
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
        self.protect();
        let realtime = self.conductor.mode() == ClockMode::Realtime;
        let is_locked = locks(scenario.settings(), may_lock_memory());
        if realtime && !is_locked && self.reservation.is_none() {
            let MemoryNeed { shared_mb, own_mb } = MemoryNeed::RESERVED;
            let all_mb = shared_mb + own_mb;
            self.print(&format!(
                "the memory of this flight is neither locked nor reserved, for which {shared_mb} MB in {BASE} and {all_mb} MB \
                 in all would have to be free: a program that takes them can end the flight"
            ));
        }
        let start_ns = mono_now_ns() + if realtime { COUNTDOWN_NS } else { 0 };
        if let Some(recording) = &mut self.tap.sinks.recording {
            recording.set_start(start_ns);
        }
        self.start_clock(start_ns);
        self.begun = (0, start_ns);
        if let Some(stopwatch) = &mut self.tap.sinks.stopwatch {
            stopwatch.started(start_ns);
        }
        self.supervisor.note_clock(self.conductor.record());
        self.wakers.wake_all();
        self.progress_at = (mono_now_ns(), 0);
        Ok(())
    }
}
