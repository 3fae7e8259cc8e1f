//! Arguments of `goto`, `morph` and `disturb`.

use super::duration::duration;
use super::{Format, RunChoice};
use clap::{Args, Subcommand};
use core::time::Duration;
use scenario::orders::{Calm, Disturb, Load, Order};

pub(super) const GOTO_EXAMPLES: &str = "\
Examples:
  morphquad goto 1 0 2
  morphquad goto -1 0.5 1.5 90

The fourth number is the heading in degrees, 90 to the north. The reference leaves its plan smoothly from wherever it is, moving or not, and rests there for the rest of \
the flight. Up to 100 m from the origin; over ground not below 0.2 m. \
Ends with 0 once the pilot has it; 2 if it is out of range, or no run or several are active.";

pub(super) const MORPH_EXAMPLES: &str = "\
Examples:
  morphquad morph 160
  morphquad morph 45 --over 500ms

From 45 to 160 degrees, no faster than the servo's rate limit; a sweep that is under way is left smoothly. \
Ends with 0 once the pilot has it; 2 if it is out of range, or no run or several are active.";

pub(super) const DISTURB_EXAMPLES: &str = "\
Examples:
  morphquad disturb wind 3 0 0 --gust 1 --for 5s
  morphquad disturb force 0 0 -0.4 --for 500ms
  morphquad disturb payload 0.03
  morphquad disturb off

Adds to what the scenario's script does, up to eight at a time, until its time or `off`. \
Ends with 0 once the injector has it; 2 if it is out of range, or no run or several are active; 3 if \
eight are under way.";

/// A place to go.
#[derive(Debug, Clone, Args)]
#[command(allow_negative_numbers = true)]
pub struct GotoArguments {
    /// East, in metres
    pub x: f64,
    /// North, in metres
    pub y: f64,
    /// Up, in metres
    pub z: f64,
    /// Heading in degrees, counter-clockwise from east; as it is if left out
    pub yaw: Option<f64>,
    /// The run.
    #[command(flatten)]
    pub run: RunChoice,
    /// Form of the answer
    #[arg(long, value_enum, default_value = "text")]
    pub format: Format,
}

/// A width of the arms.
#[derive(Debug, Clone, Args)]
#[command(allow_negative_numbers = true)]
pub struct MorphArguments {
    /// Deployable angle, 45 to 160
    pub degrees: f64,
    /// Time to get there
    #[arg(long, value_name = "DURATION", default_value = "2s", allow_hyphen_values = true, value_parser = duration)]
    pub over: Duration,
    /// The run.
    #[command(flatten)]
    pub run: RunChoice,
    /// Form of the answer
    #[arg(long, value_enum, default_value = "text")]
    pub format: Format,
}

/// A disturbance.
#[derive(Debug, Clone, Args)]
pub struct DisturbArguments {
    /// Which.
    #[command(subcommand)]
    pub what: Disturbance,
}

/// What disturbs.
#[derive(Debug, Clone, Subcommand)]
pub enum Disturbance {
    /// Wind with gusts
    #[command(allow_negative_numbers = true)]
    Wind {
        /// Mean towards the east [m/s]
        x: f64,
        /// Mean towards the north [m/s]
        y: f64,
        /// Mean upwards [m/s]
        z: f64,
        /// Standard deviation of the gusts along each axis [m/s]
        #[arg(long, value_name = "M_S", default_value = "0")]
        gust: f64,
        /// When, and where to.
        #[command(flatten)]
        span: Span,
    },
    /// A force at the centre of mass
    #[command(allow_negative_numbers = true)]
    Force {
        /// Towards the east [N]
        x: f64,
        /// Towards the north [N]
        y: f64,
        /// Upwards [N]
        z: f64,
        /// When, and where to.
        #[command(flatten)]
        span: Span,
    },
    /// A torque about the body's axes
    #[command(allow_negative_numbers = true)]
    Torque {
        /// Roll [N m]
        x: f64,
        /// Pitch [N m]
        y: f64,
        /// Yaw [N m]
        z: f64,
        /// When, and where to.
        #[command(flatten)]
        span: Span,
    },
    /// A jump of the body rate, once
    #[command(allow_negative_numbers = true)]
    Kick {
        /// Roll [rad/s]
        x: f64,
        /// Pitch [rad/s]
        y: f64,
        /// Yaw [rad/s]
        z: f64,
        /// From when on, after the order is in effect
        #[arg(long = "in", value_name = "DURATION", default_value = "0s", allow_hyphen_values = true, value_parser = duration)]
        delay: Duration,
        /// The run.
        #[command(flatten)]
        target: Target,
    },
    /// A mass attached to the vehicle
    #[command(allow_negative_numbers = true)]
    Payload {
        /// Its mass [kg]
        mass: f64,
        /// When, and where to.
        #[command(flatten)]
        span: Span,
    },
    /// A rotor that gives less than it should
    #[command(allow_negative_numbers = true)]
    Rotor {
        /// 1 front, 2 left, 3 rear, 4 right
        rotor: u32,
        /// Thrust relative to a healthy one, 0 to 1
        efficiency: f64,
        /// When, and where to.
        #[command(flatten)]
        span: Span,
    },
    /// End what has been ordered
    Off {
        /// Also what the scenario's script does, for the rest of the flight
        #[arg(long)]
        script: bool,
        /// The run.
        #[command(flatten)]
        target: Target,
    },
}

/// Which run, and how to answer.
#[derive(Debug, Clone, Args)]
pub struct Target {
    /// The run.
    #[command(flatten)]
    pub run: RunChoice,
    /// Form of the answer
    #[arg(long, value_enum, default_value = "text")]
    pub format: Format,
}

/// When a disturbance acts, and in which run.
#[derive(Debug, Clone, Args)]
pub struct Span {
    /// From when on, after the order is in effect
    #[arg(long = "in", value_name = "DURATION", default_value = "0s", allow_hyphen_values = true, value_parser = duration)]
    pub delay: Duration,
    /// For how long; until `off` if left out
    #[arg(long = "for", value_name = "DURATION", allow_hyphen_values = true, value_parser = duration)]
    pub duration: Option<Duration>,
    /// The run.
    #[command(flatten)]
    pub target: Target,
}

impl Disturbance {
    /// As an order, and its target.
    pub(crate) fn order(&self) -> (Order, &Target) {
        let during = |load: Load, span: &'_ Span| {
            let for_s = span.duration.map(|duration| duration.as_secs_f64());
            Order::Disturb(Disturb { load, in_s: span.delay.as_secs_f64(), for_s })
        };
        match *self {
            Self::Wind { x, y, z, gust, ref span } => {
                let load = Load::Wind { mean_w_m_s: [x, y, z], sigma_w_m_s: [gust; 3] };
                (during(load, span), &span.target)
            }
            Self::Force { x, y, z, ref span } => {
                (during(Load::ForceWN([x, y, z]), span), &span.target)
            }
            Self::Torque { x, y, z, ref span } => {
                (during(Load::TorqueBNm([x, y, z]), span), &span.target)
            }
            Self::Kick { x, y, z, delay, ref target } => {
                let load = Load::KickBRadS([x, y, z]);
                (Order::Disturb(Disturb { load, in_s: delay.as_secs_f64(), for_s: None }), target)
            }
            Self::Payload { mass, ref span } => (during(Load::PayloadKg(mass), span), &span.target),
            Self::Rotor { rotor, efficiency, ref span } => {
                (during(Load::Rotor { rotor, efficiency }, span), &span.target)
            }
            Self::Off { script, ref target } => (Order::Calm(Calm { script }), target),
        }
    }
}
