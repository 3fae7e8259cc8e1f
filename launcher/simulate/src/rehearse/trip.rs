//! A rehearsed flight in which the owner of the position slot trips: the candidate for the attitude slot, which
//! consumes its set points, has to follow the fallback from then on.

use super::derive::Role;
use super::{Rehearsal, fly, not_rehearsed};
use crate::in_process::{InProcess, StateSource};
use monitor::reports::FOLLOWED_WITHIN_NS;
use observe::Observer;
use rehearsal::RehearsalRefusal;
use scenario::candidate::name_of;
use shared_types::time::s_from_ns;
use shared_types::{
    AppliedSetpoint, AttitudeSetpoint, NO_SEAT, OwnerRecord, Role as LoopRole, Sample, Slot, Topic,
    Trip,
};
use std::any::Any;

/// Seat of a controller that is swapped in, in either slot; the owner has seat 0.
const SWAPPED_SEAT: u32 = 1;

/// Makes the new owner of the position slot ask for more thrust than a law may, and sees what becomes of the trip.
#[derive(Debug, Default)]
struct Tripping {
    /// Thrust that trips \[N\].
    thrust_n: f64,
    /// From when on the new owner commands \[ns\].
    owner_from_ns: Option<u64>,
    /// When its trip takes effect \[ns\].
    tripped_ns: Option<u64>,
    /// Releases of the candidate since then, and which seat it followed in each \[ns\].
    followed: Vec<(u64, u32)>,
}

impl Observer for Tripping {
    fn observe<T: Sample>(&mut self, _topic: &'static Topic<T>, sample: &T) {
        let any: &dyn Any = sample;
        if let Some(record) = any.downcast_ref::<OwnerRecord>() {
            if record.slot == LoopRole::Position && record.owner == SWAPPED_SEAT {
                self.owner_from_ns.get_or_insert(record.header.valid_ns);
            }
        } else if let Some(trip) = any.downcast_ref::<Trip>() {
            if trip.slot == LoopRole::Position {
                self.tripped_ns.get_or_insert(trip.header.valid_ns);
            }
        } else if let Some(applied) = any.downcast_ref::<AppliedSetpoint>()
            && applied.header.seat == SWAPPED_SEAT
            && self.tripped_ns.is_some()
        {
            // The backup law in place of an owner that has tripped follows no seat.
            let flies_by_itself = applied.tripped.is_set() && applied.setpoint_sequence == 0;
            let followed = if flies_by_itself { NO_SEAT } else { applied.seat };
            self.followed.push((applied.header.release_ns, followed));
        }
    }

    fn alter<T: Sample>(&mut self, _topic: &'static Topic<T>, sample: &mut T) {
        let any: &mut dyn Any = sample;
        if let Some(asked) = any.downcast_mut::<AttitudeSetpoint>()
            && asked.header.seat == SWAPPED_SEAT
            && self.owner_from_ns.is_some_and(|from_ns| asked.header.valid_ns >= from_ns)
        {
            asked.thrust_n = self.thrust_n;
        }
    }
}

impl Tripping {
    /// The candidate's steps more than `within_ns` after the trip: how long after it \[ns\], and which seat it follows.
    fn since(&self, within_ns: u64) -> impl Iterator<Item = (u64, u32)> {
        let tripped_ns = self.tripped_ns.unwrap_or(u64::MAX);
        let since =
            move |(release_ns, seat): &(u64, u32)| (release_ns.saturating_sub(tripped_ns), *seat);
        self.followed.iter().map(since).filter(move |(after_ns, _)| *after_ns > within_ns)
    }

    /// The first step in which it still follows the owner that has tripped; if there is none, that in which it
    /// follows the fallback or nothing more than `levels_ns` later.
    fn due(&self, within_ns: u64, levels_ns: u64) -> Option<(u64, u32)> {
        let ignores = self.since(within_ns).find(|(_, seat)| *seat == SWAPPED_SEAT);
        ignores.or_else(|| self.since(within_ns.saturating_add(levels_ns)).next())
    }
}

