//! The chain that every runtime carries: which node sends what to which node at which tick.
//!
//! It has the shape, the rates and the sizes of a flight's loops and computes nothing. The plant ticks at 1 kHz and is
//! sensor and motor at once; the estimator answers each tick, the attitude loop every second one, the position loop every
//! tenth, the injector every fifth. The way from sensor to motor has three hops: plant, estimator, attitude, plant.

use crate::Result;
use iceoryx2::prelude::ZeroCopySend;
use rustix::time::{ClockId, clock_gettime};
use std::collections::VecDeque;

/// A tick \[ns\].
pub const TICK_NS: u64 = 1_000_000;
/// How long a realtime plant waits for the last command after the last tick \[ns\].
const LAST_NS: u64 = 200_000_000;

/// `CLOCK_MONOTONIC` \[ns\].
pub fn now_ns() -> u64 {
    let now = clock_gettime(ClockId::Monotonic);
    now.tv_sec.unsigned_abs() * 1_000_000_000 + now.tv_nsec.unsigned_abs()
}

/// A node of the chain.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Node {
    Plant,
    Estimator,
    Position,
    Attitude,
    Injector,
}

impl Node {
    pub const ALL: [Self; 5] =
        [Self::Plant, Self::Estimator, Self::Position, Self::Attitude, Self::Injector];

    pub fn name(self) -> &'static str {
        ["plant", "estimator", "position", "attitude", "injector"][self as usize]
    }

    /// Priority under `SCHED_FIFO`: each faster rate has one more, as in a flight.
    pub fn priority(self) -> u8 {
        [14, 14, 11, 13, 12][self as usize]
    }
}

/// What a sample is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum Topic {
    Imu,
    Estimate,
    Setpoint,
    Wrench,
    Time,
    Disturbance,
}

impl Topic {
    pub const ALL: [Self; 6] =
        [Self::Imu, Self::Estimate, Self::Setpoint, Self::Wrench, Self::Time, Self::Disturbance];

    pub fn name(self) -> &'static str {
        ["imu", "estimate", "setpoint", "wrench", "time", "disturbance"][self as usize]
    }

    pub fn from(self) -> Node {
        match self {
            Self::Imu | Self::Time => Node::Plant,
            Self::Estimate => Node::Estimator,
            Self::Setpoint => Node::Position,
            Self::Wrench => Node::Attitude,
            Self::Disturbance => Node::Injector,
        }
    }

    /// Everything that may ever get it.
    pub fn to(self) -> &'static [Node] {
        match self {
            Self::Imu => &[Node::Estimator],
            Self::Estimate => &[Node::Attitude, Node::Position],
            Self::Setpoint => &[Node::Attitude],
            Self::Wrench | Self::Disturbance => &[Node::Plant],
            Self::Time => &[Node::Injector],
        }
    }
}

/// What travels: as large as a flight's samples are in the mean.
#[derive(Debug, Clone, Copy, ZeroCopySend)]
#[repr(C)]
pub struct Sample {
    /// Which of [`Topic::ALL`].
    pub topic: u32,
    /// 1 at the last tick.
    pub is_last: u32,
    pub tick: u64,
    /// When the sensor was read \[ns\].
    pub stamp_ns: u64,
    body: [u8; 232],
}

impl Sample {
    pub const SIZE: usize = size_of::<Self>();

    pub fn new(topic: Topic, tick: u64, stamp_ns: u64, is_last: bool) -> Self {
        // Numbers that do not all compress to nothing.
        let mut body = [0; 232];
        let mut state = tick ^ (topic as u64) << 32;
        for eight in body.chunks_exact_mut(8).step_by(2) {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            eight.copy_from_slice(&state.to_le_bytes());
        }
        Self { topic: topic as u32, is_last: u32::from(is_last), tick, stamp_ns, body }
    }

    fn answer(&self, topic: Topic) -> Self {
        Self { topic: topic as u32, ..*self }
    }

    pub fn topic(&self) -> Option<Topic> {
        Topic::ALL.get(usize::try_from(self.topic).ok()?).copied()
    }

    pub fn to_bytes(self) -> [u8; Self::SIZE] {
        let mut bytes = [0; Self::SIZE];
        bytes[..4].copy_from_slice(&self.topic.to_le_bytes());
        bytes[4..8].copy_from_slice(&self.is_last.to_le_bytes());
        bytes[8..16].copy_from_slice(&self.tick.to_le_bytes());
        bytes[16..24].copy_from_slice(&self.stamp_ns.to_le_bytes());
        bytes[24..].copy_from_slice(&self.body);
        bytes
    }

