//! The supervisor's side: one state machine per slot, events in, actions out.
//!
//! It reads no clock: each event comes with the time, and [`Slot::deadline_ns`] says when the next
//! [`Event::Time`] is due. In lockstep allowed time must stop exactly there, and stand still while
//! [`Slot::holds_time`]; then every instant in a record follows from script and flight alone.
//!
//! Start with `Phase`, then [`message`]. `candidate.rs` is the way of a candidate to the flip,
//! `loss.rs` what happens when somebody is lost, `publish.rs` how instants are chosen.

mod candidate;
mod chairs;
mod ledger;
mod loss;
pub mod message;
mod publish;
mod request;

pub use message::{
    Action, Event, Fault, Instance, Now, Order, Outcome, Program, Reason, RehearsalRefusal,
    Rehearsed, Report, Request, Step, Target,
};

use crate::record::{Record, SEATS, Seat};
use chairs::{Chair, Chairs};
use ledger::Ledger;

/// How far a slot is, for who looks on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Progress {
    /// The owner commands and nothing is under way.
    Steady,
    /// Nobody commands; the owner is being started.
    Ownerless,
    /// A candidate is being started.
    Joining(Seat),
    /// It shadows the owner until this instant \[ns\], and tracks what is applied.
    Tracking(Seat, u64),
    /// It shadows the owner and runs free, until this instant \[ns\].
    Shadowing(Seat, u64),
    /// It is being flown ahead.
    Rehearsing(Seat),
    /// It gets the slot.
    Flipping(Seat),
    /// It commands, and can be rolled back until this instant \[ns\].
    Window(Seat, u64),
    /// The owner before it gets the slot again.
    Reverting(Seat),
}

impl Progress {
    /// In a word.
    #[must_use]
    pub fn label(self) -> &'static str {
        match self {
            Self::Steady => "steady",
            Self::Ownerless => "ownerless",
            Self::Joining(_) => "joining",
            Self::Tracking(..) => "tracking",
            Self::Shadowing(..) => "shadowing",
            Self::Rehearsing(_) => "rehearsing",
            Self::Flipping(_) => "flipping",
            Self::Window(..) => "window",
            Self::Reverting(_) => "reverting",
        }
    }

    /// The instance that it is about.
    #[must_use]
    pub fn seat(self) -> Option<Seat> {
        match self {
            Self::Steady | Self::Ownerless => None,
            Self::Joining(seat)
            | Self::Tracking(seat, _)
            | Self::Shadowing(seat, _)
            | Self::Rehearsing(seat)
            | Self::Flipping(seat)
            | Self::Window(seat, _)
            | Self::Reverting(seat) => Some(seat),
        }
    }

    /// When it is over, if that is known \[ns\].
    #[must_use]
    pub fn until_ns(self) -> Option<u64> {
        match self {
            Self::Tracking(_, until_ns)
            | Self::Shadowing(_, until_ns)
            | Self::Window(_, until_ns) => Some(until_ns),
            _ => None,
        }
    }
}

/// How the slot's time runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Clock {
    /// A record is in time if its instant has not been allowed yet.
    Lockstep,
    /// A record is in time if it is one and a half periods ahead.
    Realtime,
}

/// Times of one slot's supervision. All are logical time \[ns\].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct SlotConfig {
    /// Clock.
    pub clock: Clock,
    /// Lockstep: a flip lies at least this far beyond what is allowed.
    pub margin_ns: u64,
    /// From something the flight did to the answer: in lockstep beyond anything that can have been
    /// allowed by then, so that the answer's instant does not depend on when the supervisor saw it.
    pub react_ns: u64,
    /// From an owner's death to its successor's start, if nobody can take over.
    pub restart_ns: u64,
    /// How long the consumer may be on its own before its owner is taken for useless, beside three of
    /// the owner's periods.
    pub unguided_ns: u64,
    /// From a record's instant until it is written again, if it is not confirmed.
    pub acknowledge_ns: u64,
    /// Flips that are not confirmed so often are taken back.
    pub tries_max: u32,
    /// Standbys lost in a row, or refused, before there shall be none.
    pub standby_losses_max: u32,
    /// The last proven owner stays as the fallback of an owner that is not trusted.
    pub keeps_fallback: bool,
    /// From a rehearsal's instant until its answer is about a flight that is past.
    pub rehearsal_ns: u64,
    /// How long the next standby of a slot that was found in flight shadows: how long the first was asked
    /// to is not known any more.
    pub adopted_shadow_ns: u64,
}

