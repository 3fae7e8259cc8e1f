//! The monitor as a process: it reads what a real vehicle can measure or estimate, and publishes trips.

use crate::judge::{Applied, Finding, Findings, Judge, JudgeMemory, Moment, Setpoint};
use crate::limits::Limits;
use controller::preview::{Landing, target};
use nalgebra::Vector3;
use runtime::{Link, Service, inputs, outputs};
use shared_types::{
    AppliedCommand, AppliedSetpoint, GateMode, NO_SEAT, OwnerRecord, Reference, Role,
    StateEstimate, Trip, TripCause, topics,
};
use vehicle::{MorphAngle, VehicleParameters, rotation};

/// Age above which an estimate is ignored, because it no longer shows what the owner does \[ns\]; twice the
/// period of the monitor where that is longer.
const STALE_NS: u64 = 20_000_000;
/// Longest step over which motion is integrated \[s\]. After a longer pause the step counts as zero, so that
/// a gap in the estimates is not mistaken for a motion.
const LONGEST_STEP_S: f64 = 0.1;

inputs! {
    /// What an owner is judged by. A trip is traced back to the state estimate, the primary input.
    pub struct Inputs {
        /// Estimated state of the vehicle.
        state_estimate: StateEstimate = topics::STATE_ESTIMATE,
        /// Command that the plant applied to the rotors.
        applied_command: AppliedCommand = topics::APPLIED_COMMAND,
        /// Set point that the attitude loop tracks.
        applied_setpoint: AppliedSetpoint = topics::APPLIED_SETPOINT,
        /// Trajectory to follow.
        reference: Reference = topics::REFERENCE,
        /// Owner of the attitude slot.
        attitude_owner: OwnerRecord = topics::ATTITUDE_OWNER,
        /// Owner of the position slot.
        position_owner: OwnerRecord = topics::POSITION_OWNER,
    }
}

outputs! {
    /// What the monitor publishes.
    pub struct Outputs {
        /// Takes command from an owner.
        trip: Trip = topics::TRIP,
    }
}

/// Configuration of the monitor, fixed for a flight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MonitorConfig {
    /// Thresholds.
    pub limits: Limits,
    /// Period of the loop \[s\].
    pub period_s: f64,
    /// Latency of the trip topic: from a step of the monitor to the instant at which its trip takes effect
    /// \[s\].
    pub latency_s: f64,
    /// Landing that position controllers fly when the reference has ended; it replaces the reference then.
    pub landing: Landing,
}

shared_types::memory! {
    /// State of the monitor between two steps.
    #[derive(PartialEq)]
    pub struct Memory {
        /// State of the criteria.
        pub judge: JudgeMemory,
        /// Set point that the attitude slot's owner tracks: φ, θ, ψ \[rad\] and T \[N\].
        pub setpoint: [f64; 4],
        /// Whether a set point has been received.
        pub has_setpoint: bool,
        /// Owners of attitude and position slot at the last step, [`NO_SEAT`] for none.
        pub owners: [u32; 2],
        /// Epochs of the last trips published for the attitude and the position slot; 0 for none.
        pub tripped: [u64; 2],
        /// Instant of the last step \[ns\].
        pub seen_ns: u64,
    }
}

/// The owner of a slot, if it is to be judged.
#[derive(Debug, Clone, Copy)]
struct Watched {
    epoch: u64,
    instance: u32,
}

/// The monitor between its ports.
#[derive(Debug)]
pub struct Monitor {
    judge: Judge,
    landing: Landing,
    stale_ns: u64,
    memory: Memory,
}

