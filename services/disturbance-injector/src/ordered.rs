//! Disturbances that are ordered in flight.

use crate::event::{Constant, Event, Kick, Load, Payload, RotorEfficiency, Wind};
use crate::player::{Disturbance, EventMemory, Player};
use shared_types::{DISTURBANCE_ORDERS, DisturbanceKind, DisturbanceOrder, OrderedDisturbance};

shared_types::memory! {
    /// One of them as plain numbers.
    #[derive(PartialEq)]
    pub struct OrderedMemory {
        /// Its number in the orders; 0 for none.
        pub number: u64,
        /// How far it is.
        pub event: EventMemory,
    }
}

/// Streams of noise from here on belong to what is ordered; a script has far fewer.
const FIRST_STREAM: u64 = 1 << 32;

/// One that holds.
#[derive(Debug, Clone)]
struct Holding {
    number: u64,
    player: Player,
}

/// All that hold.
#[derive(Debug, Clone)]
pub(crate) struct Ordered {
    holding: [Option<Holding>; DISTURBANCE_ORDERS],
    /// Of a predecessor, until the order itself is seen.
    remembered: [OrderedMemory; DISTURBANCE_ORDERS],
    /// Sequence of the order that has been taken in.
    followed: u64,
    silences_script: bool,
    rate_hz: f64,
    seed: u64,
}

/// As a script would have it; `None` for an order of another build.
fn event(ordered: &OrderedDisturbance) -> Option<Event> {
    let constant = |load| Event::Constant(Constant { load });
    Some(match ordered.kind {
        DisturbanceKind::Wind => Event::Wind(Wind {
            at_s: 0.0,
            until_s: None,
            mean_w_m_s: ordered.wind_w_m_s,
            sigma_m_s: ordered.gust_sigma_w_m_s,
            length_m: Wind::default_length_m(),
        }),
        DisturbanceKind::Force => {
            constant(Load { force_w_n: ordered.force_w_n, ..Load::default() })
        }
        DisturbanceKind::Torque => {
            constant(Load { torque_b_nm: ordered.torque_b_nm, ..Load::default() })
        }
        DisturbanceKind::Kick => {
            Event::Kick(Kick { at_s: 0.0, body_rate_b_rad_s: ordered.body_rate_kick_b_rad_s })
        }
        DisturbanceKind::Payload => {
            Event::Payload(Payload { at_s: 0.0, until_s: None, mass_kg: ordered.payload_kg })
        }
        DisturbanceKind::Rotor => Event::RotorEfficiency(RotorEfficiency {
            at_s: 0.0,
            until_s: None,
            rotor: u8::try_from(ordered.rotor).ok().filter(|rotor| (1..=4).contains(rotor))?,
            efficiency: ordered.efficiency,
        }),
        _ => return None,
    })
}

impl Ordered {
    /// Nothing yet.
    pub(crate) fn new(rate_hz: f64, seed: u64) -> Self {
        Self {
            holding: core::array::from_fn(|_| None),
            remembered: [OrderedMemory::default(); DISTURBANCE_ORDERS],
            followed: 0,
            silences_script: false,
            rate_hz,
            seed,
        }
    }

    /// Begins what is new in an order, keeps what it repeats and ends what it leaves out.
    pub(crate) fn follow(&mut self, order: &DisturbanceOrder) {
        if self.followed == order.header.sequence {
            return;
        }
        self.followed = order.header.sequence;
        self.silences_script = order.script_off.is_set();
        let count = usize::try_from(order.count).unwrap_or(0).min(DISTURBANCE_ORDERS);
        let mut before = core::mem::replace(&mut self.holding, core::array::from_fn(|_| None));
        for (slot, ordered) in self.holding.iter_mut().zip(&order.entries[..count]) {
            let mut kept = before.iter_mut().filter(|holding| {
                holding.as_ref().is_some_and(|holding| holding.number == ordered.number)
            });
            *slot = match kept.next() {
                Some(holding) => holding.take(),
                None => begin(ordered, &self.remembered, self.rate_hz, self.seed),
            };
        }
    }

    /// True if the script is to be calm.
    pub(crate) fn silences_script(&self) -> bool {
        self.silences_script
    }

    /// Adds what all do at `now_ns`.
    pub(crate) fn play(&mut self, now_ns: u64, dt_s: f64, total: &mut Disturbance) {
        for holding in self.holding.iter_mut().flatten() {
            holding.player.play(now_ns, dt_s, total);
        }
    }

    pub(crate) fn memory(&self) -> [OrderedMemory; DISTURBANCE_ORDERS] {
        core::array::from_fn(|place| {
            self.holding[place].as_ref().map_or(OrderedMemory::default(), |holding| OrderedMemory {
                number: holding.number,
                event: holding.player.memory(),
            })
        })
    }

    /// Forgets what it holds; the order in effect brings it back, as far as `memory` knows it.
    pub(crate) fn restore(&mut self, memory: &[OrderedMemory; DISTURBANCE_ORDERS]) {
        *self = Self { remembered: *memory, ..Self::new(self.rate_hz, self.seed) };
    }

    pub(crate) fn reseed(&mut self, seed: u64) {
        self.seed = seed;
        for remembered in &mut self.remembered {
            remembered.event.noise = remembered.event.noise.with_seed(seed);
        }
        self.holding.iter_mut().flatten().for_each(|holding| holding.player.reseed(seed));
    }
}

