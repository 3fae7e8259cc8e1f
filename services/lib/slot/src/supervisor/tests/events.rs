//! Random events in random order.

use super::*;
use proptest::prelude::*;

fn any_event() -> impl Strategy<Value = Event> {
    let seat = (0..4_usize).prop_map(|i| SEAT[i]);
    let epoch = 0..12_u64;
    let order =
        (0..3_u64, 0..3_u64, any::<bool>(), any::<bool>()).prop_map(|(a, b, force, dry_run)| {
            SwapTerms {
                shadow_ns: a * MS,
                rollback_ns: b * MS,
                force,
                rehearse: a % 2 == 1,
                dry_run,
            }
        });
    prop_oneof![
        (order.clone(), any::<bool>()).prop_map(|(o, is_trusted)| {
            let target = Target::New(Program { number: 1, is_trusted });
            Event::Request(Request::Swap(target, o))
        }),
        (seat.clone(), order)
            .prop_map(|(s, o)| Event::Request(Request::Swap(Target::Seated(s), o))),
        Just(Event::Request(Request::Rollback)),
        seat.clone().prop_map(|s| Event::Request(Request::Retire(s))),
        any::<bool>().prop_map(|is_trusted| {
            Event::Request(Request::Standby(Program { number: 2, is_trusted }, MS, true))
        }),
        (seat.clone(), 7..9_u64).prop_map(|(s, layout)| Event::Ready(s, instance(layout))),
        seat.clone().prop_map(|s| Event::Verdict(s, Ok(Box::default()))),
        seat.clone().prop_map(|s| Event::Verdict(s, Err(failed()))),
        (seat.clone(), any::<bool>(), any::<bool>()).prop_map(|(s, left_tube, passed)| {
            let refusal = || RehearsalRefusal::NotRehearsed("it took too long".to_owned());
            let verdict = passed.then(String::new).ok_or_else(refusal);
            Event::Rehearsed(s, Rehearsed { from_ns: 0, left_tube, verdict })
        }),
        epoch.clone().prop_map(|epoch| Event::Tripped { epoch, at_ns: 0 }),
        Just(Event::Unwatched),
        Just(Event::Time),
        (epoch.clone(), seat.clone()).prop_map(|(epoch, seat)| Event::Acknowledged {
            epoch,
            seat,
            at_ns: 0
        }),
        epoch.clone().prop_map(|epoch| Event::RecordRefused { epoch }),
        epoch.prop_map(|epoch| Event::FailedOver { epoch, at_ns: 0 }),
        seat.clone().prop_map(Event::Died),
        seat.prop_map(|s| Event::Misbehaved(s, Fault::Stalled)),
    ]
}

proptest! {
    #[test]
    fn no_events_in_any_order_break_it(
        events in prop::collection::vec((any_event(), 0..4 * MS), 0..120),
        lockstep in any::<bool>(),
    ) {
        let config = if lockstep { SlotConfig::LOCKSTEP } else { SlotConfig::REALTIME };
        let mut slot = SlotMachine::new(config, SEAT[0], program(0));
        let mut t = 0;
        let mut newest: Option<Record> = None;
        let mut programs = [program(0); SEATS];
        for (event, later_ns) in events {
            t += later_ns;
            for action in slot.on(Now { logical_ns: t, allowed_ns: t }, event) {
                if let Action::Spawn(seat, program) = action {
                    programs[seat.index()] = program;
                }
                let Action::Publish(record) = action else { continue };
                let is_trusted = |seat: Seat| programs[seat.index()].is_trusted;
                prop_assert!(record.watched || is_trusted(record.owner), "watched by what it is");
                if let Some(before) = newest {
                    prop_assert!(record.epoch > before.epoch);
                    prop_assert!(record.effective_ns >= before.effective_ns);
                }
                prop_assert!(record.is_taken(record.owner), "an owner that is there");
                prop_assert_ne!(record.fallback, Some(record.owner));
                prop_assert!(record.fallback.is_none_or(|seat| record.is_taken(seat)));
                newest = Some(record);
                if let Phase::Steady { .. } = slot.phase {
                    let is_fit = record.fallback.is_none_or(is_trusted);
                    prop_assert!(is_fit || is_trusted(record.owner), "two that are not trusted");
                }
            }
        }
    }
}
