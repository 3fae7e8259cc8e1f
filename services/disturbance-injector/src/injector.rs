//! A script, played.

use crate::config::{InjectorConfig, InjectorError, MAX_EVENTS};
use crate::ordered::{Ordered, OrderedMemory};
use crate::player::{Disturbance, EventMemory, Player};
use garde::Validate;
use noise::NoiseMemory;
use shared_types::{DISTURBANCE_ORDERS, DisturbanceOrder};

shared_types::memory! {
    /// An [`Injector`] as plain numbers.
    #[derive(PartialEq)]
    pub struct InjectorMemory {
        /// Instant of the last step \[ns\].
        pub last_ns: u64,
        /// By place in the script; the rest has a stream that no event has.
        pub events: [EventMemory; MAX_EVENTS],
        /// What has been ordered in flight, in any order; number 0 where there is none.
        pub ordered: [OrderedMemory; DISTURBANCE_ORDERS],
    }
}

/// Stream of a place without an event.
const NO_EVENT: u64 = u64::MAX;

/// Plays a script, and what is ordered beside it.
#[derive(Debug, Clone)]
pub struct Injector {
    players: Vec<Player>,
    ordered: Ordered,
    last_ns: u64,
}

impl Injector {
    /// An injector at 0 ns.
    ///
    /// # Errors
    /// [`InjectorError::Config`] for a value out of its range or more than [`MAX_EVENTS`] events.
    pub fn new(config: &InjectorConfig, seed: u64) -> Result<Self, InjectorError> {
        config.validate()?;
        let script = (0..).zip(&config.script);
        let players =
            script.map(|(place, event)| Player::new(*event, config.rate_hz, seed, place)).collect();
        Ok(Self { players, ordered: Ordered::new(config.rate_hz, seed), last_ns: 0 })
    }

    /// Takes in what has been ordered; call before each step with the order in effect.
    pub fn follow(&mut self, order: &DisturbanceOrder) {
        self.ordered.follow(order);
    }

    /// The disturbance at `now_ns`. To be called at each release of the configured rate, with
    /// instants that never go back.
    pub fn step(&mut self, now_ns: u64) -> Disturbance {
        let dt_s = now_ns.saturating_sub(self.last_ns) as f64 * 1e-9;
        self.last_ns = now_ns;
        let mut total = Disturbance::CALM;
        for player in &mut self.players {
            player.play(now_ns, dt_s, &mut total);
        }
        if self.ordered.silences_script() {
            // Played all the same, so that the gusts are where they would be.
            total = Disturbance::CALM;
        }
        self.ordered.play(now_ns, dt_s, &mut total);
        total
    }

    /// Everything that evolves.
    #[must_use]
    pub fn memory(&self) -> InjectorMemory {
        let noise = NoiseMemory { key: [0; 4], stream: NO_EVENT, word_position: 0 };
        let mut events = [EventMemory { emitted: 0, values: [0.0; 3], noise }; MAX_EVENTS];
        for (slot, player) in events.iter_mut().zip(&self.players) {
            *slot = player.memory();
        }
        InjectorMemory { last_ns: self.last_ns, events, ordered: self.ordered.memory() }
    }

    /// Continues from a memory: bit for bit if it is of the same script. In another script an event
    /// takes over what was at its place unless it begins later, so that a fault can be added to a
    /// running flight; one that would have been over by now stays away.
    pub fn restore(&mut self, memory: &InjectorMemory) {
        self.last_ns = memory.last_ns;
        self.ordered.restore(&memory.ordered);
        for (player, slot) in self.players.iter_mut().zip(&memory.events) {
            player.take_over(slot, memory.last_ns);
        }
    }

    /// Draws from the streams of another seed from now on.
    pub fn reseed(&mut self, seed: u64) {
        self.players.iter_mut().for_each(|player| player.reseed(seed));
        self.ordered.reseed(seed);
    }
}

#[cfg(test)]
mod gust_tests;
#[cfg(test)]
mod tests;
