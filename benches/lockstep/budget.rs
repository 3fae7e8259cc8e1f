//! What a simulated millisecond consists of: steps, samples, states, and the time of each.

use crate::flights::scenario;
use crate::registry::enrol;
use crate::{Plan, Result, Rounds};
use core::hint::black_box;
use observe::Observer;
use runtime::clock::mono_now_ns;
use runtime::ipc::{Bus, IpcSource, RECORDER_CAPACITY};
use runtime::{Input, Output, Source as _};
use shared_types::{Header, Role, Sample, StateEstimate, Topic, topics};
use simulate::in_process::{InProcess, StateSource};
use std::collections::BTreeMap;

/// Logical time of the flight that is taken apart [s].
const SECONDS: u64 = 20;
/// Samples through shared memory per block, and blocks.
const BLOCK: u64 = 1_000;
const BLOCKS: usize = 100;
/// Rounds of the flight; a loop's time is the median over them.
const ROUNDS: usize = 5;

/// Counts what is published.
#[derive(Debug, Default)]
struct Census {
    samples: u64,
    bytes: u64,
    readings: u64,
    readers: BTreeMap<&'static str, u64>,
    states: u64,
    state_bytes: u64,
}

impl Observer for Census {
    fn observe<T: Sample>(&mut self, topic: &'static Topic<T>, _sample: &T) {
        self.samples += 1;
        self.bytes += size_of::<T>() as u64;
        self.readings += self.readers.get(topic.info.name).copied().unwrap_or(0);
    }
    fn wants_states(&self) -> bool {
        true
    }
    fn observe_state(&mut self, _role: Role, _header: &Header, state: &[u8]) {
        self.states += 1;
        self.state_bytes += state.len() as u64;
    }
}

/// Lets the loops pack their states, as processes do, and looks at nothing.
struct Packing;

impl Observer for Packing {
    fn observe<T: Sample>(&mut self, _topic: &'static Topic<T>, _sample: &T) {}
    fn wants_states(&self) -> bool {
        true
    }
}

/// One loop's share of a simulated millisecond.
#[derive(Debug)]
pub(crate) struct Loop {
    pub(crate) role: Role,
    pub(crate) steps_per_ms: f64,
    /// Inputs taken in, step, outputs stamped, state packed [us].
    pub(crate) step_us: Rounds,
}

/// A simulated millisecond of a plan.
#[derive(Debug)]
pub(crate) struct Budget {
    pub(crate) plan: Plan,
    pub(crate) loops: Vec<Loop>,
    /// Published, and received by loops, per simulated millisecond.
    pub(crate) samples_per_ms: f64,
    pub(crate) readings_per_ms: f64,
    pub(crate) bytes_per_ms: f64,
    pub(crate) states_per_ms: f64,
    pub(crate) state_bytes_per_ms: f64,
    /// One sample published to a loop and the recorder, and received by the loop [us].
    pub(crate) sample_us: f64,
}

impl Budget {
    /// `sample_us`: see [`sample_us`].
    pub(crate) fn of(plan: Plan, sample_us: f64) -> Result<Self> {
        let scenario = scenario(plan, SECONDS)?;
        let mut readers = BTreeMap::new();
        for edge in scenario.graph()?.edges() {
            *readers.entry(edge.topic.name).or_insert(0) += 1;
        }
        let census = Census { readers, ..Census::default() };
        let mut flight = InProcess::new(&scenario, StateSource::Estimator, census)?;
        flight.fly_until(u64::MAX)?;
        let per_ms = |count: u64| count as f64 / (SECONDS as f64 * 1e3);
        let mut loops: Vec<Loop> = Vec::new();
        for _ in 0..ROUNDS {
            let mut flight = InProcess::new(&scenario, StateSource::Estimator, Packing)?;
            for (index, (us, steps)) in each_step_us(&mut flight).into_iter().enumerate() {
                if loops.len() == index {
                    let role = flight.role(index);
                    let step_us = Rounds::default();
                    loops.push(Loop { role, steps_per_ms: per_ms(steps), step_us });
                }
                loops[index].step_us.add(us);
            }
        }
        Ok(flight.seen(|c| Self {
            plan,
            loops,
            samples_per_ms: per_ms(c.samples),
            readings_per_ms: per_ms(c.readings),
            bytes_per_ms: per_ms(c.bytes),
            states_per_ms: per_ms(c.states),
            state_bytes_per_ms: per_ms(c.state_bytes),
            sample_us,
        }))
    }

    /// All steps of a simulated millisecond [us].
    pub(crate) fn compute_us(&self) -> f64 {
        self.loops.iter().map(|l| l.steps_per_ms * l.step_us.median()).sum()
    }
}

/// Mean time of a step of each loop, the clock's own time taken off [us], and the number of steps.
fn each_step_us(flight: &mut InProcess<Packing>) -> Vec<(f64, u64)> {
    let clock_ns = {
        let start_ns = mono_now_ns();
        (0..1000).for_each(|_| _ = black_box(mono_now_ns()));
        (mono_now_ns() - start_ns) as f64 / 1000.0
    };
    let mut spent: Vec<(u64, u64)> = Vec::new();
    loop {
        let next = flight.runnable(u64::MAX).min_by_key(|&index| flight.mark_ns(index));
        let Some(index) = next else { break };
        let start_ns = mono_now_ns();
        flight.step(index);
        let step_ns = mono_now_ns() - start_ns;
        if spent.len() <= index {
            spent.resize(index + 1, (0, 0));
        }
        spent[index].0 += step_ns;
        spent[index].1 += 1;
    }
    let mean_us = |ns: u64, steps: u64| (ns as f64 / f64::max(steps as f64, 1.0) - clock_ns) * 1e-3;
    spent.into_iter().map(|(ns, steps)| (mean_us(ns, steps), steps)).collect()
}

/// A sample through shared memory as in flight, without waking a process [us].
pub(crate) fn sample_us(bus: &Bus) -> Result<f64> {
    let topic = &topics::STATE_ESTIMATE;
    let factory = bus.create_topic(topic)?;
    let _registry = enrol(bus, Role::Estimator)?;
    let mut output = Output::<StateEstimate>::default();
    let mut input = Input::<StateEstimate>::default();
    let mut recorder = IpcSource::with_capacity(&factory, RECORDER_CAPACITY)?;
    output.connect(Box::new(bus.writer(topic)?), 0);
    input.connect(Box::new(bus.reader(topic, Role::Estimator)?), None);
    let mut blocks = Rounds::default();
    let mut release_ns = 0;
    for _ in 0..BLOCKS {
        let start_ns = mono_now_ns();
        for _ in 0..BLOCK {
            let previous_ns = Some(release_ns);
            release_ns += 1_000_000;
            output.write(StateEstimate::default());
            output.flush(&Header { release_ns, ..Header::default() });
            input.receive();
            input.accept(release_ns, previous_ns);
            black_box(input.latest());
        }
        blocks.add((mono_now_ns() - start_ns) as f64 * 1e-3 / BLOCK as f64);
        while recorder.receive().is_some() {}
    }
    Ok(blocks.median())
}
