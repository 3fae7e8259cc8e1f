//! How long the processes of a flight stay without a launcher.

use crate::Flight;
use std::path::Path;

/// Longest time that the processes of a lockstep flight stay after their launcher's death: no launcher can
/// take it over \[s\].
pub const LOCKSTEP_GRACE_S: f64 = 2.0;

/// Wall time from the launcher's death on \[s\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Staying {
    /// Until then the flight goes on, for another launcher to take it over. Then the pilot leaves.
    pub(crate) grace_s: f64,
    /// Then all others leave: in realtime, once the vehicle has landed.
    pub(crate) leave_s: f64,
}

impl Staying {
    pub(crate) fn of(flight: &Flight) -> Self {
        if !flight.is_realtime() {
            let grace_s = flight.grace_s.min(LOCKSTEP_GRACE_S);
            return Self { grace_s, leave_s: grace_s };
        }
        // The vehicle flies and lands in the time of the flight.
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

    fn staying(clock: Clock, speed: f64, grace_s: f64) -> Staying {
        let (mut flight, _, _) = flight();
        (flight.clock, flight.speed, flight.grace_s) = (clock, speed, grace_s);
        Staying::of(&flight)
    }

    #[test]
    fn grace_and_landing_are_times_of_the_flight() {
        let realtime = |speed, grace_s| staying(Clock::Realtime, speed, grace_s);
        assert_eq!(realtime(1.0, 3.0), Staying { grace_s: 3.0, leave_s: 7.5 });
        assert_eq!(realtime(0.5, 3.0), Staying { grace_s: 6.0, leave_s: 15.0 });
        assert_eq!(realtime(4.0, 3.0), Staying { grace_s: 0.75, leave_s: 1.875 });
        let at_once = Staying { grace_s: 0.0, leave_s: 0.0 };
        assert_eq!(realtime(0.5, 0.0), at_once, "a flight without a grace is not landed");
        let lockstep = |grace_s| staying(Clock::Lockstep, 0.5, grace_s);
        assert_eq!(lockstep(1.0), Staying { grace_s: 1.0, leave_s: 1.0 });
        let longest = Staying { grace_s: LOCKSTEP_GRACE_S, leave_s: LOCKSTEP_GRACE_S };
        assert_eq!(lockstep(30.0), longest);
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