impl SlotConfig {
    /// For simulated time.
    pub const LOCKSTEP: Self = Self {
        clock: Clock::Lockstep,
        margin_ns: 0,
        react_ns: 500_000_000,
        restart_ns: 100_000_000,
        unguided_ns: 200_000_000,
        acknowledge_ns: 500_000_000,
        tries_max: 5,
        standby_losses_max: 3,
        keeps_fallback: true,
        rehearsal_ns: 2_000_000_000,
        adopted_shadow_ns: 2_000_000_000,
    };
    /// For flights by the wall clock.
    pub const REALTIME: Self = Self {
        clock: Clock::Realtime,
        react_ns: 0,
        restart_ns: 0,
        acknowledge_ns: 100_000_000,
        ..Self::LOCKSTEP
    };
}

/// What is going on in a slot.
///
/// ```text
///                       ┌──────────── refused, lost, or dry run ────────────┐
///                       ▼                                                   │
///   Ownerless ──Ready─▶ Steady ──Swap, Standby─▶ Joining ──Ready─▶ Shadowing┤
///       ▲               ▲ ▲ ▲                                               │ gate passed, rehearsed
///       │               │ │ └────────── a standby: it is the fallback ──────┤
///       │ owner lost,   │ │                                                 ▼
///       │ nobody else   │ └─window over─ Window ◀──────confirmed──────── Flipping
///       │               │                 │ │                              │ │
///    (any phase)        └──── confirmed ─ Reverting ◀── Rollback; never confirmed
///                       ▲                   │                              │
///                       └─ new owner lost: the old one is owner again ─────┘
/// ```
///
/// Whoever leaves does so beside this (`Leaving`, `Dying` of its chair), and a record that has not
/// been confirmed is written again whatever the phase.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
enum Phase {
    /// Nobody commands; the process on `seat` is being started, or will be at `at_ns`; `None`: once
    /// it is dead, or it is starting now.
    Ownerless { seat: Seat, at_ns: Option<u64> },
    /// The owner commands. A standby that is wanted and missing is started at `rejoin_ns`.
    Steady { rejoin_ns: Option<u64> },
    /// A candidate has been spawned and has not connected.
    Joining { seat: Seat, goal: Goal },
    /// It steps and publishes; nobody obeys.
    Shadowing { seat: Seat, goal: Goal, track_until_ns: u64, until_ns: u64, stage: Stage },
    /// A record from `epoch` on names it as the owner.
    Flipping { new: Seat, old: Seat, epoch: u64, order: Order },
    /// It commands; the old owner is the fallback.
    Window { new: Seat, old: Seat, until_ns: u64, order: Order },
    /// A record from `epoch` on names the old owner again; the other one is healthy and leaves when
    /// that is confirmed.
    Reverting { from: Seat, to: Seat, epoch: u64, asked: bool },
}

/// What a candidate is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum Goal {
    Swap(Order),
    Standby { shadow_ns: u64, rehearse: bool },
}

impl Goal {
    fn shadow_ns(self) -> u64 {
        match self {
            Self::Swap(order) => order.shadow_ns,
            Self::Standby { shadow_ns, .. } => shadow_ns,
        }
    }

    fn is_rehearsed(self) -> bool {
        match self {
            Self::Swap(order) => order.rehearse,
            Self::Standby { rehearse, .. } => rehearse,
        }
    }
}

/// Part of the shadow window.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum Stage {
    Tracking,
    Free,
    /// The gate has been asked.
    Judged,
    /// It has passed the gate and is being flown ahead.
    Rehearsing {
        again: bool,
    },
}

/// The standby that is to be kept.
#[expect(clippy::struct_excessive_bools, reason = "facts of their own, in any combination")]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
struct Standby {
    program: Program,
    shadow_ns: u64,
    /// It is flown ahead before it may stand by.
    rehearse: bool,
    /// It is there because the owner is not trusted, and goes with that owner.
    automatic: bool,
    /// Where it is, once it has passed the gate.
    seat: Option<Seat>,
    /// How often in a row it has been lost.
    losses: u32,
    /// One of it has passed the gate: what refuses the next may pass.
    proven: bool,
    /// The gate has refused the last.
    refused: bool,
}

/// A slot as its supervisor sees it.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct Slot {
    config: SlotConfig,
    chairs: Chairs,
    ledger: Ledger,
    phase: Phase,
    standby: Option<Standby>,
    /// What the flight began with, and who is started when nothing else holds.
    home: Program,
    /// When an owner of another program was last started again \[ns\].
    restarted_ns: Option<u64>,
    /// An owner without usable commands, and when it is sent away.
    useless: Option<Useless>,
    /// An owner that came by a swap and is watched for as long as it commands.
    untrusted: Option<Seat>,
}

/// An owner that is there, does not command, and has no fallback.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
struct Useless {
    seat: Seat,
    epoch: u64,
    fault: Fault,
    /// When it is dealt with: in lockstep beyond all that can have been allowed \[ns\].
    due_ns: u64,
}

