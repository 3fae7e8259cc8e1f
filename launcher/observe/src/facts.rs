//! The facts of a flight: one table, from which every output takes those that it shows.

use super::metrics::Metrics;
use serde_json::{Map, Value};
use verdict::{Outcome, Unit};

/// Part of a report.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// Where the vehicle was.
    Flight,
    /// What was asked of the rotors, and how it was found.
    Constraints,
    /// When things were done, and by which command.
    Timing,
}

/// A number that is reported about a flight.
#[derive(Debug, Clone, Copy)]
pub struct Fact {
    /// Part of a report that it belongs to.
    pub part: Part,
    /// Name for machines: in the summary of a recording, in the JSON of a flight and of a report, as the column of a
    /// campaign.
    pub key: &'static str,
    /// Name for people.
    pub name: &'static str,
    /// Unit of the number, which for a share is 1.
    pub unit: Unit,
    /// Key of the check that judges it, if one does.
    pub check: Option<&'static str>,
    measure: fn(&Metrics, &Outcome) -> Option<f64>,
}

macro_rules! facts {
    ($($part:ident $key:literal, $name:literal, $unit:ident $([$check:literal])? =>
        |$metrics:ident, $outcome:ident| $measure:expr;)*) => {
        &[$(Fact {
            part: Part::$part,
            key: $key,
            name: $name,
            unit: Unit::$unit,
            check: [$(Some($check),)? None][0],
            measure: |$metrics, $outcome| $measure,
        }),*]
    };
}

/// Every fact, in the order reported.
pub const FACTS: &[Fact] = facts! {
    Flight "flown_s", "flown", Second => |_m, o| Some(o.flown_s);
    Flight "position_rms_m", "tracking error, rms", Metre => |m, _o| m.tracked().map(|t| t.rms_m);
    Flight "position_max_m", "tracking error, largest", Metre => |m, _o| m.tracked().map(|t| t.max_m);
    Flight "tracking_rms_m", "tracking error outside recoveries, rms", Metre ["tracking_rms_max_m"] =>
        |_m, o| o.tracking.map(|t| t.rms_m);
    Flight "tracking_max_m", "tracking error outside recoveries, largest", Metre ["tracking_max_m"] =>
        |_m, o| o.tracking.map(|t| t.max_m);
    Flight "position_sustained_m", "tracking error, largest mean over a second", Metre ["tracking_sustained_max_m"] =>
        |_m, o| o.tracking.map(|t| t.sustained_m);
    Flight "position_recovering_m", "tracking error, largest during a recovery", Metre ["recovery_max_m"] =>
        |_m, o| o.tracking.map(|t| t.recovering_m);
    Flight "position_last_second_m", "tracking error, mean of the last second", Metre ["lost_m"] =>
        |_m, o| o.tracking.map(|t| t.end_m);
    Flight "heading_max_rad", "heading error outside recoveries, largest", Radian ["heading_max_rad"] =>
        |_m, o| o.tracking.map(|t| t.heading_rad);
    Flight "attitude_end_rad", "error of an angle at the end, largest", Radian ["attitude_end_max_rad"] =>
        |_m, o| o.turned_rad;
    Flight "tilt_max_rad", "largest tilt", Radian ["tilt_max_rad"] => |_m, o| Some(o.tilt_rad);
    Flight "contact_s", "time on the ground where its path is not", Second ["contact_max_s"] =>
        |_m, o| Some(o.contact.total_s);
    Flight "rotors_cut_s", "time with the rotors cut", Second ["cut_max_s"] => |_m, o| Some(o.cut_s);
    Constraints "constraint_violations", "commands outside their bounds", Count ["violations_max"] =>
        |_m, o| Some(o.violations as f64);
    Constraints "controller_steps", "steps of controllers in command", Count => |m, _o| Some(m.effort().steps as f64);
    Constraints "relaxed_steps", "steps with a relaxed increment bound", Count => |m, _o| Some(m.effort().relaxed as f64);
    Constraints "yielded_steps", "steps that left a soft bound", Count => |m, _o| Some(m.effort().yielded as f64);
    Constraints "unsolved_steps", "steps without a solved optimum", Count => |m, _o| Some(m.effort().unsolved as f64);
    Constraints "unsolved_share", "steps without a solved optimum, of the controller with most", Share ["unsolved_max_share"] =>
        |_m, o| Some(o.unsolved.share);
    Constraints "most_iterations", "most iterations in a step", Count => |m, _o| Some(m.effort().most_iterations as f64);
    Constraints "clipped_share", "ticks with clipped rotors", Share ["clipped_max_share"] => |_m, o| Some(o.clipping.share);
    Constraints "clipped_s", "longest stretch with clipped rotors", Second ["clipped_max_s"] =>
        |_m, o| Some(o.clipping.longest_s);
    Timing "missed_ticks", "missed deadlines and skipped releases", Count => |m, _o| Some(m.totals().missed as f64);
    Timing "missed_share", "missed deadlines and skipped releases, of the loop with most", Share ["missed_max_share"] =>
        |_m, o| Some(o.missed.share);
    Timing "late_samples", "samples after their step", Count => |m, _o| Some(m.totals().late as f64);
    Timing "late_share", "samples after their step, of the loop with most", Share ["late_max_share"] => |_m, o| Some(o.late.share);
    Timing "unseen_samples", "samples that a loop never saw", Count => |m, _o| Some(m.totals().unseen as f64);
    Timing "imu_overdue_steps", "estimates without IMU samples", Count =>
        |m, _o| Some(m.estimates().imu_overdue().steps as f64);
    Timing "fix_overdue_steps", "estimates without pose fixes", Count =>
        |m, _o| Some(m.estimates().fix_overdue().steps as f64);
    Timing "safe_mode_episodes", "safe-mode episodes", Count => |m, _o| Some(m.gate().safe_mode_episodes as f64);
    Timing "safe_mode_unexplained", "safe-mode episodes that no fault, trip or loss of a process explains", Count ["safe_mode_max"] =>
        |_m, o| Some(o.safe_mode.unexplained as f64);
    Timing "safe_mode_explained", "safe-mode episodes that one of these explains", Count =>
        |_m, o| Some(o.safe_mode.explained as f64);
    Timing "safe_mode_s", "longest safe-mode episode", Second ["safe_mode_max_s"] => |_m, o| Some(o.safe_mode.longest_s);
    Timing "unguided_ticks", "ticks in which the actuation guard flew", Count => |m, _o| Some(m.ticks().2 as f64);
    Timing "restarts", "processes started again", Count => |m, _o| Some(m.totals().restarts as f64);
    Timing "wrong_owner_ticks", "ticks commanded by a wrong owner", Count ["wrong_owner_max"] =>
        |_m, o| Some(o.wrong_owner as f64);
    Timing "duplicated_ticks", "ticks with two commands", Count ["duplicated_max"] => |_m, o| Some(o.duplicated as f64);
    Timing "missed_commands", "ticks without a valid command", Count => |m, _o| Some(m.commands().missed as f64);
    Timing "dropped_samples", "samples and states that the recorder lost", Count ["dropped_max"] =>
        |_m, o| Some(o.dropped as f64);
};

