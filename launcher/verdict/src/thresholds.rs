//! The limits of a flight, derived from its plan and its environment.

use crate::CHECKS;
use serde::ser::{Serialize, SerializeMap, Serializer};
use std::collections::BTreeMap;

/// Mean distance from the path in the last second above which a vehicle counts as lost \[m\]. It is several
/// times the size of the vehicle, and far more than wind or a failing rotor causes while the vehicle is under
/// control.
pub const LOST_M: f64 = 1.0;
/// Error of an angle at the end of a flight on a rig above which the vehicle counts as lost \[rad\].
pub const LOST_RAD: f64 = 1.0;

/// Permitted position error at rest in still air \[m\]: half of the span of the arms.
const AT_REST_M: f64 = 0.15;
/// Permitted lag along the path \[s\].
const BEHIND_S: f64 = 0.05;
/// Permitted position error per m/s² of a push \[s²\]: the compliance 1/ω² of a position loop of about
/// ω = 6 rad/s.
const YIELD_S2: f64 = 0.03;
/// Limit on the mean error over a second, as a share of the limit on the largest error.
const SUSTAINED_SHARE: f64 = 0.6;
/// Permitted error of the heading along a path, apart from recoveries \[rad\]: several times that of a shipped controller
/// that is ordered to turn around, which `report` prints for `run hover --goto 0,0,1.5,170@3s`.
const HEADING_RAD: f64 = 0.5;
/// Permitted tilt in excess of twice the largest commanded angle \[rad\].
const TILT_MARGIN_RAD: f64 = 0.2;
/// Time that a vehicle on a rig needs to answer its step \[s\]; after a shorter flight the error at the end
/// has only the limit [`LOST_RAD`].
const ANSWER_S: f64 = 0.5;
/// Permitted error of an angle at the end of a flight on a rig, as a share of its step.
const STEP_SHARE: f64 = 0.25;
/// Smallest limit on that error, for small steps and for a rig without a step \[rad\].
const MIN_STEP_RAD: f64 = 0.02;
/// Longest permitted time with clipped rotors \[s\]: the time that a position loop may be without authority
/// before the error exceeds [`AT_REST_M`].
const CLIPPED_S: f64 = 0.5;
/// Permitted share of ticks with clipped rotors; a vehicle above it flies at its bounds as a rule.
const CLIPPED_SHARE: f64 = 0.25;
/// Permitted share of a controller's steps without a solved optimum: such a step flies what the one before has planned,
/// which is no control law if it is the rule.
const UNSOLVED_SHARE: f64 = 0.05;
/// Permitted share of missed releases of a loop in realtime: a command is valid for two periods, so that a
/// loop that misses every other release still commands.
const MISSED_SHARE: f64 = 0.5;
/// Time per permitted safe-mode episode in realtime \[s\]: the operating system may occasionally delay a
/// controller.
const EPISODE_EVERY_S: f64 = 5.0;

/// The properties of a flight from which its limits are derived; the caller takes them from a scenario.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Basis {
    /// True in realtime, false in lockstep.
    pub realtime: bool,
    /// Planned duration of the flight \[s\].
    pub planned_s: f64,
    /// Largest speed along the path, including guidance orders \[m/s\].
    pub speed_m_s: f64,
    /// Largest acceleration by wind, forces, loads and an unknown mass \[m/s²\].
    pub push_m_s2: f64,
    /// Largest tilt that the position loop or the rig commands \[rad\].
    pub tilt_rad: f64,
    /// Step of the angles on a rig \[rad\]; `None` for a flight along a path.
    pub step_rad: Option<f64>,
    /// Time from that step to the end of the flight \[s\].
    pub after_step_s: f64,
    /// Number of samples of the fastest topic in a period of the slowest loop.
    pub samples_per_step: f64,
    /// Longest time that the actuation guard levels the vehicle by itself before it descends \[s\].
    pub gate_s: f64,
    /// True if the script kills or stops a process.
    pub faults: bool,
}

impl Default for Basis {
    fn default() -> Self {
        Self {
            realtime: false,
            planned_s: 0.0,
            speed_m_s: 0.0,
            push_m_s2: 0.0,
            tilt_rad: 0.35,
            step_rad: None,
            after_step_s: f64::INFINITY,
            samples_per_step: 1.0,
            gate_s: 2.0,
            faults: false,
        }
    }
}

/// One limit with its origin.
#[derive(Debug, Clone, PartialEq)]
pub struct Threshold {
    /// The limit, in the unit that the suffix of its key names.
    pub limit: f64,
    /// Where the limit comes from.
    pub why: String,
}

