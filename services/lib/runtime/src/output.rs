//! One output of a service: at most one sample per step, stamped and sent by the runtime.

use crate::clock::WallMap;
use core::any::Any;
use shared_types::{Header, Sample, Topic, TopicInfo};

/// Where samples go: a shared-memory publisher, or a queue within one process.
pub trait Sink<T> {
    /// Sends one sample. Must not block; overflow drops the reader's oldest sample.
    fn send(&mut self, sample: &T);
    /// Lets a reader that has just joined have the history.
    fn serve_late_joiners(&mut self);
}

/// One output.
pub struct Output<T> {
    sink: Option<Box<dyn Sink<T>>>,
    slot: Option<T>,
    sequence: u64,
    latency_ns: u64,
    /// Realtime: the clock by which samples take effect when they are published.
    asap: Option<WallMap>,
}

impl<T: Sample> core::fmt::Debug for Output<T> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Output")
            .field("topic", &T::SCHEMA.name)
            .field("sequence", &self.sequence)
            .finish_non_exhaustive()
    }
}

impl<T> Default for Output<T> {
    fn default() -> Self {
        Self { sink: None, slot: None, sequence: 0, latency_ns: 0, asap: None }
    }
}

impl<T: Sample> Output<T> {
    /// Connects the output; `latency_ns` separates release from effect.
    pub fn connect(&mut self, sink: Box<dyn Sink<T>>, latency_ns: u64) {
        self.sink = Some(sink);
        self.latency_ns = latency_ns;
    }

    /// Lets samples take effect when they are published, and not a latency after their release.
    pub fn take_effect_when_published(&mut self, wall: WallMap) {
        self.asap = Some(wall);
    }

    /// Writes this step's sample; the header is the runtime's business.
    pub fn write(&mut self, sample: T) {
        self.slot = Some(sample);
    }

    /// This step's sample, until the runtime sends it.
    #[must_use]
    pub fn written(&self) -> Option<&T> {
        self.slot.as_ref()
    }

    /// Sequence of the last sample sent.
    #[must_use]
    pub fn sequence(&self) -> u64 {
        self.sequence
    }

    /// Stamps and sends what the step wrote. `step` carries release, cause and host stamps.
    pub fn flush(&mut self, step: &Header) {
        let Some(sample) = &mut self.slot else { return };
        self.sequence += 1;
        let valid_ns = match &self.asap {
            // A source that works ahead of time publishes before the release.
            Some(wall) => wall.logical_ns(step.publish_mono_ns).max(step.release_ns),
            None => step.release_ns + self.latency_ns,
        };
        *sample.header_mut() = Header { sequence: self.sequence, valid_ns, ..*step };
        if let Some(sink) = &mut self.sink {
            sink.send(sample);
        }
        self.slot = None;
    }

    /// See [`Sink::serve_late_joiners`].
    pub fn serve_late_joiners(&mut self) {
        if let Some(sink) = &mut self.sink {
            sink.serve_late_joiners();
        }
    }

    /// Continues counting after a restore.
    pub fn resume_after(&mut self, sequence: u64) {
        self.sequence = sequence;
    }
}

/// Does something for every output of a service, with its type.
pub trait OutputVisitor {
    /// What can go wrong.
    type Error;
    /// Called once per output, in declaration order.
    ///
    /// # Errors
    /// Whatever the visitor meets; it ends the walk.
    fn visit<T: Sample>(
        &mut self,
        topic: &'static Topic<T>,
        output: &mut Output<T>,
    ) -> Result<(), Self::Error>;
}

