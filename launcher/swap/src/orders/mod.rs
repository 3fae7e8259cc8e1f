//! From requests to the slots' state machines, and from their reports back to the client that asked.
//!
//! Instances are called `NAME@SEAT`: `attitude-mpc@0`. A bare name asks for a new instance where one
//! is to be started, and for the only one that can be meant where one is to leave.

use protocol::control::protocol::{Reason, Refusal, Reply, Request, SwapRequest};
use protocol::control::server::Answer;
use scenario::candidate::{Candidate, NoCandidate};
use shared_types::Slot;
use slot::{Action, Outcome, Program, Report, Seat, Target};
use std::collections::BTreeMap;
use std::fs::File;
use std::path::PathBuf;

mod messages;
#[cfg(test)]
mod tests;

/// The longest window that can be asked for \[ns\].
const MAX_WINDOW_NS: u64 = 3_600_000_000_000;
/// The largest bump that can be allowed, over the largest command.
const MAX_BUMP: f64 = 2.0;

/// What a process is started from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Executable {
    /// Service or path.
    pub candidate: Candidate,
    /// Scenario that configures it, if not the flight's.
    pub config: Option<PathBuf>,
    /// Hash of the files, as they are when it is asked for: after another build, or with other gains,
    /// the same path is another controller. `None` for a service with the flight's own settings.
    pub build: Option<blake3::Hash>,
}

impl Executable {
    /// `candidate` as its files are now; one that cannot be read any more cannot be started either,
    /// and that is reported then.
    #[must_use]
    pub fn new(candidate: Candidate, config: Option<PathBuf>) -> Self {
        let executable = match &candidate {
            Candidate::Service(_) => None,
            Candidate::Executable(path) => Some(path),
        };
        let mut hasher = blake3::Hasher::new();
        let files = executable.into_iter().chain(&config);
        let count = files
            .map(|path| File::open(path).and_then(|file| hasher.update_reader(file).map(|_| ())))
            .count();
        let build = (count > 0).then(|| hasher.finalize());
        Self { candidate, config, build }
    }

    /// Compiled into this executable.
    #[must_use]
    pub fn is_built_in(&self) -> bool {
        matches!(self.candidate, Candidate::Service(_))
    }

    /// Compiled in, with the settings of the flight: a user's gains make another controller of it.
    #[must_use]
    pub fn is_trusted(&self) -> bool {
        self.is_built_in() && self.config.is_none()
    }
}

/// A request that makes sense.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ordered {
    /// Slot that it is about.
    pub slot: Slot,
    /// For the slot's state machine.
    pub request: slot::Request,
    /// Largest bump that the gate may allow, over the largest command; what suits the kind if `None`.
    pub max_bump: Option<f64>,
    /// It was asked for without the rehearsal that it would have had.
    pub skips_rehearsal: bool,
}

/// The slots of a flight.
pub type Machines = BTreeMap<Slot, slot::SlotMachine>;

/// What ends an order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Until {
    /// The end of what goes on at this seat.
    Seat(Seat),
    /// The departure of the process that sits there.
    Retired(Seat),
    /// The old owner's return.
    RolledBack,
}

/// A client that waits for the end of an order.
#[derive(Debug)]
struct Open {
    slot: Slot,
    until: Until,
    answer: Answer,
}

/// The orders of a flight.
#[derive(Debug, Default)]
pub struct Orders {
    programs: Vec<Executable>,
    seats: BTreeMap<(Slot, Seat), Program>,
    /// What is known of the end of the process that sat there last, for the client that asked for it.
    ends: BTreeMap<(Slot, Seat), String>,
    /// A candidate that differs from the owner is flown ahead unless the request asks otherwise.
    rehearses: bool,
    /// No executable of a user can take part.
    services_only: bool,
    open: Vec<Open>,
}

impl Orders {
    /// Has candidates flown ahead that differ from the owner, or not, unless a request asks otherwise.
    pub fn set_rehearses(&mut self, rehearses: bool) {
        self.rehearses = rehearses;
    }

    /// Refuses executables of users, or not.
    pub fn set_services_only(&mut self, services_only: bool) {
        self.services_only = services_only;
    }

    /// The number under which state machines know an executable.
    pub fn program(&mut self, executable: Executable) -> Program {
        let known = self.programs.iter().position(|known| *known == executable);
        let index = known.unwrap_or_else(|| {
            self.programs.push(executable);
            self.programs.len() - 1
        });
        let is_trusted = self.programs.get(index).is_some_and(Executable::is_trusted);
        Program { number: u32::try_from(index).unwrap_or(u32::MAX), is_trusted }
    }

