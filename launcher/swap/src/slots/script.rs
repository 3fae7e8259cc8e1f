//! What is done to a flight on purpose, at logical instants: swaps, standbys, faults and orders.

use super::{News, SlotContext, Slots, SwapReport};
use crate::FlightError;
use protocol::control::Request;
use protocol::control::protocol::SwapRequest;
use runtime::Graph;
use scenario::Settings;
use scenario::orders::{self, Planner};
use scenario::script::{FaultKind, FaultSettings, StandbySettings, SwapSettings};
use shared_types::time::ns_from_s;
use slot::supervisor::Now;

/// One thing to be done.
#[derive(Debug, Clone)]
enum Deed {
    Swap(SwapSettings),
    Standby(StandbySettings),
    Fault(FaultSettings),
    /// To be in effect at an instant \[ns\].
    Order(orders::Order, u64),
}

/// Everything that is still to be done, the next thing last.
#[derive(Debug, Default)]
pub struct Script {
    deeds: Vec<(u64, Deed)>,
}

impl Script {
    /// The deeds of a scenario.
    #[must_use]
    pub fn new(settings: &Settings, graph: &Graph) -> Self {
        let Settings { swap, standby, fault, order, .. } = settings;
        let swaps = swap.iter().map(|swap| (ns_from_s(swap.at_s), Deed::Swap(swap.clone())));
        let standbys =
            standby.iter().map(|standby| (ns_from_s(standby.at_s), Deed::Standby(standby.clone())));
        let faults = fault.iter().map(|f| (ns_from_s(f.at_s), Deed::Fault(f.clone())));
        let orders = order.iter().filter_map(|settings| {
            let (order, at_ns) = (settings.order()?, ns_from_s(settings.at_s));
            // Pilot and injector run ahead, so their orders are sent ahead; not before every loop flies.
            let send_ns = at_ns.saturating_sub(Planner::ahead_ns(&order, graph)).max(1);
            Some((send_ns, Deed::Order(order, at_ns)))
        });
        let mut deeds: Vec<_> = standbys.chain(swaps).chain(faults).chain(orders).collect();
        // Stable: what is written first at an instant is done first.
        deeds.sort_by_key(|(at_ns, _)| *at_ns);
        deeds.reverse();
        Self { deeds }
    }

    /// Leaves out what was due before `t_ns`.
    pub fn skip_before(&mut self, t_ns: u64) {
        self.deeds.retain(|(at_ns, _)| *at_ns >= t_ns);
    }

    /// Instant of the next deed; lockstep time stops there \[ns\].
    #[must_use]
    pub fn next_ns(&self) -> u64 {
        self.deeds.last().map_or(u64::MAX, |(at_ns, _)| *at_ns)
    }

    /// True if there is something to be done now. Where time stands still for a slot, what is due then comes after what
    /// it waits for, which may take as long as it likes.
    #[must_use]
    pub fn is_due(&self, slots: &Slots, now: Now) -> bool {
        self.next_ns() <= now.logical_ns && !slots.holds_time()
    }

    /// The next deed that is due. A swap waits while the monitor does not step, since nothing would watch the new owner.
    fn take_due(&mut self, now_ns: u64, monitor_silent_ns: Option<u64>) -> Option<Deed> {
        let waits = |deed: &Deed| monitor_silent_ns.is_some() && matches!(deed, Deed::Swap(_));
        let is_next = |(at_ns, deed): &(u64, Deed)| *at_ns <= now_ns && !waits(deed);
        let at = self.deeds.iter().rposition(is_next)?;
        Some(self.deeds.remove(at).1)
    }

    /// The flight has ended: the swaps that were due have not begun, and are reported as refused.
    pub fn refuse_waiting(&mut self, flown_ns: u64, reports: &mut Vec<SwapReport>) {
        for (at_ns, deed) in self.deeds.drain(..).rev().filter(|(at_ns, _)| *at_ns < flown_ns) {
            let Deed::Swap(swap) = deed else { continue };
            let mut report = SwapReport::new(swap.slot, "", &swap.to, at_ns, true);
            report.refuse(
                &"the flight ended before it began: a scripted swap waits for a monitor that does not step",
            );
            reports.push(report);
        }
    }

