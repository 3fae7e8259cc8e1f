//! The world of the search: which processes there are, what is on the way, and what must not happen.

mod observer;

use shared_types::Role;
use shared_types::wire::Value;
use slot::{
    Action, Clock, Command, CommandBuffer, CommandBufferMemory, Consumer, Event, Instance, Now,
    Program, REJECTED_AFTER_TRIP_NS, Record, SEATS, Seat, SlotConfig, SlotMachine, Source,
};

/// After this a consumer that ignores a trip is itself replaced: sooner than the end of a window is acted upon \[ticks\].
pub(crate) const REPLACED_WITHIN: u64 = 1;
/// If it has not come to rest by then, it never will.
pub(crate) const NEVER: u64 = 80;
/// Lockstep: how far allowed time runs ahead \[ticks\].
pub(crate) const CREDIT: u64 = 2;
/// How old the answer of a rehearsal may be \[ticks\].
pub(crate) const REHEARSAL: u64 = 2;
/// How long the gate levels the vehicle after a trip far from trim \[ticks\].
pub(crate) const LEVEL: u64 = 3;
/// From a release to the command's effect \[ticks\].
pub(crate) const LATENCY: u64 = 1;
/// Rate of a controller that steps each tick, a tick being a nanosecond \[mHz\].
const EACH_TICK: u64 = 1_000_000_000_000;

/// How much may happen on one path.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) struct Budget {
    /// Deaths and silences of controllers, and of the launcher.
    pub misfortunes: u8,
    /// Requests of users.
    pub requests: u8,
    /// The longest that anything but a record waits \[ticks\].
    pub patience: u64,
    /// The longest that a record waits: long enough to come too late \[ticks\].
    pub record_patience: u64,
}

impl Budget {
    pub(crate) const fn new(misfortunes: u8, requests: u8, patience: u64) -> Self {
        Self { misfortunes, requests, patience, record_patience: 2 }
    }

    /// The same with records that wait for so long.
    pub(crate) const fn with_records(self, record_patience: u64) -> Self {
        Self { record_patience, ..self }
    }
}

/// A mistake put in on purpose.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Flaw {
    IgnoresInstant,
    FollowsMembers,
    ForgetsFailOver,
    NeverFailsOver,
    NeverTriesAgain,
    ForgetsTrip,
}

/// What must not happen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Broken {
    WrongWriter,
    Missed,
    Unlatched,
    TripForgotten,
    Backwards,
}

/// A process on a seat.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Process {
    Gone,
    Starting {
        program: Program,
        since: u64,
    },
    /// Connected, and without an order to begin.
    Waiting(Instance),
    Flying {
        instance: Instance,
        from: u64,
        mute: Option<u64>,
        leaving: Option<u64>,
    },
    /// Dead, and not noticed yet.
    Dead {
        since: u64,
    },
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Commands(pub CommandBuffer);

impl std::hash::Hash for Commands {
    fn hash<H: std::hash::Hasher>(&self, state: &mut H) {
        let mut packed = [0; CommandBufferMemory::PACKED_SIZE];
        self.0.memory().pack(&mut packed);
        state.write(&packed);
    }
}

