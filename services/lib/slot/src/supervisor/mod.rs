//! The supervisor's side: one state machine per slot, events in, actions out.
//!
//! It reads no clock: each event comes with the time, and [`SlotMachine::deadline_ns`] gives when the next
//! [`Event::Time`] is due. In lockstep allowed time must stop exactly there, and stand still while
//! [`SlotMachine::holds_time`]; then every instant in a record follows from script and flight alone.
//!
//! Start with `Phase`, then [`message`]. `candidate.rs` is the way of a candidate to the flip,
//! `loss.rs` what happens when a process is lost, `publish.rs` how instants are chosen.

mod candidate;
mod config;
mod instances;
mod ledger;
mod loss;
pub mod message;
mod progress;
mod publish;
mod reason;
mod report;
mod request;

pub use config::{Clock, SlotConfig};
pub use instances::{Instance, Program};
pub use message::{Action, Event, Now, Rehearsed, Request, SwapTerms, Target};
pub use progress::Progress;
pub use reason::{Fault, Reason, RehearsalRefusal};
pub use report::{Outcome, Report, Step};

use crate::record::{Record, SEATS, Seat};
use instances::{InstanceState, Instances};
use ledger::Ledger;

/// What is going on in a slot.
///
/// ```text
///                       ┌──────────── refused, lost, or dry run ────────────┐
///                       ▼                                                   │
///   Ownerless ──Ready─▶ Steady ──Swap, Standby─▶ Joining ──Ready─▶ Shadowing┤
///       ▲               ▲ ▲ ▲                                               │ gate passed, rehearsed
///       │               │ │ └────────── a standby: it is the fallback ──────┤
///       │ owner lost,   │ │                                                 ▼
///       │ no other left │ └─window over─ Window ◀──────confirmed──────── Flipping
///       │               │                 │ │                              │ │
///    (any phase)        └──── confirmed ─ Reverting ◀── Rollback; never confirmed
///                       ▲                   │                              │
///                       └─ new owner lost: the old one is owner again ─────┘
/// ```
///
/// A process that leaves does so beside this (`Leaving`, `Dying` of its instance), and a record that has not
/// been confirmed is written again whatever the phase.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
enum Phase {
    /// No process commands; the one on `seat` is being started, or will be at `at_ns`; `None`: once
    /// it is dead, or it is starting now.
    Ownerless { seat: Seat, at_ns: Option<u64> },
    /// The owner commands. A standby that is wanted and missing is started at `rejoin_ns`.
    Steady { rejoin_ns: Option<u64> },
    /// A candidate has been spawned and has not connected.
    Joining { seat: Seat, goal: Goal },
    /// It steps and publishes, and is not followed.
    Shadowing { seat: Seat, goal: Goal, track_until_ns: u64, until_ns: u64, stage: Stage },
    /// A record from `epoch` on names it as the owner. Its window ends at `ends_ns` at the earliest.
    Flipping { new: Seat, old: Seat, epoch: u64, order: SwapTerms, ends_ns: u64 },
    /// It commands; the old owner is the fallback.
    Window { new: Seat, old: Seat, until_ns: u64, order: SwapTerms },
    /// A record from `epoch` on names the old owner again; the other one is healthy and leaves when
    /// that is confirmed.
    Reverting { from: Seat, to: Seat, epoch: u64, asked: bool },
}

/// What a candidate is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum Goal {
    Swap(SwapTerms),
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
pub struct SlotMachine {
    config: SlotConfig,
    instances: Instances,
    ledger: Ledger,
    phase: Phase,
    standby: Option<Standby>,
    /// The program that the flight began with, and that is started when nothing else holds.
    home: Program,
    /// The owner of another program that was last started again, and when \[ns\].
    restarted: Option<(Program, u64)>,
    /// An owner without usable commands, and when it is sent away.
    useless: Option<Useless>,
    /// The fallback of a rollback window that is over, and when it is sent away.
    outgoing: Option<Outgoing>,
    /// By seat: what sits there is not trusted although its program is, since it was let through by force, or found
    /// watched.
    untrusted: [bool; SEATS],
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

/// The old owner after the window of one that is trusted, which is not watched any more. A trip may still be on its way,
/// and a record without the fallback would give the slot back to the owner that has tripped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
struct Outgoing {
    seat: Seat,
    /// Epoch of the record that ends the window.
    epoch: u64,
    /// The consumer has put it into effect.
    is_confirmed: bool,
    /// When it leaves if that is confirmed, and is looked at again if not \[ns\].
    until_ns: u64,
}

impl SlotMachine {
    /// A slot whose first owner, a process of `program` on `seat`, is being started by the caller.
    /// Its [`Event::Ready`] gives it the slot.
    #[must_use]
    pub fn new(config: SlotConfig, seat: Seat, program: Program) -> Self {
        let mut instances = Instances::new([InstanceState::Free; SEATS]);
        instances.set(seat, InstanceState::Starting(program));
        Self {
            config,
            instances,
            ledger: Ledger::default(),
            phase: Phase::Ownerless { seat, at_ns: None },
            standby: None,
            home: program,
            restarted: None,
            useless: None,
            outgoing: None,
            untrusted: [false; SEATS],
        }
    }

