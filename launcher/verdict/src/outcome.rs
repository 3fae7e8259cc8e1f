//! What was measured in a flight, as plain numbers.

/// Everything that a flight is judged by.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// How the flight ended.
    pub end: End,
    /// Logical time flown \[s\].
    pub flown_s: f64,
    /// Logical time planned \[s\].
    pub planned_s: f64,
    /// Distance from the path, of a flight along one.
    pub tracking: Option<Tracking>,
    /// Largest error of an angle at the end of a rig's flight, which has no path \[rad\].
    pub turned_rad: Option<f64>,
    /// Time on the ground where the path has none.
    pub contact: Contact,
    /// Largest angle between the vehicle's axis and the vertical \[rad\].
    pub tilt_rad: f64,
    /// Time without a valid command.
    pub safe_mode: SafeMode,
    /// Rotors at their limits.
    pub clipping: Clipping,
    /// Time with the rotors cut \[s\].
    pub cut_s: f64,
    /// When they were cut \[s\].
    pub cut_at_s: f64,
    /// Commands outside their bounds.
    pub violations: u64,
    /// Deadlines and releases of the loop that missed most.
    pub missed: Misses,
    /// Samples after their step, of the loop that got most.
    pub late: Misses,
    /// Ticks with a command that was not its writer's to give.
    pub wrong_owner: u64,
    /// Ticks with two commands.
    pub duplicated: u64,
    /// Samples and states that the recorder lost.
    pub dropped: u64,
    /// Whose samples these are; empty if there are none.
    pub dropped_of: String,
    /// Hashes of a recording that are not those of its flight.
    pub altered: u64,
    /// Why the recording is incomplete, if it is.
    pub unrecorded: Option<String>,
}

/// How a flight ended.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum End {
    /// At the instant planned.
    #[default]
    Planned,
    /// The user ended it.
    Interrupted,
    /// What is known of it ends earlier: why.
    Cut(String),
    /// A process failed for good: which, and how.
    Crashed(String),
}

/// Distance of the vehicle from its path.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Tracking {
    /// Root mean square, apart from recoveries \[m\].
    pub rms_m: f64,
    /// Largest, apart from recoveries \[m\].
    pub max_m: f64,
    /// When \[s\].
    pub max_at_s: f64,
    /// Largest while the flight recovered from a fault or a restart \[m\].
    pub recovering_m: f64,
    /// When \[s\].
    pub recovering_at_s: f64,
    /// Largest mean over a second without a recovery in it \[m\].
    pub sustained_m: f64,
    /// When that second ended \[s\].
    pub sustained_at_s: f64,
    /// Mean over the last second \[m\].
    pub end_m: f64,
}

/// Time during which a foot of the vehicle touched the ground while its path was above it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Contact {
    /// In all \[s\].
    pub total_s: f64,
    /// Since when \[s\].
    pub from_s: f64,
}

/// Episodes in which the actuation gate had no valid command.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SafeMode {
    /// Those that neither a scripted fault, a restart nor the replacement of a controller explains.
    pub unexplained: u64,
    /// When the first of these began \[s\].
    pub unexplained_from_s: f64,
    /// Those that one of these explains.
    pub explained: u64,
    /// The longest of all \[s\].
    pub longest_s: f64,
    /// When that one began \[s\].
    pub longest_from_s: f64,
}

/// Ticks in which the rotors could not give what was asked for.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Clipping {
    /// Of all ticks.
    pub share: f64,
    /// Longest without a break \[s\].
    pub longest_s: f64,
    /// When that began \[s\].
    pub longest_from_s: f64,
}

/// What the worst loop missed.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Misses {
    /// Missed, or late.
    pub count: u64,
    /// Of the releases of that loop.
    pub share: f64,
    /// Name of the loop; empty if none missed any.
    pub of: String,
}

impl Default for Outcome {
    /// A flight of no time in which nothing happened.
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

/// The larger of two measurements. One that is no number is larger than every number.
#[must_use]
pub fn worst(a: f64, b: f64) -> f64 {
    if a.is_nan() || b.is_nan() { f64::NAN } else { a.max(b) }
}
