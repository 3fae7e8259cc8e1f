//! What happens in a storm: drawn from its seed, in instants of the flight.

use crate::common::controllers;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng as _};
use shared_types::Slot;

/// Orders and faults between these instants \[s\].
const FROM_S: f64 = 0.5;
const LASTS_S: f64 = 4.0;
/// How many there are at least, and by how many there may be more.
const ACTS: (u32, u32) = (20, 8);
/// From the end of a swap's window to the next swap of its slot \[s\].
const SETTLE_S: f64 = 0.3;
/// A stopped process goes on after at most this \[s\].
const STOPPED_S: f64 = 0.5;

/// What flies alone in its role and is started again when it dies.
const ALONE: [&str; 4] = ["estimator", "disturbance-injector", "monitor", "pilot"];
/// The processes that may be stopped, which include the launcher; its end is an [`Act::Adopt`].
const STOPPED: [&str; 6] = [ALONE[0], ALONE[1], ALONE[2], ALONE[3], "plant", LAUNCHER];
/// The name of the launcher in an act.
pub(super) const LAUNCHER: &str = "launcher";

/// One order or fault.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Act {
    /// Another controller takes a slot over.
    Swap { slot: &'static str, to: &'static str, shadow_s: f64, window_s: f64 },
    /// Another instance waits beside the owner.
    StandBy { slot: &'static str, name: &'static str },
    /// A slot goes back to the owner before.
    Rollback { slot: &'static str },
    /// An instance that does not command is sent away.
    Retire { name: &'static str },
    /// SIGKILL to a process.
    Kill { name: &'static str },
    /// SIGSTOP, and SIGCONT after a while.
    Stop { name: &'static str, for_s: f64 },
    /// SIGKILL to the launcher, and another one that takes over.
    Adopt,
    /// The vehicle is sent to a place \[m\].
    GoTo { x_m: f64, y_m: f64, z_m: f64 },
    /// The arms are folded or spread \[°\].
    Morph { degrees: f64 },
}

/// Which acts there may be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// Those that a script can have, at exact instants.
    Scripted,
    /// All but another launcher, which lockstep does not have.
    Ordered,
    /// All.
    Realtime,
}

/// A number from 0 to 1.
fn share(random: &mut ChaCha8Rng) -> f64 {
    f64::from(random.next_u32()) / f64::from(u32::MAX)
}

fn one_of<T: Copy>(random: &mut ChaCha8Rng, of: &[T]) -> T {
    of[random.next_u32() as usize % of.len()]
}

/// Acts of the storm with this seed, by instant \[s\].
pub(super) fn storm(seed: u64, kind: Kind) -> Vec<(f64, Act)> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let count = ACTS.0 + random.next_u32() % ACTS.1;
    let mut acts: Vec<(f64, Act)> = Vec::new();
    while acts.len() < count as usize {
        // In milliseconds, as a script has them.
        let at_s = (1e3 * (FROM_S + LASTS_S * share(&mut random))).round() * 1e-3;
        let Some(act) = draw(&mut random, kind) else { continue };
        // A script is refused as a whole if it asks for a slot before the last swap of it is over, or kills what never flies.
        let overlaps = |(b_s, b): &(f64, Act)| overlap((at_s, &act), (*b_s, b));
        if kind != Kind::Scripted || flies(&act, &acts) && !acts.iter().any(overlaps) {
            acts.push((at_s, act));
        }
    }
    acts.sort_by(|(a, _), (b, _)| a.total_cmp(b));
    acts
}

/// False for the end of a process that is in none of these acts, nor running from the start.
fn flies(act: &Act, acts: &[(f64, Act)]) -> bool {
    let (Act::Kill { name } | Act::Stop { name, .. }) = act else { return true };
    let is_swapped_in = |(_, act): &(f64, Act)| matches!(act, Act::Swap { to, .. } if to == name);
    Slot::ALL.into_iter().any(|slot| controllers(slot)[0] == *name)
        || ALONE.contains(name)
        || acts.iter().any(is_swapped_in)
}

/// True for two swaps of one slot of which the second begins before the first is over.
fn overlap((a_s, a): (f64, &Act), (b_s, b): (f64, &Act)) -> bool {
    let swap = |act: &Act| match *act {
        Act::Swap { slot, shadow_s, window_s, .. } => Some((slot, shadow_s + window_s + SETTLE_S)),
        _ => None,
    };
    let (Some((one, a_lasts_s)), Some((other, b_lasts_s))) = (swap(a), swap(b)) else {
        return false;
    };
    one == other && a_s < b_s + b_lasts_s && b_s < a_s + a_lasts_s
}

/// One act; none if the kind does not have what was drawn.
fn draw(random: &mut ChaCha8Rng, kind: Kind) -> Option<Act> {
    let slot = one_of(random, &Slot::ALL);
    let name = one_of(random, &controllers(slot));
    let slot = slot.label();
    let act = match random.next_u32() % 20 {
        0..7 => Act::Swap {
            slot,
            to: name,
            shadow_s: 0.2 + (10.0 * share(random)).round() * 0.03,
            window_s: 0.2 + (10.0 * share(random)).round() * 0.03,
        },
        7..9 => Act::StandBy { slot, name },
        9 => Act::Rollback { slot },
        10 => Act::Retire { name },
        11..14 => Act::Kill { name },
        14 => Act::Kill { name: one_of(random, &ALONE) },
        15 => Act::Stop { name, for_s: STOPPED_S * share(random) },
        16 => Act::Stop { name: one_of(random, &STOPPED), for_s: STOPPED_S * share(random) },
        17 => Act::Adopt,
        18 => Act::GoTo {
            x_m: 2.0 * share(random) - 1.0,
            y_m: 2.0 * share(random) - 1.0,
            z_m: 1.2 + share(random),
        },
        _ => Act::Morph { degrees: (45.0 + 115.0 * share(random)).round() },
    };
    let is_there = match (&act, kind) {
        (Act::Adopt, kind) => kind == Kind::Realtime,
        (Act::StandBy { .. } | Act::Rollback { .. } | Act::Retire { .. }, Kind::Scripted) => false,
        // Of what flies alone a script's stop ends only after seconds of the wall clock.
        (Act::Stop { name, .. }, Kind::Scripted) => !STOPPED.contains(name),
        _ => true,
    };
    is_there.then_some(act)
}

impl Act {
    /// As arguments of `morphquad run`, at an instant of the flight.
    pub(super) fn script(&self, at_s: f64) -> [String; 2] {
        let (flag, value) = match self {
            Self::Swap { slot, to, shadow_s, window_s } => {
                let how = format!("shadow={shadow_s:.2}s,rollback={window_s:.2}s");
                ("--swap", format!("{slot}={to}@{at_s:.3}s,{how}"))
            }
            Self::Kill { name } => ("--fault", format!("kill:{name}@{at_s:.3}s")),
            Self::Stop { name, .. } => ("--fault", format!("stop:{name}@{at_s:.3}s")),
            Self::GoTo { x_m, y_m, z_m } => {
                ("--goto", format!("{x_m:.2},{y_m:.2},{z_m:.2}@{at_s:.3}s"))
            }
            Self::Morph { degrees } => ("--morph", format!("{degrees}@{at_s:.3}s,over=1s")),
            other => panic!("{other:?} is an order only"),
        };
        [flag.to_owned(), value]
    }

    /// As arguments of `morphquad`, for a run in flight; none of what is no order.
    pub(super) fn order(&self) -> Option<Vec<String>> {
        let owned = |arguments: &[&str]| Some(arguments.iter().map(ToString::to_string).collect());
        match self {
            Self::Swap { slot, to, shadow_s, window_s } => {
                let [shadow, window] = [shadow_s, window_s].map(|s| format!("{s:.2}s"));
                owned(&["swap", slot, "--to", to, "--shadow", &shadow, "--rollback", &window])
            }
            Self::StandBy { slot, name } => owned(&["standby", slot, name, "--shadow", "300ms"]),
            Self::Rollback { slot } => owned(&["rollback", slot]),
            Self::Retire { name } => owned(&["retire", name]),
            Self::GoTo { x_m, y_m, z_m } => {
                let [x, y, z] = [x_m, y_m, z_m].map(|m| format!("{m:.2}"));
                // What is negative is no option.
                owned(&["goto", "--", &x, &y, &z])
            }
            Self::Morph { degrees } => owned(&["morph", &degrees.to_string(), "--over", "1s"]),
            Self::Kill { .. } | Self::Stop { .. } | Self::Adopt => None,
        }
    }
}
