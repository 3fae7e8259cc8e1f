//! The section `[pilot]` of a scenario: where to fly and how wide to spread the arms.

mod trajectory;

pub use trajectory::{MAX_ROWS, MAX_SPEED_M_S, MAX_TIME_SCALE, Trajectory, first_not_increasing};

use crate::{
    AttitudeStep, FigureEightConfig, Heading, MorphKnot, PilotConfig, RigPilotConfig, TakenUp,
    TrajectoryConfig, Waypoint,
};
use garde::Validate;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use shared_types::time::ns_from_s;

/// Keys of the section that belong to no kind of manoeuvre.
pub const COMMON_KEYS: [&str; 4] = ["rate_hz", "lead_s", "preview_spacing_s", "morph"];

/// Values of `kind`.
pub const KINDS: [&str; 5] = ["hover", "figure8", "waypoints", "trajectory", "attitude_step"];

/// The whole section.
#[derive(Debug, Clone, Default)]
pub struct Settings {
    /// What every manoeuvre has.
    pub common: Common,
    /// What is flown.
    pub manoeuvre: Manoeuvre,
}

/// What every manoeuvre has.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields, default)]
pub struct Common {
    /// Loop rate \[Hz\]. A reference of two seconds ago is one that has ended: then controllers land.
    #[garde(range(min = 1.0, max = 1000.0))]
    pub rate_hz: f64,
    /// How far the pilot runs ahead of the plant \[s\].
    #[garde(range(min = 0.001, max = 1.0))]
    pub lead_s: f64,
    /// Time between two points of the reference \[s\]; there are 48.
    #[garde(range(min = 0.0001, max = 1.0))]
    pub preview_spacing_s: f64,
    /// `[[t_s, angle_deg], ...]`: β to have reached, at rest, at a time. The angle of `[start]`
    /// throughout if empty.
    #[garde(custom(knots_within_the_linkage))]
    pub morph: Vec<[f64; 2]>,
}

impl Default for Common {
    fn default() -> Self {
        Self { rate_hz: 50.0, lead_s: 0.2, preview_spacing_s: 0.05, morph: Vec::new() }
    }
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "the signature that the validator calls")]
fn knots_within_the_linkage(knots: &[[f64; 2]], _context: &()) -> garde::Result {
    let outside = knots.iter().find(|[_, angle_deg]| !(45.0..=160.0).contains(angle_deg));
    outside.map_or(Ok(()), |[t_s, angle_deg]| {
        let what = format!("the angle {angle_deg} at {t_s} s is not a number from 45 to 160");
        Err(garde::Error::new(what))
    })
}

