//! Which processes are entered in the registry, and which leave it.

use super::{HELLOS, Supervisor};
use crate::tap::Tap;
use runtime::clock::mono_now_ns;
use runtime::ipc::{Bus, ServiceKind};
use shared_types::{Hello, NodeId, Seat};
use std::path::Path;
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
    /// Enters the processes that have become ready in the registry, and counts what others say in their place.
    pub(super) fn take_hellos(&mut self, bus: &Bus, tap: &mut Tap) -> Vec<Joined> {
        let mut joined = Vec::new();
        // No more than are kept: a client that writes without a pause does not keep the launcher.
        for _ in 0..HELLOS {
            let Some((hello, node, pid)) = self.hello.receive_from() else { break };
            // The process that the transport names must be the one that was started for the seat, or one that this has
            // started.
            let said = hello.and_then(|hello| {
                let seat = Seat { role: hello.role, index: hello.seat };
                let of_seat =
                    |post: &&mut Post| (post.seat, post.generation) == (seat, hello.generation);
                let post = self.posts.iter_mut().find(of_seat)?;
                post.is_controller(pid).then_some((hello, seat, post))
            });
            let Some((hello, seat, post)) = said else {
                // A process of this launcher may have died after its hello.
                if Path::new(&format!("/proc/{pid}")).exists() {
                    bus.count_stray(ServiceKind::Hello, node, pid);
                }
                continue;
            };
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
