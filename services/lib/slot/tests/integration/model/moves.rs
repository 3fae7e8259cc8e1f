//! What may happen next.

use super::world::{
    CREDIT, Flaw, LATENCY, LEVEL, Message, OTHER_KIND, OWNER, Process, REHEARSAL, SAME_KIND,
    STANDBY, World, config,
};
use slot::{
    Clock, Event, Fault, GateFigures, Instance, Program, Refusal, RehearsalRefusal, Rehearsed,
    Request, SEATS, Seat, SlotMachine, SwapTerms, Target,
};

/// One thing that happens.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Move {
    /// Lockstep: the conductor lets time go on.
    Allow,
    /// The plant ticks.
    Tick,
    /// A record arrives.
    Deliver,
    /// The launcher reads what the plant has sent.
    Listen,
    /// The launcher's slot gets its time.
    Time,
    /// A process has connected.
    Connect(Seat),
    /// It never will.
    NeverReady(Seat),
    /// The gate's verdict.
    Verdict(bool),
    /// The rehearsal's verdict; begun so many ticks ago.
    Rehearsed(bool, u64),
    /// The monitor trips the watched owner; the gate levels the vehicle for so many ticks first.
    Trip(u64),
    /// It does, and the consumer ignores that.
    IgnoredTrip,
    /// Another consumer follows the slot instead, which has not.
    Replace,
    /// A process that is to leave does.
    Exit(Seat),
    /// The launcher notices a death.
    NoticeDeath(Seat),
    /// The launcher notices that a process is of no use.
    NoticeSilence(Seat),
    /// A process dies.
    Die(Seat),
    /// A process goes on, and nothing useful comes of it.
    FallSilent(Seat),
    /// And then it does again.
    PublishAgain(Seat),
    /// The launcher dies.
    LauncherDies,
    /// Another takes over.
    Adopt,
    /// A user asks.
    Ask(Request),
}

const AT_ONCE: SwapTerms =
    SwapTerms { shadow_ns: 2, rollback_ns: 3, force: false, rehearse: false, dry_run: false };
const REHEARSED: SwapTerms = SwapTerms { rehearse: true, ..AT_ONCE };

const REQUESTS: [Request; 10] = [
    Request::Swap(Target::New(SAME_KIND), AT_ONCE),
    Request::Swap(Target::New(OTHER_KIND), REHEARSED),
    Request::Swap(Target::New(SAME_KIND), SwapTerms { dry_run: true, ..REHEARSED }),
    Request::Swap(Target::Seated(Seat::ALL[0]), AT_ONCE),
    Request::Swap(Target::Seated(Seat::ALL[1]), AT_ONCE),
    Request::Standby(STANDBY, 2, false),
    Request::Rollback,
    Request::Retire(Seat::ALL[0]),
    Request::Retire(Seat::ALL[1]),
    Request::Retire(Seat::ALL[2]),
];

impl World {
    pub(crate) fn moves(&self, moves: &mut Vec<Move>) {
        if self.broken.is_some() {
            return;
        }
        self.on_the_way(moves);
        self.misfortunes(moves);
        if !self.is_quiet() && !self.overdue() {
            match self.clock {
                Clock::Realtime => moves.push(Move::Tick),
                Clock::Lockstep if self.t < self.allowed => moves.push(Move::Tick),
                Clock::Lockstep if self.end_of_allowed() > self.allowed => moves.push(Move::Allow),
                Clock::Lockstep => {}
            }
        }
    }

    /// Messages, notices and answers that can come now.
    fn on_the_way(&self, moves: &mut Vec<Move>) {
        if !self.records.is_empty() {
            moves.push(Move::Deliver);
        }
        if self.replacement_is_due() {
            moves.push(Move::Replace);
        }
        for seat in Seat::ALL {
            if let Process::Flying { mute: Some(_), .. } = self.processes[seat.index()] {
                moves.push(Move::PublishAgain(seat));
            }
        }
        if self.slot.is_none() {
            self.exits(moves);
            return;
        }
        if !self.messages.is_empty() {
            moves.push(Move::Listen);
        }
        if self.time_is_due() {
            moves.push(Move::Time);
        }
        if let Some(seat) = self.judging {
            // A shadow that publishes nothing has missed its deadlines.
            let fit = matches!(self.processes[seat.index()], Process::Flying { mute: None, .. });
            if fit {
                moves.push(Move::Verdict(true));
            }
            if !fit || self.budget.misfortunes > 0 {
                moves.push(Move::Verdict(false));
            }
        }
        if self.rehearsing.is_some() {
            moves.push(Move::Rehearsed(true, 0));
            if self.budget.misfortunes > 0 {
                moves.push(Move::Rehearsed(false, 0));
                moves.push(Move::Rehearsed(true, REHEARSAL + 1));
            }
        }
        for seat in Seat::ALL {
            match self.processes[seat.index()] {
                Process::Starting { .. } => moves.push(Move::Connect(seat)),
                Process::Dead { .. } => moves.push(Move::NoticeDeath(seat)),
                Process::Flying { mute: Some(_), .. } => {
                    moves.push(Move::NoticeSilence(seat));
                }
                _ => {}
            }
        }
        self.exits(moves);
    }

