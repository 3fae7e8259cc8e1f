//! How far loops run ahead of one another, and what readers and topics must keep for it.

use super::{Edge, Graph, GraphError, ROLES};
use crate::rate::Rate;
use shared_types::{Role, TopicInfo};

/// Furthest ahead of its mark that a process announces that it is quiet, where readers and topics
/// keep enough for it \[ns\]. The monitor, woken once in four steps instead of at each, takes a
/// third less of the processor.
const QUIET_LIMIT_NS: u64 = 80_000_000;

/// Furthest that the end of allowed time lies ahead of the slowest loop's mark \[ns\].
pub const CREDIT_NS: u64 = 250_000_000;

/// Samples a flying reader keeps, queued and pending together.
pub const READER_CAPACITY: usize = 1024;

impl Graph {
    /// Sets how far ahead a process may announce that it is quiet: as far as readers keep what is
    /// ahead of it, and topics what it has missed if it is restarted.
    ///
    /// # Errors
    /// [`GraphError::BufferTooSmall`] if too little is kept even if no process is quiet.
    pub(super) fn bound(&mut self) -> Result<(), GraphError> {
        self.quiet_limit_ns = QUIET_LIMIT_NS;
        let fits = |graph: &Self| {
            graph.refuse_overflow().is_ok()
                && graph.too_short_history(Role::Monitor, 1, &|_| None).is_none()
        };
        while self.quiet_limit_ns > 0 && !fits(self) {
            self.quiet_limit_ns /= 2;
        }
        self.refuse_overflow()
    }

    /// Lockstep: how far ahead a process of a role may announce that it is quiet \[ns\]. Only the
    /// monitor publishes nothing at most of its steps.
    #[must_use]
    pub fn quiet_limit_ns(&self, role: Role) -> u64 {
        if role == Role::Monitor { self.quiet_limit_ns } else { 0 }
    }

    /// Furthest that the mark of `of` can ever be ahead of the mark of `over` \[ns\].
    ///
    /// Every arrow holds its consumer back to one period past the instant until which the producer is quiet plus the
    /// latency, a lead does the same for a source, and allowed time ends [`CREDIT_NS`] ahead of the slowest
    /// loop. The shortest way from one to the other is the bound.
    #[must_use]
    pub fn look_ahead_ns(&self, of: Role, over: Role) -> u64 {
        let mut ahead = [u64::MAX; ROLES];
        ahead[over.index()] = 0;
        for _ in &self.nodes {
            for node in &self.nodes {
                let held_by = |e: &Edge| {
                    let slack_ns = e.latency_ns.saturating_add(self.quiet_limit_ns(e.from));
                    (e.to == node.role).then_some((e.from, slack_ns))
                };
                let lead = (node.lead_ns > 0).then_some((Role::Plant, node.lead_ns));
                for (from, slack_ns) in self.edges.iter().filter_map(held_by).chain(lead) {
                    let through = ahead[from.index()]
                        .saturating_add(slack_ns)
                        .saturating_add(node.rate.period_ns());
                    let best = &mut ahead[node.role.index()];
                    *best = through.min(*best);
                }
            }
        }
        let period_ns = self.node(of).map_or(0, |n| n.rate.period_ns());
        ahead[of.index()].min(CREDIT_NS.saturating_add(period_ns))
    }

    /// Most samples of an arrow that can have been published and not be in effect `periods` steps
    /// of the consumer after the last one it took in: what a reader must hold for one period, and
    /// what a topic must keep for a consumer that restarts from a state so old.
    #[must_use]
    pub fn most_waiting(&self, edge: &Edge, periods: u64) -> u64 {
        let (Some(from), Some(_)) = (self.node(edge.from), self.node(edge.to)) else { return 0 };
        from.rate.first_at_or_after(self.window_ns(edge, periods)).saturating_add(1)
    }

    /// The time from which such samples come \[ns\].
    fn window_ns(&self, edge: &Edge, periods: u64) -> u64 {
        let period_ns = self.node(edge.to).map_or(0, |to| to.rate.period_ns());
        period_ns
            .saturating_mul(periods)
            .saturating_add(edge.latency_ns)
            .saturating_add(self.look_ahead_ns(edge.from, edge.to))
    }

    /// The first input whose topic keeps too little for `role` to restart exactly, if it publishes
    /// its state every `state_every` steps; with the samples that would be needed. `rate_of` gives
    /// the rate of topics that are published less often than their producer steps.
    #[must_use]
    pub fn too_short_history(
        &self,
        role: Role,
        state_every: u64,
        rate_of: &dyn Fn(&TopicInfo) -> Option<Rate>,
    ) -> Option<(&Edge, u64)> {
        let needed = |e: &Edge| {
            let waiting = self.most_waiting(e, state_every.max(1));
            let published = rate_of(e.topic).map_or(waiting, |rate| {
                let window_ns = self.window_ns(e, state_every.max(1));
                rate.first_at_or_after(window_ns).saturating_add(1)
            });
            waiting.min(published)
        };
        self.edges
            .iter()
            .filter(|e| e.to == role)
            .map(|e| (e, needed(e)))
            .find(|(e, needed)| *needed > e.topic.history as u64)
    }

    /// Refuses a graph with an arrow of which more samples can wait than its reader keeps.
    fn refuse_overflow(&self) -> Result<(), GraphError> {
        for edge in &self.edges {
            let needed = self.most_waiting(edge, 1);
            if needed > READER_CAPACITY as u64 {
                return Err(GraphError::BufferTooSmall {
                    topic: edge.topic.name,
                    producer: edge.from.label(),
                    consumer: edge.to.label(),
                    needed,
                    capacity: READER_CAPACITY as u64,
                });
            }
        }
        Ok(())
    }
}
