//! What a process is made of: a pure step with a publishable, restorable memory.

use crate::input::{InputPort, InputSet};
use crate::output::OutputSet;
use crate::state_header::StateHeader;
use shared_types::wire::{Schema, Value, Wire, hash_bytes};
use shared_types::{TopicInfo, TopicVisitor, topics};
use thiserror::Error;

/// A flying component.
///
/// `step` is a function of time, inputs and its own memory: no clock, no file, no lock, no
/// allocation, no panic. The same component therefore runs in its own process, in one process with
/// all others, and again from a recording.
pub trait Service {
    /// What it reads.
    type Inputs: InputSet;
    /// What it writes.
    type Outputs: OutputSet;
    /// Everything that evolves, besides latched inputs and output sequences.
    type Memory: Wire;

    /// Runs the release at logical time `now_ns`.
    fn step(&mut self, now_ns: u64, inputs: &Self::Inputs, outputs: &mut Self::Outputs);

    /// The evolving memory.
    fn memory(&self) -> Self::Memory;

    /// Continues from a memory, bit for bit.
    ///
    /// # Errors
    /// A reason, if the memory cannot belong to this configuration.
    fn restore(&mut self, memory: &Self::Memory) -> Result<(), String>;

    /// Sets the memory so that the output of the next step continues from what the slot last applied.
    ///
    /// The runtime calls it before each step while the service shadows a controller of another kind,
    /// whose memory it cannot restore, and while it [is displaced](Self::is_displaced), with the
    /// instant and the inputs of that step. What the slot
    /// applied is among the inputs (`applied_command` for attitude, `applied_setpoint` for position).
    /// A service that fills no slot has nothing to track.
    fn track(&mut self, _now_ns: u64, _inputs: &Self::Inputs) {}

    /// Forgets what the memory holds of the step before: `_left_out` releases since then, more than one, have been left
    /// out, so that the change since then is not that of one period. The runtime calls it before
    /// the next step, also after a restore from an old state.
    fn skip(&mut self, _left_out: u64) {}

    /// True while the slot applies what no controller commands, because its consumer brings the vehicle
    /// back by itself: the controller that is to command afterwards then tracks too, see [`track`](Self::track).
    fn is_displaced(&self, _inputs: &Self::Inputs) -> bool {
        false
    }

    /// Instant before which no step from `from_ns` on publishes anything, `from_ns` if that is not known. All owner
    /// records that take effect before `known_ns` have arrived. Loops that wait for this one may run so far ahead of it,
    /// and need not wake it meanwhile.
    fn quiet_until_ns(&self, from_ns: u64, _known_ns: u64, _inputs: &Self::Inputs) -> u64 {
        from_ns
    }

    /// Draws everything random from the streams of another seed from now on, at the places reached.
    fn reseed(&mut self, _seed: u64) {}

    /// IMU sequence that this step's outputs descend from.
    fn cause_sequence(&self, inputs: &Self::Inputs) -> u64 {
        inputs.origin().cause_sequence
    }
}

/// Why a published state cannot be restored.
#[derive(Debug, Error, PartialEq, Eq)]
pub enum RestoreError {
    /// Another kind of service, or another build of it.
    #[error(
        "the state was published with layout {theirs:016x}, this executable has {ours:016x}: restart the flight with one build"
    )]
    Layout {
        /// Layout of the state.
        theirs: u64,
        /// Layout of this build.
        ours: u64,
    },
    /// Cut or padded bytes.
    #[error("the state has {actual} bytes instead of {expected}")]
    Size {
        /// Bytes received.
        actual: usize,
        /// Bytes expected.
        expected: usize,
    },
    /// NaN or infinity in the memory.
    #[error("the state holds a number that is not finite")]
    NotFinite,
    /// The component refused it.
    #[error("the component refused the state: {0}")]
    Refused(String),
}

/// What a service reads and writes, and how its published state is laid out.
#[derive(Debug, Clone, Copy)]
pub struct Layout {
    /// Topic and sample of each input, in declaration order.
    pub inputs: &'static [InputPort],
    /// Topic of each output, in declaration order.
    pub outputs: &'static [&'static TopicInfo],
    /// What evolves besides latched inputs and output sequences.
    pub memory: &'static Schema,
    /// Bytes of the packed memory.
    pub memory_size: usize,
    latches_hash: u64,
}

/// The parts of a published state.
#[derive(Debug, Clone, Copy)]
pub struct StateParts<'a> {
    /// Where in the flight it was taken.
    pub header: StateHeader,
    /// Packed sequence of each output.
    pub sequences: &'a [u8],
    /// Of each input: whether it has a sample, and the sample, packed.
    pub latches: &'a [u8],
    /// The packed memory.
    pub memory: &'a [u8],
}

impl Layout {
    /// Of a service.
    #[must_use]
    pub fn of<S: Service>() -> Self {
        Self {
            inputs: S::Inputs::PORTS,
            outputs: S::Outputs::TOPICS,
            memory: &S::Memory::SCHEMA,
            memory_size: S::Memory::PACKED_SIZE,
            latches_hash: S::Inputs::LAYOUT_HASH,
        }
    }

