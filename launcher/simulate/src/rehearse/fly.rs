//! Flies one derived scenario in this process.

use super::look::Look;
use super::{LOOK_EVERY_NS, not_rehearsed};
use crate::in_process::{InProcess, InProcessError, StateSource};
use observe::Observer;
use rehearsal::{RehearsalRefusal, Track};
use scenario::Scenario;
use shared_types::time::s_from_ns;

/// Flies to the end, or until the vehicle is lost and the rest of the flight shows nothing more.
pub(super) fn fly<E: Observer + Default>(
    scenario: &Scenario,
    look: Look,
    extra: E,
    go_on: &mut dyn FnMut() -> bool,
) -> Result<Track, Box<RehearsalRefusal>> {
    let mut flight =
        InProcess::new(scenario, StateSource::Estimator, (look, extra)).map_err(not_flown)?;
    let is_over = |(look, _): &mut (Look, E)| look.is_over;
    to_the_end(&mut flight, scenario.duration_ns(), is_over, go_on)?;
    let exits = flight.conclude().exits;
    let (look, _) = flight.seen(core::mem::take);
    if let Some(exit) = exits.first().filter(|_| look.has_candidate()) {
        // A candidate that was started again may have flown on, but it would fail in the real flight too.
        let why = exit.to_string();
        return Err(Box::new(RehearsalRefusal::Failed { why: why.trim_end().to_owned() }));
    }
    if !look.flipped {
        let why = look.warning.unwrap_or_else(|| "it did not take over in time".to_owned());
        return Err(Box::new(RehearsalRefusal::Failed { why }));
    }
    Ok(look.track)
}

/// Flies to the end \[ns\], or until it is over before, unless the time for the rehearsal is.
pub(super) fn to_the_end<O: Observer>(
    flight: &mut InProcess<O>,
    end_ns: u64,
    is_over: impl Fn(&mut O) -> bool,
    go_on: &mut dyn FnMut() -> bool,
) -> Result<(), Box<RehearsalRefusal>> {
    let mut t_ns = 0;
    while t_ns < end_ns {
        t_ns += LOOK_EVERY_NS;
        flight.fly_until(if t_ns >= end_ns { u64::MAX } else { t_ns }).map_err(not_flown)?;
        if flight.seen(&is_over) {
            break;
        }
        if !go_on() {
            return Err(not_rehearsed(out_of_time(t_ns, end_ns)));
        }
    }
    Ok(())
}

/// Why a flight was not flown to its end.
fn out_of_time(flown_ns: u64, end_ns: u64) -> String {
    format!(
        "the time for it was over after {:.2} s of a flight of {:.2} s: raise rehearsal.wall_max_s, or swap when the machine has time",
        s_from_ns(flown_ns),
        s_from_ns(end_ns)
    )
}

/// Classifies an error. A component that fails must be the candidate, because all others already run in the
/// real flight.
pub(super) fn not_flown(error: InProcessError) -> Box<RehearsalRefusal> {
    match error {
        InProcessError::Component { .. } | InProcessError::Panicked { .. } => {
            Box::new(RehearsalRefusal::Failed { why: error.to_string() })
        }
        error => not_rehearsed(error),
    }
}
