//! The section `[start]`: where the flight begins, and how it moves there.
//!
//! Left out, all keys of motion mean rest at trim. A rehearsal writes every key, so that its flight
//! can be read and flown by any user.

use garde::Validate;
use nalgebra::{UnitQuaternion, Vector3};
use plant::Motion;
use schemars::JsonSchema;
use serde::Deserialize;
use shared_types::time::ns_from_s;
use shared_types::{AngleDiversion, Flag, GuidanceOrder, PositionDiversion};

/// Where the flight begins: in the air, and at trim unless something else is set.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields, default)]
pub struct StartSettings {
    /// Position \[m\].
    #[garde(inner(range(min = -10000.0, max = 10000.0)))]
    pub position_w_m: [f64; 3],
    /// Heading \[°\].
    #[garde(range(min = -360.0, max = 360.0))]
    pub yaw_deg: f64,
    /// Pitch, the second of the intrinsic z-y-x angles \[°\].
    #[garde(range(min = -80.0, max = 80.0))]
    pub pitch_deg: f64,
    /// Roll, the third of them \[°\].
    #[garde(range(min = -180.0, max = 180.0))]
    pub roll_deg: f64,
    /// β \[°\].
    #[garde(range(min = 45.0, max = 160.0))]
    pub morph_angle_deg: f64,
    /// Velocity \[m/s\].
    #[garde(inner(range(min = -100.0, max = 100.0)))]
    pub velocity_w_m_s: [f64; 3],
    /// Body rate \[rad/s\].
    #[garde(inner(range(min = -100.0, max = 100.0)))]
    pub body_rate_b_rad_s: [f64; 3],
    /// β̇ \[rad/s\].
    #[garde(range(min = -100.0, max = 100.0))]
    pub morph_rate_rad_s: f64,
    /// Thrust of rotors 1 to 4, as they turn and as they were last commanded \[N\]; a quarter of the
    /// weight each if left out.
    #[garde(inner(inner(range(min = 0.0, max = 1000.0))))]
    pub rotor_thrust_n: Option<[f64; 4]>,
    /// The estimator believes that it is by this much elsewhere \[m\].
    #[garde(inner(range(min = -100.0, max = 100.0)))]
    pub error_position_w_m: [f64; 3],
    /// The estimator believes that it is by this much faster \[m/s\].
    #[garde(inner(range(min = -100.0, max = 100.0)))]
    pub error_velocity_w_m_s: [f64; 3],
    /// The estimator believes that it is turned by this rotation vector about the body axes \[rad\].
    #[garde(inner(range(min = -1.0, max = 1.0)))]
    pub error_attitude_b_rad: [f64; 3],
    /// Time of the pilot's plan at which the flight takes it up \[s\]: trajectory, morph schedule and
    /// `[start.guidance]` count from its beginning.
    #[garde(range(min = 0.0, max = 1e6))]
    pub at_s: f64,
    /// Length of the whole plan, which a figure eight ends within \[s\]; that of the flight if left out.
    #[garde(range(min = 0.001, max = 1e6))]
    pub plan_s: Option<f64>,
    /// What had been ordered of the pilot before.
    #[garde(dive)]
    pub guidance: GuidanceSettings,
}

impl Default for StartSettings {
    fn default() -> Self {
        Self {
            position_w_m: [0.0, 0.0, 1.5],
            yaw_deg: 0.0,
            pitch_deg: 0.0,
            roll_deg: 0.0,
            morph_angle_deg: 45.0,
            velocity_w_m_s: [0.0; 3],
            body_rate_b_rad_s: [0.0; 3],
            morph_rate_rad_s: 0.0,
            rotor_thrust_n: None,
            error_position_w_m: [0.0; 3],
            error_velocity_w_m_s: [0.0; 3],
            error_attitude_b_rad: [0.0; 3],
            at_s: 0.0,
            plan_s: None,
            guidance: GuidanceSettings::default(),
        }
    }
}

/// An order to the pilot that is in effect when the flight begins; times are those of the plan.
#[derive(Debug, Clone, Copy, Default, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields, default)]
pub struct GuidanceSettings {
    /// Of the position reference; with it belongs `yaw`.
    #[garde(dive)]
    pub position: Option<WaySettings>,
    /// Of the heading reference.
    #[garde(dive)]
    pub yaw: Option<TurnSettings>,
    /// Of the deployable angle.
    #[garde(dive)]
    pub morph: Option<TurnSettings>,
}

/// A way that the position reference is on.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
pub struct WaySettings {
    /// When it began \[s\].
    #[garde(range(min = 0.0, max = 1e6))]
    pub begin_s: f64,
    /// Where \[m\].
    #[garde(inner(range(min = -10000.0, max = 10000.0)))]
    pub from_w_m: [f64; 3],
    /// How fast \[m/s\].
    #[garde(inner(range(min = -100.0, max = 100.0)))]
    pub velocity_w_m_s: [f64; 3],
    /// With which acceleration \[m/s²\].
    #[garde(inner(range(min = -1000.0, max = 1000.0)))]
    pub acceleration_w_m_s2: [f64; 3],
    /// Where it rests in the end \[m\].
    #[garde(inner(range(min = -10000.0, max = 10000.0)))]
    pub goal_w_m: [f64; 3],
    /// Time in which the motion that it began with dies out \[s\].
    #[garde(range(min = 0.0, max = 1e6))]
    pub brake_s: f64,
    /// Time of the way from where that alone would lead to the goal \[s\].
    #[garde(range(min = 0.0, max = 1e6))]
    pub move_s: f64,
}

