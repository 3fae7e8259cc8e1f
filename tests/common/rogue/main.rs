//! A controller that misbehaves when configured to, and a stranger that was never asked.
//!
//! As a candidate (`morphquad swap attitude --to PATH --config FILE`) it flies like the template that
//! users begin with, until the instant at which its file wants something else. As `rogue stray RUN` it forges every
//! field of commands and of whatever a flight follows, and publishes them without a seat; as `rogue usurp RUN` it frees
//! what a dead launcher has left before that.

mod stray;

use host::{BuildError, Config, Flight};
use my_attitude_controller::{Controller, Inputs, Memory};
use runtime::ipc::{Bus, ServiceKind};
use runtime::namespace::Membership;
use runtime::{Service, SetpointSlot, outputs};
use serde::Deserialize;
use shared_types::{AppliedSetpoint, Progress, WrenchCommand, topics};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

/// What to do, and from when on.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct Mischief {
    what: What,
    /// Logical time \[s\].
    from_s: f64,
    /// Not before this file is there.
    from_file: Option<PathBuf>,
    /// Gain, offset over the largest command, seconds per step, or lines per step.
    amount: f64,
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum What {
    #[default]
    Nothing,
    CrashAtOnce,
    Crash,
    NeverReady,
    OldBuild,
    NotANumber,
    BeyondBounds,
    Gain,
    Frozen,
    Offset,
    Late,
    Prints,
}

outputs! {
    /// What it publishes.
    pub struct Outputs {
        /// Thrust and torque asked of the rotors.
        wrench_command: WrenchCommand = topics::WRENCH_COMMAND,
        /// The set point that it tracks.
        applied_setpoint: AppliedSetpoint = topics::APPLIED_SETPOINT,
    }
}

/// The template's controller, and what becomes of its commands.
#[derive(Debug)]
struct Rogue {
    inner: Controller,
    mischief: Mischief,
    largest: [f64; 4],
    validity_ns: u64,
    /// What a frozen output stays at.
    frozen: Option<[f64; 4]>,
}

impl Mischief {
    fn is_due(&mut self, now_ns: u64) -> bool {
        // Once it is there it is not looked for any more.
        self.from_file.take_if(|path| path.exists());
        self.from_file.is_none() && now_ns as f64 * 1e-9 >= self.from_s
    }
}

impl Rogue {
    fn new(flight: &Flight, config: &Config) -> Result<Self, BuildError> {
        let mischief: Mischief = config.read()?;
        match mischief.what {
            What::CrashAtOnce => std::process::abort(),
            What::NeverReady => loop {
                std::thread::park();
            },
            What::OldBuild => return Err(be_of_an_old_build()),
            _ => {}
        }
        let vehicle = flight.vehicle();
        let rate_hz = flight.rate_hz(shared_types::Role::Attitude).ok_or("no attitude loop")?;
        Ok(Self {
            inner: Controller::new(flight, &Config::default())?,
            mischief,
            largest: vehicle.largest_wrench(vehicle::MorphAngle::MIN),
            validity_ns: Duration::from_secs_f64(2.0 / rate_hz).as_nanos().try_into()?,
            frozen: None,
        })
    }

    /// What it publishes in place of `command`, T \[N\] and τ \[N m\].
    fn spoil(&mut self, command: [f64; 4]) -> [f64; 4] {
        let Mischief { what, amount, .. } = self.mischief;
        let [thrust, x, y, z] = command;
        match what {
            What::Crash => std::process::abort(),
            What::NotANumber => [thrust, f64::NAN, y, z],
            What::BeyondBounds => [thrust, x, 2.0 * self.largest[0], z],
            What::Gain => [thrust, amount * x, amount * y, amount * z],
            What::Frozen => *self.frozen.get_or_insert(command),
            What::Offset => [thrust, x + amount * self.largest[1], y, z],
            What::Late => {
                #[expect(clippy::disallowed_methods, reason = "being late is its misdeed")]
                std::thread::sleep(Duration::from_secs_f64(amount));
                command
            }
            What::Prints => {
                print_lines(amount);
                command
            }
            _ => command,
        }
    }
}

#[expect(clippy::print_stdout, reason = "printing is its misdeed")]
fn print_lines(count: f64) {
    for line in (0_u32..).take_while(|line| f64::from(*line) < count) {
        println!("line {line}");
        eprintln!("error {line}");
    }
}

/// Opens a service as a build with another layout of it would, and returns the error of the port.
fn be_of_an_old_build() -> BuildError {
    let mut arguments = std::env::args().skip_while(|argument| argument != "--run");
    let folder = PathBuf::from(arguments.nth(1).unwrap_or_default());
    let opened = Membership::join(&folder).map_err(BuildError::from).and_then(|membership| {
        let bus = Bus::join(&membership.ipc_config(), "rogue")?;
        Ok(bus.open_service::<Progress>(ServiceKind::Hello).map(|_| ())?)
    });
    opened.err().unwrap_or_else(|| "another layout was accepted".into())
}

impl Service for Rogue {
    type Inputs = Inputs;
    type Outputs = Outputs;
    type Memory = Memory;

    fn step(&mut self, now_ns: u64, inputs: &Inputs, outputs: &mut Outputs) {
        self.inner.step(now_ns, inputs, &mut my_attitude_controller::Outputs::default());
        let Memory { torque_nm: [x, y, z], setpoint, setpoint_sequence, slot, .. } =
            self.inner.memory();
        let mut command = [setpoint[3], x, y, z];
        if self.mischief.is_due(now_ns) {
            command = self.spoil(command);
        }
        let [thrust_n, x, y, z] = command;
        outputs.wrench_command.write(WrenchCommand {
            thrust_n,
            torque_b_nm: [x, y, z],
            validity_ns: self.validity_ns,
            ..WrenchCommand::default()
        });
        let mut follows = SetpointSlot::new(self.largest[0], 9.81);
        follows.restore(&slot);
        let [roll_rad, pitch_rad, yaw_rad, thrust_n] = setpoint;
        outputs.applied_setpoint.write(AppliedSetpoint {
            setpoint_sequence,
            thrust_n,
            roll_rad,
            pitch_rad,
            yaw_rad,
            ..follows.applied()
        });
    }

    fn track(&mut self, now_ns: u64, inputs: &Inputs) {
        self.inner.track(now_ns, inputs);
    }

    fn is_displaced(&self, inputs: &Inputs) -> bool {
        self.inner.is_displaced(inputs)
    }

    fn memory(&self) -> Memory {
        self.inner.memory()
    }

    fn restore(&mut self, memory: &Memory) -> Result<(), String> {
        self.inner.restore(memory)
    }
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().collect();
    match arguments.as_slice() {
        [_, mode, folder] if mode == "stray" => stray::write_on(folder.as_ref(), false),
        [_, mode, folder] if mode == "usurp" => stray::write_on(folder.as_ref(), true),
        _ => host::controller("rogue", Rogue::new),
    }
}
