//! Which clients may stay: all, until every place is taken. Then the one that has been idle for longest makes room.

use core::sync::atomic::{AtomicU64, Ordering};
use std::sync::Arc;
use tokio::sync::Notify;
use tokio::task::AbortHandle;

/// Clients at a time.
pub(super) const CLIENTS: usize = 64;
/// Stands for no instant: a client that waits for our answer.
const AT_WORK: u64 = u64::MAX;

/// The clients that are connected.
#[derive(Debug, Default)]
pub(super) struct Guests {
    inside: Vec<(Arc<AtomicU64>, AbortHandle)>,
    doings: Arc<Doings>,
}

/// What guests do, counted.
#[derive(Debug, Default)]
struct Doings {
    count: AtomicU64,
    /// Notified whenever one has its answer, or leaves.
    ended: Notify,
}

/// One guest's part in it.
pub(super) struct Guest {
    /// What was done last before it began to idle, or [`AT_WORK`].
    idle_since: Arc<AtomicU64>,
    doings: Arc<Doings>,
}

impl Guest {
    /// From here on it waits for our answer.
    pub(super) fn works(&self) {
        self.idle_since.store(AT_WORK, Ordering::Relaxed);
    }

    /// It has its answer, or has only just come.
    pub(super) fn idles(&self) {
        let now = self.doings.count.fetch_add(1, Ordering::Relaxed);
        self.idle_since.store(now, Ordering::Relaxed);
        self.doings.ended.notify_one();
    }
}

impl Drop for Guest {
    fn drop(&mut self) {
        self.doings.ended.notify_one();
    }
}

impl Guests {
    /// Lets one in, once there is a place: it waits only for those that are being answered.
    pub(super) async fn admit<C: Future<Output = ()> + Send + 'static>(
        &mut self,
        conversation: impl FnOnce(Guest) -> C,
    ) {
        while !self.has_room() {
            self.doings.ended.notified().await;
        }
        let idle_since = Arc::<AtomicU64>::default();
        let doings = Arc::clone(&self.doings);
        let guest = Guest { idle_since: Arc::clone(&idle_since), doings };
        guest.idles();
        let task = tokio::spawn(conversation(guest));
        self.inside.push((idle_since, task.abort_handle()));
        // So that what it has sent already counts before the next one is let in.
        tokio::task::yield_now().await;
    }

    /// Sends away the client that has been idle for longest if every place is taken; false if all are at work.
    fn has_room(&mut self) -> bool {
        self.inside.retain(|(_, task)| !task.is_finished());
        if self.inside.len() < CLIENTS {
            return true;
        }
        let since = |place: usize| self.inside[place].0.load(Ordering::Relaxed);
        let longest = (0..self.inside.len()).min_by_key(|place| since(*place));
        let Some(place) = longest.filter(|place| since(*place) != AT_WORK) else { return false };
        self.inside.swap_remove(place).1.abort();
        true
    }
}
