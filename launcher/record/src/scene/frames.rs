//! Frames of the vehicle and its arms, and poses in the world.
//!
//! `world` → `vehicle` → `arm_i` → `forearm_i` and `vehicle` → `rotor_i`; x ahead, y left, z up.
//! `vehicle_level` is where the vehicle is, along the axes of the world.

use super::linkage::{DIRECTIONS_RAD, Fold};
use foxglove::messages::{
    FrameTransform, FrameTransforms, Pose, PoseInFrame, Quaternion, Timestamp, Vector3,
};
use shared_types::Quaternion as Attitude;

pub(super) const WORLD: &str = "world";
pub(super) const VEHICLE: &str = "vehicle";
pub(super) const LEVEL: &str = "vehicle_level";
pub(super) const ARMS: [&str; 4] = ["arm_1", "arm_2", "arm_3", "arm_4"];
pub(super) const FOREARMS: [&str; 4] = ["forearm_1", "forearm_2", "forearm_3", "forearm_4"];
pub(super) const ROTORS: [&str; 4] = ["rotor_1", "rotor_2", "rotor_3", "rotor_4"];

/// Position in the world \[m\] and attitude.
pub(super) type Place = ([f64; 3], Attitude);

pub(super) const fn vector([x, y, z]: [f64; 3]) -> Vector3 {
    Vector3 { x, y, z }
}

const fn rotation(q: Attitude) -> Quaternion {
    Quaternion { x: q.x, y: q.y, z: q.z, w: q.w }
}

/// About z.
fn turned(angle_rad: f64) -> Quaternion {
    let (z, w) = libm::sincos(0.5 * angle_rad);
    Quaternion { x: 0.0, y: 0.0, z, w }
}

/// A point at a distance from the axis, in a direction.
pub(super) fn polar(length_m: f64, angle_rad: f64) -> [f64; 3] {
    let (sine, cosine) = libm::sincos(angle_rad);
    [length_m * cosine, length_m * sine, 0.0]
}

pub(super) fn of_vehicle(
    (position_w_m, q_wb): Place,
    fold: &Fold,
    stamp: Timestamp,
) -> FrameTransforms {
    let frame = |parent: &str, child: &str, translation, rotation| FrameTransform {
        timestamp: Some(stamp),
        parent_frame_id: parent.to_owned(),
        child_frame_id: child.to_owned(),
        translation: Some(vector(translation)),
        rotation: Some(rotation),
    };
    let mut transforms = Vec::with_capacity(14);
    transforms.push(frame(WORLD, VEHICLE, position_w_m, rotation(q_wb)));
    transforms.push(frame(WORLD, LEVEL, position_w_m, turned(0.0)));
    for (i, direction_rad) in DIRECTIONS_RAD.into_iter().enumerate() {
        let hinge = polar(fold.hinge_m, direction_rad);
        transforms.push(frame(VEHICLE, ARMS[i], hinge, turned(direction_rad + fold.bend_rad)));
        let elbow = [fold.link_m, 0.0, 0.0];
        transforms.push(frame(ARMS[i], FOREARMS[i], elbow, turned(-2.0 * fold.bend_rad)));
        let rotor = polar(fold.arm_m, direction_rad);
        transforms.push(frame(VEHICLE, ROTORS[i], rotor, turned(0.0)));
    }
    FrameTransforms { transforms }
}

pub(super) fn pose((position_w_m, q_wb): Place, stamp: Timestamp) -> PoseInFrame {
    let pose = Pose { position: Some(vector(position_w_m)), orientation: Some(rotation(q_wb)) };
    PoseInFrame { timestamp: Some(stamp), frame_id: WORLD.to_owned(), pose: Some(pose) }
}