#[derive(Clone, Debug, PartialEq, Hash)]
pub(crate) struct World {
    /// The plant's next tick.
    pub t: u64,
    /// Lockstep: ticks before it may run.
    pub allowed: u64,
    pub clock: Clock,
    pub budget: Budget,
    pub flaw: Option<Flaw>,
    /// `None`: the launcher is dead.
    pub slot: Option<SlotMachine>,
    pub consumer: Consumer,
    pub commands: Commands,
    /// What is to follow the slot in place of a consumer that has ignored a trip, and when.
    pub successor: Option<(Consumer, Commands, u64)>,
    pub processes: [Process; SEATS],
    /// On the way to the plant, with when (lockstep: at which end of allowed time) it was sent.
    pub records: Vec<(Record, u64)>,
    /// On the way from the plant.
    pub messages: Vec<(Message, u64)>,
    reported: (u64, u64, u64),
    /// The seat for which the launcher owes a verdict.
    pub judging: Option<Seat>,
    /// The seat that it rehearses.
    pub rehearsing: Option<Seat>,
    /// Ticks in a row at which nothing changed.
    calm: u8,
    /// The records that the plant has accepted, newest first, as a mere observer remembers them.
    accepted: Vec<Record>,
    /// The newest record written by any supervisor.
    pub written: Option<Record>,
    /// The epoch in which the plant was last seen to follow the fallback.
    latched: u64,
    /// The epoch whose owner the monitor has tripped, as a mere observer remembers it.
    tripped: u64,
    /// Until then the gate levels the vehicle, whichever process commands.
    level_until: u64,
    followed: Option<Seat>,
    /// By seat: what sits there leaves, since the plant has left it for its fallback or a user has retired it.
    pub given_up: [bool; SEATS],
    /// Since when the plant has been on its own.
    alone: Option<u64>,
    pub broken: Option<Broken>,
}

/// What the plant reports to the launcher.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Message {
    Acknowledged { epoch: u64, seat: Seat, at_ns: u64 },
    Refused { epoch: u64 },
    FailedOver { epoch: u64, at_ns: u64 },
    Tripped { epoch: u64, at_ns: u64 },
    Unguided { epoch: u64, since_ns: u64, at_ns: u64 },
}

pub(crate) const OWNER: Program = Program { number: 0, is_trusted: true };
pub(crate) const STANDBY: Program = Program { number: 1, is_trusted: false };
pub(crate) const SAME_KIND: Program = Program { number: 2, is_trusted: true };
/// Of a user, of another kind, and at half the rate.
pub(crate) const OTHER_KIND: Program = Program { number: 3, is_trusted: false };

pub(crate) fn config(clock: Clock) -> SlotConfig {
    let common = SlotConfig {
        acknowledge_ns: 5,
        close_ns: CREDIT + 1,
        unguided_ns: 0,
        rehearsal_ns: REHEARSAL,
        standby_shadow_ns: 2,
        ..SlotConfig::REALTIME
    };
    match clock {
        Clock::Realtime => common,
        Clock::Lockstep => SlotConfig { clock, react_ns: CREDIT + 1, restart_ns: 1, ..common },
    }
}

impl World {
    /// In flight: an owner, and a standby or none, everything at rest.
    pub(crate) fn new(clock: Clock, budget: Budget, standby: bool, flaw: Option<Flaw>) -> Self {
        let mut config = config(clock);
        if flaw == Some(Flaw::NeverTriesAgain) {
            config.acknowledge_ns = 2 * NEVER;
        }
        let mut world = Self {
            t: 0,
            allowed: 0,
            clock,
            budget,
            flaw: None,
            slot: Some(SlotMachine::new(config, Seat::ALL[0], OWNER)),
            consumer: Consumer::new(REJECTED_AFTER_TRIP_NS),
            commands: Commands(CommandBuffer::new()),
            successor: None,
            processes: [Process::Gone; SEATS],
            records: Vec::new(),
            messages: Vec::new(),
            reported: (0, 0, 0),
            judging: None,
            rehearsing: None,
            calm: 0,
            accepted: Vec::new(),
            written: None,
            latched: 0,
            tripped: 0,
            level_until: 0,
            followed: None,
            given_up: [false; SEATS],
            alone: None,
            broken: None,
        };
        let first = Seat::ALL[0];
        let instance = Self::instance(OWNER);
        world.processes[0] = Process::Flying { instance, from: 0, mute: None, leaving: None };
        world.notify(Event::Ready(first, instance));
        if standby {
            world.calm_down();
            world.notify(Event::Request(slot::Request::Standby(STANDBY, 2, false)));
        }
        world.calm_down();
        World { flaw, ..world }
    }

