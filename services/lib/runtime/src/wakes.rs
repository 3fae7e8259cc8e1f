//! Which loops to wake in lockstep: only those that are not sure to be woken again for the same releases.
//!
//! The attitude loop waits for plant and estimator, but the estimator's mark cannot pass an instant
//! before the plant's has. Waking the attitude loop for the plant's mark would only show it that
//! the estimator is not there yet, and a wake-up costs more than most steps. In realtime a loop may
//! step without its inputs, no mark implies another, and all of [`Graph::wakes`] are woken.

use crate::graph::{Edge, Graph, Node};
use crate::rate::Rate;
use shared_types::Role;

/// Releases looked at; a process that is unblocked for more is woken without looking.
const MAX_RELEASES: usize = 8;

impl Graph {
    /// Of [`wakes`](Self::wakes), the roles for which the mark of `from` may be the last that one
    /// of their releases waits for, among those from `woken_from_ns` on.
    pub fn lockstep_wakes(
        &self,
        from: Role,
        old_ns: u64,
        new_ns: u64,
        woken_from_ns: impl Fn(&Node) -> u64,
    ) -> impl Iterator<Item = Role> {
        self.nodes()
            .iter()
            .filter(move |node| {
                let may_come_last = |e: &Edge| {
                    let first_ns = woken_from_ns(node).saturating_sub(e.lag_ns());
                    self.may_come_last(e, node, old_ns.max(first_ns), new_ns)
                };
                node.is_paced_by(from, old_ns, new_ns)
                    || self
                        .edges()
                        .iter()
                        .any(|e| e.from == from && e.to == node.role && may_come_last(e))
            })
            .map(|node| node.role)
    }

    /// True if some release of `node` that `edge` permits since its mark moved may then run.
    fn may_come_last(&self, edge: &Edge, node: &Node, old_ns: u64, new_ns: u64) -> bool {
        if old_ns >= new_ns {
            return false;
        }
        let mut releases = edge.unblocked(node.rate, old_ns, new_ns);
        releases.by_ref().take(MAX_RELEASES).any(|t_ns| !self.is_implied(edge, t_ns))
            || releases.next().is_some()
    }

    /// True if another arrow to the same consumer permits its release at `t_ns` only after `edge`
    /// has.
    fn is_implied(&self, edge: &Edge, t_ns: u64) -> bool {
        let Some(producer) = self.node(edge.from) else { return false };
        // What a quiet loop permits it permits before it has run.
        let runs_first = |f: &&Edge| f.from != edge.from && self.quiet_limit_ns(f.from) == 0;
        self.edges().iter().filter(|f| f.to == edge.to).filter(runs_first).any(|f| {
            let Some(last_ns) = self.last_release_needed(f, t_ns) else { return false };
            // That release has run, so the arrows to it have permitted it.
            self.edges().iter().filter(|g| g.to == f.from && g.from == edge.from).any(|g| {
                let Some(need_ns) = last_ns.checked_sub(g.latency_ns) else { return false };
                let past_ns = need_ns + u64::from(!g.strict);
                let grid = Some(producer.rate).filter(|_| self.quiet_limit_ns(edge.from) == 0);
                let mark_ns = grid.map_or(past_ns, |r| r.release_ns(r.first_at_or_after(past_ns)));
                (need_ns > 0 || !g.strict) && edge.permits(t_ns, mark_ns)
            })
        })
    }

    /// Instant of the last release of the producer that must have run before `edge` permits its
    /// consumer's release at `t_ns`; none if it permits that from the start.
    fn last_release_needed(&self, edge: &Edge, t_ns: u64) -> Option<u64> {
        let need_ns = t_ns.checked_sub(edge.latency_ns)?;
        let rate = self.node(edge.from)?.rate;
        let first_not_needed = rate.first_at_or_after(need_ns + u64::from(!edge.strict));
        first_not_needed.checked_sub(1).map(|k| rate.release_ns(k))
    }
}

impl Node {
    /// True if this is a source and `from` lets it work on by moving its mark.
    pub(crate) fn is_paced_by(&self, from: Role, old_ns: u64, new_ns: u64) -> bool {
        // A source works half its lead at a time, so that pacing it costs few wake-ups.
        let chunk_ns = (self.lead_ns / 2).max(1);
        self.lead_ns > 0 && from == Role::Plant && old_ns / chunk_ns != new_ns / chunk_ns
    }
}

impl Edge {
    /// How much later than the producer's mark the first release lies that it does not permit \[ns\].
    fn lag_ns(&self) -> u64 {
        self.latency_ns + u64::from(self.strict)
    }

    /// True if moving the producer's mark from `old_ns` to `new_ns` may unblock a release of the
    /// consumer: the only case in which it is worth waking.
    #[must_use]
    pub fn unblocks(&self, consumer: Rate, old_ns: u64, new_ns: u64) -> bool {
        self.unblocked(consumer, old_ns, new_ns).next().is_some()
    }

    /// The releases of the consumer that this arrow permits at mark `new_ns` and not at `old_ns`.
    pub fn unblocked(
        &self,
        consumer: Rate,
        old_ns: u64,
        new_ns: u64,
    ) -> impl Iterator<Item = u64> + use<> {
        let end_ns = self.open_until_ns(new_ns);
        (consumer.first_at_or_after(self.open_until_ns(old_ns))..)
            .map(move |k| consumer.release_ns(k))
            .take_while(move |&t_ns| t_ns < end_ns)
    }
}