/// Flies the candidate of a rehearsal while the owner of the position slot trips.
///
/// # Errors
/// If the candidate goes on following the owner that has tripped, or could not be flown.
pub(super) fn fly_tripped<E: Observer>(
    rehearsal: &Rehearsal,
    extra: E,
    go_on: &mut dyn FnMut() -> bool,
) -> Result<(), Box<RehearsalRefusal>> {
    let scenario = rehearsal.scenario(0, Role::Following)?;
    let facts = &rehearsal.facts;
    let [_, limit_weights] = scenario.settings().monitor_limits().setpoint_thrust_weights;
    let thrust_n = 2.0 * limit_weights * facts.vehicle.weight_n();
    let observer = (Tripping { thrust_n, ..Tripping::default() }, extra);
    let mut flight =
        InProcess::new(&scenario, StateSource::Estimator, observer).map_err(fly::not_flown)?;
    fly::to_the_end(&mut flight, scenario.duration_ns(), |_| false, go_on)?;
    let failed = |why: &str| Box::new(RehearsalRefusal::Failed { why: why.trim_end().to_owned() });
    let candidate = name_of(&rehearsal.spec.candidate);
    let exits = flight.conclude().exits;
    if let Some(exit) = exits.iter().find(|exit| exit.name == candidate) {
        return Err(failed(&exit.to_string()));
    }
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "positive")]
    let two_periods_ns = (2e9 * facts.period_s[Slot::Attitude]).ceil() as u64;
    let within_ns = FOLLOWED_WITHIN_NS.max(two_periods_ns);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "positive")]
    let levels_ns = (2e9 * facts.period_s[Slot::Position]).ceil() as u64;
    let (has_tripped, due) = flight
        .seen(|(tripping, _)| (tripping.tripped_ns.is_some(), tripping.due(within_ns, levels_ns)));
    match due {
        Some((after_ns, SWAPPED_SEAT)) => Err(Box::new(RehearsalRefusal::TripIgnored {
            after_s: s_from_ns(after_ns),
            limit_s: s_from_ns(within_ns),
        })),
        Some((_, NO_SEAT)) => {
            Err(failed("it does not follow the fallback after a position controller had tripped"))
        }
        Some(_) => Ok(()),
        None if has_tripped => {
            Err(failed("it reported nothing more after a position controller had tripped"))
        }
        None => Err(not_rehearsed("the position controller that was to trip has not")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;
    const FALLBACK_SEAT: u32 = 0;

    /// What is due of a candidate that followed these seats so many milliseconds after the trip: within 20 ms it may
    /// follow any seat, and for 40 ms more none.
    fn due(followed: &[(u64, u32)]) -> Option<(u64, u32)> {
        let followed = followed.iter().map(|(ms, seat)| (1000 * MS + ms * MS, *seat)).collect();
        let tripping = Tripping { tripped_ns: Some(1000 * MS), followed, ..Tripping::default() };
        tripping.due(20 * MS, 40 * MS).map(|(after_ns, seat)| (after_ns / MS, seat))
    }

    #[test]
    fn a_candidate_has_to_leave_a_tripped_owner_and_to_follow_its_fallback() {
        let leaves = [(10, SWAPPED_SEAT), (30, NO_SEAT), (60, NO_SEAT)];
        let with = |next: &[(u64, u32)]| due(&[&leaves[..], next].concat());
        assert_eq!(with(&[(70, FALLBACK_SEAT), (80, NO_SEAT)]), Some((70, FALLBACK_SEAT)));
        assert_eq!(with(&[(70, NO_SEAT), (80, FALLBACK_SEAT)]), Some((70, NO_SEAT)));
        assert_eq!(with(&[]), None, "it says nothing more");
        // However late, and whichever seat it follows in between.
        assert_eq!(with(&[(70, FALLBACK_SEAT), (80, SWAPPED_SEAT)]), Some((80, SWAPPED_SEAT)));
        assert_eq!(due(&[(30, SWAPPED_SEAT), (70, FALLBACK_SEAT)]), Some((30, SWAPPED_SEAT)));
        assert_eq!(due(&[(70, FALLBACK_SEAT)]), Some((70, FALLBACK_SEAT)), "at once");
    }
}