    fn exits(&self, moves: &mut Vec<Move>) {
        for seat in Seat::ALL {
            if self.may_exit(seat) {
                moves.push(Move::Exit(seat));
            }
        }
    }

    fn may_exit(&self, seat: Seat) -> bool {
        let Process::Flying { mute: None, leaving: Some(_), .. } = self.processes[seat.index()]
        else {
            return false;
        };
        self.consumer.record().is_none_or(|record| !record.is_taken(seat))
    }

    fn time_is_due(&self) -> bool {
        let deadline_ns = self.slot.as_ref().and_then(SlotMachine::deadline_ns);
        deadline_ns.is_some_and(|at| {
            at <= self.t && (self.clock == Clock::Realtime || self.allowed <= self.t)
        })
    }

    fn replacement_is_due(&self) -> bool {
        self.successor.as_ref().is_some_and(|(.., at)| self.t >= *at)
    }

    /// True if something has waited as long as it can: it comes before the next tick.
    fn overdue(&self) -> bool {
        let late = |since: u64| self.t >= since + self.budget.patience;
        let lockstep = self.clock == Clock::Lockstep;
        // What was written before time was allowed is there before it runs.
        let record = self.records.first().is_some_and(|(_, sent)| {
            if lockstep { self.t >= *sent } else { self.t >= sent + self.budget.record_patience }
        });
        let replacement = self.replacement_is_due();
        if self.slot.is_none() {
            return record || replacement;
        }
        let message = self.messages.first().is_some_and(|(_, sent)| late(*sent));
        let deadline = self.slot.as_ref().and_then(SlotMachine::deadline_ns);
        let time = deadline.is_some_and(|at| self.t >= at + self.budget.patience);
        let seats = Seat::ALL.into_iter().any(|seat| match self.processes[seat.index()] {
            Process::Starting { since, .. } | Process::Dead { since } => late(since),
            // Silence is only seen after a while; the plant may be faster.
            Process::Flying { mute: Some(since), .. } => late(since + 3),
            Process::Flying { leaving: Some(since), .. } => self.may_exit(seat) && late(since + 2),
            _ => false,
        });
        let answer = self.judging.is_some() || self.rehearsing.is_some();
        record || message || time || seats || replacement || answer
    }

    /// Lockstep: how far the conductor lets time go.
    fn end_of_allowed(&self) -> u64 {
        let credit = self.t + CREDIT;
        let Some(slot) = &self.slot else { return credit };
        if slot.holds_time() {
            return self.allowed;
        }
        let read_by = self.messages.first().map_or(u64::MAX, |(_, sent)| sent + CREDIT);
        slot.deadline_ns().map_or(credit, |at| at.min(credit)).min(read_by)
    }

    fn misfortunes(&self, moves: &mut Vec<Move>) {
        if self.budget.misfortunes > 0 {
            if self.consumer.record().is_some_and(|record| record.watched)
                && !self.consumer.tripped()
                && !self.consumer.failed_over()
            {
                moves.extend([0, LEVEL].map(Move::Trip));
                if self.successor.is_none() {
                    moves.push(Move::IgnoredTrip);
                }
            }
            for seat in Seat::ALL {
                match self.processes[seat.index()] {
                    Process::Starting { .. } => {
                        moves.push(Move::Die(seat));
                        if self.slot.is_some() {
                            moves.push(Move::NeverReady(seat));
                        }
                    }
                    Process::Waiting(_) => moves.push(Move::Die(seat)),
                    Process::Flying { mute: None, .. } => {
                        moves.push(Move::Die(seat));
                        moves.push(Move::FallSilent(seat));
                    }
                    _ => {}
                }
            }
            if self.slot.is_some() {
                moves.push(Move::LauncherDies);
            }
        }
        if self.budget.requests > 0 {
            if self.slot.is_some() {
                moves.extend(REQUESTS.map(Move::Ask));
            } else if self.written.is_some() {
                moves.push(Move::Adopt);
            }
        }
    }