impl Slot {
    /// A slot whose first owner, a process of `program` on `seat`, is being started by the caller.
    /// Its [`Event::Ready`] gives it the slot.
    #[must_use]
    pub fn new(config: SlotConfig, seat: Seat, program: Program) -> Self {
        let mut chairs = Chairs::new([Chair::Free; SEATS]);
        chairs.set(seat, Chair::Starting(program));
        Self {
            config,
            chairs,
            ledger: Ledger::default(),
            phase: Phase::Ownerless { seat, at_ns: None },
            standby: None,
            home: program,
            restarted_ns: None,
            useless: None,
            untrusted: None,
        }
    }

    /// A slot found in flight: the newest record that its supervisor had written, and who is there.
    /// Whoever is neither owner nor fallback is sent away; an owner that is not there is replaced, or
    /// started again as an instance of `owner`. If the consumer obeys the fallback, send
    /// [`Event::FellOver`] next.
    #[must_use]
    pub fn adopt(
        config: SlotConfig,
        now: Now,
        record: &Record,
        owner: Program,
        seated: [Option<(Program, Instance)>; SEATS],
    ) -> (Self, Vec<Action>) {
        let chair = |who: Option<(Program, Instance)>| {
            who.map_or(Chair::Free, |(program, instance)| Chair::Seated(program, instance))
        };
        let chairs = Chairs::new(seated.map(chair));
        let mut ledger = Ledger::default();
        ledger.in_force = chairs.instance(record.owner).map(|owner| (record.owner, *owner));
        ledger.take_up(*record);
        let standby = record.fallback.filter(|seat| chairs.is_seated(*seat)).and_then(|seat| {
            let program = chairs.get(seat).program()?;
            Some(Standby {
                program,
                shadow_ns: config.adopted_shadow_ns,
                rehearse: false,
                automatic: record.watched,
                seat: Some(seat),
                losses: 0,
                proven: true,
                refused: false,
            })
        });
        let phase = Phase::Steady { rejoin_ns: None };
        let mut slot = Self {
            config,
            chairs,
            ledger,
            phase,
            standby,
            home: owner,
            restarted_ns: None,
            useless: None,
            untrusted: record.watched.then_some(record.owner),
        };
        let mut actions = Vec::new();
        for seat in Seat::ALL {
            if seat != record.owner && Some(seat) != record.fallback {
                slot.dismiss(seat, &mut actions);
            }
        }
        if slot.chairs.is_seated(record.owner) {
            slot.publish(now, record.owner, None, &mut actions);
        } else {
            slot.chairs.set(record.owner, Chair::Starting(owner));
            actions.extend(slot.on(now, Event::Died(record.owner)));
        }
        (slot, actions)
    }

    /// Takes in one event.
    pub fn on(&mut self, now: Now, event: Event) -> Vec<Action> {
        let mut actions = Vec::new();
        let out = &mut actions;
        match event {
            Event::Request(request) => self.request(now, request, out),
            Event::Ready(seat, instance) => self.ready(now, seat, instance, out),
            Event::Verdict(seat, verdict) => self.verdict(now, seat, verdict, out),
            Event::Rehearsed(seat, rehearsed) => self.rehearsed(now, seat, rehearsed, out),
            Event::Time => self.time(now, out),
            Event::Acknowledged { epoch, seat, at_ns } => {
                self.acknowledged(now, epoch, seat, at_ns, out);
            }
            Event::RecordRefused { epoch } if epoch == self.ledger.epoch() => {
                self.try_again(now, out);
            }
            Event::RecordRefused { .. } => {}
            Event::FellOver { epoch, at_ns } => self.fell_over(now, epoch, at_ns, out),
            Event::Tripped { epoch, at_ns } => self.tripped(now, epoch, at_ns, out),
            Event::Unguided { epoch, since_ns, at_ns } => self.unguided(epoch, since_ns, at_ns),
            Event::Unwatched => self.unwatched(now, out),
            Event::Died(seat) => self.died(now, seat, out),
            Event::Misbehaved(seat, fault) => self.misbehaved(now, seat, fault, out),
        }
        actions
    }

    /// When the next [`Event::Time`] is due \[ns\]. In lockstep allowed time must end there until it
    /// has been given.
    #[must_use]
    pub fn deadline_ns(&self) -> Option<u64> {
        let phase_ns = match self.phase {
            Phase::Ownerless { at_ns, .. } => at_ns,
            Phase::Steady { rejoin_ns } => rejoin_ns,
            Phase::Shadowing { track_until_ns, stage: Stage::Tracking, .. } => Some(track_until_ns),
            Phase::Shadowing { until_ns, stage: Stage::Free, .. }
            | Phase::Window { until_ns, .. } => Some(until_ns),
            _ => None,
        };
        let outstanding_ns = self.ledger.outstanding.map(|outstanding| outstanding.until_ns);
        let useless_ns = self.useless.map(|useless| useless.due_ns);
        [phase_ns, outstanding_ns, useless_ns].into_iter().flatten().min()
    }

