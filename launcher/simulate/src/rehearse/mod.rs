//! Rehearses a swap candidate: `morphquad rehearse`, which the launcher also runs before a flip.
//!
//! [`RehearsalSpec`] names candidate, slot and initial [`Snapshot`]; [`rehearse`] derives a scenario per draw
//! (`derive.rs`), flies it in this process with the candidate and with the owner alone (`fly.rs`), and lets
//! the pure crate `rehearsal` judge the flights. [`watch`] takes the snapshot of a flight.

mod derive;
mod facts;
mod fly;
mod look;
mod trip;
pub mod watch;

pub use derive::Role;
pub use rehearsal::{RehearsalFigures, RehearsalRefusal, Snapshot, Verdict};

use observe::Observer;
use rehearsal::{Draw, Facts, Flown, Schedule, Track};
use scenario::candidate::name_of;
use scenario::{Override, Scenario};
use shared_types::Slot;
use swap::RehearsalSpec;

/// Logical time between two checks of whether to continue \[ns\].
const LOOK_EVERY_NS: u64 = 50_000_000;

/// A rehearsal before its first flight: everything that follows from the specification.
#[derive(Debug)]
pub struct Rehearsal {
    spec: RehearsalSpec,
    scenario: Scenario,
    facts: Facts,
    draws: [Draw; rehearsal::DRAWS],
    schedules: [Schedule; rehearsal::DRAWS],
}

/// The refusal of a rehearsal that was not flown, with its reason.
fn not_rehearsed(why: impl core::fmt::Display) -> Box<RehearsalRefusal> {
    Box::new(RehearsalRefusal::NotRehearsed { why: why.to_string() })
}

impl Rehearsal {
    /// Prepares the flights of a specification.
    ///
    /// # Errors
    /// [`RehearsalRefusal::NotRehearsed`] if the scenario cannot be read or has no such slot, or if the
    /// vehicle is not in a state from which a rehearsal can begin.
    pub fn prepare(spec: RehearsalSpec) -> Result<Self, Box<RehearsalRefusal>> {
        let mut edits = vec![Override::clock("lockstep")];
        for slot in Slot::ALL {
            let owner = spec.owners[slot].as_ref().map(|name| format!("{}={name}", slot.label()));
            let edit = owner.map(|owner| Override::controller(&owner)).transpose();
            edits.extend(edit.map_err(not_rehearsed)?);
        }
        let scenario = Scenario::from_text("the flight's scenario", &spec.scenario, &edits)
            .map_err(not_rehearsed)?;
        let snapshot = &spec.snapshot;
        if !snapshot.is_usable() {
            let why = "the estimate is not finite: swap when the estimator has recovered";
            return Err(not_rehearsed(why));
        }
        if !snapshot.commanded {
            let why =
                "the actuation guard holds the vehicle: swap when a controller commands again";
            return Err(not_rehearsed(why));
        }
        let facts = facts::of(&scenario, snapshot).map_err(not_rehearsed)?;
        let sweeps = facts::sweeps_ahead(&scenario, snapshot);
        let planned = facts::sweeps_planned(&scenario, snapshot);
        let (flip_s, end_s) =
            (derive::flip_s(&facts, spec.slot), scenario.settings().rehearsal.duration_s);
        let draws = rehearsal::draws(snapshot, spec.seed, spec.swap);
        let slot = spec.slot;
        let schedules =
            rehearsal::schedule(slot, &facts, snapshot, (&sweeps, &planned), (flip_s, end_s));
        Ok(Self { spec, scenario, facts, draws, schedules })
    }