impl Fact {
    /// A number as text for machines: in units of the key, to a micrometre and a microsecond.
    #[must_use]
    pub fn text(&self, value: f64) -> String {
        if self.unit == Unit::Count { format!("{value:.0}") } else { format!("{value:.6}") }
    }

    /// A number as text for people, with its unit.
    #[must_use]
    pub fn text_with_unit(&self, value: f64) -> String {
        match self.unit {
            Unit::Metre => format!("{:.1} mm", 1e3 * value),
            Unit::Second => format!("{value:.3} s"),
            Unit::Radian => format!("{value:.4} rad"),
            Unit::Share => format!("{:.2} %", 1e2 * value),
            Unit::Count => format!("{value:.0}"),
        }
    }

    /// A number as JSON; null for what is no number.
    #[must_use]
    pub fn json(&self, value: f64) -> Value {
        if !value.is_finite() {
            return Value::Null;
        }
        match self.unit {
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a count")]
            Unit::Count => (value as u64).into(),
            // As many digits as the text has.
            _ => ((value * 1e6).round() / 1e6).into(),
        }
    }
}

/// The facts of one flight.
#[derive(Debug, Clone, Default)]
pub struct Facts(Vec<(&'static Fact, f64)>);

impl Facts {
    /// Measures everything that this flight has.
    #[must_use]
    pub fn of(metrics: &Metrics, outcome: &Outcome) -> Self {
        let measured = |fact: &'static Fact| Some((fact, (fact.measure)(metrics, outcome)?));
        Self(FACTS.iter().filter_map(measured).collect())
    }

    /// Every fact with its number, in the order reported.
    pub fn iter(&self) -> impl Iterator<Item = (&'static Fact, f64)> + '_ {
        self.0.iter().copied()
    }

    /// The number of a key; `None` if the flight has none, or no fact is called so.
    #[must_use]
    pub fn number(&self, key: &str) -> Option<f64> {
        self.iter().find(|(fact, _)| fact.key == key).map(|(_, value)| value)
    }

    /// By key, as JSON.
    #[must_use]
    pub fn to_json(&self) -> Map<String, Value> {
        self.iter().map(|(fact, value)| (fact.key.to_owned(), fact.json(value))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;
    use verdict::CHECKS;

    #[test]
    fn every_check_but_of_the_file_judges_one_fact_in_its_unit() {
        let facts_of = |key: &str| FACTS.iter().filter(|fact| fact.check == Some(key)).count();
        let without_fact =
            CHECKS.iter().filter(|check| facts_of(check.key) != 1).map(|check| check.key);
        // A rig's angle is one fact for two limits; whether hashes are those of the flight is shown with the hashes.
        assert_eq!(without_fact.collect::<Vec<_>>(), ["lost_rad", "altered_max"]);
        for fact in FACTS.iter().filter(|fact| fact.check.is_some()) {
            let check = CHECKS.iter().find(|check| Some(check.key) == fact.check);
            assert_eq!(check.map(|check| check.unit), Some(fact.unit), "{}", fact.key);
        }
        let keys: BTreeSet<_> = FACTS.iter().map(|fact| fact.key).collect();
        assert_eq!(keys.len(), FACTS.len());
    }

    #[test]
    fn a_key_ends_with_its_unit() {
        for fact in FACTS {
            let unit = match fact.unit {
                Unit::Metre => "_m",
                Unit::Second => "_s",
                Unit::Radian => "_rad",
                Unit::Share => "_share",
                Unit::Count => "",
            };
            assert!(fact.key.ends_with(unit), "{}", fact.key);
        }
    }

    #[test]
    fn a_number_is_printed_in_its_unit_and_what_is_none_is_null() {
        let fact = |key: &str| FACTS.iter().find(|fact| fact.key == key).expect("a fact");
        let (error, steps) = (fact("position_max_m"), fact("relaxed_steps"));
        assert_eq!(
            (error.text(0.012_345_678), error.text_with_unit(0.012_345_678)),
            ("0.012346".into(), "12.3 mm".into())
        );
        assert_eq!((steps.text(3.0), steps.json(3.0)), ("3".into(), 3.into()));
        assert_eq!((error.json(0.5), error.json(f64::NAN)), (0.5.into(), Value::Null));
        assert_eq!(steps.json(f64::NAN), Value::Null);
    }
}