/// A turn that an angle is on.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
pub struct TurnSettings {
    /// When it began \[s\].
    #[garde(range(min = 0.0, max = 1e6))]
    pub begin_s: f64,
    /// Angle there \[rad\].
    #[garde(range(min = -1000.0, max = 1000.0))]
    pub from_rad: f64,
    /// Rate there \[rad/s\].
    #[garde(range(min = -100.0, max = 100.0))]
    pub rate_rad_s: f64,
    /// Acceleration there \[rad/s²\].
    #[garde(range(min = -10000.0, max = 10000.0))]
    pub acceleration_rad_s2: f64,
    /// Angle at which it rests in the end \[rad\].
    #[garde(range(min = -1000.0, max = 1000.0))]
    pub goal_rad: f64,
    /// Time in which the motion that it began with dies out \[s\].
    #[garde(range(min = 0.0, max = 1e6))]
    pub brake_s: f64,
    /// Time of the way from where that alone would lead to the goal \[s\].
    #[garde(range(min = 0.0, max = 1e6))]
    pub move_s: f64,
}

impl StartSettings {
    /// How the vehicle moves at the start.
    #[must_use]
    pub fn motion(&self) -> Motion {
        Motion {
            velocity_w_m_s: self.velocity_w_m_s.into(),
            roll_rad: self.roll_deg.to_radians(),
            pitch_rad: self.pitch_deg.to_radians(),
            body_rate_b_rad_s: self.body_rate_b_rad_s.into(),
            morph_rate_rad_s: self.morph_rate_rad_s,
            rotor_thrust_n: self.rotor_thrust_n,
        }
    }

    /// True unless the vehicle is level and the estimator right about it.
    fn is_tilted(&self) -> bool {
        let angles = [self.roll_deg, self.pitch_deg].into_iter();
        angles.chain(self.error_attitude_b_rad).any(|angle| angle != 0.0)
    }

    /// What the estimator believes at first: position \[m\], velocity \[m/s\], and, unless the vehicle is
    /// level, attitude.
    pub(super) fn belief(&self) -> ([f64; 3], Vector3<f64>, Option<UnitQuaternion<f64>>) {
        let sum = |a: [f64; 3], b: [f64; 3]| core::array::from_fn(|i| a[i] + b[i]);
        let position_w_m = sum(self.position_w_m, self.error_position_w_m);
        let velocity: [f64; 3] = sum(self.velocity_w_m_s, self.error_velocity_w_m_s);
        let attitude = self.is_tilted().then(|| {
            let [roll, pitch, yaw] =
                [self.roll_deg, self.pitch_deg, self.yaw_deg].map(f64::to_radians);
            let is = ::vehicle::quaternion_from_euler(&Vector3::new(roll, pitch, yaw));
            is * UnitQuaternion::from_scaled_axis(Vector3::from(self.error_attitude_b_rad))
        });
        (position_w_m, velocity.into(), attitude)
    }

    /// Time of the plan at the beginning of the flight \[ns\].
    #[must_use]
    pub fn at_ns(&self) -> u64 {
        ns_from_s(self.at_s)
    }
}

impl GuidanceSettings {
    /// The order, with instants of the plan; `None` if nothing had been ordered.
    #[must_use]
    pub fn order(&self) -> Option<GuidanceOrder> {
        let Self { position, yaw, morph } = self;
        (position.is_some() || yaw.is_some() || morph.is_some()).then(|| GuidanceOrder {
            position: position.map(|way| way.diversion()).unwrap_or_default(),
            yaw: yaw.map(|turn| turn.diversion()).unwrap_or_default(),
            morph: morph.map(|turn| turn.diversion()).unwrap_or_default(),
            ..GuidanceOrder::default()
        })
    }
}

impl WaySettings {
    fn diversion(&self) -> PositionDiversion {
        PositionDiversion {
            begin_ns: ns_from_s(self.begin_s),
            from_w_m: self.from_w_m,
            velocity_w_m_s: self.velocity_w_m_s,
            acceleration_w_m_s2: self.acceleration_w_m_s2,
            goal_w_m: self.goal_w_m,
            brake_s: self.brake_s,
            move_s: self.move_s,
            ordered: Flag::Yes,
            reserved: 0,
        }
    }
}

impl TurnSettings {
    fn diversion(&self) -> AngleDiversion {
        AngleDiversion {
            begin_ns: ns_from_s(self.begin_s),
            from_rad: self.from_rad,
            rate_rad_s: self.rate_rad_s,
            acceleration_rad_s2: self.acceleration_rad_s2,
            goal_rad: self.goal_rad,
            brake_s: self.brake_s,
            move_s: self.move_s,
            ordered: Flag::Yes,
            reserved: 0,
        }
    }
}