    /// A slot found in flight: the newest record that its supervisor had written, and which processes are there.
    /// One that is neither owner nor fallback is sent away; an owner that is not there is replaced, or
    /// started again as an instance of `owner`; `home` is what the flight began with. The fallback of an owner that is not
    /// watched is taken for a standby, be it of a window that has just ended. If the consumer follows the fallback,
    /// send [`Event::FailedOver`] next.
    #[must_use]
    pub fn adopt(
        config: SlotConfig,
        now: Now,
        record: &Record,
        [owner, home]: [Program; 2],
        seated: [Option<(Program, Instance)>; SEATS],
    ) -> (Self, Vec<Action>) {
        let state = |process: Option<(Program, Instance)>| {
            process.map_or(InstanceState::Free, |(program, instance)| {
                InstanceState::Seated(program, instance)
            })
        };
        let instances = Instances::new(seated.map(state));
        let mut ledger = Ledger::default();
        ledger.in_force = instances.instance(record.owner).map(|owner| (record.owner, *owner));
        ledger.take_up(*record);
        let standby = record.fallback.filter(|seat| instances.is_seated(*seat)).and_then(|seat| {
            let program = instances.state(seat).program()?;
            Some(Standby {
                program,
                shadow_ns: config.standby_shadow_ns,
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
            instances,
            ledger,
            phase,
            standby,
            home,
            restarted: None,
            useless: None,
            outgoing: None,
            untrusted: [false; SEATS],
        };
        slot.untrusted[record.owner.index()] = record.watched;
        let mut actions = Vec::new();
        for seat in Seat::ALL {
            if seat != record.owner && Some(seat) != record.fallback {
                slot.dismiss(seat, &mut actions);
            }
        }
        if slot.instances.is_seated(record.owner) {
            if slot.standby.is_none() && !slot.is_trusted(record.owner) {
                slot.keep_fallback(None, config.standby_shadow_ns, &mut actions);
                slot.settle(now.logical_ns);
            }
            slot.publish(now, record.owner, None, &mut actions);
        } else {
            slot.instances.set(record.owner, InstanceState::Starting(owner));
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
            Event::FailedOver { epoch, at_ns } => self.failed_over(now, epoch, at_ns, out),
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
            // However far ahead time is allowed, it has not passed the end when the record is confirmed.
            Phase::Flipping { ends_ns, .. } => Some(ends_ns),
            _ => None,
        };
        let outstanding_ns = self.ledger.outstanding.map(|outstanding| outstanding.until_ns);
        let useless_ns = self.useless.map(|useless| useless.due_ns);
        let outgoing_ns = self.outgoing.map(|outgoing| outgoing.until_ns);
        [phase_ns, outstanding_ns, useless_ns, outgoing_ns].into_iter().flatten().min()
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
        matches!(self.phase, Phase::Steady { .. })
            && self.ledger.outstanding.is_none()
            && self.outgoing.is_none()
    }

    /// Seat of the candidate that joins or shadows.
    #[must_use]
    pub fn candidate(&self) -> Option<Seat> {
        match self.phase {
            Phase::Joining { seat, .. } | Phase::Shadowing { seat, .. } => Some(seat),
            _ => None,
        }
    }

    /// The process on a seat; none before it is there.
    #[must_use]
    pub fn instance(&self, seat: Seat) -> Option<&Instance> {
        self.instances.instance(seat)
    }

    /// True if both are there and have states of the same layout.
    #[must_use]
    pub fn are_alike(&self, a: Seat, b: Seat) -> bool {
        let layout = self.instances.layout(a);
        layout.is_some() && layout == self.instances.layout(b)
    }

    /// True if what sits there may command the slot alone.
    fn is_trusted(&self, seat: Seat) -> bool {
        let program = self.instances.state(seat).program();
        !self.untrusted[seat.index()] && program.is_none_or(|program| program.is_trusted)
    }

    /// True if `seat` is taken by a process that is there or on the way, leaving included.
    #[must_use]
    pub fn is_taken(&self, seat: Seat) -> bool {
        *self.instances.state(seat) != InstanceState::Free
    }

    fn time(&mut self, now: Now, out: &mut Vec<Action>) {
        let due = |at_ns: u64| at_ns <= now.logical_ns;
        if self.ledger.outstanding.is_some_and(|outstanding| due(outstanding.until_ns)) {
            self.try_again(now, out);
        }
        if let Some(useless) = self.useless.take_if(|useless| due(useless.due_ns)) {
            self.clear_seat(now, useless, out);
        }
        if self.outgoing.is_some_and(|outgoing| due(outgoing.until_ns)) {
            self.send_fallback_away(now, out);
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
                self.commit(now, (new, old), true, out);
            }
            Phase::Flipping { new, order, ref mut ends_ns, .. } if due(*ends_ns) => {
                // Not confirmed until now, so that the window begins later.
                let least_ns = order.rollback_ns.max(self.instances.period_ns(new)).max(1);
                *ends_ns = now.logical_ns.saturating_add(least_ns);
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