    /// Does what is due.
    ///
    /// # Errors
    /// [`FlightError`] if the flight cannot go on.
    pub fn run(
        &mut self,
        slots: &mut Slots,
        context: &mut SlotContext<'_>,
    ) -> Result<(), FlightError> {
        while self.is_due(slots, context.now)
            && let Some(deed) = self.take_due(context.now.logical_ns, context.monitor_silent_ns)
        {
            match deed {
                Deed::Swap(swap) => slots.script(&order(&swap), context)?,
                Deed::Standby(StandbySettings { slot, name, shadow_s, rehearse, .. }) => {
                    let slot = slot.label().to_owned();
                    let shadow_ns = ns_from_s(shadow_s);
                    slots.script(&Request::Standby { slot, name, shadow_ns, rehearse }, context)?;
                }
                Deed::Fault(fault) => afflict(&fault, slots, context)?,
                Deed::Order(order, at_ns) => slots.give_scripted(&order, at_ns, context),
            }
        }
        Ok(())
    }
}

/// Begins every report of a fault that was asked for.
pub const FAULT: &str = "fault: ";

/// A scripted swap is what a user would have asked for.
fn order(swap: &SwapSettings) -> Request {
    Request::Swap(SwapRequest {
        slot: swap.slot.label().to_owned(),
        to: swap.to.clone(),
        config: swap.config.clone(),
        shadow_ns: ns_from_s(swap.shadow_s),
        max_bump: swap.max_bump,
        rollback_ns: ns_from_s(swap.rollback_s),
        force: swap.force,
        rehearse: swap.rehearse,
        dry_run: false,
    })
}

/// Kills or stops the process that has the name; of several in a slot the one that commands.
fn afflict(
    fault: &FaultSettings,
    slots: &mut Slots,
    context: &mut SlotContext<'_>,
) -> Result<(), FlightError> {
    let in_slot = slots.seats_of(&fault.name).first().copied();
    let Some(place) = in_slot.or_else(|| context.posts.seat_of(&fault.name)) else {
        return Ok(());
    };
    let deed = if matches!(fault.kind, FaultKind::Kill) { "killed" } else { "stopped" };
    let text = format!("{FAULT}{} is {deed} on purpose", fault.name);
    slots.news.push(News { text, warning: false });
    slots.strike(place);
    match fault.kind {
        FaultKind::Kill => {
            slots.killed(place, context);
            context.posts.kill_at_once(place);
        }
        FaultKind::Stop => {
            context.posts.stop(place);
            if slots.has(place.role) {
                slots.stopped(place, context)?;
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_swap_waits_for_a_silent_monitor_and_what_is_due_behind_it_does_not() {
        let script = [
            scenario::Override::swap("attitude=attitude-pid@1s").unwrap(),
            scenario::Override::fault("kill:plant@2s").unwrap(),
        ];
        let scenario = scenario::Scenario::load("hover", &script).unwrap();
        let swap = Deed::Swap(scenario.settings().swap[0].clone());
        let fault = Deed::Fault(scenario.settings().fault[0].clone());
        let mut script = Script { deeds: vec![(30, swap.clone()), (20, fault), (10, swap)] };
        let silent_ns = Some(40_000_000);
        assert!(script.take_due(9, silent_ns).is_none());
        assert!(matches!(script.take_due(25, silent_ns), Some(Deed::Fault(_))));
        assert!(script.take_due(40, silent_ns).is_none());
        assert_eq!(script.next_ns(), 10, "it is still to come");
        assert!(matches!(script.take_due(25, None), Some(Deed::Swap(_))));
        assert!(script.take_due(25, None).is_none(), "not before its time");
        let mut reports = Vec::new();
        script.refuse_waiting(30, &mut reports);
        assert!(reports.is_empty(), "it was not due when the flight ended");
        let swap = Deed::Swap(scenario.settings().swap[0].clone());
        Script { deeds: vec![(30, swap.clone()), (10, swap)] }.refuse_waiting(30, &mut reports);
        assert_eq!(reports.len(), 1);
        assert!(reports[0].has_failed() && reports[0].to == "attitude-pid", "{reports:?}");
    }
}