    /// True while lockstep time must stand still: a process is being started or flown ahead, or the
    /// gate has been asked.
    #[must_use]
    pub fn holds_time(&self) -> bool {
        match self.phase {
            Phase::Joining { .. }
            | Phase::Shadowing { stage: Stage::Judged | Stage::Rehearsing { .. }, .. } => true,
            Phase::Ownerless { at_ns, .. } => at_ns.is_none(),
            _ => false,
        }
    }

    /// How far the slot is.
    #[must_use]
    pub fn progress(&self) -> Progress {
        match self.phase {
            Phase::Ownerless { .. } => Progress::Ownerless,
            Phase::Steady { .. } => Progress::Steady,
            Phase::Joining { seat, .. } => Progress::Joining(seat),
            Phase::Shadowing { seat, stage: Stage::Rehearsing { .. }, .. } => {
                Progress::Rehearsing(seat)
            }
            Phase::Shadowing { seat, stage: Stage::Tracking, track_until_ns, .. } => {
                Progress::Tracking(seat, track_until_ns)
            }
            Phase::Shadowing { seat, until_ns, .. } => Progress::Shadowing(seat, until_ns),
            Phase::Flipping { new, .. } => Progress::Flipping(new),
            Phase::Window { new, until_ns, .. } => Progress::Window(new, until_ns),
            Phase::Reverting { to, .. } => Progress::Reverting(to),
        }
    }

    /// The newest record written.
    #[must_use]
    pub fn record(&self) -> Option<&Record> {
        self.ledger.newest()
    }

    /// True if nothing is going on: an owner commands, and its record is confirmed.
    #[must_use]
    pub fn is_quiet(&self) -> bool {
        matches!(self.phase, Phase::Steady { .. }) && self.ledger.outstanding.is_none()
    }

    /// Seat of the candidate that joins or shadows.
    #[must_use]
    pub fn candidate(&self) -> Option<Seat> {
        match self.phase {
            Phase::Joining { seat, .. } | Phase::Shadowing { seat, .. } => Some(seat),
            _ => None,
        }
    }

    /// True if both are there and have states of the same layout.
    #[must_use]
    pub fn are_alike(&self, a: Seat, b: Seat) -> bool {
        let layout = self.chairs.layout(a);
        layout.is_some() && layout == self.chairs.layout(b)
    }

    /// True if `seat` is taken by somebody who is there or on the way, leaving included.
    #[must_use]
    pub fn is_taken(&self, seat: Seat) -> bool {
        *self.chairs.get(seat) != Chair::Free
    }

    fn time(&mut self, now: Now, out: &mut Vec<Action>) {
        let due = |at_ns: u64| at_ns <= now.logical_ns;
        if self.ledger.outstanding.is_some_and(|outstanding| due(outstanding.until_ns)) {
            self.try_again(now, out);
        }
        if let Some(useless) = self.useless.take_if(|useless| due(useless.due_ns)) {
            self.clear_seat(now, useless, out);
        }
        match self.phase {
            Phase::Ownerless { seat, at_ns: Some(at_ns) } if due(at_ns) => {
                self.start_owner(now, seat, out);
            }
            Phase::Steady { rejoin_ns: Some(at_ns) } if due(at_ns) => self.start_standby(out),
            Phase::Shadowing { track_until_ns, stage: Stage::Tracking, .. }
                if due(track_until_ns) =>
            {
                self.run_free(out);
            }
            Phase::Shadowing { until_ns, stage: Stage::Free, .. } if due(until_ns) => self.ask(out),
            Phase::Window { new, old, until_ns, .. } if due(until_ns) => {
                self.commit(now, new, old, out);
            }
            _ => {}
        }
    }

    /// Back to rest; a standby that is wanted and missing is fetched a reaction after `at_ns`, and one
    /// that the gate has refused when as much time has passed again.
    fn settle(&mut self, at_ns: u64) {
        let missing = self.standby.filter(|standby| standby.seat.is_none());
        let rejoin_ns = missing.map(|standby| {
            let pause_ns = if standby.refused { standby.shadow_ns } else { 0 };
            at_ns.saturating_add(self.config.react_ns).saturating_add(pause_ns)
        });
        self.phase = Phase::Steady { rejoin_ns };
    }
}

fn step(out: &mut Vec<Action>, step: Step) {
    out.push(Action::Report(Report::Step(step)));
}

#[cfg(test)]
mod tests;
