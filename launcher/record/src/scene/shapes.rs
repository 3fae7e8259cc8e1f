//! Shapes: the vehicle in its frames, arrows, paths. Colours can be distinguished by colour-blind people.

use super::frames::{ARMS, FOREARMS, LEVEL, ROTORS, VEHICLE, WORLD, vector};
use super::linkage::{Fold, Linkage};
use core::f64::consts::FRAC_1_SQRT_2;
use foxglove::messages::{
    ArrowPrimitive, Color, CubePrimitive, CylinderPrimitive, KeyValuePair, LinePrimitive, Point3,
    Pose, Quaternion, SceneEntity, SceneUpdate, Timestamp, line_primitive,
};
use shared_types::Disturbance;

const fn colour(r: f64, g: f64, b: f64, a: f64) -> Color {
    Color { r, g, b, a }
}

pub(super) const BLUE: Color = colour(0.0, 0.45, 0.7, 1.0);
pub(super) const ORANGE: Color = colour(0.9, 0.62, 0.0, 1.0);
pub(super) const PURPLE: Color = colour(0.8, 0.47, 0.65, 1.0);
const GREEN: Color = colour(0.0, 0.62, 0.45, 0.9);
const VERMILION: Color = colour(0.84, 0.37, 0.0, 1.0);
const SKY: Color = colour(0.34, 0.71, 0.91, 0.8);
pub(super) const GREY: Color = colour(0.35, 0.37, 0.4, 1.0);
pub(super) const DISC: Color = colour(0.34, 0.71, 0.91, 0.45);
/// Of rotor 1, in front.
pub(super) const FRONT_DISC: Color = colour(0.9, 0.62, 0.0, 0.6);

/// An external force of the vehicle's weight is drawn so long \[m\].
const WEIGHT_M: f64 = 1.0;
/// A wind of 1 m/s is drawn so long \[m\].
const WIND_M: f64 = 0.1;
/// Wind is drawn so far above the vehicle \[m\].
const WIND_ABOVE_M: f64 = 0.15;
/// Shorter arrows are not drawn \[m\].
const MIN_ARROW_M: f64 = 1e-3;

/// From the x axis to z.
const UP: Quaternion = Quaternion { x: 0.0, y: -FRAC_1_SQRT_2, z: 0.0, w: FRAC_1_SQRT_2 };
const LEVEL_ATTITUDE: Quaternion = Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 };

fn at(position: [f64; 3], orientation: Quaternion) -> Pose {
    Pose { position: Some(vector(position)), orientation: Some(orientation) }
}

fn entity(frame: &str, id: &str, stamp: Timestamp) -> SceneEntity {
    SceneEntity {
        timestamp: Some(stamp),
        frame_id: frame.to_owned(),
        id: id.to_owned(),
        frame_locked: true,
        ..SceneEntity::default()
    }
}

fn update(entities: Vec<SceneEntity>) -> SceneUpdate {
    SceneUpdate { deletions: Vec::new(), entities }
}

fn block(centre: [f64; 3], size: [f64; 3], color: Color) -> CubePrimitive {
    CubePrimitive {
        pose: Some(at(centre, LEVEL_ATTITUDE)),
        size: Some(vector(size)),
        color: Some(color),
    }
}

/// Body, links of the arms, rotor discs.
pub(super) fn vehicle(linkage: &Linkage, fold: &Fold, stamp: Timestamp) -> SceneUpdate {
    let radius_m = linkage.disc_radius_m();
    let (hub_m, link_m) = (linkage.hinge_m, fold.link_m);
    let (width_m, height_m) = (0.12 * hub_m, 0.25 * hub_m);
    let mut body = entity(VEHICLE, "body", stamp);
    let side_m = core::f64::consts::SQRT_2 * hub_m;
    body.cubes = vec![
        block([0.0; 3], [side_m, side_m, 0.5 * hub_m], GREY),
        block([0.9 * hub_m, 0.0, 0.0], [0.5 * hub_m, 0.3 * hub_m, 0.3 * hub_m], FRONT_DISC),
    ];
    let mut entities = vec![body];
    for i in 0..4 {
        for frame in [ARMS[i], FOREARMS[i]] {
            let mut link = entity(frame, frame, stamp);
            let centre = [0.5 * link_m, 0.0, 0.0];
            link.cubes = vec![block(centre, [link_m, width_m, height_m], GREY)];
            entities.push(link);
        }
        let mut rotor = entity(ROTORS[i], ROTORS[i], stamp);
        let disc = |centre_m: f64, radius_m: f64, height_m: f64, color| CylinderPrimitive {
            pose: Some(at([0.0, 0.0, centre_m], LEVEL_ATTITUDE)),
            size: Some(vector([2.0 * radius_m, 2.0 * radius_m, height_m])),
            bottom_scale: 1.0,
            top_scale: 1.0,
            color: Some(color),
        };
        let color = if i == 0 { FRONT_DISC } else { DISC };
        let motor_m = 0.5 * hub_m;
        rotor.cylinders = vec![
            disc(0.25 * hub_m, 0.2 * hub_m, motor_m, GREY),
            disc(motor_m, radius_m, 0.05 * hub_m, color),
        ];
        entities.push(rotor);
    }
    update(entities)
}