    /// Distinguishes the published states of different services, and of different builds.
    #[must_use]
    pub fn hash(&self) -> u64 {
        let hash = hash_bytes(self.latches_hash, &self.memory.layout_hash.to_le_bytes());
        let hash = hash_bytes(hash, &StateHeader::SCHEMA.layout_hash.to_le_bytes());
        hash_bytes(hash, &(self.outputs.len() as u64).to_le_bytes())
    }

    /// Distinguishes ports, whatever is remembered: services of one slot may have the same.
    #[must_use]
    pub fn ports_hash(&self) -> u64 {
        hash_bytes(self.latches_hash, &(self.outputs.len() as u64).to_le_bytes())
    }

    /// Bytes of a published state.
    #[must_use]
    pub fn state_size(&self) -> usize {
        let latches: usize = self.inputs.iter().map(|input| input.latch_size).sum();
        StateHeader::PACKED_SIZE + 8 * self.outputs.len() + latches + self.memory_size
    }

    /// Takes a published state apart; none if it has another size.
    #[must_use]
    pub fn parts<'a>(&self, state: &'a [u8]) -> Option<StateParts<'a>> {
        if state.len() != self.state_size() {
            return None;
        }
        let (header, rest) = state.split_at(StateHeader::PACKED_SIZE);
        let (sequences, rest) = rest.split_at(8 * self.outputs.len());
        let (latches, memory) = rest.split_at(rest.len() - self.memory_size);
        Some(StateParts { header: StateHeader::unpack(header), sequences, latches, memory })
    }

    /// True if the memory of a published state holds no NaN and no infinity, from which no process could go on.
    #[must_use]
    pub fn is_finite(&self, state: &[u8]) -> bool {
        self.parts(state).is_some_and(|parts| self.memory.is_finite(parts.memory))
    }

    /// Of each input the packed sample that was in effect, if there was one.
    pub fn latches<'a>(
        &self,
        state: &StateParts<'a>,
    ) -> impl Iterator<Item = (&'static InputPort, Option<&'a [u8]>)> + use<'a> {
        let mut rest = state.latches;
        self.inputs.iter().map(move |input| {
            let latch;
            (latch, rest) = rest.split_at(input.latch_size);
            let (present, sample) = latch.split_at(8);
            (input, (u64::unpack(present) != 0).then_some(sample))
        })
    }

    /// Topics of the inputs, in declaration order.
    pub fn reads(&self) -> impl Iterator<Item = &'static TopicInfo> + use<> {
        self.inputs.iter().map(|input| input.topic)
    }

    /// Topics of the outputs, in declaration order.
    pub fn writes(&self) -> impl Iterator<Item = &'static TopicInfo> + use<> {
        self.outputs.iter().copied()
    }

    /// Shows these topics, typed, to a visitor.
    ///
    /// # Errors
    /// The visitor's first error.
    pub fn visit_topics<V: TopicVisitor>(
        mut topics: impl Iterator<Item = &'static TopicInfo>,
        visitor: &mut V,
    ) -> Result<(), V::Error> {
        topics.try_for_each(|topic| topics::visit_named(topic.name, visitor))
    }
}

/// Writes the whole evolving state; `out` holds [`Layout::state_size`] bytes.
pub fn pack_state<S: Service>(
    service: &S,
    header: &StateHeader,
    inputs: &S::Inputs,
    outputs: &S::Outputs,
    out: &mut [u8],
) {
    let (head, rest) = out.split_at_mut(StateHeader::PACKED_SIZE);
    let (sequences, rest) = rest.split_at_mut(8 * S::Outputs::COUNT);
    let (latches, memory) = rest.split_at_mut(S::Inputs::LATCH_SIZE);
    header.pack(head);
    outputs.pack_sequences(sequences);
    inputs.pack_latches(latches);
    service.memory().pack(memory);
}

/// Restores what [`pack_state`] wrote and returns its header.
///
/// # Errors
/// [`RestoreError`]; nothing has been changed then, unless the component itself refused.
pub fn unpack_state<S: Service>(
    service: &mut S,
    inputs: &mut S::Inputs,
    outputs: &mut S::Outputs,
    from: &[u8],
) -> Result<StateHeader, RestoreError> {
    let expected = Layout::of::<S>().state_size();
    if from.len() < StateHeader::PACKED_SIZE {
        return Err(RestoreError::Size { actual: from.len(), expected });
    }
    let (head, rest) = from.split_at(StateHeader::PACKED_SIZE);
    let header = StateHeader::unpack(head);
    let ours = Layout::of::<S>().hash();
    if header.layout_hash != ours {
        return Err(RestoreError::Layout { theirs: header.layout_hash, ours });
    }
    if from.len() != expected {
        return Err(RestoreError::Size { actual: from.len(), expected });
    }
    let (sequences, rest) = rest.split_at(8 * S::Outputs::COUNT);
    let (latches, memory) = rest.split_at(S::Inputs::LATCH_SIZE);
    if !S::Memory::SCHEMA.is_finite(memory) {
        return Err(RestoreError::NotFinite);
    }
    service.restore(&S::Memory::unpack(memory)).map_err(RestoreError::Refused)?;
    inputs.unpack_latches(latches);
    outputs.unpack_sequences(sequences);
    Ok(header)
}