/// Every limit of a flight, by its key.
#[derive(Debug, Clone, PartialEq)]
pub struct Thresholds(BTreeMap<&'static str, Threshold>);

impl Default for Thresholds {
    fn default() -> Self {
        Self::derive(&Basis::default())
    }
}

impl Thresholds {
    /// Derives the limits of a flight.
    #[must_use]
    pub fn derive(basis: &Basis) -> Self {
        let mut all = Self(BTreeMap::new());
        all.put("cut_max_s", 0.0, "rotors that are cut stay off");
        all.put("lost_m", LOST_M, "several times the vehicle's size");
        all.put("lost_rad", LOST_RAD, "several times what a controller answers linearly");
        all.put("contact_max_s", 0.0, "only where the path itself is on the ground");
        all.put("clipped_max_s", CLIPPED_S, "as long as a position loop can do without authority");
        all.put("unsolved_max_share", UNSOLVED_SHARE, "a step without one flies an older plan");
        all.put("clipped_max_share", CLIPPED_SHARE, "bounds are the exception");
        for key in
            ["violations_max", "wrong_owner_max", "duplicated_max", "dropped_max", "altered_max"]
        {
            all.put(key, 0.0, "a promise, not a measurement");
        }
        all.follow(basis);
        all.turn(basis);
        all.wait(basis);
        all
    }

    /// Adds the limits on the tracking error.
    fn follow(&mut self, basis: &Basis) {
        let Basis { speed_m_s, push_m_s2, .. } = *basis;
        let most_m = AT_REST_M + BEHIND_S * speed_m_s + YIELD_S2 * push_m_s2;
        let tracking_m = most_m.clamp(AT_REST_M, LOST_M);
        let why = format!(
            "{AT_REST_M} m at rest, {BEHIND_S} s behind at up to {speed_m_s:.2} m/s, {YIELD_S2} s2 of a push \
             of up to {push_m_s2:.2} m/s2, at most {LOST_M} m"
        );
        self.follow_within(tracking_m, why);
        self.put("recovery_max_m", LOST_M, "as far as a vehicle that is not lost");
        self.put("heading_max_rad", HEADING_RAD, "several times what any turn of a path takes");
    }

    /// Adds the limit on the tracking error with those that are made of it.
    fn follow_within(&mut self, tracking_m: f64, why: impl Into<String>) {
        self.put("tracking_max_m", tracking_m, why);
        let why = format!("{SUSTAINED_SHARE} of tracking_max_m");
        self.put("tracking_sustained_max_m", SUSTAINED_SHARE * tracking_m, why);
        self.put("tracking_rms_max_m", tracking_m, "that of tracking_max_m");
    }

    /// Adds the limits on the attitude.
    fn turn(&mut self, basis: &Basis) {
        let Basis { tilt_rad, step_rad, after_step_s, .. } = *basis;
        let end_rad = if after_step_s < ANSWER_S {
            LOST_RAD
        } else {
            MIN_STEP_RAD.max(STEP_SHARE * step_rad.unwrap_or(0.0).abs())
        };
        let why = format!("{STEP_SHARE} of the step, at least {MIN_STEP_RAD} rad");
        self.put("attitude_end_max_rad", end_rad, why);
        let tilt_max_rad = (2.0 * tilt_rad + TILT_MARGIN_RAD).clamp(0.0, core::f64::consts::PI);
        let why =
            format!("twice the {tilt_rad:.2} rad asked for at most, and {TILT_MARGIN_RAD} rad");
        self.put("tilt_max_rad", tilt_max_rad, why);
    }

    /// Adds the limits on missing and late commands and samples.
    fn wait(&mut self, basis: &Basis) {
        let Basis { realtime, planned_s, samples_per_step, gate_s, faults, .. } = *basis;
        if realtime {
            let episodes = (planned_s / EPISODE_EVERY_S).max(0.0).ceil();
            let why = format!("by the wall clock one in {EPISODE_EVERY_S} s");
            self.put("safe_mode_max", episodes, why);
        } else {
            self.put("safe_mode_max", 0.0, "in lockstep nothing is late");
        }
        self.put("safe_mode_max_s", gate_s, "as long as the actuation guard hovers");
        let (share, why) = if realtime || faults {
            (MISSED_SHARE, "every other: a command is valid for two periods")
        } else {
            (0.0, "in lockstep nothing is late")
        };
        self.put("missed_max_share", share, why);
        let why = format!("{why}; up to {samples_per_step} samples in a step");
        self.put("late_max_share", share * samples_per_step, why);
    }

    fn put(&mut self, key: &'static str, limit: f64, why: impl Into<String>) {
        self.0.insert(key, Threshold { limit, why: why.into() });
    }

    /// Sets a limit from the scenario, with those that are made of it; false if no check has this key.
    pub fn set(&mut self, key: &str, limit: f64) -> bool {
        let check = CHECKS.iter().find(|check| check.key == key);
        let why = "set in [verdict]";
        match check {
            Some(check) if check.key == "tracking_max_m" => self.follow_within(limit, why),
            Some(check) => self.put(check.key, limit, why),
            None => {}
        }
        check.is_some()
    }

    /// The limit with this key, in the unit that the suffix of the key names; `None` if there is none.
    #[must_use]
    pub fn limit(&self, key: &str) -> Option<f64> {
        self.0.get(key).map(|threshold| threshold.limit)
    }

    /// All limits in alphabetical order of their keys.
    pub fn iter(&self) -> impl Iterator<Item = (&'static str, &Threshold)> {
        self.0.iter().map(|(key, threshold)| (*key, threshold))
    }
}

impl Serialize for Thresholds {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(self.0.len()))?;
        for (key, threshold) in self.iter() {
            map.serialize_entry(key, threshold)?;
        }
        map.end()
    }
}

impl Serialize for Threshold {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(2))?;
        map.serialize_entry("limit", &self.limit)?;
        map.serialize_entry("why", &self.why)?;
        map.end()
    }
}
