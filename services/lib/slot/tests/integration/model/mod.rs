//! Every interleaving of one plant, three controllers, one launcher and an intruder, through the same
//! code that flies: [`slot::SlotMachine`] at the launcher, [`slot::Consumer`] and [`slot::CommandBuffer`] at the plant.
//!
//! Messages wait, processes die or fall silent, the launcher dies and is succeeded, users ask for
//! anything, all at any moment that a bounded number of such misfortunes allows. `world.rs` is the
//! world, `moves.rs` what may happen next. Time is counted in ticks of the plant.
//!
//! Time and misfortunes only grow, so no path comes back to where it was; each one ends, and where it
//! ends everything must be at rest. With that the search for unwanted states is also one for deadlocks.
//!
//! `SLOT_MODEL=large` searches further; it takes minutes.

mod moves;
mod world;

use moves::Move;
use slot::Clock;
use stateright::{Checker, HasDiscoveries, Model, Property};
use world::{Broken, Budget, Flaw, World};

/// What is searched.
struct Search {
    clock: Clock,
    budget: Budget,
    standby: bool,
    flaw: Option<Flaw>,
}

impl Model for Search {
    type State = World;
    type Action = Move;

    fn init_states(&self) -> Vec<World> {
        vec![World::new(self.clock, self.budget, self.standby, self.flaw)]
    }

    fn actions(&self, world: &World, moves: &mut Vec<Move>) {
        world.moves(moves);
    }

    fn next_state(&self, world: &World, action: Move) -> Option<World> {
        let mut next = world.clone();
        next.make(action);
        Some(next)
    }

    fn properties(&self) -> Vec<Property<Self>> {
        vec![
            Property::always(
                "no command but that of the owner, or of the fallback after a fail-over",
                |_, world: &World| world.broken != Some(Broken::WrongWriter),
            ),
            Property::always(
                "a command in effect at each tick at which one was there to follow, but for one of an owner that has tripped",
                |_, world: &World| world.broken != Some(Broken::Missed),
            ),
            Property::always(
                "what has failed over does not go back within the epoch, nor after a trip to the same owner",
                |_, world: &World| world.broken != Some(Broken::Unlatched),
            ),
            Property::always("an owner that has tripped is not followed", |_, world: &World| {
                world.broken != Some(Broken::TripForgotten)
            }),
            Property::always("epochs grow and instants do not go back", |_, world: &World| {
                world.broken != Some(Broken::Backwards)
            }),
            Property::always(
                "in simulated time no record comes too late",
                |search: &Self, world: &World| {
                    search.clock == Clock::Realtime
                        || world.consumer.counters().refused_records == 0
                },
            ),
            Property::always("everything comes to rest", |search: &Self, world: &World| {
                let mut moves = Vec::new();
                search.actions(world, &mut moves);
                world.broken.is_some()
                    || (world.t < world::NEVER && (!moves.is_empty() || world.is_quiet()))
            }),
        ]
    }
}

impl Search {
    #[expect(
        clippy::print_stdout,
        reason = "the path to what went wrong, and how much was searched"
    )]
    fn run(self) -> (Vec<&'static str>, usize) {
        let title = format!("{:?}, {}, {:?}", self.clock, self.standby, self.flaw);
        let until =
            if self.flaw.is_some() { HasDiscoveries::Any } else { HasDiscoveries::AnyFailures };
        let checker = self.checker().threads(1).finish_when(until).spawn_bfs().join();
        let found = checker.discoveries();
        for (name, path) in &found {
            println!("{title}: not so: {name}");
            for (world, action) in path.clone().into_vec() {
                println!("  t {:2} {:?}", world.t, action);
            }
        }
        println!("{title}: {} states", checker.unique_state_count());
        (found.into_keys().collect(), checker.unique_state_count())
    }
}

/// Searches with and without a standby.
fn holds(clock: Clock, budget: Budget) {
    for standby in [true, false] {
        let (broken, states) = Search { clock, budget, standby, flaw: None }.run();
        assert!(broken.is_empty(), "{broken:?}");
        assert!(states > 50, "the search went nowhere");
    }
}

fn large() -> bool {
    std::env::var("SLOT_MODEL").is_ok_and(|size| size == "large")
}

#[test]
fn in_realtime_nothing_unwanted_can_happen() {
    holds(Clock::Realtime, Budget::new(1, 0, 1));
    holds(Clock::Realtime, Budget::new(0, 1, 1));
    holds(Clock::Realtime, Budget::new(1, 1, u64::from(large())));
    if large() {
        holds(Clock::Realtime, Budget::new(1, 1, 0).with_records(3));
    }
}

#[test]
fn in_lockstep_nothing_unwanted_can_happen() {
    holds(Clock::Lockstep, Budget::new(1, 1, 1));
    if large() {
        holds(Clock::Lockstep, Budget::new(2, 1, 1));
        holds(Clock::Lockstep, Budget::new(1, 2, 1));
    }
}

const ONE_REQUEST: Budget = Budget::new(0, 1, 1);
const ONE_MISFORTUNE: Budget = Budget::new(1, 0, 1);

fn catches(flaw: Flaw, budget: Budget, expected: &str) {
    let search = Search { clock: Clock::Realtime, budget, standby: true, flaw: Some(flaw) };
    let (broken, _) = search.run();
    assert!(broken.iter().any(|name| name.contains(expected)), "{flaw:?}: {broken:?}");
}

#[test]
fn a_consumer_that_ignores_the_effective_instant_is_caught() {
    catches(Flaw::IgnoresInstant, ONE_REQUEST, "no command but that");
}

#[test]
fn a_consumer_that_follows_any_member_is_caught() {
    catches(Flaw::FollowsMembers, ONE_REQUEST, "no command but that");
}

#[test]
fn a_consumer_that_goes_back_to_its_owner_is_caught() {
    catches(Flaw::ForgetsFailOver, ONE_MISFORTUNE, "does not go back");
}

#[test]
fn a_consumer_that_does_not_fail_over_is_caught() {
    catches(Flaw::NeverFailsOver, ONE_MISFORTUNE, "there to follow");
}

#[test]
fn a_consumer_that_forgets_a_trip_is_caught() {
    catches(Flaw::ForgetsTrip, Budget::new(1, 1, 1), "has tripped is not followed");
}

#[test]
fn a_supervisor_that_does_not_try_again_is_caught() {
    catches(Flaw::NeverTriesAgain, ONE_REQUEST, "comes to rest");
}