    /// The derived scenario of flight number `draw`, which `morphquad run` can fly too.
    ///
    /// # Errors
    /// [`RehearsalRefusal::NotRehearsed`] if the derived scenario is not valid.
    ///
    /// # Panics
    /// If `draw` is not less than [`rehearsal::DRAWS`].
    pub fn scenario(&self, draw: usize, role: Role) -> Result<Scenario, Box<RehearsalRefusal>> {
        let none = Schedule::default();
        let schedule = if role == Role::Following { &none } else { &self.schedules[draw] };
        let draw = &self.draws[draw];
        derive::scenario(&self.spec, &self.scenario, &self.facts, (draw, schedule), role)
            .map_err(not_rehearsed)
    }

    /// Name of the controller that commands the slot now.
    #[must_use]
    pub fn owner(&self) -> String {
        if let Some((executable, _)) = &self.spec.owner {
            return name_of(executable).to_owned();
        }
        let assignment = scenario::services::Assignment::of(self.scenario.settings());
        assignment.name(self.spec.slot.role()).to_owned()
    }

    /// Flies all flights and compares candidate and owner. `go_on` is called every 50 ms of logical time and
    /// returns false when the time for the rehearsal is over.
    ///
    /// # Errors
    /// If the candidate is refused, or the flights could not be flown to their end.
    pub fn fly(
        &self,
        go_on: &mut dyn FnMut() -> bool,
    ) -> Result<RehearsalFigures, Box<RehearsalRefusal>> {
        self.fly_with(go_on, || ())
    }

    /// As [`fly`](Self::fly), with one more observer on each flight.
    ///
    /// # Errors
    /// As [`fly`](Self::fly).
    pub fn fly_with<E: Observer + Default>(
        &self,
        go_on: &mut dyn FnMut() -> bool,
        extra: impl Fn() -> E,
    ) -> Result<RehearsalFigures, Box<RehearsalRefusal>> {
        let slot = self.spec.slot;
        let tube = self.scenario.settings().rehearsal.tube();
        let mut flown: Vec<(Track, Track)> = Vec::with_capacity(self.draws.len());
        for draw in 0..self.draws.len() {
            let mut one = |role: Role| {
                let scenario = self.scenario(draw, role)?;
                fly::fly(&scenario, self.look(role), extra(), go_on)
            };
            let candidate = one(Role::Candidate)?;
            let owner = one(Role::Owner)?;
            flown.push((candidate, owner));
            let flights: Vec<Flown<'_>> = flown
                .iter()
                .enumerate()
                .map(|(draw, (candidate, owner))| Flown {
                    draw,
                    schedule: &self.schedules[draw],
                    candidate,
                    owner,
                })
                .collect();
            let judged = rehearsal::judge(slot, &self.facts, &tube, &flights);
            if judged.is_err() || draw + 1 == self.draws.len() {
                let figures = judged?;
                if self.spec.slot == Slot::Attitude && !self.facts.is_rig {
                    trip::fly_tripped(self, extra(), go_on)?;
                }
                return Ok(figures);
            }
        }
        Err(not_rehearsed("there is no start to fly from"))
    }

    fn look(&self, role: Role) -> look::Look {
        look::Look::new(self.spec.slot, &self.facts, role)
    }
}

/// Rehearses a swap and returns the verdict about the candidate, which holds the refusal if there is one.
#[must_use]
pub fn verdict(spec: RehearsalSpec, go_on: &mut dyn FnMut() -> bool) -> Verdict {
    let candidate = name_of(&spec.candidate).to_owned();
    match Rehearsal::prepare(spec) {
        Ok(rehearsal) => Verdict::of(&candidate, &rehearsal.owner(), rehearsal.fly(go_on)),
        Err(refusal) => Verdict::of(&candidate, "the owner", Err(refusal)),
    }
}

/// Rehearses a swap and returns the figures of a candidate that may fly.
///
/// # Errors
/// If the candidate may not fly, with the figures, or if it was not rehearsed.
pub fn rehearse(
    spec: RehearsalSpec,
    go_on: &mut dyn FnMut() -> bool,
) -> Result<RehearsalFigures, Box<RehearsalRefusal>> {
    Rehearsal::prepare(spec)?.fly(go_on)
}