    /// What a number stands for.
    #[must_use]
    pub fn executable(&self, program: Program) -> Option<&Executable> {
        self.programs.get(usize::try_from(program.number).ok()?)
    }

    /// Remembers what flies, or flew last, on a seat.
    pub fn seat(&mut self, slot: Slot, seat: Seat, program: Program) {
        self.seats.insert((slot, seat), program);
        self.ends.remove(&(slot, seat));
    }

    /// Keeps how the process on a seat has ended, with what it printed, for the answer to the client that
    /// asked for it.
    pub fn explain(&mut self, slot: Slot, seat: Seat, how: &str) {
        self.ends.insert((slot, seat), how.trim_end().to_owned());
    }

    /// How the process on a seat has ended and its last line, in one line; none if nothing is known of it.
    #[must_use]
    pub fn end_of(&self, slot: Slot, seat: Seat) -> Option<String> {
        let mut lines = self.ends.get(&(slot, seat))?.lines();
        let how = lines.next()?;
        Some(match lines.map(str::trim).rfind(|line| !line.is_empty()) {
            Some(last) => format!("{how} {last}"),
            None => how.to_owned(),
        })
    }

    /// `NAME@SEAT`.
    #[must_use]
    pub fn name(&self, slot: Slot, seat: Seat) -> String {
        format!("{}@{}", self.program_name(slot, seat), seat.index())
    }

    /// What flies, or flew last, on a seat.
    #[must_use]
    pub fn seated_on(&self, slot: Slot, seat: Seat) -> Option<&Executable> {
        self.executable(*self.seats.get(&(slot, seat))?)
    }

    fn program_name(&self, slot: Slot, seat: Seat) -> &str {
        let program = self.seats.get(&(slot, seat));
        let executable = program.and_then(|program| self.executable(*program));
        executable.map_or(slot.label(), |executable| executable.candidate.name())
    }

    /// What a request means in this flight.
    ///
    /// # Errors
    /// No such slot, controller or instance, or a value out of range.
    pub fn understand(
        &mut self,
        request: &Request,
        machines: &Machines,
    ) -> Result<Option<Ordered>, Refusal> {
        let mut skips_rehearsal = false;
        let (slot, request, max_bump) = match request {
            Request::Ps | Request::Stop | Request::Order { .. } => return Ok(None),
            Request::Swap(order) => {
                let slot = known_slot(&order.slot, machines)?;
                check(order)?;
                let target = match self.seated(slot, &order.to, machines)? {
                    Some(seat) => Target::Seated(seat),
                    None => Target::New(self.find(slot, &order.to, order.config.clone())?),
                };
                let SwapRequest { shadow_ns, rollback_ns, force, dry_run, .. } = *order;
                let program = match target {
                    Target::New(program) => Some(program),
                    Target::Seated(seat) => self.seats.get(&(slot, seat)).copied(),
                };
                let must = || self.must_rehearse(slot, program, machines);
                let rehearse = order.rehearse.unwrap_or_else(must);
                skips_rehearsal = !rehearse && must();
                let how = slot::SwapTerms { shadow_ns, rollback_ns, force, rehearse, dry_run };
                (slot, slot::Request::Swap(target, how), order.max_bump)
            }
            Request::Rollback { slot } => {
                (known_slot(slot, machines)?, slot::Request::Rollback, None)
            }
            Request::Retire { name } => {
                let (slot, seat) = self.leaver(name, machines)?;
                (slot, slot::Request::Retire(seat), None)
            }
            Request::Standby { slot, name, shadow_ns, rehearse } => {
                let slot = known_slot(slot, machines)?;
                check_window("shadow", *shadow_ns)?;
                let program = self.find(slot, name, None)?;
                let must = || self.must_rehearse(slot, Some(program), machines);
                let rehearse = rehearse.unwrap_or_else(must);
                (slot, slot::Request::Standby(program, *shadow_ns, rehearse), None)
            }
        };
        Ok(Some(Ordered { slot, request, max_bump, skips_rehearsal }))
    }

    /// True if a program has to be flown ahead: it is of another kind or build than the one that
    /// commands, or that cannot be known. Programs that have the same files have the same number.
    fn must_rehearse(&self, slot: Slot, program: Option<Program>, machines: &Machines) -> bool {
        if !self.rehearses {
            return false;
        }
        let owner = machines.get(&slot).and_then(|machine| machine.record()).map(|r| r.owner);
        let owner = owner.and_then(|seat| self.seats.get(&(slot, seat)));
        owner.is_none() || owner != program.as_ref()
    }

