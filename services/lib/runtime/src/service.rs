//! What a process is made of: a pure step with a publishable, restorable memory.

use crate::input::InputSet;
use crate::output::OutputSet;
use shared_types::wire::{Value, Wire, hash_bytes};
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

    /// True while the slot applies what no controller commands, because its consumer brings the vehicle
    /// back by itself: whoever is to command afterwards then tracks too, see [`track`](Self::track).
    fn is_displaced(&self, _inputs: &Self::Inputs) -> bool {
        false
    }

    /// Draws everything random from the streams of another seed from now on, at the places reached.
    fn reseed(&mut self, _seed: u64) {}

    /// IMU sequence that this step's outputs descend from.
    fn cause_sequence(&self, inputs: &Self::Inputs) -> u64 {
        inputs.origin().cause_sequence
    }
}

shared_types::memory! {
    /// First part of a published state: where in the flight it was taken.
    pub struct StateHeader {
        /// Layout of this header, memory, latches and sequences together.
        pub layout_hash: u64,
        /// Index of the release that has just run.
        pub release_index: u64,
        /// Its instant \[ns\].
        pub release_ns: u64,
        /// Steps run so far.
        pub steps: u64,
        /// Releases skipped so far.
        pub skipped: u64,
        /// Releases run late so far.
        pub caught_up: u64,
        /// Steps started without final inputs so far.
        pub input_deadline_misses: u64,
        /// Samples that came after the step they were for so far.
        pub late_samples: u64,
        /// Samples never seen so far.
        pub lost_samples: u64,
        /// Sequence of this state.
        pub state_sequence: u64,
        /// Sequence of the last loop statistics.
        pub stats_sequence: u64,
        /// Sequence of the last deviation that this life of the process has told.
        pub deviation_sequence: u64,
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
    /// The component refused it.
    #[error("the component refused the state: {0}")]
    Refused(String),
}

/// Layout of the published state of `S`.
#[must_use]
pub fn state_layout<S: Service>() -> u64 {
    let hash = hash_bytes(S::Inputs::LAYOUT_HASH, &S::Memory::SCHEMA.layout_hash.to_le_bytes());
    let hash = hash_bytes(hash, &StateHeader::SCHEMA.layout_hash.to_le_bytes());
    hash_bytes(hash, &(S::Outputs::COUNT as u64).to_le_bytes())
}

/// What the ports of `S` are, whatever it remembers: services of one slot may have the same.
#[must_use]
pub fn ports_layout<S: Service>() -> u64 {
    hash_bytes(S::Inputs::LAYOUT_HASH, &(S::Outputs::COUNT as u64).to_le_bytes())
}

/// The state of a predecessor with the same [`ports_layout`] and the memory of `service` in place of
/// its own: where in the flight it was, what it had latched and sent last. `None` if it is too short.
#[must_use]
pub fn with_memory_of<S: Service>(service: &S, state: &[u8]) -> Option<Vec<u8>> {
    let ports = state_size::<S>() - S::Memory::PACKED_SIZE;
    let mut taken = state.get(..ports)?.to_vec();
    let header = StateHeader::unpack(&taken[..StateHeader::PACKED_SIZE]);
    let header = StateHeader { layout_hash: state_layout::<S>(), ..header };
    header.pack(&mut taken[..StateHeader::PACKED_SIZE]);
    taken.resize(state_size::<S>(), 0);
    service.memory().pack(&mut taken[ports..]);
    Some(taken)
}

/// Bytes of the published state of `S`.
#[must_use]
pub fn state_size<S: Service>() -> usize {
    StateHeader::PACKED_SIZE
        + 8 * S::Outputs::COUNT
        + S::Inputs::LATCH_SIZE
        + S::Memory::PACKED_SIZE
}

/// Writes the whole evolving state; `out` holds [`state_size`] bytes.
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
    let expected = state_size::<S>();
    if from.len() < StateHeader::PACKED_SIZE {
        return Err(RestoreError::Size { actual: from.len(), expected });
    }
    let (head, rest) = from.split_at(StateHeader::PACKED_SIZE);
    let header = StateHeader::unpack(head);
    let ours = state_layout::<S>();
    if header.layout_hash != ours {
        return Err(RestoreError::Layout { theirs: header.layout_hash, ours });
    }
    if from.len() != expected {
        return Err(RestoreError::Size { actual: from.len(), expected });
    }
    let (sequences, rest) = rest.split_at(8 * S::Outputs::COUNT);
    let (latches, memory) = rest.split_at(S::Inputs::LATCH_SIZE);
    service.restore(&S::Memory::unpack(memory)).map_err(RestoreError::Refused)?;
    inputs.unpack_latches(latches);
    outputs.unpack_sequences(sequences);
    Ok(header)
}
