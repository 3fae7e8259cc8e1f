//! Has candidates rehearsed, and reports the verdicts to the swap protocol.

use super::{SlotContext, Slots};
use crate::orders::Executable;
use crate::{FlightError, RehearsalSpec};
use ::rehearsal::{RehearsalRefusal as Refused, Verdict};
use rehearsal::Measure;
use scenario::Scenario;
use scenario::candidate::Candidate;
use shared_types::Seat as Place;
use shared_types::{PerSlot, Slot};
use slot::Seat;
use slot::supervisor::{Event, RehearsalRefusal, Rehearsed};

/// The properties of the flight that every rehearsal needs.
#[derive(Debug, Clone)]
pub(super) struct Rehearsing {
    /// Text of the scenario.
    scenario: String,
    seed: u64,
    pub(super) is_enabled: bool,
    wall_max_s: f64,
    /// Number of rehearsals requested so far; each uses its own random streams.
    asked: u64,
}

/// A running rehearsal.
#[derive(Debug, Clone, Copy)]
pub(super) struct Underway {
    pub(super) seat: Seat,
    /// Instant of the snapshot \[ns\].
    from_ns: u64,
}

impl Rehearsing {
    pub(super) fn of(scenario: &Scenario) -> Self {
        let settings = scenario.settings();
        Self {
            scenario: scenario.to_toml().to_owned(),
            seed: settings.scenario.seed,
            is_enabled: settings.rehearsal.enabled,
            wall_max_s: settings.rehearsal.wall_max_s,
            asked: 0,
        }
    }
}

impl Slots {
    /// Starts to rehearse a candidate from the present state of the vehicle.
    pub(super) fn rehearse(
        &mut self,
        slot: Slot,
        seat: Seat,
        context: &mut SlotContext<'_>,
    ) -> Result<(), FlightError> {
        let from_ns = context.now.logical_ns;
        if let Some(state) = self.states.get_mut(&slot) {
            state.rehearsal = Some(Underway { seat, from_ns });
        }
        self.rehearsing.asked += 1;
        let place = Place { role: slot.role(), index: seat.into() };
        let begun = match self.rehearsal_of(slot, seat, from_ns, context) {
            Some(spec) => context.posts.rehearse(place, spec, self.rehearsing.wall_max_s),
            None => Err("the vehicle's state is not known yet: swap later".to_owned()),
        };
        match begun {
            Ok(()) => Ok(()),
            Err(why) => self.answer_rehearsal(
                slot,
                seat,
                Err(RehearsalRefusal::NotRehearsed(why)),
                false,
                context,
            ),
        }
    }

    /// Reports that a candidate is not rehearsed, at the user's request, although it differs from the owner.
    pub(super) fn skip_rehearsal(&mut self, slot: Slot) {
        let Some(report) = self.reports.last_mut() else { return };
        report.rehearsal = Some("skipped, as requested".to_owned());
        let text = format!("{} slot: {} is not rehearsed, as requested", slot.label(), report.to);
        self.add_news(text, true);
    }

    fn rehearsal_of(
        &self,
        slot: Slot,
        seat: Seat,
        at_ns: u64,
        context: &mut SlotContext<'_>,
    ) -> Option<RehearsalSpec> {
        let snapshot = context.posts.snapshot(at_ns)?;
        let executable = self.orders.seated_on(slot, seat)?;
        let candidate = name_of(executable);
        let owner_of = |slot: Slot| {
            let owner = self.machines.get(&slot)?.record()?.owner;
            self.orders.seated_on(slot, owner)
        };
        let built_in = |slot: Slot| {
            let executable = owner_of(slot).filter(|executable| executable.is_trusted())?;
            Some(executable.candidate.name().to_owned())
        };
        let owner = owner_of(slot).filter(|executable| !executable.is_trusted());
        Some(RehearsalSpec {
            scenario: self.rehearsing.scenario.clone(),
            snapshot,
            slot,
            owners: PerSlot::from_fn(built_in),
            owner: owner.map(|owner| (name_of(owner), owner.config.clone())),
            candidate,
            config: executable.config.clone(),
            seed: self.rehearsing.seed,
            swap: self.rehearsing.asked,
        })
    }

    /// Takes the verdicts that have arrived, and ends rehearsals whose candidate has been withdrawn.
    pub(super) fn take_rehearsals(
        &mut self,
        context: &mut SlotContext<'_>,
    ) -> Result<(), FlightError> {
        for (place, verdict) in context.posts.take_rehearsed() {
            let (Some(slot), Some(seat)) = (self.slot_of(place.role), Seat::new(place.index))
            else {
                continue;
            };
            let left_tube = has_left_tube(&verdict, context);
            let course = verdict.refusal.as_ref().map_or(&[][..], Refused::course);
            if !course.is_empty() {
                self.orders.show_failure(slot, course.to_vec());
            }
            let verdict = match verdict.refusal {
                None => Ok(verdict.message),
                Some(Refused::NotRehearsed { why }) => Err(RehearsalRefusal::NotRehearsed(why)),
                Some(refusal) => Err(RehearsalRefusal::Fails(format!("it {refusal}"))),
            };
            self.answer_rehearsal(slot, seat, verdict, left_tube, context)?;
        }
        for slot in Slot::ALL {
            let candidate = self.machines.get(&slot).and_then(slot::SlotMachine::candidate);
            let Some(state) = self.states.get_mut(&slot) else { continue };
            if let Some(gone) = state.rehearsal.take_if(|it| Some(it.seat) != candidate) {
                context.posts.end_rehearsal(Place { role: slot.role(), index: gone.seat.into() });
            }
        }
        Ok(())
    }

    fn answer_rehearsal(
        &mut self,
        slot: Slot,
        seat: Seat,
        verdict: Result<String, RehearsalRefusal>,
        left_tube: bool,
        context: &mut SlotContext<'_>,
    ) -> Result<(), FlightError> {
        let state = self.states.get_mut(&slot);
        let underway = state.and_then(|state| state.rehearsal.take_if(|it| it.seat == seat));
        let Some(Underway { from_ns, .. }) = underway else { return Ok(()) };
        self.feed(slot, Event::Rehearsed(seat, Rehearsed { from_ns, left_tube, verdict }), context)
    }
}

/// True if the vehicle is now further from its reference than the tube allows, so that the rehearsal, which
/// began closer to the reference, no longer applies to it.
fn has_left_tube(verdict: &Verdict, context: &SlotContext<'_>) -> bool {
    let Some(figures) = &verdict.figures else { return false };
    let limits = figures.figures.iter().filter(|f| f.measure == Measure::PositionPeak);
    let Some(limit_m) = limits.map(|figure| figure.limit).reduce(f64::max) else {
        return false;
    };
    context.posts.tracking_error_m(context.now.logical_ns).is_some_and(|error_m| error_m > limit_m)
}

/// Name or path of a controller, in the form that a request for a swap uses.
fn name_of(executable: &Executable) -> String {
    match &executable.candidate {
        Candidate::Service(name) => (*name).to_owned(),
        Candidate::Executable(path) => path.display().to_string(),
    }
}