    pub(crate) fn make(&mut self, action: Move) {
        match action {
            Move::Allow => self.allowed = self.end_of_allowed(),
            Move::Tick => self.tick(),
            Move::Deliver => self.deliver(),
            Move::Listen => self.listen(),
            Move::Time => self.notify_time(),
            Move::Connect(seat) => self.connect(seat),
            Move::NeverReady(seat) => {
                self.budget.misfortunes -= 1;
                self.notify(Event::Misbehaved(seat, Fault::NeverReady));
            }
            Move::Verdict(passed) => self.verdict(passed),
            Move::Rehearsed(passed, age) => self.rehearsed(passed, age),
            Move::Trip(level) => {
                self.budget.misfortunes -= 1;
                self.trip(level);
            }
            Move::IgnoredTrip => {
                self.budget.misfortunes -= 1;
                self.ignore_trip();
            }
            Move::Replace => self.replace_consumer(),
            Move::Exit(seat) => self.die(seat),
            Move::NoticeDeath(seat) => {
                self.processes[seat.index()] = Process::Gone;
                self.notify(Event::Died(seat));
            }
            Move::NoticeSilence(seat) => self.notify(Event::Misbehaved(seat, Fault::Stalled)),
            Move::Die(seat) => {
                self.budget.misfortunes -= 1;
                self.die(seat);
            }
            Move::FallSilent(seat) => {
                self.budget.misfortunes -= 1;
                if let Process::Flying { mute, .. } = &mut self.processes[seat.index()] {
                    *mute = Some(self.t);
                }
            }
            Move::PublishAgain(seat) => {
                let t = self.t;
                if let Process::Flying { mute, from, .. } = &mut self.processes[seat.index()] {
                    *mute = None;
                    *from = t.saturating_sub(LATENCY).max(*from);
                }
            }
            Move::LauncherDies => {
                self.budget.misfortunes -= 1;
                self.slot = None;
                self.messages.clear();
                (self.judging, self.rehearsing) = (None, None);
            }
            Move::Adopt => self.adopt(),
            Move::Ask(request) => {
                self.budget.requests -= 1;
                if let Request::Retire(seat) = request {
                    self.given_up[seat.index()] = true;
                }
                self.notify(Event::Request(request));
            }
        }
    }

    fn die(&mut self, seat: Seat) {
        self.processes[seat.index()] = Process::Dead { since: self.t };
    }

    fn connect(&mut self, seat: Seat) {
        let Process::Starting { program, .. } = self.processes[seat.index()] else { return };
        let instance = Self::instance(program);
        self.processes[seat.index()] = Process::Waiting(instance);
        self.notify(Event::Ready(seat, instance));
    }

    fn listen(&mut self) {
        let (message, _) = self.messages.remove(0);
        let deaf = self.flaw == Some(Flaw::NeverTriesAgain);
        match message {
            Message::Acknowledged { epoch, seat, at_ns } => {
                self.notify(Event::Acknowledged { epoch, seat, at_ns });
            }
            Message::Refused { .. } if deaf => {}
            Message::Refused { epoch } => self.notify(Event::RecordRefused { epoch }),
            Message::FailedOver { epoch, at_ns } => self.notify(Event::FailedOver { epoch, at_ns }),
            Message::Tripped { epoch, at_ns } => self.notify(Event::Tripped { epoch, at_ns }),
            Message::Unguided { epoch, since_ns, at_ns } => {
                self.notify(Event::Unguided { epoch, since_ns, at_ns });
            }
        }
    }

    fn notify_time(&mut self) {
        self.notify(Event::Time);
    }

    fn verdict(&mut self, passed: bool) {
        let Some(seat) = self.judging.take() else { return };
        let verdict = if passed {
            Ok(Box::new(GateFigures::default()))
        } else {
            if matches!(self.processes[seat.index()], Process::Flying { mute: None, .. }) {
                self.budget.misfortunes -= 1;
            }
            Err(Refusal::MissedDeadlines { missed: 1, limit: 0, at_ns: self.t })
        };
        self.notify(Event::Verdict(seat, verdict));
    }

    fn rehearsed(&mut self, passed: bool, age: u64) {
        let Some(seat) = self.rehearsing.take() else { return };
        let refusal = || RehearsalRefusal::Fails("would lose the vehicle".to_owned());
        let verdict = passed.then(|| "keeps to the tube".to_owned()).ok_or_else(refusal);
        if !passed || age > 0 {
            self.budget.misfortunes -= 1;
        }
        let from_ns = self.t.saturating_sub(age);
        self.notify(Event::Rehearsed(seat, Rehearsed { from_ns, left_tube: false, verdict }));
    }

    /// A new launcher finds the flight: the newest record written, and the processes that are there.
    fn adopt(&mut self) {
        self.budget.requests -= 1;
        let Some(record) = self.written else { return };
        let mut seated: [Option<(Program, Instance)>; SEATS] = [None; SEATS];
        for seat in Seat::ALL {
            match self.processes[seat.index()] {
                Process::Flying { instance, .. } => {
                    seated[seat.index()] = Some((SAME_KIND, instance));
                }
                // No process can reach it.
                Process::Starting { .. } | Process::Waiting(_) | Process::Dead { .. } => {
                    self.processes[seat.index()] = Process::Gone;
                }
                Process::Gone => {}
            }
        }
        let now = slot::Now {
            logical_ns: self.t,
            allowed_ns: if self.clock == Clock::Lockstep { self.allowed } else { self.t },
        };
        let (adopted, actions) =
            SlotMachine::adopt(config(self.clock), now, &record, [OWNER; 2], seated);
        self.slot = Some(adopted);
        self.act(actions);
        if self.consumer.tripped() {
            // The monitor repeats itself for a reader that listens late.
            let (epoch, at_ns) = (self.consumer.epoch(), self.consumer.counters().trip_ns);
            self.notify(Event::Tripped { epoch, at_ns });
        }
        if self.consumer.failed_over() {
            let (epoch, at_ns) = (self.consumer.epoch(), self.consumer.counters().fail_over_ns);
            self.notify(Event::FailedOver { epoch, at_ns });
        }
    }
}
