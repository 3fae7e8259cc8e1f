//! What the loops of a realtime flight cost besides their steps, for the summary.

use super::loops::seat_name;
use core::fmt;
use serde_json::{Value, json};
use shared_types::LoopStats;

/// Allocations and page faults of every loop since it was warm.
#[derive(Debug, Clone, Default)]
pub struct Upkeep {
    /// Name and totals of those that had any.
    loops: Vec<(String, LoopStats)>,
}

impl Upkeep {
    /// Of the totals of every seat's loop.
    #[must_use]
    pub fn of(stats: &[LoopStats]) -> Self {
        let named = stats.iter().map(|stats| (seat_name(stats), *stats));
        Self { loops: named.collect() }
    }

    fn sum(&self, of: impl Fn(&LoopStats) -> u64) -> u64 {
        self.loops.iter().fold(0, |all: u64, (_, stats)| all.saturating_add(of(stats)))
    }

    /// Allocations of warm loops while no process came or left.
    #[must_use]
    pub fn allocations(&self) -> u64 {
        self.sum(|stats| stats.allocations)
    }

    /// Allocations of the transport for the samples that those loops sent.
    #[must_use]
    pub fn transport_allocations(&self) -> u64 {
        self.sum(|stats| stats.transport_allocations)
    }

    /// Page faults of warm loops while no process came or left.
    #[must_use]
    pub fn page_faults(&self) -> u64 {
        self.sum(|stats| stats.minor_faults.saturating_add(stats.major_faults))
    }

    /// For machines: each loop's counts.
    #[must_use]
    pub fn to_json(&self) -> Value {
        let of_loop = |(name, stats): &(String, LoopStats)| {
            json!({
                "loop": name,
                "allocations": stats.allocations,
                "transport_allocations": stats.transport_allocations,
                "minor_faults": stats.minor_faults,
                "major_faults": stats.major_faults,
                "allocations_at_changes": stats.allocations_at_changes,
                "faults_at_changes": stats.faults_at_changes,
            })
        };
        self.loops.iter().map(of_loop).collect()
    }
}

impl fmt::Display for Upkeep {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (allocations, faults) = (self.allocations(), self.page_faults());
        let at_changes = (
            self.sum(|stats| stats.allocations_at_changes),
            self.sum(|stats| stats.faults_at_changes),
        );
        write!(
            f,
            "  upkeep       {faults} page faults and {allocations} allocations of warm loops"
        )?;
        // Lending a sample takes the transport one small block of memory; there is no way around it.
        write!(f, "; {} of the transport for samples sent", self.transport_allocations())?;
        if at_changes != (0, 0) {
            write!(f, "; {} and {} while processes joined or left", at_changes.1, at_changes.0)?;
        }
        writeln!(f)?;
        for (name, stats) in &self.loops {
            let LoopStats { allocations, minor_faults, major_faults, .. } = stats;
            if [minor_faults, major_faults, allocations].into_iter().any(|count| *count > 0) {
                writeln!(
                    f,
                    "  upkeep       {name}: {minor_faults} page faults in memory, {major_faults} from disk, {allocations} allocations"
                )?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::{Header, Role};

    #[test]
    fn a_loop_with_page_faults_is_named_with_its_seat() {
        let header = Header { seat: 8 + Role::Attitude.0, ..Header::default() };
        let shadow = LoopStats {
            header,
            role: Role::Attitude,
            allocations: 2,
            minor_faults: 3,
            faults_at_changes: 5,
            ..LoopStats::default()
        };
        let quiet = LoopStats { role: Role::Plant, ..LoopStats::default() };
        let upkeep = Upkeep::of(&[quiet, shadow]);
        let text = upkeep.to_string();
        assert!(text.contains("3 page faults and 2 allocations of warm loops"), "{text}");
        assert!(text.contains("; 5 and 0 while processes joined or left"), "{text}");
        assert!(text.contains("attitude@1: 3 page faults") && !text.contains("plant"), "{text}");
        assert_eq!(upkeep.to_json()[1]["faults_at_changes"], 5);
    }
}
