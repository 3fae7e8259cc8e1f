//! The floor plan: every topic of the flight, once.
//!
//! Ports, recorder, command line and documentation iterate over this table. A new topic is one
//! sample type and one line here.

use crate::Role;
use crate::header::Sample;
use crate::wire::Schema;
use core::marker::PhantomData;

/// How the logical time of an arrow is judged (see `launcher/docs/time.md`).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Edge {
    /// The consumer's step at t starts when this input is final through t.
    ZeroLatency,
    /// Effective a declared latency after release; never waited for in realtime.
    Delayed,
    /// No loop reads it; it exists for the recorder.
    RecordOnly,
}

/// Facts about a topic that do not depend on its sample type.
#[derive(Debug, Clone, Copy)]
pub struct TopicInfo {
    /// Its number in the hashes of a flight, which no other topic ever gets: a new topic takes the next one.
    pub id: u32,
    /// Service name.
    pub name: &'static str,
    /// One line for tables and documentation.
    pub summary: &'static str,
    /// Producing role; a slot's role stands for the controller that holds the slot.
    pub from: Role,
    /// Consuming roles, recorder aside.
    pub to: &'static [Role],
    /// Kind of the arrow.
    pub edge: Edge,
    /// Samples kept for a consumer that joins late.
    pub history: usize,
    /// True if the flight hash covers the topic.
    pub in_flight_hash: bool,
}

/// A topic with its sample type.
#[derive(Debug)]
pub struct Topic<T> {
    /// Untyped facts.
    pub info: TopicInfo,
    sample: PhantomData<fn() -> T>,
}

impl<T: Sample> Topic<T> {
    const fn new(info: TopicInfo) -> Self {
        Self { info, sample: PhantomData }
    }

    /// Layout of the sample.
    #[must_use]
    pub const fn schema(&self) -> Schema {
        T::SCHEMA
    }
}

