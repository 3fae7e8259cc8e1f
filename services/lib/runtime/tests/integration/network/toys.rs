//! Services whose outputs are hashes of everything they see and remember, so that a sample which
//! comes a step early, late, twice or in another order changes all that follows.

use runtime::{Input, Service, inputs, outputs};
use shared_types::{
    ActuatorState, AppliedCommand, AppliedSetpoint, AttitudeReport, AttitudeSetpoint, Barometer,
    Disturbance, Imu, MorphAngle, MorphCommand, PoseFix, PositionReport, RangeFinder, Reference,
    Sample, StateEstimate, Trip, Truth, WrenchCommand, topics,
};

/// Steps a hash by one word.
pub(crate) fn mix(hash: u64, word: u64) -> u64 {
    let mut z = (hash ^ word).wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// A sample that can carry a hash in one of its numbers.
trait Carrier: Sample {
    fn number(&mut self) -> &mut f64;
}

macro_rules! carrier {
    ($($sample:ident => |$s:ident| $place:expr),+ $(,)?) => { $(
        impl Carrier for $sample {
            fn number(&mut self) -> &mut f64 {
                let $s = self;
                &mut $place
            }
        }
    )+ };
}

carrier!(
    Imu => |s| s.gyro_b_rad_s[0],
    PoseFix => |s| s.position_w_m[0],
    MorphAngle => |s| s.angle_rad,
    Barometer => |s| s.height_w_m,
    RangeFinder => |s| s.range_m,
    AppliedCommand => |s| s.thrust_n,
    Truth => |s| s.position_w_m[0],
    ActuatorState => |s| s.morph_command_rad,
    StateEstimate => |s| s.position_w_m[0],
    Reference => |s| s.points[0].yaw_rad,
    MorphCommand => |s| s.angle_rad,
    AttitudeSetpoint => |s| s.thrust_n,
    AppliedSetpoint => |s| s.thrust_n,
    WrenchCommand => |s| s.thrust_n,
    AttitudeReport => |s| s.torque_b_nm[0],
    PositionReport => |s| s.input.thrust_n,
    Disturbance => |s| s.payload_kg,
    Trip => |s| s.angle_rad,
);

fn absorb<T: Carrier>(hash: u64, input: &Input<T>) -> u64 {
    let one = |hash, sample: &T| {
        let mut sample = *sample;
        let header = *sample.header();
        [header.sequence, header.valid_ns, header.cause_sequence, sample.number().to_bits()]
            .into_iter()
            .fold(hash, mix)
    };
    let hash = mix(hash, input.fresh().len() as u64);
    let hash = input.fresh().iter().fold(hash, one);
    let hash = input.before_fresh().map_or(hash, |s| one(hash, s));
    input.latest().map_or(mix(hash, 7), |s| one(hash, s))
}

shared_types::memory! {
    /// What a toy remembers.
    pub(crate) struct ToyMemory {
        /// Hash of everything so far.
        pub(crate) mixed: u64,
        /// Steps run.
        pub(crate) steps: u64,
    }
}

/// The monitor is quiet in most of each tenth of a second.
fn quiet_until_ns(toy: &str, from_ns: u64) -> u64 {
    let (turn_ns, loud_ns) = (100_000_000, 23_000_000);
    let until_ns = from_ns - from_ns % turn_ns + turn_ns - loud_ns;
    if toy == "monitor" { until_ns.max(from_ns) } else { from_ns }
}

/// `one_in` 1 publishes every step, n about every n-th, as the hash decides.
macro_rules! toy {
    ($name:ident, [$($input:ident : $in_sample:ident = $in_topic:ident),*],
        [$($output:ident : $out_sample:ident = $out_topic:ident / $one_in:literal),*]) => {
        pub(crate) mod $name {
            use super::{Carrier as _, Service, ToyMemory, inputs, mix, outputs, topics};

            inputs! {
                /// What the toy reads.
                pub struct Inputs { $($input : super::$in_sample = topics::$in_topic),* }
            }
            outputs! {
                /// What the toy writes.
                pub struct Outputs { $($output : super::$out_sample = topics::$out_topic),* }
            }

            /// The toy.
            #[derive(Debug, Default)]
            pub(crate) struct Toy {
                memory: ToyMemory,
            }

            impl Service for Toy {
                type Inputs = Inputs;
                type Outputs = Outputs;
                type Memory = ToyMemory;

                fn step(&mut self, now_ns: u64, inputs: &Inputs, outputs: &mut Outputs) {
                    let mut hash = mix(self.memory.mixed, now_ns);
                    $(hash = super::absorb(hash, &inputs.$input);)*
                    let _ = inputs;
                    self.memory = ToyMemory { mixed: hash, steps: self.memory.steps + 1 };
                    let is_quiet = self.quiet_until_ns(now_ns, u64::MAX, inputs) > now_ns;
                    $(
                        hash = mix(hash, stringify!($output).len() as u64);
                        if !is_quiet && hash.is_multiple_of($one_in) {
                            let mut sample = super::$out_sample::default();
                            *sample.number() = (hash >> 11) as f64;
                            outputs.$output.write(sample);
                        }
                    )*
                }

                fn quiet_until_ns(&self, from_ns: u64, known_ns: u64, _: &Inputs) -> u64 {
                    super::quiet_until_ns(stringify!($name), from_ns).min(known_ns).max(from_ns)
                }

                fn memory(&self) -> ToyMemory {
                    self.memory
                }

                fn restore(&mut self, memory: &ToyMemory) -> Result<(), String> {
                    self.memory = *memory;
                    if memory.steps == u64::MAX { Err("no toy lives so long".into()) } else { Ok(()) }
                }
            }
        }
    };
}

toy!(plant,
    [wrench_command: WrenchCommand = WRENCH_COMMAND, disturbance: Disturbance = DISTURBANCE,
     morph_command: MorphCommand = MORPH_COMMAND, trip: Trip = TRIP,
     state_estimate: StateEstimate = STATE_ESTIMATE, reference: Reference = REFERENCE],
    [imu: Imu = IMU / 1, pose_fix: PoseFix = POSE_FIX / 10, morph_angle: MorphAngle = MORPH_ANGLE / 2,
     barometer: Barometer = BAROMETER / 7, range_finder: RangeFinder = RANGE_FINDER / 5,
     applied_command: AppliedCommand = APPLIED_COMMAND / 1, truth: Truth = TRUTH / 1,
     actuator_state: ActuatorState = ACTUATOR_STATE / 3]);
toy!(estimator,
    [imu: Imu = IMU, pose_fix: PoseFix = POSE_FIX, morph_angle: MorphAngle = MORPH_ANGLE,
     barometer: Barometer = BAROMETER, range_finder: RangeFinder = RANGE_FINDER],
    [state_estimate: StateEstimate = STATE_ESTIMATE / 1]);
toy!(position,
    [state_estimate: StateEstimate = STATE_ESTIMATE, reference: Reference = REFERENCE,
     applied_setpoint: AppliedSetpoint = APPLIED_SETPOINT, applied_command: AppliedCommand = APPLIED_COMMAND,
     morph_command: MorphCommand = MORPH_COMMAND],
    [attitude_setpoint: AttitudeSetpoint = ATTITUDE_SETPOINT / 1,
     position_report: PositionReport = POSITION_REPORT / 2]);
toy!(attitude,
    [state_estimate: StateEstimate = STATE_ESTIMATE, attitude_setpoint: AttitudeSetpoint = ATTITUDE_SETPOINT,
     applied_command: AppliedCommand = APPLIED_COMMAND, morph_command: MorphCommand = MORPH_COMMAND,
     trip: Trip = TRIP, reference: Reference = REFERENCE],
    [wrench_command: WrenchCommand = WRENCH_COMMAND / 1,
     applied_setpoint: AppliedSetpoint = APPLIED_SETPOINT / 1,
     attitude_report: AttitudeReport = ATTITUDE_REPORT / 1]);
toy!(disturbance, [], [disturbance: Disturbance = DISTURBANCE / 2]);
toy!(monitor,
    [state_estimate: StateEstimate = STATE_ESTIMATE, applied_command: AppliedCommand = APPLIED_COMMAND,
     applied_setpoint: AppliedSetpoint = APPLIED_SETPOINT, attitude_setpoint: AttitudeSetpoint = ATTITUDE_SETPOINT,
     reference: Reference = REFERENCE],
    [trip: Trip = TRIP / 5]);
toy!(pilot, [], [reference: Reference = REFERENCE / 1, morph_command: MorphCommand = MORPH_COMMAND / 1]);
toy!(rig_pilot, [],
    [attitude_setpoint: AttitudeSetpoint = ATTITUDE_SETPOINT / 1,
     morph_command: MorphCommand = MORPH_COMMAND / 2]);
