//! What is done to a flight on purpose, at logical instants: swaps and faults.

use super::facts::order;
use super::{Limits, Means, Slots};
use crate::run::child::ChildSpec;
use crate::run::supervisor::FlightError;
use crate::scenario::settings::{FaultKind, FaultSettings, SwapSettings};
use shared_types::Role;
use slot::supervisor::{Request, Target};

/// One thing to be done.
#[derive(Debug, Clone)]
enum Deed {
    Swap { slot: Role, spec: Box<ChildSpec>, settings: SwapSettings },
    Fault(FaultSettings),
}

/// Everything that is still to be done, the next thing last.
#[derive(Debug, Default)]
pub(in crate::run) struct Script {
    deeds: Vec<(u64, Deed)>,
}

impl Script {
    /// `swaps` come with whom to start.
    pub(in crate::run) fn new(
        swaps: Vec<(SwapSettings, ChildSpec)>,
        faults: &[FaultSettings],
    ) -> Self {
        let swaps = swaps.into_iter().map(|(settings, spec)| {
            let (slot, at_ns) = (settings.slot.role(), nanoseconds(settings.at_s));
            (at_ns, Deed::Swap { slot, spec: Box::new(spec), settings })
        });
        let faults = faults.iter().map(|f| (nanoseconds(f.at_s), Deed::Fault(f.clone())));
        let mut deeds: Vec<_> = swaps.chain(faults).collect();
        // Stable: what is written first at an instant is done first.
        deeds.sort_by_key(|(at_ns, _)| *at_ns);
        deeds.reverse();
        Self { deeds }
    }

    /// Instant of the next deed; lockstep time stops there \[ns\].
    pub(in crate::run) fn next_ns(&self) -> u64 {
        self.deeds.last().map_or(u64::MAX, |(at_ns, _)| *at_ns)
    }

    /// Does what is due. True if something was done.
    pub(in crate::run) fn run(
        &mut self,
        slots: &mut Slots,
        means: &mut Means<'_>,
    ) -> Result<bool, FlightError> {
        let mut done = false;
        while self.next_ns() <= means.now.logical_ns {
            let Some((_, deed)) = self.deeds.pop() else { break };
            done = true;
            match deed {
                Deed::Swap { slot, spec, settings } => {
                    let program = slots.program(*spec);
                    let mut order =
                        order(nanoseconds(settings.shadow_s), nanoseconds(settings.rollback_s));
                    order.force = settings.force;
                    let request = Request::Swap(Target::New(program), order);
                    let limits = Limits { max_bump: settings.max_bump };
                    slots.request(slot, request, limits, means)?;
                }
                Deed::Fault(fault) => afflict(&fault, slots, means)?,
            }
        }
        Ok(done)
    }
}

/// Kills or stops whoever has the name; of several in a slot the one that commands.
fn afflict(
    fault: &FaultSettings,
    slots: &mut Slots,
    means: &mut Means<'_>,
) -> Result<(), FlightError> {
    let in_slot = slots.seats_of(&fault.name).first().copied();
    let Some(place) = in_slot.or_else(|| means.supervisor.seat_of(&fault.name)) else {
        return Ok(());
    };
    match fault.kind {
        FaultKind::Kill => means.supervisor.kill_at_once(place),
        FaultKind::Stop => {
            means.supervisor.stop(place, means.tap);
            if slots.has(place.role) {
                slots.stopped(place, means)?;
            }
        }
    }
    Ok(())
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked settings")]
fn nanoseconds(seconds: f64) -> u64 {
    (seconds * 1e9).round() as u64
}
