//! One command's way from the sensor to the rotors.

use super::links::Links;
use shared_types::Header;
use thiserror::Error;

/// A command with everything it descends from, and what became of it.
#[derive(Debug, Clone, Copy)]
pub struct Chain {
    /// The inertial sample.
    pub imu: Header,
    /// The estimate made of it.
    pub estimate: Header,
    pub command: Header,
    /// The plant's first tick with the command in effect; none for a shadow's, for one that another
    /// followed within the same tick, and at the end of a flight.
    pub tick: Option<Header>,
    /// The set point of the step, if a controller gave it.
    pub setpoint: Option<SetpointChain>,
}

/// Where a command's set point comes from.
#[derive(Debug, Clone, Copy)]
pub struct SetpointChain {
    /// The inertial sample.
    pub imu: Header,
    /// The estimate made of it.
    pub estimate: Header,
    /// The set point.
    pub setpoint: Header,
}

/// Why a command cannot be followed to its sensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum Broken {
    /// The step had nothing to go by.
    #[error("names no estimate that it went by")]
    NoEstimate,
    /// The estimate is not in the file.
    #[error("went by state_estimate {0}, which is not in the file")]
    EstimateMissing(u64),
    /// Nothing had been measured.
    #[error("went by state_estimate {0}, which descends from no imu sample")]
    NoImu(u64),
    /// The sample is not in the file.
    #[error("descends from imu {0}, which is not in the file")]
    ImuMissing(u64),
    /// Command and estimate disagree.
    #[error("claims to descend from imu {stated}; its state_estimate descends from imu {is}")]
    Contradiction {
        /// The cause that the command states.
        stated: u64,
        /// The cause of its estimate.
        is: u64,
    },
    /// Host stamps that no order of events explains.
    #[error("has stamps that run backwards: {0}")]
    Backwards(&'static str),
}

impl Links {
    /// The chain of a command.
    pub(super) fn follow(&self, command: &Header) -> Result<Chain, Broken> {
        let (imu, estimate) = self.origin(command)?;
        let setpoint = self.setpoint(command).and_then(|setpoint| {
            let (imu, estimate) = self.origin(setpoint).ok()?;
            Some(SetpointChain { imu, estimate, setpoint: *setpoint })
        });
        let tick = self.tick(command).copied();
        Ok(Chain { imu, estimate, command: *command, tick, setpoint })
    }

    /// IMU sample and estimate that a step went by.
    fn origin(&self, user: &Header) -> Result<(Header, Header), Broken> {
        if user.input_sequence == 0 {
            return Err(Broken::NoEstimate);
        }
        let missing = Broken::EstimateMissing(user.input_sequence);
        let estimate = self.estimate(user).ok_or(missing)?;
        if estimate.cause_sequence != user.cause_sequence {
            let (stated, is) = (user.cause_sequence, estimate.cause_sequence);
            return Err(Broken::Contradiction { stated, is });
        }
        if estimate.cause_sequence == 0 {
            return Err(Broken::NoImu(estimate.sequence));
        }
        let missing = Broken::ImuMissing(estimate.cause_sequence);
        let imu = self.imu(estimate.cause_sequence).ok_or(missing)?;
        Ok((*imu, *estimate))
    }
}

impl Chain {
    /// Arrival of the command at the plant, if the tick that applied it was the one that saw it last
    /// \[ns\].
    #[must_use]
    pub fn gate_mono_ns(&self) -> u64 {
        let seen = self.tick.filter(|tick| tick.input_sequence == self.command.sequence);
        seen.map_or(0, |tick| tick.receive_mono_ns)
    }

    /// Instant from which the command moved the rotors: the tick's beginning, or the arrival of a command that
    /// the tick, already awake, still took in \[ns\].
    #[must_use]
    pub fn effect_mono_ns(&self) -> Option<u64> {
        self.tick.map(|tick| tick.start_mono_ns.max(self.gate_mono_ns()))
    }

    /// Age of the IMU sample at the instant from which the command is in effect, in logical time
    /// \[ns\].
    #[must_use]
    pub fn age_ns(&self) -> u64 {
        self.command.valid_ns.saturating_sub(self.imu.valid_ns)
    }
}

#[cfg(test)]
mod tests {
    use super::Chain;
    use crate::trace::SEGMENTS;
    use shared_types::Header;

    #[test]
    fn a_command_that_a_tick_takes_in_while_awake_is_held_for_no_time() {
        let header = |receive_mono_ns, start_mono_ns| Header {
            sequence: 7,
            input_sequence: 7,
            release_mono_ns: 100,
            receive_mono_ns,
            start_mono_ns,
            publish_mono_ns: start_mono_ns + 5,
            ..Header::default()
        };
        let command = header(120, 130);
        let chain = |tick| {
            let (imu, estimate) = (header(0, 101), header(110, 112));
            Chain { imu, estimate, command, tick: Some(tick), setpoint: None }
        };
        let of = |key: &str, tick| {
            let segment = SEGMENTS.iter().find(|segment| segment.key == key).unwrap();
            assert!(!segment.runs_backwards(&chain(tick)));
            segment.of(&chain(tick))
        };
        // Awake since 140, the command came at 150; or it waited from 150 to 160.
        for (tick, held, to_motor) in [(header(150, 140), 0, 50), (header(150, 160), 10, 60)] {
            assert_eq!(
                (of("gate_hold", tick), of("sensor_to_motor", tick)),
                (Some(held), Some(to_motor))
            );
        }
    }
}