    /// Does what comes next, without misfortune, until everything is at rest.
    fn calm_down(&mut self) {
        let spare = std::mem::replace(&mut self.budget, Budget::new(0, 0, 1));
        let mut moves = Vec::new();
        while !self.is_quiet() {
            moves.clear();
            self.moves(&mut moves);
            assert!(self.t < NEVER && !moves.is_empty(), "no rest: {self:#?}");
            self.make(moves[0]);
        }
        self.budget = spare;
    }

    pub(crate) fn instance(program: Program) -> Instance {
        let other = program == OTHER_KIND;
        let millihertz = if other { EACH_TICK / 2 } else { EACH_TICK };
        Instance { layout: u64::from(other), millihertz, latency_ns: LATENCY }
    }

    fn now(&self) -> Now {
        let allowed_ns = if self.clock == Clock::Lockstep { self.allowed } else { self.t };
        Now { logical_ns: self.t, allowed_ns }
    }

    /// The launcher is notified of an event and does what its slot wants.
    pub(crate) fn notify(&mut self, event: Event) {
        let now = self.now();
        let Some(slot) = &mut self.slot else { return };
        let actions = slot.on(now, event);
        self.act(actions);
    }

    pub(crate) fn act(&mut self, actions: Vec<Action>) {
        let t = self.t;
        for action in actions {
            match action {
                Action::Spawn(seat, program) | Action::Restart(seat, program) => {
                    assert!(self.processes[seat.index()] == Process::Gone, "{seat} is taken");
                    self.given_up[seat.index()] = false;
                    self.processes[seat.index()] = Process::Starting { program, since: t };
                }
                Action::Publish(record) => {
                    if self.written.is_some_and(|before| {
                        record.epoch <= before.epoch || record.effective_ns < before.effective_ns
                    }) {
                        self.broken = Some(Broken::Backwards);
                    }
                    self.written = Some(record);
                    let sent = if self.clock == Clock::Lockstep { self.allowed } else { t };
                    self.records.push((record, sent));
                }
                Action::HandOver { seat, join_ns, .. } => {
                    if let Process::Waiting(instance) = self.processes[seat.index()] {
                        self.processes[seat.index()] =
                            Process::Flying { instance, from: join_ns, mute: None, leaving: None };
                    }
                }
                Action::Judge(seat) => self.judging = Some(seat),
                Action::Rehearse(seat) => self.rehearsing = Some(seat),
                Action::AwaitExit(seat) => {
                    if let Process::Flying { leaving, .. } = &mut self.processes[seat.index()] {
                        *leaving = Some(t);
                    }
                }
                Action::Kill(seat) => match &mut self.processes[seat.index()] {
                    Process::Gone | Process::Dead { .. } => {}
                    process => *process = Process::Dead { since: t },
                },
                Action::Report(_) => {}
            }
        }
        let candidate = self.slot.as_ref().and_then(SlotMachine::candidate);
        self.judging = self.judging.filter(|seat| Some(*seat) == candidate);
        self.rehearsing = self.rehearsing.filter(|seat| Some(*seat) == candidate);
    }

    /// A record arrives at the plant.
    pub(crate) fn deliver(&mut self) {
        let (written, _) = self.records.remove(0);
        // As it travels.
        let mut record =
            Record::read(&written.to_sample(Role::Attitude)).expect("seats that exist");
        if self.flaw == Some(Flaw::IgnoresInstant) {
            let mut hasty = record;
            hasty.effective_ns = self.t;
            self.accept(&record);
            record = hasty;
            self.consumer.take_record(&record);
        } else if self.consumer.take_record(&record) == slot::Taken::Accepted {
            self.accept(&record);
        }
        if let Some((consumer, ..)) = &mut self.successor {
            let _ = consumer.take_record(&record);
        }
        self.report();
    }