/// Does something for every topic, with its type.
pub trait TopicVisitor {
    /// What can go wrong.
    type Error;
    /// Called once per topic, in table order.
    ///
    /// # Errors
    /// Whatever the visitor meets; it ends the walk.
    fn visit<T: Sample>(&mut self, topic: &'static Topic<T>) -> Result<(), Self::Error>;
}

macro_rules! floor_plan {
    ($($id:literal $constant:ident $name:literal : $sample:ident, $from:ident => [$($to:ident),*],
        $edge:ident, history $history:literal $(, $hashed:ident)? ; $summary:literal)+) => {
        $(#[doc = $summary]
        pub static $constant: Topic<crate::$sample> = Topic::new(TopicInfo {
            id: $id,
            name: $name,
            summary: $summary,
            from: Role::$from,
            to: &[$(Role::$to),*],
            edge: Edge::$edge,
            history: $history,
            in_flight_hash: false $(|| stringify!($hashed).len() > 0)?,
        });)+

        /// Every topic, untyped, in table order.
        #[must_use]
        pub fn all() -> [&'static TopicInfo; [$(stringify!($constant)),+].len()] {
            [$(&$constant.info),+]
        }

        /// Walks every topic, typed, in table order.
        ///
        /// # Errors
        /// The visitor's first error.
        pub fn visit_all<V: TopicVisitor>(visitor: &mut V) -> Result<(), V::Error> {
            $(visitor.visit(&$constant)?;)+
            Ok(())
        }

        /// Shows one topic, typed, by its name; nothing if the table has none of that name.
        ///
        /// # Errors
        /// The visitor's.
        pub fn visit_named<V: TopicVisitor>(name: &str, visitor: &mut V) -> Result<(), V::Error> {
            match name {
                $($name => visitor.visit(&$constant),)+
                _ => Ok(()),
            }
        }
    };
}

floor_plan! {
    1 IMU "imu": Imu, Plant => [Estimator], ZeroLatency, history 128;
        "angular rate and specific force"
    2 POSE_FIX "pose_fix": PoseFix, Plant => [Estimator], ZeroLatency, history 32;
        "delayed position and attitude from a tracker"
    3 MORPH_ANGLE "morph_angle": MorphAngle, Plant => [Estimator], ZeroLatency, history 64;
        "encoder reading of the deployable angle"
    4 APPLIED_COMMAND "applied_command": AppliedCommand, Plant => [Position, Attitude, Monitor], ZeroLatency, history 128, hashed;
        "wrench and rotor thrusts the gate applied"
    5 TRUTH "truth": Truth, Plant => [], RecordOnly, history 1, hashed;
        "real state of the vehicle"
    6 ACTUATOR_STATE "actuator_state": ActuatorState, Plant => [], RecordOnly, history 1;
        "real rotor thrusts"
    7 STATE_ESTIMATE "state_estimate": StateEstimate, Estimator => [Plant, Position, Attitude, Monitor], ZeroLatency, history 128, hashed;
        "believed state with one-sigma errors"
    8 REFERENCE "reference": Reference, Pilot => [Plant, Position, Attitude, Monitor], ZeroLatency, history 32;
        "trajectory to follow, with preview"
    9 MORPH_COMMAND "morph_command": MorphCommand, Pilot => [Plant, Position, Attitude], ZeroLatency, history 32;
        "commanded deployable angle, with its path"
    10 ATTITUDE_SETPOINT "attitude_setpoint": AttitudeSetpoint, Position => [Attitude, Monitor], Delayed, history 32;
        "thrust and Euler angles for the attitude loop"
    11 APPLIED_SETPOINT "applied_setpoint": AppliedSetpoint, Attitude => [Position, Monitor], Delayed, history 64;
        "set point the attitude loop tracks"
    12 WRENCH_COMMAND "wrench_command": WrenchCommand, Attitude => [Plant], Delayed, history 64;
        "thrust and torque asked of the rotors"
    13 POSITION_REPORT "position_report": PositionReport, Position => [], RecordOnly, history 1;
        "bounds, verdict and effort of the position controller"
    14 ATTITUDE_REPORT "attitude_report": AttitudeReport, Attitude => [], RecordOnly, history 1;
        "bounds, verdict and effort of the attitude controller"
    15 DISTURBANCE "disturbance": Disturbance, Disturbance => [Plant], ZeroLatency, history 64;
        "wind, force, torque, payload and rotor faults"
    16 TRIP "trip": Trip, Monitor => [Plant, Attitude], Delayed, history 32;
        "an owner that is not to be followed any more, and why"
    17 ATTITUDE_OWNER "attitude_owner": OwnerRecord, Supervisor => [Plant, Position, Monitor], Delayed, history 16;
        "owner of the attitude slot"
    18 POSITION_OWNER "position_owner": OwnerRecord, Supervisor => [Attitude, Monitor], Delayed, history 16;
        "owner of the position slot"
    19 GUIDANCE_ORDER "guidance_order": GuidanceOrder, Supervisor => [Pilot], Delayed, history 16;
        "where to go and how wide to spread the arms, as ordered in flight"
    20 DISTURBANCE_ORDER "disturbance_order": DisturbanceOrder, Supervisor => [Disturbance], Delayed, history 16;
        "disturbances ordered in flight"
    21 LOOP_STATS "loop_stats": LoopStats, Supervisor => [], RecordOnly, history 8;
        "running totals of every loop"
    22 DEVIATION "deviation": Deviation, Supervisor => [], RecordOnly, history 64;
        "where a step's inputs were not what edges and time prescribe"
    23 SEATING "seating": Seating, Supervisor => [], RecordOnly, history 64;
        "who takes a slot's seat in flight, and how it begins"
    24 BAROMETER "barometer": Barometer, Plant => [Estimator], ZeroLatency, history 32;
        "height by air pressure, if there is a barometer"
    25 RANGE_FINDER "range_finder": RangeFinder, Plant => [Estimator], ZeroLatency, history 32;
        "distance to the ground below, if there is a range finder"
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::Kind;
    use core::convert::Infallible;

    const UNITS: [&str; 11] =
        ["_m", "_m_s", "_m_s2", "_rad", "_rad_s", "_rad_s2", "_n", "_nm", "_kg", "_s", "_ns"];
    /// Numbers that have no unit: parts of a unit quaternion, a statistic, shares.
    const PURE: [&str; 7] = ["w", "x", "y", "z", "pose_fix_nis", "efficiency", "rotor_efficiency"];

    fn check(schema: &Schema) {
        for field in schema.fields {
            let (of, name) = (schema.name, field.name);
            match field.kind {
                Kind::F64 => {
                    let has_unit = UNITS.iter().any(|unit| name.ends_with(unit));
                    assert!(has_unit || PURE.contains(&name), "{of}.{name} names no unit");
                }
                Kind::Message(inner) => check(inner),
                _ => {}
            }
        }
    }

    /// Numbers that have been given, with the names of today; a topic that goes leaves its number here.
    const GIVEN: [(u32, &str); 25] = [
        (1, "imu"),
        (2, "pose_fix"),
        (3, "morph_angle"),
        (4, "applied_command"),
        (5, "truth"),
        (6, "actuator_state"),
        (7, "state_estimate"),
        (8, "reference"),
        (9, "morph_command"),
        (10, "attitude_setpoint"),
        (11, "applied_setpoint"),
        (12, "wrench_command"),
        (13, "position_report"),
        (14, "attitude_report"),
        (15, "disturbance"),
        (16, "trip"),
        (17, "attitude_owner"),
        (18, "position_owner"),
        (19, "guidance_order"),
        (20, "disturbance_order"),
        (21, "loop_stats"),
        (22, "deviation"),
        (23, "seating"),
        (24, "barometer"),
        (25, "range_finder"),
    ];

    #[test]
    fn every_topic_has_a_number_of_its_own_that_it_keeps() {
        for info in all() {
            assert!(GIVEN.contains(&(info.id, info.name)), "{}, {}", info.id, info.name);
        }
        let mut numbers = GIVEN.map(|(id, _)| id);
        numbers.sort_unstable();
        assert!(numbers.windows(2).all(|pair| pair[0] < pair[1]), "{numbers:?}");
    }

    #[test]
    fn every_number_on_every_topic_names_its_unit() {
        struct Check;
        impl TopicVisitor for Check {
            type Error = Infallible;
            fn visit<T: Sample>(&mut self, topic: &'static Topic<T>) -> Result<(), Infallible> {
                check(&topic.schema());
                Ok(())
            }
        }
        let Ok(()) = visit_all(&mut Check);
    }
}
