//! How long the processes of a flight stay without a launcher.

use crate::Flight;
use std::path::Path;

/// Longest time that the processes of a lockstep flight stay after their launcher's death: no launcher can
/// take it over \[s\].
pub const LOCKSTEP_GRACE_S: f64 = 2.0;

/// Wall time from the launcher's death on \[s\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Staying {
    /// Until then the vehicle hovers and another launcher can take the flight over.
    pub(crate) grace_s: f64,
    /// Then all leave: in realtime, once the vehicle has landed.
    pub(crate) leave_s: f64,
}

impl Staying {
    pub(crate) fn of(flight: &Flight) -> Self {
        if !flight.is_realtime() {
            let grace_s = flight.grace_s.min(LOCKSTEP_GRACE_S);
            return Self { grace_s, leave_s: grace_s };
        }
        // The vehicle hovers and lands in the time of the flight.
        let landing_s = if flight.grace_s > 0.0 { flight.landing_s } else { 0.0 };
        let by_the_wall = |s: f64| s / flight.speed;
        let grace_s = by_the_wall(flight.grace_s);
        Self { grace_s, leave_s: grace_s + by_the_wall(landing_s) }
    }

    /// As the launcher has noted it last in the run's folder.
    pub(crate) fn noted(folder: &Path, before: Self) -> Self {
        Flight::read(folder).map_or(before, |flight| Self::of(&flight))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flight::Clock;
    use crate::flight::tests::flight;

    fn staying(clock: Clock, speed: f64, grace_s: f64) -> [f64; 2] {
        let (mut flight, _, _) = flight();
        (flight.clock, flight.speed, flight.grace_s) = (clock, speed, grace_s);
        let staying = Staying::of(&flight);
        [staying.grace_s, staying.leave_s]
    }

    #[test]
    fn grace_and_landing_are_times_of_the_flight() {
        let realtime = |speed, grace_s| staying(Clock::Realtime, speed, grace_s);
        assert_eq!(realtime(1.0, 3.0), [3.0, 7.5]);
        assert_eq!(realtime(0.5, 3.0), [6.0, 15.0]);
        assert_eq!(realtime(4.0, 3.0), [0.75, 1.875]);
        assert_eq!(realtime(0.5, 0.0), [0.0, 0.0], "a flight without a grace is not landed");
        assert_eq!(staying(Clock::Lockstep, 0.5, 1.0), [1.0, 1.0]);
        assert_eq!(staying(Clock::Lockstep, 1.0, 30.0), [LOCKSTEP_GRACE_S, LOCKSTEP_GRACE_S]);
    }

    #[test]
    fn what_the_launcher_has_noted_last_counts_and_without_it_what_it_noted_first() {
        let folder = tempfile::TempDir::new().unwrap();
        let (mut flight, _, _) = flight();
        let known = Staying::of(&flight);
        assert_eq!(Staying::noted(folder.path(), known), known);
        flight.landing_s = 99.0;
        flight.write(folder.path()).unwrap();
        assert_eq!(Staying::noted(folder.path(), known), Staying::of(&flight));
    }
}