    fn accept(&mut self, record: &Record) {
        // From the plant's next tick on at the earliest.
        let effective_ns = record.effective_ns.max(self.t);
        self.accepted.retain(|older| older.effective_ns < effective_ns);
        self.accepted.insert(0, Record { effective_ns, ..*record });
        self.accepted.truncate(6);
    }

    /// The plant's tick.
    pub(crate) fn tick(&mut self) {
        let t = self.t;
        if self.successor.is_some() {
            self.exchange_consumers();
            self.follow();
            self.decide();
            self.exchange_consumers();
        }
        self.follow();
        let choice = self.decide();
        let before = self.followed;
        let levels = t < self.level_until;
        self.followed = choice.map(|choice| choice.seat).filter(|_| !levels);
        self.judge(choice.map(|choice| (choice.seat, choice.source, choice.command)));
        let sent = self.messages.len();
        self.report();
        self.complain();
        let changed = before != self.followed || self.messages.len() > sent;
        self.calm = if changed { 0 } else { (self.calm + 1).min(3) };
        self.t += 1;
    }

    /// What replaces the consumer does as it does, at each tick.
    fn exchange_consumers(&mut self) {
        if let Some((consumer, commands, _)) = &mut self.successor {
            core::mem::swap(consumer, &mut self.consumer);
            core::mem::swap(commands, &mut self.commands);
        }
    }

    /// The consumer takes what is due, and every command there is.
    fn follow(&mut self) {
        let t = self.t;
        if let Some(turn) = self.consumer.advance(t) {
            self.commands.0.turn(&turn);
        }
        for seat in Seat::ALL {
            if let Some(command) = self.command(seat) {
                self.offer(seat, &command);
            } else if self.consumer.record().is_none_or(|record| !record.is_taken(seat)) {
                // An intruder that finds the seat empty.
                let valid_until_ns = t + 9;
                let forged = Command { effective_ns: t, valid_until_ns, ..Command::default() };
                self.offer(seat, &forged);
            }
        }
        if self.flaw == Some(Flaw::ForgetsFailOver) {
            let memory = slot::ConsumerMemory { failed_over: false, ..self.consumer.memory() };
            self.consumer.restore(&memory);
        }
    }

    /// Which command the consumer follows.
    fn decide(&mut self) -> Option<slot::Choice> {
        let t = self.t;
        if self.flaw == Some(Flaw::NeverFailsOver) {
            let mut alone = self.consumer.clone();
            let choice = self.commands.0.decide(&mut alone, t);
            if choice.is_some_and(|choice| choice.source == Source::Fallback) {
                let _ = self.consumer.decide(t, false, false);
                None
            } else {
                self.consumer = alone;
                choice
            }
        } else {
            self.commands.0.decide(&mut self.consumer, t)
        }
    }

    /// The monitor's trip takes effect at the plant's next tick.
    pub(crate) fn trip(&mut self, level: u64) {
        let Some(record) = self.consumer.record().copied() else { return };
        let mut memory = self.consumer.memory();
        self.consumer.trip(record.epoch, record.owner, self.t);
        if self.flaw == Some(Flaw::ForgetsTrip) {
            memory.counters = self.consumer.memory().counters;
            self.consumer.restore(&memory);
        }
        self.tripped = record.epoch;
        self.level_until = self.t + level;
        self.send(Message::Tripped { epoch: record.epoch, at_ns: self.t });
    }

    /// The same, which the consumer ignores. It is replaced by one that takes it.
    pub(crate) fn ignore_trip(&mut self) {
        let Some(record) = self.consumer.record().copied() else { return };
        let mut successor = self.consumer.clone();
        successor.trip(record.epoch, record.owner, self.t);
        self.successor = Some((successor, self.commands.clone(), self.t + REPLACED_WITHIN));
    }

