//! The spans of a chain, by host stamps. A sum of spans begins at the sensor's intended release, so that
//! a late sensor cannot make a latency shorter.

use super::{Broken, Chain};

/// Two instants of a chain on `CLOCK_MONOTONIC` \[ns\]; 0 where one is not known.
type Ends = (u64, u64);

/// A span of every chain.
#[derive(Debug, Clone, Copy)]
pub struct Segment {
    /// Name for machines.
    pub key: &'static str,
    /// Name for people.
    pub text: &'static str,
    ends: fn(&Chain) -> Option<Ends>,
}

impl Segment {
    /// Length \[ns\]; `None` if the chain does not have it, or one of its stamps.
    #[must_use]
    pub fn of(&self, chain: &Chain) -> Option<u64> {
        let (from, to) = self.known(chain)?;
        to.checked_sub(from)
    }

    pub(super) fn runs_backwards(&self, chain: &Chain) -> bool {
        self.known(chain).is_some_and(|(from, to)| to < from)
    }

    fn known(&self, chain: &Chain) -> Option<Ends> {
        (self.ends)(chain).filter(|(from, to)| *from > 0 && *to > 0)
    }
}

/// Refuses a chain whose stamps run backwards.
pub(super) fn check(chain: &Chain) -> Result<(), Broken> {
    match SEGMENTS.iter().find(|segment| segment.runs_backwards(chain)) {
        Some(segment) => Err(Broken::Backwards(segment.key)),
        None => Ok(()),
    }
}

const fn segment(
    key: &'static str,
    text: &'static str,
    ends: fn(&Chain) -> Option<Ends>,
) -> Segment {
    Segment { key, text, ends }
}

/// Every span, in the order of time; the whole ways after their parts.
pub static SEGMENTS: [Segment; 18] = [
    segment("imu_lateness", "plant late with the imu sample", |c| {
        Some((c.imu.release_mono_ns, c.imu.start_mono_ns))
    }),
    segment("imu_compute", "plant computes", |c| {
        Some((c.imu.start_mono_ns, c.imu.publish_mono_ns))
    }),
    segment("imu_hop", "hop plant to estimator", |c| {
        Some((c.imu.publish_mono_ns, c.estimate.receive_mono_ns))
    }),
    segment("estimator_wait", "estimator waits", |c| {
        Some((c.estimate.receive_mono_ns, c.estimate.start_mono_ns))
    }),
    segment("estimator_compute", "estimator computes", |c| {
        Some((c.estimate.start_mono_ns, c.estimate.publish_mono_ns))
    }),
    segment("estimate_hop", "hop estimator to attitude", |c| {
        Some((c.estimate.publish_mono_ns, c.command.receive_mono_ns))
    }),
    segment("attitude_wait", "attitude loop waits", |c| {
        Some((c.command.receive_mono_ns, c.command.start_mono_ns))
    }),
    segment("attitude_compute", "attitude loop computes", |c| {
        Some((c.command.start_mono_ns, c.command.publish_mono_ns))
    }),
    segment("command_hop", "hop attitude to plant", |c| {
        Some((c.command.publish_mono_ns, c.gate_mono_ns()))
    }),
    segment("gate_hold", "held until in effect", |c| {
        c.effect_mono_ns().map(|effect| (c.gate_mono_ns(), effect))
    }),
    segment("sensor_to_command", "imu due to command sent", |c| {
        Some((c.imu.release_mono_ns, c.command.publish_mono_ns))
    }),
    segment("sensor_to_gate", "imu due to command at plant", |c| {
        Some((c.imu.release_mono_ns, c.gate_mono_ns()))
    }),
    segment("sensor_to_motor", "imu due to rotors", |c| {
        c.effect_mono_ns().map(|effect| (c.imu.release_mono_ns, effect))
    }),
    segment("position_hop", "hop estimator to position", |c| {
        c.setpoint.map(|s| (s.estimate.publish_mono_ns, s.setpoint.receive_mono_ns))
    }),
    segment("position_wait", "position loop waits", |c| {
        c.setpoint.map(|s| (s.setpoint.receive_mono_ns, s.setpoint.start_mono_ns))
    }),
    segment("position_compute", "position loop computes", |c| {
        c.setpoint.map(|s| (s.setpoint.start_mono_ns, s.setpoint.publish_mono_ns))
    }),
    segment("setpoint_use", "set point sent to its use", |c| {
        c.setpoint.map(|s| (s.setpoint.publish_mono_ns, c.command.start_mono_ns))
    }),
    segment("sensor_to_command_by_position", "imu due to command by position", |c| {
        c.setpoint.map(|s| (s.imu.release_mono_ns, c.command.publish_mono_ns))
    }),
];