/// What is flown; `kind` names the variant.
#[derive(Debug, Clone, Validate)]
pub enum Manoeuvre {
    /// `kind = "hover"`.
    Hover(#[garde(dive)] Hover),
    /// `kind = "figure8"`.
    Figure8(#[garde(dive)] Figure8),
    /// `kind = "waypoints"`.
    Waypoints(#[garde(dive)] Waypoints),
    /// `kind = "trajectory"`.
    Trajectory(#[garde(dive)] Trajectory),
    /// `kind = "attitude_step"`.
    AttitudeStep(#[garde(dive)] Step),
}

impl Default for Manoeuvre {
    fn default() -> Self {
        Self::Hover(Hover::default())
    }
}

/// Stays where it is.
#[derive(Debug, Clone, Copy, Default, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields, default)]
pub struct Hover {
    /// Position \[m\]; the start if left out.
    #[garde(inner(inner(range(min = -10000.0, max = 10000.0))))]
    pub position_w_m: Option<[f64; 3]>,
    /// Heading \[°\]; that of the start if left out.
    #[garde(range(min = -360.0, max = 360.0))]
    pub yaw_deg: Option<f64>,
}

/// x = ½ size sin(w s), y = ½ size sin(2 w s), z = ½ size sin(w s + phase) about the center.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields, default)]
pub struct Figure8 {
    /// Crossing point \[m\].
    #[garde(inner(range(min = -10000.0, max = 10000.0)))]
    pub center_w_m: [f64; 3],
    /// Whole length \[m\].
    #[garde(range(min = 0.0, max = 2000.0))]
    pub size_x_m: f64,
    /// Whole width \[m\].
    #[garde(range(min = 0.0, max = 2000.0))]
    pub size_y_m: f64,
    /// Whole height \[m\].
    #[garde(range(min = 0.0, max = 2000.0))]
    pub size_z_m: f64,
    /// Phase of the height \[°\].
    #[garde(range(min = -360.0, max = 360.0))]
    pub phase_deg: f64,
    /// Time of one eight at full speed \[s\].
    #[garde(range(min = 0.1, max = 1e5))]
    pub period_s: f64,
    /// From rest to full speed \[s\].
    #[garde(range(min = 0.1, max = 1e4))]
    pub lead_in_s: f64,
    /// From full speed to rest, so that the flight ends in hover \[s\].
    #[garde(range(min = 0.1, max = 1e4))]
    pub lead_out_s: f64,
    /// Which way the nose points.
    #[garde(skip)]
    pub yaw: Yaw,
    /// Heading while it is fixed \[°\].
    #[garde(range(min = -360.0, max = 360.0))]
    pub yaw_deg: f64,
}

impl Default for Figure8 {
    fn default() -> Self {
        let figure = FigureEightConfig::default();
        let [x, y, z] = figure.amplitude_m.map(|amplitude| 2.0 * amplitude);
        Self {
            center_w_m: figure.center_w_m,
            size_x_m: x,
            size_y_m: y,
            size_z_m: z,
            phase_deg: 0.0,
            period_s: figure.period_s,
            lead_in_s: figure.lead_in_s,
            lead_out_s: figure.lead_out_s,
            yaw: Yaw::Fixed,
            yaw_deg: 0.0,
        }
    }
}

/// Which way the nose points.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema, Serialize)]
pub enum Yaw {
    /// Always the same way.
    #[serde(rename = "fixed")]
    Fixed,
    /// Along the path.
    #[serde(rename = "along path", alias = "along-path", alias = "along_path")]
    AlongPath,
}

/// From place to place, at rest at each.
#[derive(Debug, Clone, Default, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields, default)]
pub struct Waypoints {
    /// The places.
    #[garde(dive, length(min = 1))]
    pub points: Vec<Point>,
}

/// A place to be at rest at a given time.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
pub struct Point {
    /// When \[s\].
    #[garde(range(min = 0.0, max = 1e6))]
    pub t_s: f64,
    /// Where \[m\].
    #[garde(inner(range(min = -10000.0, max = 10000.0)))]
    pub position_w_m: [f64; 3],
    /// Heading \[°\].
    #[serde(default)]
    #[garde(range(min = -36000.0, max = 36000.0))]
    pub yaw_deg: f64,
}

/// A step of the attitude on the rig, instead of a trajectory.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields, default)]
pub struct Step {
    /// Axes that step.
    #[garde(length(min = 1, max = 3))]
    pub axes: Vec<Axis>,
    /// How far \[rad\].
    #[garde(range(min = -1.2, max = 1.2))]
    pub angle_rad: f64,
    /// When \[s\].
    #[garde(range(min = 0.0, max = 1e6))]
    pub at_s: f64,
}

impl Default for Step {
    fn default() -> Self {
        Self { axes: vec![Axis::Roll, Axis::Pitch, Axis::Yaw], angle_rad: 0.2, at_s: 0.0 }
    }
}

/// An axis of the attitude.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Axis {
    /// φ.
    Roll,
    /// θ.
    Pitch,
    /// ψ.
    Yaw,
}

/// What the pilot is built from.
#[derive(Debug, Clone)]
pub enum Plan {
    /// A trajectory, for the position controller.
    Flight(PilotConfig),
    /// Attitudes; the pilot holds the position slot itself.
    Rig(RigPilotConfig),
}

/// What a plan takes from other sections.
#[derive(Debug, Clone, Copy)]
pub struct Frame {
    /// Where the flight begins \[m\].
    pub position_w_m: [f64; 3],
    /// Heading there \[°\].
    pub yaw_deg: f64,
    /// β there \[°\].
    pub morph_angle_deg: f64,
    /// Length of the whole plan \[s\].
    pub duration_s: f64,
    /// Where in the plan the flight takes it up.
    pub taken_up: TakenUp,
}

impl Manoeuvre {
    /// As a reader of a scenario would call it.
    #[must_use]
    pub fn describe(&self) -> &'static str {
        match self {
            Self::Hover(_) => "hover",
            Self::Figure8(_) => "figure eight",
            Self::Waypoints(_) => "waypoints",
            Self::Trajectory(_) => "trajectory",
            Self::AttitudeStep(_) => "attitude step, no position loop",
        }
    }
}

impl Settings {
    /// True if the pilot sets attitudes and no position controller flies.
    #[must_use]
    pub fn is_rig(&self) -> bool {
        matches!(self.manoeuvre, Manoeuvre::AttitudeStep(_))
    }

    /// What the pilot is built from in a flight that begins at `frame`.
    #[must_use]
    pub fn plan(&self, frame: &Frame) -> Plan {
        let morph = self.knots(frame.morph_angle_deg);
        let spacing_ns = ns_from_s(self.common.preview_spacing_s);
        let trajectory = match &self.manoeuvre {
            Manoeuvre::AttitudeStep(step) => {
                let (step, taken_up) = (step.attitude(), frame.taken_up);
                return Plan::Rig(RigPilotConfig { step, morph, taken_up });
            }
            Manoeuvre::Hover(hover) => TrajectoryConfig::Hover {
                position_w_m: hover.position_w_m.unwrap_or(frame.position_w_m),
                yaw_rad: hover.yaw_deg.unwrap_or(frame.yaw_deg).to_radians(),
            },
            Manoeuvre::Figure8(figure) => figure.trajectory(frame.duration_s),
            Manoeuvre::Waypoints(list) => TrajectoryConfig::Waypoints(list.waypoints()),
            Manoeuvre::Trajectory(given) => given.config(),
        };
        Plan::Flight(PilotConfig { trajectory, morph, spacing_ns, taken_up: frame.taken_up })
    }

    fn knots(&self, start_deg: f64) -> Vec<MorphKnot> {
        if self.common.morph.is_empty() {
            return vec![MorphKnot { t_s: 0.0, angle_rad: start_deg.to_radians() }];
        }
        let knot =
            |&[t_s, angle_deg]: &[f64; 2]| MorphKnot { t_s, angle_rad: angle_deg.to_radians() };
        self.common.morph.iter().map(knot).collect()
    }
}

impl Step {
    fn attitude(&self) -> AttitudeStep {
        let angle = |axis: Axis| if self.axes.contains(&axis) { self.angle_rad } else { 0.0 };
        AttitudeStep {
            at_s: self.at_s,
            roll_rad: angle(Axis::Roll),
            pitch_rad: angle(Axis::Pitch),
            yaw_rad: angle(Axis::Yaw),
        }
    }
}

impl Figure8 {
    /// Ends at rest within the flight, or flies on to its end if that is too short to come to rest.
    fn trajectory(&self, duration_s: f64) -> TrajectoryConfig {
        let heading = match self.yaw {
            Yaw::Fixed => Heading::Fixed { yaw_rad: self.yaw_deg.to_radians() },
            Yaw::AlongPath => Heading::AlongPath,
        };
        let ending = TrajectoryConfig::FigureEight(FigureEightConfig {
            center_w_m: self.center_w_m,
            amplitude_m: [self.size_x_m, self.size_y_m, self.size_z_m].map(|size| 0.5 * size),
            phase_rad: self.phase_deg.to_radians(),
            period_s: self.period_s,
            lead_in_s: self.lead_in_s,
            lead_out_s: self.lead_out_s,
            duration_s: Some(duration_s),
            heading,
        });
        match (crate::Trajectory::new(&ending), ending) {
            (Err(_), TrajectoryConfig::FigureEight(figure)) => {
                TrajectoryConfig::FigureEight(FigureEightConfig { duration_s: None, ..figure })
            }
            (_, ending) => ending,
        }
    }
}

impl Waypoints {
    fn waypoints(&self) -> Vec<Waypoint> {
        let waypoint = |point: &Point| Waypoint {
            t_s: point.t_s,
            position_w_m: point.position_w_m,
            yaw_rad: point.yaw_deg.to_radians(),
        };
        self.points.iter().map(waypoint).collect()
    }
}
