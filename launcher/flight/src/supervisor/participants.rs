//! Which loops fly, and whether all that come and go have come and gone.

use super::{SERVE_LIMIT_NS, Supervisor};
use crate::tap::Tap;
use crate::turns::Participant;
use shared_types::{RegistryEntry, Seat};
use swap::post::Post;

impl Supervisor {
    /// True once every process has given what it had published to all that have joined: what those receive of a process
    /// that dies now is then certain. One that does not is not waited for any longer than [`SERVE_LIMIT_NS`].
    pub(crate) fn has_served(&self, tap: &Tap, now_mono_ns: u64) -> bool {
        let since_ns = self.joined_mono_ns;
        now_mono_ns >= since_ns.saturating_add(SERVE_LIMIT_NS)
            || self.has_served_since(tap, since_ns)
    }

    /// True once every process has given what it had published to all readers that were there at an instant of
    /// `CLOCK_MONOTONIC` \[ns\].
    pub(crate) fn has_served_since(&self, tap: &Tap, since_ns: u64) -> bool {
        self.present().all(|entry| {
            let seat = Seat { role: entry.role, index: entry.seat };
            tap.marks.has_served(seat, entry.generation, since_ns)
        })
    }

    /// True if a loop has given all that have joined what it had published, however long that takes.
    pub(crate) fn has_served_all(&self, one: &Participant, tap: &Tap) -> bool {
        tap.marks.has_served(one.seat, one.generation, self.joined_mono_ns)
    }

    /// The loops that fly: what has been started in flight does so once it has been given where to begin.
    pub(crate) fn participants(&self) -> Vec<Participant> {
        let flies = |entry: &&RegistryEntry| {
            let of_seat =
                |post: &&Post| (post.seat.role, post.seat.index) == (entry.role, entry.seat);
            self.posts.iter().find(of_seat).is_none_or(Post::flies)
        };
        let participant = |entry: &RegistryEntry| {
            let seat = Seat { role: entry.role, index: entry.seat };
            let post = self.posts.iter().find(|post| post.seat == seat);
            let name = post.map_or(seat.role.label(), |post| post.spec.name.as_str());
            let goes_on = post.is_none_or(|post| post.goes_on);
            let (generation, name) = (entry.generation, name.to_owned());
            Participant { seat, generation, name, goes_on }
        };
        self.present().filter(flies).map(participant).collect()
    }

    /// True while a process is starting, is to be started again, or has been ordered to end and has not.
    pub(crate) fn is_changing(&self) -> bool {
        self.posts.iter().any(|post| {
            post.restart_at_ns.is_some() || post.child.is_some() && (!post.ready || post.scripted)
        })
    }

    /// True if something has happened in the slots that these have not taken in.
    pub(crate) fn has_events(&self) -> bool {
        !self.events.is_empty()
    }
}