    pub fn from_bytes(bytes: &[u8; Self::SIZE]) -> Self {
        let word = |at: usize| u32::from_le_bytes(core::array::from_fn(|i| bytes[at + i]));
        let long = |at: usize| u64::from_le_bytes(core::array::from_fn(|i| bytes[at + i]));
        Self {
            topic: word(0),
            is_last: word(4),
            tick: long(8),
            stamp_ns: long(16),
            body: core::array::from_fn(|i| bytes[24 + i]),
        }
    }

    /// The nodes that need it at its tick: those at a lower rate are not woken for the others.
    pub fn needed_by(&self) -> impl Iterator<Item = Node> {
        let (topic, tick) = (self.topic(), self.tick);
        let all = topic.map_or(&[][..], Topic::to);
        all.iter().copied().filter(move |node| match (topic, node) {
            (Some(Topic::Estimate), Node::Attitude) => tick.is_multiple_of(2),
            (Some(Topic::Estimate), Node::Position) => tick.is_multiple_of(10),
            _ => true,
        })
    }
}

/// How a node reaches the others.
pub trait Port {
    /// Sends to those that need it, wakes them, and hands it to the recorder, if there is one.
    fn send(&mut self, sample: &Sample) -> Result<()>;
    /// The next sample that has arrived.
    fn receive(&mut self) -> Result<Option<Sample>>;
    /// Waits until something may have arrived, or until an instant of `CLOCK_MONOTONIC` \[ns\].
    fn wait(&mut self, until_ns: Option<u64>) -> Result<()>;
}

/// What a node gives back for what it gets.
#[derive(Debug)]
pub struct Law {
    node: Node,
    /// Simulated time: the attitude loop waits for the set point of its tick.
    in_lockstep: bool,
    setpoint_tick: u64,
    held: VecDeque<Sample>,
    /// Nothing is owed any more.
    is_over: bool,
}

impl Law {
    pub fn new(node: Node, in_lockstep: bool) -> Self {
        Self { node, in_lockstep, setpoint_tick: 0, held: VecDeque::new(), is_over: false }
    }

    /// The answer to a sample, if there is one now.
    pub fn answer(&mut self, sample: &Sample) -> Option<Sample> {
        let answer = match (self.node, sample.topic()?) {
            (Node::Estimator, Topic::Imu) => Some(sample.answer(Topic::Estimate)),
            (Node::Position, Topic::Estimate) => {
                (sample.is_last == 0).then(|| sample.answer(Topic::Setpoint))
            }
            (Node::Injector, Topic::Time) => {
                (sample.is_last == 0).then(|| sample.answer(Topic::Disturbance))
            }
            (Node::Attitude, Topic::Estimate) => {
                self.held.push_back(*sample);
                self.wrench()
            }
            (Node::Attitude, Topic::Setpoint) => {
                self.setpoint_tick = sample.tick;
                self.wrench()
            }
            _ => None,
        };
        // The attitude loop may hold the last estimate for a while.
        self.is_over = match self.node {
            Node::Attitude => answer.is_some_and(|wrench| wrench.is_last != 0),
            _ => sample.is_last != 0,
        };
        answer
    }

    fn wrench(&mut self) -> Option<Sample> {
        // A set point takes effect two ticks after its estimate.
        let needed = self.held.front()?.tick.saturating_sub(2) / 10 * 10;
        let is_due = !self.in_lockstep || self.setpoint_tick >= needed;
        is_due.then(|| self.held.pop_front())?.map(|estimate| estimate.answer(Topic::Wrench))
    }
}

/// Answers until the last tick.
pub fn react(law: &mut Law, port: &mut dyn Port) -> Result<()> {
    loop {
        while let Some(sample) = port.receive()? {
            if let Some(answer) = law.answer(&sample) {
                port.send(&answer)?;
            }
            if law.is_over {
                return Ok(());
            }
        }
        port.wait(None)?;
    }
}

/// What the plant has seen.
#[derive(Debug, Default)]
pub struct Seen {
    /// From reading the sensor to the command's arrival at the motor \[ns\].
    pub latency_ns: Vec<u64>,
    /// Ticks at which the plant was more than half a tick late.
    pub late: u64,
    /// Wall time of all ticks \[ns\].
    pub elapsed_ns: u64,
}

/// Flies the plant by the wall clock.
pub fn fly_realtime(port: &mut dyn Port, ticks: u64) -> Result<Seen> {
    let mut seen = Seen { latency_ns: Vec::with_capacity(ticks as usize), ..Seen::default() };
    let start_ns = now_ns() + 20_000_000;
    let note = |port: &mut dyn Port, seen: &mut Seen| -> Result<bool> {
        let mut is_last = false;
        while let Some(sample) = port.receive()? {
            if sample.topic() == Some(Topic::Wrench) {
                seen.latency_ns.push(now_ns().saturating_sub(sample.stamp_ns));
                is_last |= sample.is_last != 0;
            }
        }
        Ok(is_last)
    };
    for tick in 1..=ticks {
        let due_ns = start_ns + tick * TICK_NS;
        while now_ns() < due_ns {
            note(port, &mut seen)?;
            port.wait(Some(due_ns))?;
        }
        seen.late += u64::from(now_ns() > due_ns + TICK_NS / 2);
        send_tick(port, tick, ticks)?;
    }
    let end_ns = now_ns() + LAST_NS;
    while !note(port, &mut seen)? && now_ns() < end_ns {
        port.wait(Some(end_ns))?;
    }
    seen.elapsed_ns = now_ns() - start_ns;
    Ok(seen)
}

