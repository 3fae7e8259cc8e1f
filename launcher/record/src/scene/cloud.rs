//! Vehicle and path as points, for viewers that draw clouds and pass over scenes, as Rerun does.

use super::frames::{VEHICLE, WORLD, polar, vector};
use super::linkage::{DIRECTIONS_RAD, Fold, Linkage};
use super::shapes::{BLUE, DISC, FRONT_DISC, GREY};
use core::f64::consts::TAU;
use foxglove::messages::packed_element_field::NumericType;
use foxglove::messages::{Color, PackedElementField, PointCloud, Pose, Quaternion, Timestamp};

/// Points along a link, and along a side of the body.
const LINE_POINTS: u32 = 6;
/// Points around a rotor.
const RING_POINTS: u32 = 20;
/// Three coordinates and four colours.
const POINT_BYTES: u32 = 16;

/// Points as they are packed.
#[derive(Debug, Default)]
struct Points(Vec<u8>);

impl Points {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a screen shows no more, and colours are between 0 and 1"
    )]
    fn add(&mut self, position: [f64; 3], colour: &Color) {
        let Self(bytes) = self;
        bytes.extend(position.into_iter().flat_map(|v| (v as f32).to_le_bytes()));
        let channel = |value: f64| (255.0 * value) as u8;
        bytes.extend([colour.r, colour.g, colour.b, 1.0].map(channel));
    }

    /// From one place towards another, which it does not reach.
    fn line(&mut self, from: [f64; 3], to: [f64; 3], colour: &Color) {
        for index in 0..LINE_POINTS {
            let share = f64::from(index) / f64::from(LINE_POINTS);
            let between = core::array::from_fn(|i| from[i] + share * (to[i] - from[i]));
            self.add(between, colour);
        }
    }

    fn ring(&mut self, centre: [f64; 3], radius_m: f64, colour: &Color) {
        for index in 0..RING_POINTS {
            let angle_rad = TAU * f64::from(index) / f64::from(RING_POINTS);
            self.add(sum(centre, polar(radius_m, angle_rad)), colour);
        }
    }

    fn cloud(self, frame: &str, stamp: Timestamp) -> PointCloud {
        let origin = Pose {
            position: Some(vector([0.0; 3])),
            orientation: Some(Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 }),
        };
        let field = |name: &str, offset, kind: NumericType| PackedElementField {
            name: name.to_owned(),
            offset,
            r#type: kind.into(),
        };
        let places = [("x", 0), ("y", 4), ("z", 8)];
        let colours = [("red", 12), ("green", 13), ("blue", 14), ("alpha", 15)];
        let places = places.map(|(name, offset)| field(name, offset, NumericType::Float32));
        let colours = colours.map(|(name, offset)| field(name, offset, NumericType::Uint8));
        PointCloud {
            timestamp: Some(stamp),
            frame_id: frame.to_owned(),
            pose: Some(origin),
            point_stride: POINT_BYTES,
            fields: places.into_iter().chain(colours).collect(),
            data: self.0.into(),
        }
    }
}

fn sum(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    core::array::from_fn(|i| a[i] + b[i])
}

/// Outline of the body, links of the arms, rims of the rotor discs, in the vehicle's frame.
pub(super) fn vehicle(linkage: &Linkage, fold: &Fold, stamp: Timestamp) -> PointCloud {
    let mut points = Points::default();
    let hinges = DIRECTIONS_RAD.map(|direction_rad| polar(fold.hinge_m, direction_rad));
    for (i, direction_rad) in DIRECTIONS_RAD.into_iter().enumerate() {
        let elbow = sum(hinges[i], polar(fold.link_m, direction_rad + fold.bend_rad));
        let rotor = polar(fold.arm_m, direction_rad);
        points.line(hinges[i], hinges[(i + 1) % hinges.len()], &GREY);
        points.line(hinges[i], elbow, &GREY);
        points.line(elbow, rotor, &GREY);
        points.ring(rotor, linkage.disc_radius_m(), if i == 0 { &FRONT_DISC } else { &DISC });
    }
    points.cloud(VEHICLE, stamp)
}

/// Places of the world that were passed.
pub(super) fn path(places: impl Iterator<Item = [f64; 3]>, stamp: Timestamp) -> PointCloud {
    let mut points = Points::default();
    places.for_each(|place| points.add(place, &BLUE));
    points.cloud(WORLD, stamp)
}