    /// Another consumer follows the slot, and reports what it has known all along.
    pub(crate) fn replace_consumer(&mut self) {
        let Some((consumer, commands, _)) = self.successor.take() else { return };
        (self.consumer, self.commands) = (consumer, commands);
        self.report();
        if self.consumer.tripped() {
            let epoch = self.consumer.epoch();
            self.tripped = epoch;
            self.send(Message::Tripped { epoch, at_ns: self.t });
        }
        if self.consumer.failed_over() {
            self.latched = self.consumer.epoch();
        }
    }

    fn offer(&mut self, seat: Seat, command: &Command) {
        let owner = self.consumer.followed();
        let member = self.consumer.record().is_some_and(|record| record.is_taken(seat));
        let posed_as = match (self.flaw, owner) {
            (Some(Flaw::FollowsMembers), Some(owner)) if member => {
                // Any member that publishes is taken for the owner; the watcher remembers which one the owner was.
                if seat != owner {
                    self.broken = Some(Broken::WrongWriter);
                }
                owner
            }
            _ => seat,
        };
        self.commands.0.offer(&self.consumer, posed_as, command);
    }

    /// What the process on `seat` publishes for this tick.
    fn command(&self, seat: Seat) -> Option<Command> {
        let Process::Flying { instance, from, mute: None, .. } = self.processes[seat.index()]
        else {
            return None;
        };
        let is_due = self.t >= from + LATENCY && instance.effective_at_or_after(self.t) == self.t;
        let valid_until_ns = self.t + 2 * instance.period_ns();
        let command = Command { effective_ns: self.t, valid_until_ns, ..Command::default() };
        is_due.then_some(command)
    }

    /// The plant reports what has changed.
    fn report(&mut self) {
        let counters = self.consumer.counters();
        let (epoch, refused, fail_overs) = self.reported;
        self.reported = (self.consumer.epoch(), counters.refused_records, counters.fail_overs);
        if let (Some(record), Some(seat)) = (self.consumer.record(), self.consumer.seat_in_effect())
            && record.epoch != epoch
        {
            let at_ns = self.t;
            self.send(Message::Acknowledged { epoch: record.epoch, seat, at_ns });
        }
        if counters.refused_records != refused {
            self.send(Message::Refused { epoch: counters.refused_epoch });
        }
        if counters.fail_overs != fail_overs {
            let at_ns = counters.fail_over_ns;
            self.send(Message::FailedOver { epoch: self.consumer.epoch(), at_ns });
        }
    }

    /// The plant reports now and then that it is on its own.
    fn complain(&mut self) {
        let epoch = self.consumer.epoch();
        self.alone = match self.alone {
            _ if self.followed.is_some() || epoch == 0 || self.t < self.level_until => None,
            Some(since_ns) => {
                if (self.t - since_ns).is_multiple_of(3) {
                    self.send(Message::Unguided { epoch, since_ns, at_ns: self.t });
                }
                Some(since_ns)
            }
            None => Some(self.t),
        };
    }

    fn send(&mut self, message: Message) {
        if self.slot.is_some() {
            self.messages.push((message, self.t));
        }
    }

    /// Nothing is on the way and no process has anything to do.
    pub(crate) fn is_quiet(&self) -> bool {
        let at_rest = |process: &Process| {
            matches!(process, Process::Gone | Process::Flying { mute: None, leaving: None, .. })
        };
        let still = self.records.is_empty()
            && self.messages.is_empty()
            && self.successor.is_none()
            && self.calm >= 2;
        match &self.slot {
            None => still && self.written.is_none_or(|record| record.effective_ns <= self.t),
            Some(slot) => {
                let owner = slot
                    .record()
                    .filter(|record| record.is_taken(record.owner))
                    .map(|record| record.owner);
                still
                    && slot.is_quiet()
                    && slot.deadline_ns().is_none()
                    && self.processes.iter().all(at_rest)
                    && slot.record().is_some_and(|record| record.epoch == self.consumer.epoch())
                    && owner == self.followed
                    && owner.is_some()
            }
        }
    }
}
