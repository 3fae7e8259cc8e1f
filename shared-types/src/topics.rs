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
    /// Nobody in the flight reads it; it exists for the recorder.
    RecordOnly,
}

/// Facts about a topic that do not depend on its sample type.
#[derive(Debug, Clone, Copy)]
pub struct TopicInfo {
    /// Service name.
    pub name: &'static str,
    /// One line for tables and documentation.
    pub summary: &'static str,
    /// Producing role; a slot's role stands for whoever holds the slot.
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
    ($($constant:ident $name:literal : $sample:ident, $from:ident => [$($to:ident),*],
        $edge:ident, history $history:literal $(, $hashed:ident)? ; $summary:literal)+) => {
        $(#[doc = $summary]
        pub static $constant: Topic<crate::$sample> = Topic::new(TopicInfo {
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
    IMU "imu": Imu, Plant => [Estimator], ZeroLatency, history 128;
        "angular rate and specific force"
    POSE_FIX "pose_fix": PoseFix, Plant => [Estimator], ZeroLatency, history 32;
        "delayed position and attitude from a tracker"
    MORPH_ANGLE "morph_angle": MorphAngle, Plant => [Estimator], ZeroLatency, history 64;
        "encoder reading of the deployable angle"
    APPLIED_COMMAND "applied_command": AppliedCommand, Plant => [Position, Attitude, Monitor], ZeroLatency, history 64, hashed;
        "wrench and rotor thrusts the gate applied"
    TRUTH "truth": Truth, Plant => [], RecordOnly, history 1, hashed;
        "real state of the vehicle"
    ACTUATOR_STATE "actuator_state": ActuatorState, Plant => [], RecordOnly, history 1;
        "real rotor thrusts"
    STATE_ESTIMATE "state_estimate": StateEstimate, Estimator => [Position, Attitude, Monitor], ZeroLatency, history 64, hashed;
        "believed state with one-sigma errors"
    REFERENCE "reference": Reference, Pilot => [Position, Monitor], ZeroLatency, history 32;
        "trajectory to follow, with preview"
    MORPH_COMMAND "morph_command": MorphCommand, Pilot => [Plant, Position, Attitude], ZeroLatency, history 32;
        "commanded deployable angle, with its path"
    ATTITUDE_SETPOINT "attitude_setpoint": AttitudeSetpoint, Position => [Attitude, Monitor], Delayed, history 32;
        "thrust and Euler angles for the attitude loop"
    APPLIED_SETPOINT "applied_setpoint": AppliedSetpoint, Attitude => [Position, Monitor], Delayed, history 32;
        "set point the attitude loop tracks"
    WRENCH_COMMAND "wrench_command": WrenchCommand, Attitude => [Plant], Delayed, history 64;
        "thrust and torque asked of the rotors"
    POSITION_REPORT "position_report": PositionReport, Position => [], RecordOnly, history 1;
        "bounds, verdict and effort of the position controller"
    ATTITUDE_REPORT "attitude_report": AttitudeReport, Attitude => [], RecordOnly, history 1;
        "bounds, verdict and effort of the attitude controller"
    DISTURBANCE "disturbance": Disturbance, Disturbance => [Plant], ZeroLatency, history 64;
        "wind, force, torque, payload and rotor faults"
    TRIP "trip": Trip, Monitor => [Plant, Attitude], Delayed, history 32;
        "an owner that is not to be obeyed any more, and why"
    ATTITUDE_OWNER "attitude_owner": OwnerRecord, Supervisor => [Plant, Position, Monitor], Delayed, history 16;
        "owner of the attitude slot"
    POSITION_OWNER "position_owner": OwnerRecord, Supervisor => [Attitude, Monitor], Delayed, history 16;
        "owner of the position slot"
    GUIDANCE_ORDER "guidance_order": GuidanceOrder, Supervisor => [Pilot], Delayed, history 16;
        "where to go and how wide to spread the arms, as ordered in flight"
    DISTURBANCE_ORDER "disturbance_order": DisturbanceOrder, Supervisor => [Disturbance], Delayed, history 16;
        "disturbances ordered in flight"
    LOOP_STATS "loop_stats": LoopStats, Supervisor => [], RecordOnly, history 8;
        "running totals of every loop"
    DEVIATION "deviation": Deviation, Supervisor => [], RecordOnly, history 64;
        "where a step's inputs were not what edges and time prescribe"
    SEATING "seating": Seating, Supervisor => [], RecordOnly, history 64;
        "who takes a slot's seat in flight, and how it begins"
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