impl Monitor {
    /// A monitor at the beginning of a flight, for a vehicle with these parameters.
    #[must_use]
    pub fn new(config: &MonitorConfig, vehicle: &VehicleParameters) -> Self {
        let command_s = config.period_s + config.latency_s;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "positive")]
        let period_ns = (1e9 * config.period_s).ceil() as u64;
        Self {
            judge: Judge::new(config.limits, vehicle, command_s),
            landing: config.landing,
            stale_ns: STALE_NS.max(2 * period_ns),
            memory: Memory { owners: [NO_SEAT; 2], ..Memory::default() },
        }
    }

    fn take_setpoint(&mut self, inputs: &Inputs) {
        let said = inputs.applied_setpoint.in_command(&inputs.attitude_owner);
        if let Some(said) = said.filter(|said| said.setpoint_sequence > 0) {
            self.memory.setpoint = [said.roll_rad, said.pitch_rad, said.yaw_rad, said.thrust_n];
            self.memory.has_setpoint = true;
        }
    }

    /// The owners to judge at `now_ns`, of the attitude and the position slot; `None` where the owner is not
    /// watched, or the fallback commands in its place. A change of owner resets the criteria, since the new
    /// owner is not to blame for the old one.
    fn watched(&mut self, now_ns: u64, inputs: &Inputs) -> [Option<Watched>; 2] {
        let records = [&inputs.attitude_owner, &inputs.position_owner];
        let records = records.map(|records| records.in_effect_at(now_ns));
        let owners = records.map(|record| record.map_or(NO_SEAT, |record| record.owner));
        if owners != self.memory.owners {
            self.memory.owners = owners;
            self.judge.forget();
        }
        let command = inputs.applied_command.latest();
        let setpoint = inputs.applied_setpoint.latest();
        let attitude_failed_over = command.is_some_and(|applied| applied.failed_over.is_set());
        let position_failed_over = setpoint.is_some_and(|applied| applied.failed_over.is_set());
        let mut watched = records.map(|record| {
            let record = record.filter(|record| record.watched.is_set())?;
            Some(Watched { epoch: record.epoch, instance: record.owner })
        });
        watched[0].take_if(|_| attitude_failed_over);
        watched[1].take_if(|_| position_failed_over);
        watched
    }

    fn moment(&mut self, now_ns: u64, inputs: &Inputs) -> Option<Moment> {
        let Link::Fresh(estimate) = inputs.state_estimate.link(now_ns, self.stale_ns) else {
            return None;
        };
        let elapsed_s = now_ns.saturating_sub(self.memory.seen_ns) as f64 * 1e-9;
        self.memory.seen_ns = now_ns;
        let [roll, pitch, yaw, thrust_n] = self.memory.setpoint;
        let setpoint = Setpoint { gamma_rad: Vector3::new(roll, pitch, yaw), thrust_n };
        let applied = inputs.applied_command.latest().map(|applied| Applied {
            thrust_n: applied.thrust_n,
            is_commanded: applied.mode == GateMode::Normal && applied.command_sequence > 0,
        });
        let reference = inputs.reference.latest().map(|reference| {
            let target = target(reference, now_ns, 0.0, &self.landing);
            [target.position_w_m, target.velocity_w_m_s]
        });
        Some(Moment {
            now_ns,
            elapsed_s: if elapsed_s > LONGEST_STEP_S { 0.0 } else { elapsed_s },
            morph_angle: MorphAngle::saturating_from_rad(estimate.morph_angle_rad)?,
            q_wb: rotation(estimate.q_wb.to_array()),
            rate_b_rad_s: estimate.body_rate_b_rad_s.into(),
            position_w_m: estimate.position_w_m.into(),
            velocity_w_m_s: estimate.velocity_w_m_s.into(),
            setpoint: self.memory.has_setpoint.then_some(setpoint),
            applied,
            reference,
        })
    }
}

/// Assigns the findings to the watched owners. If only one slot is watched, its owner is blamed for all of
/// them: the owner of the other slot is not watched any more because it has proven itself.
fn blame(findings: Findings, watched: [bool; 2]) -> [Option<Finding>; 2] {
    let Findings { attitude, position } = findings;
    match watched {
        [true, true] => [attitude, position],
        [true, false] => [attitude.or(position), None],
        [false, true] => [None, position.or(attitude)],
        [false, false] => [None, None],
    }
}

/// Builds the trip for a finding; the cause decides which of the sample's fields carry number and limit.
fn trip(slot: Role, owner: Watched, finding: &Finding) -> Trip {
    let Finding { cause, value, limit, lasted_s } = *finding;
    let common = Trip {
        epoch: owner.epoch,
        slot,
        instance: owner.instance,
        cause,
        lasted_s,
        ..Trip::default()
    };
    match cause {
        TripCause::RateOscillates => Trip {
            rate_rad_s: value,
            rate_limit_rad_s: limit,
            reversals: Judge::reversals(),
            ..common
        },
        TripCause::SetpointOscillates => Trip {
            angle_rad: value,
            angle_limit_rad: limit,
            reversals: Judge::reversals(),
            ..common
        },
        TripCause::ThrustAstray => Trip { speed_m_s: value, speed_limit_m_s: limit, ..common },
        TripCause::PositionDeparts | TripCause::Sinks => {
            Trip { distance_m: value, distance_limit_m: limit, ..common }
        }
        _ => Trip { angle_rad: value, angle_limit_rad: limit, ..common },
    }
}

impl Service for Monitor {
    type Inputs = Inputs;
    type Outputs = Outputs;
    type Memory = Memory;

    fn step(&mut self, now_ns: u64, inputs: &Inputs, outputs: &mut Outputs) {
        self.take_setpoint(inputs);
        let watched = self.watched(now_ns, inputs);
        if watched.iter().all(Option::is_none) {
            return;
        }
        let Some(moment) = self.moment(now_ns, inputs) else { return };
        let findings = self.judge.see(&moment);
        let found = blame(findings, watched.map(|owner| owner.is_some()));
        for (index, slot) in [Role::Attitude, Role::Position].into_iter().enumerate() {
            let (Some(owner), Some(finding)) = (watched[index], &found[index]) else { continue };
            // One trip per epoch is enough, and one sample per step: a second one follows at the next step.
            if self.memory.tripped[index] < owner.epoch {
                self.memory.tripped[index] = owner.epoch;
                outputs.trip.write(trip(slot, owner, finding));
                break;
            }
        }
    }

    fn memory(&self) -> Memory {
        Memory { judge: self.judge.memory(), ..self.memory }
    }

    fn restore(&mut self, memory: &Memory) -> Result<(), String> {
        self.judge.restore(&memory.judge);
        self.memory = *memory;
        Ok(())
    }
}