/// The outputs of a service; declared with [`outputs!`](crate::outputs).
pub trait OutputSet: Default {
    /// Topic of each output, in declaration order.
    const TOPICS: &'static [&'static TopicInfo];
    /// Number of outputs.
    const COUNT: usize = Self::TOPICS.len();

    /// Walks the outputs.
    ///
    /// # Errors
    /// The visitor's first error.
    fn visit<V: OutputVisitor>(&mut self, visitor: &mut V) -> Result<(), V::Error>;
    /// The [`Output`] of a topic, its sample's type forgotten; none if nothing is written on it.
    fn by_topic(&mut self, name: &str) -> Option<&mut dyn Any>;
    /// Stamps and sends what the step wrote.
    fn flush(&mut self, step: &Header);
    /// Lets late joiners have their history.
    fn serve_late_joiners(&mut self);
    /// Last sequence of each output, in declaration order.
    fn pack_sequences(&self, out: &mut [u8]);
    /// Continues counting after a restore.
    fn unpack_sequences(&mut self, from: &[u8]);
}

/// Declares a service's outputs: `outputs! { pub struct Outputs { imu: Imu = IMU, .. } }`.
#[macro_export]
macro_rules! outputs {
    ($(#[$meta:meta])* pub struct $name:ident {
        $($(#[$field_meta:meta])* $field:ident : $sample:ty = $topic:path),* $(,)?
    }) => {
        $(#[$meta])*
        #[derive(Debug, Default)]
        pub struct $name {
            $($(#[$field_meta])* pub $field: $crate::Output<$sample>,)*
        }

        impl $crate::OutputSet for $name {
            const TOPICS: &'static [&'static ::shared_types::TopicInfo] = &[$(&$topic.info),*];
            fn by_topic(&mut self, name: &str) -> Option<&mut dyn ::core::any::Any> {
                $(if name == $topic.info.name {
                    return Some(&mut self.$field);
                })*
                let _ = name;
                None
            }
            fn visit<V: $crate::OutputVisitor>(&mut self, visitor: &mut V) -> Result<(), V::Error> {
                $(visitor.visit(&$topic, &mut self.$field)?;)*
                Ok(())
            }
            fn flush(&mut self, step: &::shared_types::Header) {
                $(self.$field.flush(step);)*
            }
            fn serve_late_joiners(&mut self) {
                $(self.$field.serve_late_joiners();)*
            }
            fn pack_sequences(&self, out: &mut [u8]) {
                let mut slots = out.chunks_exact_mut(8);
                $(if let Some(slot) = slots.next() {
                    slot.copy_from_slice(&self.$field.sequence().to_le_bytes());
                })*
            }
            fn unpack_sequences(&mut self, from: &[u8]) {
                let mut slots = from.chunks_exact(8);
                $(if let Some(slot) = slots.next() {
                    self.$field.resume_after(
                        <u64 as ::shared_types::wire::Value>::unpack(slot));
                })*
            }
        }
    };
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::cell::RefCell;
    use shared_types::{ClockRecord, WrenchCommand};
    use std::rc::Rc;

    struct Log(Rc<RefCell<Vec<u64>>>);

    impl Sink<WrenchCommand> for Log {
        fn send(&mut self, sample: &WrenchCommand) {
            self.0.borrow_mut().push(sample.header.valid_ns);
        }
        fn serve_late_joiners(&mut self) {}
    }

    #[test]
    fn a_sample_takes_effect_a_latency_after_its_release_or_when_it_is_published() {
        let effects = Rc::new(RefCell::new(Vec::new()));
        let mut output = Output::default();
        output.connect(Box::new(Log(Rc::clone(&effects))), 1000);
        let send = |output: &mut Output<WrenchCommand>, publish_mono_ns: u64| {
            output.write(WrenchCommand::default());
            output.flush(&Header { release_ns: 50, publish_mono_ns, ..Header::default() });
        };
        send(&mut output, 7070);
        let start = ClockRecord { start_mono_ns: 7000, speed: 2.0, ..ClockRecord::default() };
        output.take_effect_when_published(WallMap::new(&start));
        send(&mut output, 7070);
        // Ahead of its release.
        send(&mut output, 7010);
        assert_eq!(*effects.borrow(), [1050, 140, 50]);
    }
}
