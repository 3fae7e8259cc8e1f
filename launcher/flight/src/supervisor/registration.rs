//! Which processes are entered in the registry, and which leave it.

use super::{HELLOS, Supervisor};
use crate::tap::Tap;
use runtime::clock::mono_now_ns;
use shared_types::{Hello, NodeId, Seat};
use swap::PostEvent;
use swap::post::Post;

/// A process that has just been entered in the registry.
#[derive(Debug, Clone, Copy)]
pub(super) struct Joined {
    pub(super) seat: Seat,
    pub(super) layout: u64,
    pub(super) period_ns: u64,
}

impl Joined {
    /// For a slot of several seats.
    pub(super) fn to_event(self) -> Option<PostEvent> {
        let Self { seat, layout, period_ns } = self;
        seat.role.is_slot().then_some(PostEvent::Joined { place: seat, layout, period_ns })
    }
}

impl Supervisor {
    /// Enters the processes that have become ready in the registry.
    pub(super) fn take_hellos(&mut self, tap: &mut Tap) -> Vec<Joined> {
        let mut joined = Vec::new();
        // No more than are kept: a client that writes without a pause does not keep the launcher.
        for _ in 0..HELLOS {
            let Some((hello, node, pid)) = self.hello.receive_from() else { break };
            let Some(hello) = hello else { continue };
            let seat = Seat { role: hello.role, index: hello.seat };
            let of_seat =
                |post: &&mut Post| post.seat == seat && post.generation == hello.generation;
            // The process that the transport names must be the one that was started for the seat, or one that this has
            // started.
            let Some(post) = self.posts.iter_mut().find(of_seat) else { continue };
            if !post.is_controller(pid) {
                continue;
            }
            post.ready = true;
            post.layout = hello.state_layout;
            post.period_ns = hello.period_ns;
            joined.push(Joined { seat, layout: hello.state_layout, period_ns: hello.period_ns });
            self.enter(node, seat, &hello, tap);
            self.joined_mono_ns = mono_now_ns();
        }
        joined
    }

    fn enter(&mut self, node: NodeId, seat: Seat, hello: &Hello, tap: &mut Tap) {
        self.registry.enter(node, seat, hello.generation, hello.period_ns);
        self.note();
        self.registry.publish();
        tap.marks.learn_registry(self.registry.entries());
    }

    /// No process waits for a seat any more.
    pub(super) fn leave_registry(&mut self, seat: Seat, tap: &mut Tap) {
        self.registry.leave(seat);
        self.note();
        self.registry.publish();
        tap.marks.learn_registry(self.registry.entries());
    }
}
