//! All inputs of a service together.

use super::{Input, InputCounts, Origin};
use crate::graph::Roles;
use crate::ownership::SlotBook;
use core::any::Any;
use shared_types::wire::Schema;
use shared_types::{Role, Sample, Seat, Topic, TopicInfo};

/// What one input reads.
#[derive(Debug, Clone, Copy)]
pub struct InputPort {
    /// The topic.
    pub topic: &'static TopicInfo,
    /// Its sample.
    pub sample: &'static Schema,
    /// Bytes of the latch in a published state: whether there is a sample, and the sample.
    pub latch_size: usize,
}

/// Does something for every input of a service, with its type.
pub trait InputVisitor {
    /// What can go wrong.
    type Error;
    /// Called once per input, in declaration order.
    ///
    /// # Errors
    /// Whatever the visitor meets; it ends the walk.
    fn visit<T: Sample>(
        &mut self,
        topic: &'static Topic<T>,
        input: &mut Input<T>,
    ) -> Result<(), Self::Error>;
}

/// The inputs of a service; declared with [`inputs!`](crate::inputs).
pub trait InputSet: Default {
    /// Bytes of all latches.
    const LATCH_SIZE: usize;
    /// Layout of the latches.
    const LAYOUT_HASH: u64;
    /// Topic and sample of each input, in declaration order.
    const PORTS: &'static [InputPort];

    /// Walks the inputs.
    ///
    /// # Errors
    /// The visitor's first error.
    fn visit<V: InputVisitor>(&mut self, visitor: &mut V) -> Result<(), V::Error>;
    /// The [`Input`] of a topic, its sample's type forgotten; none if nothing of it is read.
    fn by_topic(&mut self, name: &str) -> Option<&mut dyn Any>;
    /// Takes what has arrived on every input.
    fn receive(&mut self);
    /// Takes what has arrived on the inputs whose producers are among `moved`, or step unwaited.
    fn receive_if_moved(&mut self, moved: Roles);
    /// Updates which seats count by what has been received about owners.
    fn spread_owner_news(&mut self, previous_ns: Option<u64>);
    /// Puts into effect what is due on every input.
    fn accept(&mut self, t_ns: u64, previous_ns: Option<u64>);
    /// Sum of all inputs' counters.
    fn counts(&self) -> InputCounts;
    /// The origin of the first declared input.
    fn origin(&self) -> Origin;
    /// Writes all latches; `out` holds [`InputSet::LATCH_SIZE`] bytes.
    fn pack_latches(&self, out: &mut [u8]);
    /// Restores all latches.
    fn unpack_latches(&mut self, from: &[u8]);
    /// See [`Input::skip_until`].
    fn skip_until(&mut self, t_ns: u64);
    /// See [`Input::knows_until`].
    fn knows_until(&mut self, t_ns: u64);
    /// See [`Input::take_from`].
    fn take_from(&mut self, first_generations: &[u32; Seat::COUNT]);
    /// See [`Input::learn_owners`].
    fn learn_owners(&mut self, role: Role, slot: &SlotBook, previous_ns: Option<u64>);
}

/// Declares a service's inputs: `inputs! { pub struct Inputs { imu: Imu = IMU, .. } }`. The first
/// one is the cause of the service's outputs.
#[macro_export]
macro_rules! inputs {
    ($(#[$meta:meta])* pub struct $name:ident {
        $($(#[$field_meta:meta])* $field:ident : $sample:ty = $topic:path),* $(,)?
    }) => {
        $(#[$meta])*
        #[derive(Debug, Default)]
        pub struct $name {
            $($(#[$field_meta])* pub $field: $crate::Input<$sample>,)*
        }

        impl $crate::InputSet for $name {
            const LATCH_SIZE: usize = 0 $(+ $crate::Input::<$sample>::LATCH_SIZE)*;
            const LAYOUT_HASH: u64 = {
                let hash = ::shared_types::wire::HASH_SEED;
                $(let hash = ::shared_types::wire::hash_bytes(
                    hash,
                    &<$sample as ::shared_types::wire::Wire>::SCHEMA.layout_hash.to_le_bytes(),
                );)*
                hash
            };
            const PORTS: &'static [$crate::input::InputPort] = &[$($crate::input::InputPort {
                topic: &$topic.info,
                sample: &<$sample as ::shared_types::wire::Wire>::SCHEMA,
                latch_size: $crate::Input::<$sample>::LATCH_SIZE,
            }),*];
            fn by_topic(&mut self, name: &str) -> Option<&mut dyn ::core::any::Any> {
                $(if name == $topic.info.name {
                    return Some(&mut self.$field);
                })*
                let _ = name;
                None
            }
            fn visit<V: $crate::InputVisitor>(&mut self, visitor: &mut V) -> Result<(), V::Error> {
                $(visitor.visit(&$topic, &mut self.$field)?;)*
                let _ = visitor;
                Ok(())
            }
            fn receive(&mut self) {
                $(self.$field.receive();)*
            }
            fn receive_if_moved(&mut self, moved: $crate::graph::Roles) {
                $(self.$field.receive_if_moved(moved);)*
                let _ = moved;
            }
            fn spread_owner_news(&mut self, previous_ns: Option<u64>) {
                $(if let Some((role, book)) = self.$field.owner_news(previous_ns) {
                    self.learn_owners(role, &book, previous_ns);
                })*
                let _ = previous_ns;
            }
            fn accept(&mut self, t_ns: u64, previous_ns: Option<u64>) {
                self.spread_owner_news(previous_ns);
                $(self.$field.accept(t_ns, previous_ns);)*
                let _ = (t_ns, previous_ns);
            }
            fn counts(&self) -> $crate::InputCounts {
                let total = $crate::InputCounts::default();
                $(let total = total + self.$field.counts();)*
                total
            }
            fn origin(&self) -> $crate::input::Origin {
                let origins: &[$crate::input::Origin] = &[$(self.$field.origin()),*];
                origins.first().copied().unwrap_or_default()
            }
            fn pack_latches(&self, out: &mut [u8]) {
                let rest = out;
                $(let (head, rest) = rest.split_at_mut($crate::Input::<$sample>::LATCH_SIZE);
                self.$field.pack_latch(head);)*
                debug_assert!(rest.is_empty());
            }
            fn unpack_latches(&mut self, from: &[u8]) {
                let rest = from;
                $(let (head, rest) = rest.split_at($crate::Input::<$sample>::LATCH_SIZE);
                self.$field.unpack_latch(head);)*
                debug_assert!(rest.is_empty());
            }
            fn skip_until(&mut self, t_ns: u64) {
                self.spread_owner_news(None);
                $(self.$field.skip_until(t_ns);)*
                let _ = t_ns;
            }
            fn learn_owners(
                &mut self,
                role: ::shared_types::Role,
                slot: &$crate::ownership::SlotBook,
                previous_ns: Option<u64>,
            ) {
                $(self.$field.learn_owners(role, slot, previous_ns);)*
                let _ = (role, slot, previous_ns);
            }
            fn take_from(&mut self, first_generations: &[u32; ::shared_types::Seat::COUNT]) {
                $(self.$field.take_from(first_generations);)*
                let _ = first_generations;
            }
            fn knows_until(&mut self, t_ns: u64) {
                $(self.$field.knows_until(t_ns);)*
                let _ = t_ns;
            }
        }
    };
}