fn begin(
    ordered: &OrderedDisturbance,
    remembered: &[OrderedMemory],
    rate_hz: f64,
    seed: u64,
) -> Option<Holding> {
    let &OrderedDisturbance { number, begin_ns, until_ns, .. } = ordered;
    let stream = FIRST_STREAM.wrapping_add(number);
    let span = (begin_ns, until_ns);
    let mut player = Player::between(event(ordered)?, span, rate_hz, (seed, stream));
    if let Some(known) = remembered.iter().find(|known| known.number == number && number > 0) {
        player.go_on(&known.event);
    }
    Some(Holding { number, player })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Injector, InjectorConfig};
    use shared_types::{Flag, Header};

    const MS: u64 = 1_000_000;

    fn order(sequence: u64, entries: &[OrderedDisturbance]) -> DisturbanceOrder {
        let header = Header { sequence, ..Header::default() };
        let mut order =
            DisturbanceOrder { header, count: entries.len() as u64, ..DisturbanceOrder::default() };
        order.entries[..entries.len()].copy_from_slice(entries);
        order
    }

    fn push(number: u64, begin_ms: u64, until_ms: u64, force_n: f64) -> OrderedDisturbance {
        OrderedDisturbance {
            number,
            begin_ns: begin_ms * MS,
            until_ns: until_ms * MS,
            force_w_n: [force_n, 0.0, 0.0],
            kind: DisturbanceKind::Force,
            ..OrderedDisturbance::default()
        }
    }

    fn gusts(number: u64) -> OrderedDisturbance {
        OrderedDisturbance {
            number,
            until_ns: u64::MAX,
            gust_sigma_w_m_s: [1.0; 3],
            kind: DisturbanceKind::Wind,
            ..OrderedDisturbance::default()
        }
    }

    fn injector() -> Injector {
        Injector::new(&InjectorConfig::default(), 7).unwrap()
    }

    #[test]
    fn an_ordered_force_acts_from_its_instant_to_its_end_and_others_add_up() {
        let mut injector = injector();
        injector.follow(&order(1, &[push(1, 10, 20, 0.5), push(2, 15, 30, 0.25)]));
        let force = |injector: &mut Injector, ms: u64| injector.step(ms * MS).force_w_n[0];
        let seen: Vec<f64> = (1..8).map(|k| force(&mut injector, 5 * k)).collect();
        let expected = [0.0, 0.5, 0.75, 0.25, 0.25, 0.0, 0.0];
        assert!(seen.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-15), "{seen:?}");
    }

    #[test]
    fn what_a_later_order_repeats_goes_on_and_what_it_leaves_out_ends() {
        let (mut once, mut twice) = (injector(), injector());
        for injector in [&mut once, &mut twice] {
            injector.follow(&order(1, &[gusts(1)]));
            injector.step(5 * MS);
        }
        once.follow(&order(2, &[gusts(1), push(2, 0, 1000, 1.0)]));
        let (a, b) = (once.step(10 * MS), twice.step(10 * MS));
        assert_eq!(a.wind_w_m_s.map(f64::to_bits), b.wind_w_m_s.map(f64::to_bits));
        assert!((a.force_w_n[0] - 1.0).abs() < 1e-15);
        once.follow(&order(3, &[]));
        assert_eq!(once.step(15 * MS), Disturbance::CALM);
    }

    #[test]
    fn a_kick_lasts_one_sample_whatever_the_instant() {
        let mut injector = injector();
        let kick = OrderedDisturbance {
            number: 1,
            begin_ns: 12 * MS + 345,
            until_ns: u64::MAX,
            body_rate_kick_b_rad_s: [1.0, 0.0, 0.0],
            kind: DisturbanceKind::Kick,
            ..OrderedDisturbance::default()
        };
        injector.follow(&order(1, &[kick]));
        let hit = |injector: &mut Injector, ms: u64| {
            injector.step(ms * MS).body_rate_kick_b_rad_s[0] > 0.5
        };
        let hits: Vec<bool> = (1..8).map(|k| hit(&mut injector, 5 * k)).collect();
        assert_eq!(hits, [false, false, true, false, false, false, false]);
    }

    #[test]
    fn a_restored_injector_goes_on_with_what_was_ordered_bit_for_bit() {
        let held = order(4, &[gusts(3), push(5, 0, 9000, 0.1)]);
        let mut first = injector();
        for k in 0..50 {
            first.follow(&held);
            first.step(k * 5 * MS);
        }
        let mut second = injector();
        second.restore(&first.memory());
        for k in 50..100 {
            first.follow(&held);
            second.follow(&held);
            assert_eq!(first.step(k * 5 * MS), second.step(k * 5 * MS));
        }
    }

    #[test]
    fn a_silenced_script_is_calm_and_goes_on_where_it_would_be_when_it_is_resumed() {
        let config: InjectorConfig = toml::from_str(
            "[[script]]\nkind = 'wind'\nmean_w_m_s = [1.0, 0.0, 0.0]\nsigma_m_s = [1.0, 1.0, 1.0]",
        )
        .unwrap();
        let build = || Injector::new(&config, 7).unwrap();
        let (mut free, mut held) = (build(), build());
        held.follow(&DisturbanceOrder { script_off: Flag::Yes, ..order(1, &[]) });
        for k in 0..20 {
            free.step(k * 5 * MS);
            assert_eq!(held.step(k * 5 * MS), Disturbance::CALM);
        }
        held.follow(&order(2, &[]));
        assert_eq!(free.step(100 * MS), held.step(100 * MS));
    }

    #[test]
    fn an_order_of_an_unknown_kind_or_rotor_does_nothing() {
        let mut injector = injector();
        let strange = OrderedDisturbance { kind: DisturbanceKind(77), ..gusts(1) };
        let rotor = OrderedDisturbance { kind: DisturbanceKind::Rotor, rotor: 9, ..gusts(2) };
        injector.follow(&DisturbanceOrder { count: u64::MAX, ..order(1, &[strange, rotor]) });
        assert_eq!(injector.step(5 * MS), Disturbance::CALM);
    }
}