/// Flies the plant as fast as the others answer; each tick takes in what it must, so that two flights are the same.
pub fn fly_lockstep(port: &mut dyn Port, ticks: u64) -> Result<Seen> {
    let start_ns = now_ns();
    let (mut wrench, mut disturbance) = (0, 0);
    for tick in 1..=ticks {
        send_tick(port, tick, ticks)?;
        let wrench_needed = tick / 2 * 2;
        let disturbance_needed = if tick == ticks { disturbance } else { tick / 5 * 5 };
        loop {
            while let Some(sample) = port.receive()? {
                match sample.topic() {
                    Some(Topic::Wrench) => wrench = sample.tick,
                    Some(Topic::Disturbance) => disturbance = sample.tick,
                    _ => {}
                }
            }
            if wrench >= wrench_needed && disturbance >= disturbance_needed {
                break;
            }
            port.wait(None)?;
        }
    }
    Ok(Seen { elapsed_ns: now_ns() - start_ns, ..Seen::default() })
}

fn send_tick(port: &mut dyn Port, tick: u64, ticks: u64) -> Result<()> {
    let (stamp_ns, is_last) = (now_ns(), tick == ticks);
    port.send(&Sample::new(Topic::Imu, tick, stamp_ns, is_last))?;
    if tick.is_multiple_of(5) {
        port.send(&Sample::new(Topic::Time, tick, stamp_ns, is_last))?;
    }
    Ok(())
}

/// How many samples a recorder gets of a flight in lockstep.
pub fn recorded_samples(ticks: u64) -> u64 {
    2 * ticks + ticks / 2 + (ticks / 10 - 1) + ticks / 5 + (ticks / 5 - 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Default)]
    struct Wire {
        sent: Vec<Sample>,
        to_receive: VecDeque<Sample>,
    }

    impl Port for Wire {
        fn send(&mut self, sample: &Sample) -> Result<()> {
            self.sent.push(*sample);
            Ok(())
        }
        fn receive(&mut self) -> Result<Option<Sample>> {
            Ok(self.to_receive.pop_front())
        }
        fn wait(&mut self, _until_ns: Option<u64>) -> Result<()> {
            Err("nothing would ever come".into())
        }
    }

    #[test]
    fn a_sample_survives_its_bytes() {
        let sample = Sample::new(Topic::Wrench, 7, 42, true);
        let again = Sample::from_bytes(&sample.to_bytes());
        assert_eq!((again.topic(), again.tick, again.stamp_ns), (Some(Topic::Wrench), 7, 42));
        assert_eq!(again.to_bytes(), sample.to_bytes());
    }

    #[test]
    fn a_whole_flight_has_as_many_samples_as_a_recorder_waits_for() {
        let ticks = 40;
        let mut plant = Wire::default();
        for tick in 1..=ticks {
            send_tick(&mut plant, tick, ticks).unwrap();
        }
        let mut all = plant.sent;
        for node in [Node::Estimator, Node::Position, Node::Injector, Node::Attitude] {
            all.sort_by_key(|sample| (sample.tick, sample.topic));
            let needed = all.iter().filter(|s| s.needed_by().any(|n| n == node)).copied();
            let mut wire = Wire { to_receive: needed.collect(), ..Wire::default() };
            react(&mut Law::new(node, true), &mut wire).unwrap();
            all.extend(wire.sent);
        }
        assert_eq!(all.len() as u64, recorded_samples(ticks));
        assert_eq!(all.iter().filter(|s| s.topic() == Some(Topic::Wrench)).count(), 20);
    }

    #[test]
    fn in_lockstep_a_command_waits_for_the_set_point_of_its_tick() {
        let mut law = Law::new(Node::Attitude, true);
        let estimate = |tick| Sample::new(Topic::Estimate, tick, 0, false);
        assert!(law.answer(&estimate(10)).is_some());
        assert!(law.answer(&estimate(12)).is_none());
        let setpoint = Sample::new(Topic::Setpoint, 10, 0, false);
        assert_eq!(law.answer(&setpoint).map(|wrench| wrench.tick), Some(12));
        assert!(Law::new(Node::Attitude, false).answer(&estimate(12)).is_some());
    }
}
