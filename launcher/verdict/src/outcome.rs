//! The measurements of a flight, as plain numbers.

/// All measurements by which a flight is judged. Instants are logical time from the start of the flight.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// How the flight ended.
    pub end: End,
    /// Logical time flown \[s\].
    pub flown_s: f64,
    /// Logical time planned \[s\].
    pub planned_s: f64,
    /// Distance from the path; `None` for a rig, which has no path.
    pub tracking: Option<Tracking>,
    /// Largest error of roll, pitch and yaw at the end of a flight on a rig \[rad\]; `None` for a flight
    /// along a path.
    pub turned_rad: Option<f64>,
    /// Ground contact where the path is above the ground.
    pub contact: Contact,
    /// Largest angle between the vehicle's axis and the vertical \[rad\].
    pub tilt_rad: f64,
    /// Episodes without a valid command.
    pub safe_mode: SafeMode,
    /// Time with rotors at their limits.
    pub clipping: Clipping,
    /// Time with the rotors cut \[s\].
    pub cut_s: f64,
    /// Instant at which the rotors were cut \[s\].
    pub cut_at_s: f64,
    /// Number of commands outside their bounds.
    pub violations: u64,
    /// Steps without a solved optimum, of the controller with the largest share of them.
    pub unsolved: Misses,
    /// Missed releases and deadlines of the loop that missed most.
    pub missed: Misses,
    /// Samples that arrived after the step that needed them, of the loop that received most of them.
    pub late: Misses,
    /// Ticks with a command from a process that did not own the slot at that instant.
    pub wrong_owner: u64,
    /// Ticks with two commands.
    pub duplicated: u64,
    /// Samples and states that the recorder lost.
    pub dropped: u64,
    /// Names of the topics that lost samples; empty if there are none.
    pub dropped_of: String,
    /// Hashes of a recording that differ from those of its flight.
    pub altered: u64,
    /// Why the recording is incomplete; `None` if it is complete.
    pub unrecorded: Option<String>,
}

/// How a flight ended.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum End {
    /// At its planned end.
    #[default]
    Planned,
    /// The user interrupted it.
    Interrupted,
    /// The data end before the flight did, for this reason.
    Cut(String),
    /// A process failed permanently; the text names it and its failure.
    Crashed(String),
}

/// Distance of the vehicle from its path, and of its heading from that of the path.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Tracking {
    /// Root mean square outside recoveries \[m\].
    pub rms_m: f64,
    /// Maximum outside recoveries \[m\].
    pub max_m: f64,
    /// Instant of that maximum \[s\].
    pub max_at_s: f64,
    /// Maximum during recoveries from a fault or a restart \[m\].
    pub recovering_m: f64,
    /// Instant of that maximum \[s\].
    pub recovering_at_s: f64,
    /// Maximum of the mean over one second without a recovery \[m\].
    pub sustained_m: f64,
    /// End of that second \[s\].
    pub sustained_at_s: f64,
    /// Mean over the last second of the flight \[m\].
    pub end_m: f64,
    /// Largest error of the heading outside recoveries \[rad\].
    pub heading_rad: f64,
    /// Instant of that error \[s\].
    pub heading_at_s: f64,
}

/// Time during which a foot of the vehicle touched the ground while its path was above it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Contact {
    /// Total time \[s\].
    pub total_s: f64,
    /// Instant of the first contact \[s\].
    pub from_s: f64,
}

/// Episodes in which the actuation guard had no valid command.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SafeMode {
    /// Number of episodes that no scripted fault, restart or replacement of a controller explains.
    pub unexplained: u64,
    /// Beginning of the first unexplained episode \[s\].
    pub unexplained_from_s: f64,
    /// Number of episodes that one of these explains.
    pub explained: u64,
    /// Duration of the longest episode \[s\].
    pub longest_s: f64,
    /// Beginning of the longest episode \[s\].
    pub longest_from_s: f64,
}

/// Ticks in which the rotors could not produce the commanded wrench.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Clipping {
    /// Share of all ticks, from 0 to 1.
    pub share: f64,
    /// Longest uninterrupted time \[s\].
    pub longest_s: f64,
    /// Beginning of that time \[s\].
    pub longest_from_s: f64,
}

/// Missed, late or unsolved items of the loop that has most of them.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Misses {
    /// Number of such items.
    pub count: u64,
    /// The same relative to the releases of the loop, or to the steps of a controller in command.
    pub share: f64,
    /// Name of the loop or controller; empty if there are none.
    pub of: String,
}

impl Default for Outcome {
    /// A flight of zero duration without any event.
    fn default() -> Self {
        Self {
            end: End::Planned,
            flown_s: 0.0,
            planned_s: 0.0,
            tracking: None,
            turned_rad: None,
            contact: Contact::default(),
            tilt_rad: 0.0,
            safe_mode: SafeMode::default(),
            clipping: Clipping::default(),
            cut_s: 0.0,
            cut_at_s: 0.0,
            violations: 0,
            unsolved: Misses::default(),
            missed: Misses::default(),
            late: Misses::default(),
            wrong_owner: 0,
            duplicated: 0,
            dropped: 0,
            dropped_of: String::new(),
            altered: 0,
            unrecorded: None,
        }
    }
}

/// The larger of two measurements; NaN if either is NaN, which `f64::max` would ignore.
#[must_use]
pub fn worst(a: f64, b: f64) -> f64 {
    if a.is_nan() || b.is_nan() { f64::NAN } else { a.max(b) }
}