    fn find(&mut self, slot: Slot, to: &str, config: Option<PathBuf>) -> Result<Program, Refusal> {
        let candidate = Candidate::find(slot, to).map_err(|NoCandidate { what, remedy }| {
            Refusal::new(Reason::UnknownName, format!("{what}; {remedy}"))
        })?;
        if let Some(path) = config.as_deref().filter(|path| !path.is_file()) {
            let text = format!("{} is not a file: give the path of a scenario", path.display());
            return Err(Refusal::new(Reason::BadRequest, text));
        }
        let executable = Executable::new(candidate, config);
        if self.services_only && !executable.is_built_in() {
            let text = format!(
                "{to} is a process of its own, which takes no turns in a flight by [[timing]]: order a service of morphquad"
            );
            return Err(Refusal::new(Reason::NoSense, text));
        }
        Ok(self.program(executable))
    }

    /// The seat that `NAME@SEAT` names; `None` for a name without a seat.
    fn seated(&self, slot: Slot, name: &str, machines: &Machines) -> Result<Option<Seat>, Refusal> {
        // A path may hold the sign too.
        let named = split(name).filter(|_| !name.contains('/'));
        let Some((program, seat)) = named else { return Ok(None) };
        let taken = |seat: &Seat| machines.get(&slot).is_some_and(|m| m.is_taken(*seat));
        let seat = Seat::new(seat).filter(taken);
        match seat.filter(|seat| self.program_name(slot, *seat) == program) {
            Some(seat) => Ok(Some(seat)),
            None => Err(self.no_such_name(name, machines)),
        }
    }

    /// What is to leave: the instance that bears the whole name, or the only one but owners that bears
    /// its beginning.
    fn leaver(&self, name: &str, machines: &Machines) -> Result<(Slot, Seat), Refusal> {
        let of_name = |&(slot, seat): &(Slot, Seat)| {
            name == self.name(slot, seat) || name == self.program_name(slot, seat)
        };
        let meant: Vec<_> = taken(machines).filter(of_name).collect();
        let owner = |slot: &Slot| machines.get(slot).and_then(|m| m.record()).map(|r| r.owner);
        let others = meant.iter().filter(|(slot, seat)| owner(slot) != Some(*seat));
        let others: Vec<_> = others.copied().collect();
        match (&others[..], &meant[..]) {
            ([only], _) | ([], [only]) => Ok(*only),
            ([], _) => Err(self.no_such_name(name, machines)),
            _ => {
                let names = others.iter().map(|(slot, seat)| self.name(*slot, *seat));
                let text = format!(
                    "{name} can be any of {}: name one",
                    names.collect::<Vec<_>>().join(", ")
                );
                Err(Refusal::new(Reason::UnknownName, text))
            }
        }
    }

    fn no_such_name(&self, name: &str, machines: &Machines) -> Refusal {
        let names: Vec<_> = taken(machines).map(|(slot, seat)| self.name(slot, seat)).collect();
        if names.is_empty() {
            return nothing_to_order();
        }
        let text = format!("no instance is called {name}; there are {}", names.join(", "));
        Refusal::new(Reason::UnknownName, text)
    }

    /// Answers a request that its state machine has taken in: refused, or under way. Call before the
    /// `actions` that came of it are carried out.
    pub fn follow(
        &mut self,
        ordered: &Ordered,
        machines: &Machines,
        actions: &[Action],
        answer: Answer,
    ) {
        let slot = ordered.slot;
        let refused = actions.iter().find_map(|action| match action {
            Action::Report(Report::Refused(reason)) => Some(reason),
            _ => None,
        });
        if let Some(reason) = refused {
            return answer.send(Reply::Refused(self.refusal(slot, reason)));
        }
        let candidate = machines.get(&slot).and_then(slot::SlotMachine::candidate);
        let until = match (ordered.request, candidate) {
            (slot::Request::Retire(seat), _) => Until::Retired(seat),
            (slot::Request::Rollback, _) | (_, None) => Until::RolledBack,
            (_, Some(seat)) => Until::Seat(seat),
        };
        answer.send(Reply::Progress(messages::accepted(slot)));
        self.open.push(Open { slot, until, answer });
    }

    fn refusal(&self, slot: Slot, reason: &slot::Reason) -> Refusal {
        let text = messages::with_names(&reason.to_string(), |seat| self.name(slot, seat));
        Refusal {
            reason: Reason::of(reason),
            exit_code: reason.exit_code(),
            text: format!("{} slot: {text}", slot.label()),
        }
    }

