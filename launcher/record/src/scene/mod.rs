//! A flight as viewers draw it: frames, poses and shapes, in the messages that Foxglove and its kin
//! know, derived from the samples alone.
//!
//! Each message comes from one sample of one topic, the first in each [`Channel::period_ns`] of logical
//! time: two recordings of a flight hold the same, in whatever order topics were drained. What belongs to
//! another topic is placed by frames: thrust arrows stand in the frames of their rotors.

mod cloud;
mod frames;
mod linkage;
mod shapes;
mod trail;

use core::any::Any;
use foxglove::messages::{FrameTransforms, PointCloud, PoseInFrame, SceneUpdate, Timestamp};
use foxglove::{Encode, Schema};
use linkage::Linkage;
use prost::Message;
use shared_types::{
    ActuatorState, Disturbance, Quaternion, Reference, Sample, StateEstimate, Truth,
};
use trail::Trail;
use vehicle::VehicleParameters;

/// Layout of Foxglove and Lichtblick for a flight.
pub const LAYOUT: &str = include_str!("../../assets/foxglove-layout.json");
/// Layout for `PlotJuggler`, which opens a recording by it: without its dialog, and without the channels that
/// are of use in three dimensions alone.
const PLOTJUGGLER_LAYOUT: &str = include_str!("../../assets/plotjuggler-layout.xml");

/// The layout with which `PlotJuggler` opens this recording.
#[must_use]
pub fn plotjuggler_layout(recording: &str) -> String {
    let name = [("&", "&amp;"), ("<", "&lt;"), (">", "&gt;"), ("\"", "&quot;")]
        .into_iter()
        .fold(recording.to_owned(), |name, (letter, written)| name.replace(letter, written));
    PLOTJUGGLER_LAYOUT.replace("RECORDING", &name)
}

/// A channel of derived messages.
#[derive(Debug, Clone, Copy)]
pub struct Channel {
    /// Topic in the file.
    pub name: &'static str,
    /// Topic of the flight whose samples it is derived from.
    pub from: &'static str,
    /// Logical time of which the first sample counts \[ns\].
    pub period_ns: u64,
    /// What it shows.
    pub summary: &'static str,
    /// Name of the message, and its descriptors.
    pub schema: fn() -> Option<Schema>,
}

const HZ_50_NS: u64 = 20_000_000;

/// All channels; a message names its own by the index.
pub const CHANNELS: [Channel; 11] = [
    Channel {
        name: "/tf",
        from: "truth",
        period_ns: HZ_50_NS,
        summary: "frames of vehicle, arms and rotors",
        schema: FrameTransforms::get_schema,
    },
    Channel {
        name: "/pose/vehicle",
        from: "truth",
        period_ns: HZ_50_NS,
        summary: "where the vehicle is",
        schema: PoseInFrame::get_schema,
    },
    Channel {
        name: "/pose/estimate",
        from: "state_estimate",
        period_ns: HZ_50_NS,
        summary: "where the estimator believes it to be",
        schema: PoseInFrame::get_schema,
    },
    Channel {
        name: "/pose/reference",
        from: "reference",
        period_ns: HZ_50_NS,
        summary: "where it is to be",
        schema: PoseInFrame::get_schema,
    },
    Channel {
        name: "/scene/vehicle",
        from: "truth",
        period_ns: 500_000_000,
        summary: "body, arms and rotor discs, which move with their frames",
        schema: SceneUpdate::get_schema,
    },
    Channel {
        name: "/scene/thrust",
        from: "actuator_state",
        period_ns: HZ_50_NS,
        summary: "an arrow for the thrust of each rotor",
        schema: SceneUpdate::get_schema,
    },
    Channel {
        name: "/scene/disturbance",
        from: "disturbance",
        period_ns: HZ_50_NS,
        summary: "arrows for external force and wind",
        schema: SceneUpdate::get_schema,
    },
    Channel {
        name: "/scene/flown",
        from: "truth",
        period_ns: 500_000_000,
        summary: "the path flown in the last twenty seconds",
        schema: SceneUpdate::get_schema,
    },
    Channel {
        name: "/scene/reference",
        from: "reference",
        period_ns: 500_000_000,
        summary: "the path that was to be flown, and the one ahead",
        schema: SceneUpdate::get_schema,
    },
    Channel {
        name: "/cloud/vehicle",
        from: "truth",
        period_ns: 100_000_000,
        summary: "body, arms and rotors as points, for viewers that know no scene",
        schema: PointCloud::get_schema,
    },
    Channel {
        name: "/cloud/flown",
        from: "truth",
        period_ns: 1_000_000_000,
        summary: "the path flown in the last twenty seconds, as points",
        schema: PointCloud::get_schema,
    },
];

const TF: usize = 0;
const POSE_VEHICLE: usize = 1;
const POSE_ESTIMATE: usize = 2;
const POSE_REFERENCE: usize = 3;
const VEHICLE: usize = 4;
const THRUST: usize = 5;
const DISTURBANCE: usize = 6;
const FLOWN: usize = 7;
const REFERENCE: usize = 8;
const CLOUD_VEHICLE: usize = 9;
const CLOUD_FLOWN: usize = 10;

/// A derived message: index of its channel, and its bytes.
pub type Derived = (usize, Vec<u8>);

/// Derives the messages of one flight.
#[derive(Debug)]
pub struct Scene {
    linkage: Linkage,
    /// Weight \[N\], the measure of thrusts and forces.
    weight_n: f64,
    /// Number of the period of each channel's last message.
    last: [Option<u64>; CHANNELS.len()],
    flown: Trail,
    planned: Trail,
}