fn arrow(tail: [f64; 3], orientation: Quaternion, length_m: f64, color: Color) -> ArrowPrimitive {
    let head_m = (0.3 * length_m).min(0.03);
    ArrowPrimitive {
        pose: Some(at(tail, orientation)),
        shaft_length: length_m - head_m,
        shaft_diameter: 0.008,
        head_length: head_m,
        head_diameter: 0.02,
        color: Some(color),
    }
}

/// The shortest rotation from the x axis to a direction of unit length.
fn towards([x, y, z]: [f64; 3]) -> Quaternion {
    let w = 1.0 + x;
    if w < 1e-9 {
        return Quaternion { x: 0.0, y: 0.0, z: 1.0, w: 0.0 };
    }
    let norm = (w * w + y * y + z * z).sqrt();
    Quaternion { x: 0.0, y: -z / norm, z: y / norm, w: w / norm }
}

/// An arrow along a vector, unless it is too short to be seen.
fn along(tail: [f64; 3], value: [f64; 3], scale: f64, color: Color) -> Option<ArrowPrimitive> {
    let norm = value.iter().map(|v| v * v).sum::<f64>().sqrt();
    let length_m = norm * scale;
    let is_seen = length_m.is_finite() && length_m > MIN_ARROW_M;
    is_seen.then(|| arrow(tail, towards(value.map(|v| v / norm)), length_m, color))
}

/// Thrust of each rotor \[N\]; `scale_m_n` is drawn per newton \[m/N\].
pub(super) fn thrusts(thrust_n: &[f64; 4], scale_m_n: f64, stamp: Timestamp) -> SceneUpdate {
    let entities = ROTORS.into_iter().zip(thrust_n).map(|(frame, thrust_n)| {
        let length_m = scale_m_n * thrust_n;
        let mut entity = entity(frame, frame, stamp);
        entity.metadata = vec![number("thrust_n", *thrust_n)];
        if length_m > MIN_ARROW_M {
            entity.arrows = vec![arrow([0.0; 3], UP, length_m, GREEN)];
        }
        entity
    });
    update(entities.collect())
}

/// External force and wind.
pub(super) fn disturbance(sample: &Disturbance, weight_n: f64, stamp: Timestamp) -> SceneUpdate {
    let mut force = entity(LEVEL, "force", stamp);
    force.arrows =
        along([0.0; 3], sample.force_w_n, WEIGHT_M / weight_n, VERMILION).into_iter().collect();
    let mut wind = entity(LEVEL, "wind", stamp);
    let above = [0.0, 0.0, WIND_ABOVE_M];
    wind.arrows = along(above, sample.wind_w_m_s, WIND_M, SKY).into_iter().collect();
    update(vec![force, wind])
}

fn number(key: &str, value: f64) -> KeyValuePair {
    KeyValuePair { key: key.to_owned(), value: format!("{value:.4}") }
}

/// Lines of the world, by name, colour and width in pixels.
pub(super) fn path(
    name: &'static str,
    points: impl Iterator<Item = [f64; 3]>,
    color: Color,
    width: f64,
) -> (&'static str, LinePrimitive) {
    let line = LinePrimitive {
        r#type: line_primitive::Type::LineStrip.into(),
        pose: Some(at([0.0; 3], LEVEL_ATTITUDE)),
        thickness: width,
        scale_invariant: true,
        points: points.map(|[x, y, z]| Point3 { x, y, z }).collect(),
        color: Some(color),
        colors: Vec::new(),
        indices: Vec::new(),
    };
    (name, line)
}

/// Each line as an entity of its own, named after the channel.
pub(super) fn lines(
    channel: &str,
    lines: Vec<(&'static str, LinePrimitive)>,
    stamp: Timestamp,
) -> SceneUpdate {
    let lines = lines.into_iter().map(|(name, line)| {
        let mut entity = entity(WORLD, &format!("{channel}/{name}"), stamp);
        entity.lines = vec![line];
        entity
    });
    update(lines.collect())
}