    /// Shows the clients that asked how a candidate that was flown ahead has failed.
    pub(crate) fn show_failure(&self, slot: Slot, course: Vec<[f64; 8]>) {
        let reply = Reply::Progress(messages::failed(slot, course));
        for open in self.open.iter().filter(|open| open.slot == slot) {
            open.answer.send(reply.clone());
        }
    }

    /// Sends a report to the clients that it concerns, and returns the sentence for the record of the flight.
    pub fn notify(&mut self, slot: Slot, report: &Report) -> String {
        let name = |seat: Seat| self.name(slot, seat);
        match report {
            Report::Refused(reason) => self.refusal(slot, reason).text,
            Report::Step(step) => {
                let progress = messages::progress(slot, step, name);
                let text = progress.text.clone();
                let reply = Reply::Progress(progress);
                for open in self.open.iter().filter(|open| open.slot == slot) {
                    open.answer.send(reply.clone());
                }
                text
            }
            Report::Done(seat, outcome) => {
                let done = messages::done(slot, *outcome, &name(*seat));
                let text = done.text.clone();
                self.close(slot, &Reply::Done(done), |until| match outcome {
                    Outcome::RolledBack => until == Until::RolledBack,
                    Outcome::Retired => until == Until::Retired(*seat),
                    _ => until == Until::Seat(*seat),
                });
                text
            }
            Report::Aborted(seat, reason) => {
                let mut refusal = self.refusal(slot, reason);
                refusal.text = format!("{} is removed: {}", name(*seat), refusal.text);
                let mut text = refusal.text.clone();
                if let (slot::Reason::Fault(fault), Some(how)) =
                    (reason, self.ends.get(&(slot, *seat)))
                {
                    refusal.text = format!("{text}: {how}");
                    // All that a process printed was reported when it died; of one that is killed nothing was.
                    text = match fault {
                        slot::Fault::Died => {
                            format!("{text}: {}", self.end_of(slot, *seat).unwrap_or_default())
                        }
                        _ => refusal.text.clone(),
                    };
                }
                let asked_back = *reason == slot::Reason::RolledBack;
                self.close(slot, &Reply::Refused(refusal), |until| match until {
                    Until::Seat(of) => of == *seat,
                    Until::Retired(_) => false,
                    Until::RolledBack => !asked_back,
                });
                text
            }
        }
    }

    fn close(&mut self, slot: Slot, reply: &Reply, is_over: impl Fn(Until) -> bool) {
        self.open.retain(|open| {
            let over = open.slot == slot && is_over(open.until);
            if over {
                open.answer.send(reply.clone());
            }
            !over
        });
    }
}

fn taken(machines: &Machines) -> impl Iterator<Item = (Slot, Seat)> + '_ {
    machines.iter().flat_map(|(slot, machine)| {
        Seat::ALL.into_iter().filter(|seat| machine.is_taken(*seat)).map(|seat| (*slot, seat))
    })
}

/// From `NAME@SEAT` to its parts.
fn split(name: &str) -> Option<(&str, u32)> {
    let (program, seat) = name.rsplit_once('@')?;
    Some((program, seat.parse().ok()?))
}

fn known_slot(name: &str, machines: &Machines) -> Result<Slot, Refusal> {
    let flown: Vec<&str> = machines.keys().map(|slot| slot.label()).collect();
    Slot::named(name).filter(|slot| machines.contains_key(slot)).ok_or_else(|| {
        if flown.is_empty() {
            return nothing_to_order();
        }
        let remedy = document::suggestion(name, flown.into_iter());
        Refusal::new(Reason::UnknownSlot, format!("this flight has no slot {name}; {remedy}"))
    })
}

fn nothing_to_order() -> Refusal {
    Refusal::new(Reason::UnknownSlot, "no slot of this flight can change hands")
}

fn check(order: &SwapRequest) -> Result<(), Refusal> {
    check_window("shadow", order.shadow_ns)?;
    check_window("rollback", order.rollback_ns)?;
    match order.max_bump {
        Some(bump) if !(0.0..=MAX_BUMP).contains(&bump) => {
            let text = format!("max_bump {bump} is none: give a share from 0 to {MAX_BUMP}");
            Err(Refusal::new(Reason::BadRequest, text))
        }
        _ => Ok(()),
    }
}

fn check_window(name: &str, window_ns: u64) -> Result<(), Refusal> {
    if window_ns <= MAX_WINDOW_NS {
        return Ok(());
    }
    let text = format!("{name} {} s is too long: at most an hour", window_ns / 1_000_000_000);
    Err(Refusal::new(Reason::BadRequest, text))
}