impl Scene {
    /// For a vehicle.
    #[must_use]
    pub fn of(vehicle: &VehicleParameters) -> Self {
        Self {
            linkage: Linkage::of(vehicle.geometry),
            weight_n: vehicle.mass_kg * vehicle.gravity_m_s2,
            last: [None; CHANNELS.len()],
            flown: Trail::default(),
            planned: Trail::default(),
        }
    }

    /// What a sample shows, if it is the first in its period; `stamp_ns` is Unix time.
    pub fn observe<T: Sample>(&mut self, sample: &T, stamp_ns: u64) -> Vec<Derived> {
        let sample: &dyn Any = sample;
        let mut out = Vec::new();
        if let Some(truth) = sample.downcast_ref::<Truth>() {
            self.truth(truth, stamp_ns, &mut out);
        } else if let Some(estimate) = sample.downcast_ref::<StateEstimate>() {
            if self.is_due(POSE_ESTIMATE, estimate.header.release_ns) {
                let place = (estimate.position_w_m, estimate.q_wb);
                put(POSE_ESTIMATE, &frames::pose(place, stamp(stamp_ns)), &mut out);
            }
        } else if let Some(reference) = sample.downcast_ref::<Reference>() {
            self.reference(reference, stamp_ns, &mut out);
        } else if let Some(state) = sample.downcast_ref::<ActuatorState>() {
            if self.is_due(THRUST, state.header.release_ns) {
                let scale_m_n = 4.0 * self.linkage.shortest_m() / self.weight_n;
                let arrows = shapes::thrusts(&state.rotor_thrust_n, scale_m_n, stamp(stamp_ns));
                put(THRUST, &arrows, &mut out);
            }
        } else if let Some(disturbance) = sample.downcast_ref::<Disturbance>()
            && self.is_due(DISTURBANCE, disturbance.header.release_ns)
        {
            let arrows = shapes::disturbance(disturbance, self.weight_n, stamp(stamp_ns));
            put(DISTURBANCE, &arrows, &mut out);
        }
        out
    }

    fn truth(&mut self, truth: &Truth, stamp_ns: u64, out: &mut Vec<Derived>) {
        let release_ns = truth.header.release_ns;
        let place = (truth.position_w_m, truth.q_wb);
        self.flown.add(release_ns, truth.position_w_m);
        if self.is_due(TF, release_ns) {
            let fold = self.linkage.fold(truth.morph_angle_rad);
            put(TF, &frames::of_vehicle(place, &fold, stamp(stamp_ns)), out);
        }
        if self.is_due(POSE_VEHICLE, release_ns) {
            put(POSE_VEHICLE, &frames::pose(place, stamp(stamp_ns)), out);
        }
        if self.is_due(VEHICLE, release_ns) {
            let fold = self.linkage.fold(truth.morph_angle_rad);
            put(VEHICLE, &shapes::vehicle(&self.linkage, &fold, stamp(stamp_ns)), out);
        }
        if self.is_due(FLOWN, release_ns) {
            let line = shapes::path("flown", self.flown.points(), shapes::BLUE, 3.0);
            put(FLOWN, &shapes::lines("flown", vec![line], stamp(stamp_ns)), out);
        }
        if self.is_due(CLOUD_VEHICLE, release_ns) {
            let fold = self.linkage.fold(truth.morph_angle_rad);
            put(CLOUD_VEHICLE, &cloud::vehicle(&self.linkage, &fold, stamp(stamp_ns)), out);
        }
        if self.is_due(CLOUD_FLOWN, release_ns) {
            put(CLOUD_FLOWN, &cloud::path(self.flown.points(), stamp(stamp_ns)), out);
        }
    }

    fn reference(&mut self, reference: &Reference, stamp_ns: u64, out: &mut Vec<Derived>) {
        let release_ns = reference.header.release_ns;
        let [point, ..] = reference.points;
        self.planned.add(release_ns, point.position_w_m);
        if self.is_due(POSE_REFERENCE, release_ns) {
            let (half_sin, half_cos) = libm::sincos(0.5 * point.yaw_rad);
            let q_wb = Quaternion { w: half_cos, x: 0.0, y: 0.0, z: half_sin };
            put(POSE_REFERENCE, &frames::pose((point.position_w_m, q_wb), stamp(stamp_ns)), out);
        }
        if self.is_due(REFERENCE, release_ns) {
            let count = usize::try_from(reference.count).unwrap_or(usize::MAX);
            let ahead = reference.points.iter().take(count).map(|point| point.position_w_m);
            let lines = vec![
                shapes::path("planned", self.planned.points(), shapes::ORANGE, 1.5),
                shapes::path("ahead", ahead, shapes::PURPLE, 3.0),
            ];
            put(REFERENCE, &shapes::lines("reference", lines, stamp(stamp_ns)), out);
        }
    }

    /// True for the first sample of a period.
    fn is_due(&mut self, channel: usize, release_ns: u64) -> bool {
        let period = Some(release_ns / CHANNELS[channel].period_ns);
        core::mem::replace(&mut self.last[channel], period) != period
    }
}

fn put(channel: usize, message: &impl Message, out: &mut Vec<Derived>) {
    out.push((channel, message.encode_to_vec()));
}

fn stamp(unix_ns: u64) -> Timestamp {
    let (whole, rest) = (unix_ns / 1_000_000_000, unix_ns % 1_000_000_000);
    Timestamp::new(
        u32::try_from(whole).unwrap_or(u32::MAX),
        u32::try_from(rest).unwrap_or_default(),
    )
}
