//! What can be scripted, as a scenario writes it.

use garde::Validate;
use schemars::JsonSchema;
use serde::Deserialize;

use crate::ranges::{after, finite, later_than};

/// Longest instant a script may name \[s\], eleven days.
const MAX_TIME_S: f64 = 1e6;

/// One entry of a script; `kind` in the scenario names the variant.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema, Validate)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Event {
    /// From start to end.
    Constant(#[garde(dive)] Constant),
    /// Between two instants.
    Step(#[garde(dive)] Step),
    /// For one sample, or for a short while.
    Pulse(#[garde(dive)] Pulse),
    /// A sine.
    Sine(#[garde(dive)] Sine),
    /// Growing, then held.
    Ramp(#[garde(dive)] Ramp),
    /// The paper's random torque impulse.
    Rd(#[garde(dive)] Rd),
    /// A jump of the body rate.
    Kick(#[garde(dive)] Kick),
    /// Mean wind with turbulence.
    Wind(#[garde(dive)] Wind),
    /// A mass picked up, and perhaps dropped.
    Payload(#[garde(dive)] Payload),
    /// A weak rotor.
    RotorEfficiency(#[garde(dive)] RotorEfficiency),
}

/// What a profile in time scales: any of wind, force and torque.
#[derive(Debug, Clone, Copy, Default, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields, default)]
pub struct Load {
    /// Wind velocity in the world frame \[m/s\].
    #[garde(inner(range(min = -100.0, max = 100.0), custom(finite)))]
    pub wind_w_m_s: [f64; 3],
    /// Force at the centre of mass in the world frame \[N\].
    #[garde(inner(range(min = -100.0, max = 100.0), custom(finite)))]
    pub force_w_n: [f64; 3],
    /// Torque about the body axes \[N m\].
    #[garde(inner(range(min = -10.0, max = 10.0), custom(finite)))]
    pub torque_b_nm: [f64; 3],
}

/// `load` all the time.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
pub struct Constant {
    /// What acts.
    #[garde(dive)]
    pub load: Load,
}

/// `load` in [`at_s`, `until_s`), or for ever.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
pub struct Step {
    /// First instant.
    #[garde(range(min = 0.0, max = MAX_TIME_S), custom(finite))]
    pub at_s: f64,
    /// First instant without it.
    #[garde(custom(after(self.at_s)))]
    pub until_s: Option<f64>,
    /// What acts.
    #[garde(dive)]
    pub load: Load,
}

/// `load` from the first sample at or after `at_s`.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
pub struct Pulse {
    /// First instant.
    #[garde(range(min = 0.0, max = MAX_TIME_S), custom(finite))]
    pub at_s: f64,
    /// For the samples in [`at_s`, `at_s + duration_s`), one at least; absent, exactly one.
    #[garde(inner(range(min = 1e-9, max = MAX_TIME_S), custom(finite)))]
    pub duration_s: Option<f64>,
    /// What acts.
    #[garde(dive)]
    pub load: Load,
}

/// `load` · sin(2π f (t − `at_s`) + phase).
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
pub struct Sine {
    /// First instant.
    #[serde(default)]
    #[garde(range(min = 0.0, max = MAX_TIME_S), custom(finite))]
    pub at_s: f64,
    /// First instant without it; absent, for ever.
    #[garde(custom(after(self.at_s)))]
    pub until_s: Option<f64>,
    /// Frequency.
    #[garde(range(min = 1e-6, max = 5e3), custom(finite))]
    pub frequency_hz: f64,
    /// Phase at `at_s`.
    #[serde(default)]
    #[garde(range(min = -1e3, max = 1e3), custom(finite))]
    pub phase_rad: f64,
    /// Amplitude.
    #[garde(dive)]
    pub load: Load,
}

/// From nothing at `at_s` to `load` at `until_s`, then held.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
pub struct Ramp {
    /// Start of the growth.
    #[garde(range(min = 0.0, max = MAX_TIME_S), custom(finite))]
    pub at_s: f64,
    /// End of the growth.
    #[garde(range(min = 0.0, max = MAX_TIME_S), custom(finite), custom(later_than(self.at_s)))]
    pub until_s: f64,
    /// What acts in the end.
    #[garde(dive)]
    pub load: Load,
}

/// The paper's `r_d` as a torque pulse: scale · rd, where rd = (N(0, 1), N(0, 1), 0.1 N(0, 1))
/// unless it is given.
///
/// Its total impulse is scale · rd · duration at every rate of the injector: where the duration is
/// no whole number of samples, the torque is adapted.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
pub struct Rd {
    /// First instant.
    #[garde(range(min = 0.0, max = MAX_TIME_S), custom(finite))]
    pub at_s: f64,
    /// Length; one period of the paper's 100 Hz loop unless given.
    #[serde(default = "Rd::default_duration_s")]
    #[garde(range(min = 1e-6, max = MAX_TIME_S), custom(finite))]
    pub duration_s: f64,
    /// Torque for rd = 1.
    #[serde(default = "Rd::default_scale_nm")]
    #[garde(range(min = 0.0, max = 10.0), custom(finite))]
    pub scale_nm: f64,
    /// These values instead of random ones.
    #[garde(inner(inner(range(min = -100.0, max = 100.0), custom(finite))))]
    pub rd: Option<[f64; 3]>,
}

impl Rd {
    fn default_duration_s() -> f64 {
        0.01
    }

    fn default_scale_nm() -> f64 {
        0.1
    }
}

/// Added to the body rate once, at the first sample at or after `at_s`.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
pub struct Kick {
    /// When.
    #[garde(range(min = 0.0, max = MAX_TIME_S), custom(finite))]
    pub at_s: f64,
    /// Jump in B.
    #[garde(inner(range(min = -100.0, max = 100.0), custom(finite)))]
    pub body_rate_b_rad_s: [f64; 3],
}

/// Mean wind with gusts about it, in [`at_s`, `until_s`), or for ever.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
pub struct Wind {
    /// First instant; the gusts are stationary from here on.
    #[serde(default)]
    #[garde(range(min = 0.0, max = MAX_TIME_S), custom(finite))]
    pub at_s: f64,
    /// First instant without it.
    #[garde(custom(after(self.at_s)))]
    pub until_s: Option<f64>,
    /// Mean in W.
    #[garde(inner(range(min = -100.0, max = 100.0), custom(finite)))]
    pub mean_w_m_s: [f64; 3],
    /// Standard deviation of the gusts along each axis of W.
    #[serde(default)]
    #[garde(inner(range(min = 0.0, max = 50.0), custom(finite)))]
    pub sigma_m_s: [f64; 3],
    /// Scale length along each axis of W.
    #[serde(default = "Wind::default_length_m")]
    #[garde(inner(range(min = 1e-2, max = 1e4), custom(finite)))]
    pub length_m: [f64; 3],
}

impl Wind {
    pub(crate) fn default_length_m() -> [f64; 3] {
        [3.0, 3.0, 1.5]
    }
}

/// A point mass at the centre of mass in [`at_s`, `until_s`), or for ever.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
pub struct Payload {
    /// Picked up.
    #[garde(range(min = 0.0, max = MAX_TIME_S), custom(finite))]
    pub at_s: f64,
    /// Dropped.
    #[garde(custom(after(self.at_s)))]
    pub until_s: Option<f64>,
    /// Its mass.
    #[garde(range(min = 0.0, max = 10.0), custom(finite))]
    pub mass_kg: f64,
}

/// A rotor that gives less than it should in [`at_s`, `until_s`), or for ever.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
pub struct RotorEfficiency {
    /// First instant.
    #[garde(range(min = 0.0, max = MAX_TIME_S), custom(finite))]
    pub at_s: f64,
    /// First instant of full thrust again.
    #[garde(custom(after(self.at_s)))]
    pub until_s: Option<f64>,
    /// 1 front, 2 left, 3 rear, 4 right.
    #[garde(range(min = 1, max = 4))]
    pub rotor: u8,
    /// Thrust relative to a healthy rotor.
    #[garde(range(min = 0.0, max = 1.0), custom(finite))]
    pub efficiency: f64,
}

impl Event {
    /// First and last instant \[s\]; a burst of samples and a held ramp have no last.
    pub(crate) fn span_s(&self) -> (f64, Option<f64>) {
        match self {
            Self::Constant(_) => (0.0, None),
            Self::Step(e) => (e.at_s, e.until_s),
            Self::Pulse(e) => (e.at_s, None),
            Self::Sine(e) => (e.at_s, e.until_s),
            Self::Ramp(e) => (e.at_s, None),
            Self::Rd(e) => (e.at_s, None),
            Self::Kick(e) => (e.at_s, None),
            Self::Wind(e) => (e.at_s, e.until_s),
            Self::Payload(e) => (e.at_s, e.until_s),
            Self::RotorEfficiency(e) => (e.at_s, e.until_s),
        }
    }

    /// Length \[s\] of a burst that is counted in samples, zero for a single sample; `None` for an
    /// event that lasts.
    pub(crate) fn burst_s(&self) -> Option<f64> {
        match self {
            Self::Pulse(e) => Some(e.duration_s.unwrap_or(0.0)),
            Self::Rd(e) => Some(e.duration_s),
            Self::Kick(_) => Some(0.0),
            _ => None,
        }
    }
}
