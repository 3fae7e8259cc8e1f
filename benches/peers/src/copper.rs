//! The chain as tasks of copper-rs: one process, one thread, a step of the whole graph at each tick.

use crate::Result;
use crate::chain::{Node, TICK_NS, now_ns};
use crate::node::{self, Flight, Flown};
use cu29::bincode::{Decode, Encode};
use cu29::prelude::*;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

/// What the motor has seen; tasks are made by the runtime and give nothing back.
static LATENCY_NS: Mutex<Vec<u64>> = Mutex::new(Vec::new());

/// As large as a sample of the other chains.
#[derive(
    Debug, Default, Clone, PartialEq, Reflect, Encode, Decode, serde::Serialize, serde::Deserialize,
)]
pub struct Payload {
    tick: u64,
    stamp_ns: u64,
    body: [u64; 30],
}

macro_rules! stateless {
    ($($task:ident),+) => { $(
        #[derive(Reflect)]
        pub struct $task;
        impl Freezable for $task {}
    )+ };
}

stateless!(Estimator, Position, Attitude, Motor);

/// The sensor and the injector count their ticks.
macro_rules! source {
    ($task:ident, $every:literal) => {
        #[derive(Reflect)]
        pub struct $task {
            tick: u64,
        }
        impl Freezable for $task {}
        impl CuSrcTask for $task {
            type Resources<'r> = ();
            type Output<'m> = output_msg!(Payload);

            fn new(_: Option<&ComponentConfig>, _: ()) -> CuResult<Self> {
                Ok(Self { tick: 0 })
            }

            fn process(&mut self, _: &CuContext, output: &mut Self::Output<'_>) -> CuResult<()> {
                self.tick += 1;
                if self.tick.is_multiple_of($every) {
                    let mut state = self.tick;
                    let body = core::array::from_fn(|index| {
                        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                        if index % 2 == 0 { state } else { 0 }
                    });
                    output.set_payload(Payload { tick: self.tick, stamp_ns: now_ns(), body });
                } else {
                    output.clear_payload();
                }
                Ok(())
            }
        }
    };
}

source!(Sensor, 1);
source!(Injector, 5);

fn pass_on(from: Option<&Payload>, every: u64, to: &mut CuMsg<Payload>) {
    match from {
        Some(payload) if payload.tick.is_multiple_of(every) => to.set_payload(payload.clone()),
        _ => to.clear_payload(),
    }
}

macro_rules! task {
    ($task:ident, $every:literal) => {
        impl CuTask for $task {
            type Resources<'r> = ();
            type Input<'m> = input_msg!(Payload);
            type Output<'m> = output_msg!(Payload);

            fn new(_: Option<&ComponentConfig>, _: ()) -> CuResult<Self> {
                Ok(Self)
            }

            fn process(
                &mut self,
                _: &CuContext,
                input: &Self::Input<'_>,
                output: &mut Self::Output<'_>,
            ) -> CuResult<()> {
                pass_on(input.payload(), $every, output);
                Ok(())
            }
        }
    };
}

task!(Estimator, 1);
task!(Position, 10);

impl CuTask for Attitude {
    type Resources<'r> = ();
    type Input<'m> = input_msg!('m, Payload, Payload);
    type Output<'m> = output_msg!(Payload);

    fn new(_: Option<&ComponentConfig>, _: ()) -> CuResult<Self> {
        Ok(Self)
    }

    fn process(
        &mut self,
        _: &CuContext,
        (estimate, _setpoint): &Self::Input<'_>,
        output: &mut Self::Output<'_>,
    ) -> CuResult<()> {
        pass_on(estimate.payload(), 2, output);
        Ok(())
    }
}

impl CuSinkTask for Motor {
    type Resources<'r> = ();
    type Input<'m> = input_msg!('m, Payload, Payload);

    fn new(_: Option<&ComponentConfig>, _: ()) -> CuResult<Self> {
        Ok(Self)
    }

    fn process(&mut self, _: &CuContext, (wrench, _): &Self::Input<'_>) -> CuResult<()> {
        if let Some(wrench) = wrench.payload() {
            let mut seen = LATENCY_NS.lock().unwrap_or_else(PoisonError::into_inner);
            seen.push(now_ns().saturating_sub(wrench.stamp_ns));
        }
        Ok(())
    }
}

type Logger = Arc<Mutex<UnifiedLoggerWrite>>;

fn logger(file: &Path) -> Result<Logger> {
    let logger = UnifiedLoggerBuilder::new()
        .file_base_name(file)
        .preallocated_size(256 << 20)
        .write(true)
        .create(true)
        .build()?;
    match logger {
        UnifiedLogger::Write(logger) => Ok(Arc::new(Mutex::new(logger))),
        UnifiedLogger::Read(_) => Err("a log to read".into()),
    }
}

/// Runs the application of the module in which it stands.
macro_rules! fly_app {
    () => {
        pub(super) fn fly(
            logger: super::Logger,
            ticks: u64,
            mut wait_for: impl FnMut(u64),
        ) -> crate::Result<()> {
            let app = App::builder()
                .with_logger::<memmap::MmapSectionStorage, UnifiedLoggerWrite>(logger)
                .build()?;
            let mut running = app.start().map_err(|_| "copper-rs does not start")?;
            for tick in 1..=ticks {
                wait_for(tick);
                running.run_one_iteration()?;
            }
            running.stop().map_err(|_| "copper-rs does not stop")?;
            Ok(())
        }
    };
}

/// The two applications differ by their configuration, which is compiled in.
mod quiet {
    use cu29::prelude::*;

    #[copper_runtime(config = "copper-quiet.ron")]
    struct App {}
    fly_app!();
}

mod recorded {
    use cu29::prelude::*;

    #[copper_runtime(config = "copper-recorded.ron")]
    struct App {}
    fly_app!();
}

/// Flies the graph in this process.
pub fn fly(flight: &Flight, folder: &Path) -> Result<Flown> {
    let file = flight.record.clone().unwrap_or_else(|| folder.join("unrecorded.copper"));
    let logger = logger(&file)?;
    LATENCY_NS.lock().unwrap_or_else(PoisonError::into_inner).reserve(flight.ticks as usize);
    node::take_place(Node::Plant, flight);
    node::await_start()?;
    // The application is built when the flight has begun: its time begins with the first tick.
    let (mut begun, mut late) = (None, 0);
    let in_lockstep = flight.in_lockstep;
    let wait_for = |tick: u64| {
        let (_, start_ns) = *begun.get_or_insert_with(|| (node::cpu_ns(), now_ns()));
        if !in_lockstep {
            let due_ns = start_ns + tick * TICK_NS;
            node::sleep_until(due_ns);
            late += u64::from(now_ns() > due_ns + TICK_NS / 2);
        }
    };
    if flight.record.is_some() {
        recorded::fly(logger, flight.ticks, wait_for)?;
    } else {
        quiet::fly(logger, flight.ticks, wait_for)?;
    }
    let latency_ns =
        core::mem::take(&mut *LATENCY_NS.lock().unwrap_or_else(PoisonError::into_inner));
    let (cpu_ns, start_ns) = begun.ok_or("a flight without a tick")?;
    let (elapsed_ns, cpu_ns) = (now_ns() - start_ns, node::cpu_ns() - cpu_ns);
    Ok(Flown { latency_ns, late, elapsed_ns, cpu_ns })
}
