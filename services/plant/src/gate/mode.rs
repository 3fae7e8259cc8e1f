//! The gate's modes.
//!
//! ```text
//!             the command's           held for its validity,
//!             validity ends           at most hold_max
//!   NORMAL ─────────────────▶ HOLD ──────────────────────────▶ LEVEL
//!     ▲                        │                               │   │  level_max passed, or
//!     │                        │                               │   │  tilted for tip_over
//!     └────────────────────────┴──────── valid command ────────┘   ▼
//!                                                                 CUT   (for good)
//! ```
//!
//! LEVEL follows the reference for a while, or has the thrust of hover where it knows no better, and then descends.
//!
//! HOLD is left out where the vehicle is tilted or turns fast: a command that outlives its controller goes on turning it.
//!
//! When the owner trips, or what an unproven owner follows, while the vehicle is tilted or turns fast, all but CUT give
//! way to RECOVER; so do NORMAL and HOLD when an owner that has not proven itself is about to tilt it too far:
//!
//! ```text
//!   any ───▶ RECOVER ── calm, or recover_max passed ──▶ NORMAL, or LEVEL without a valid command
//! ```
//!
//! If the position slot's owner trips while the vehicle leaves its reference, beside an attitude owner that has not proven
//! itself, RECOVER brakes the vehicle too: two such controllers may do together what neither does alone, and before the
//! second could be found to go on as the first has begun, the vehicle would be far away.
//!
//! At most one arrow is taken per tick.

/// What the gate lets through.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// A valid command is in effect.
    Normal,
    /// None is: the last one is held.
    Hold {
        /// End of the last command's validity \[ns\].
        since_ns: u64,
    },
    /// Still none: the gate levels the vehicle by itself, and takes it along the reference while it is calm.
    Level {
        /// First tick in this mode \[ns\].
        since_ns: u64,
        /// Since when the tilt has been beyond the limit without a break \[ns\].
        tilted_since_ns: Option<u64>,
    },
    /// Rotors off, for good.
    Cut,
    /// The owner has tripped and left the vehicle in a state that no controller is made for, or would have taken it to
    /// one: the gate levels it, whichever controller commands. This mode never cuts the rotors by itself.
    Recover {
        /// First tick in this mode \[ns\].
        since_ns: u64,
        /// It follows the reference, and lasts until the vehicle does not leave that any more.
        brakes: bool,
    },
}

/// How long a mode may last \[ns\].
#[derive(Debug, Clone, Copy)]
pub(super) struct ModeLimits {
    pub(super) level_max_ns: u64,
    pub(super) tip_over_ns: u64,
    pub(super) recover_max_ns: u64,
}

/// What decides about the mode at one tick.
#[expect(clippy::struct_excessive_bools, reason = "facts of their own, in any combination")]
#[derive(Debug, Clone, Copy)]
pub(super) struct Observation {
    pub(super) now_ns: u64,
    /// A valid command took effect.
    pub(super) fresh: bool,
    /// End of the last command's validity.
    pub(super) valid_until_ns: u64,
    /// How long the last command may be held.
    pub(super) hold_ns: u64,
    /// The tilt is beyond the limit.
    pub(super) tilted: bool,
    /// The owner trips now, and tilt or rate are beyond what a controller is made for, or the tilt of an unproven owner
    /// is about to be.
    pub(super) out_of_hand: bool,
    /// Tilt or rate are beyond what a controller is made for.
    pub(super) wild: bool,
    /// Tilt and rate are such that a controller can go on.
    pub(super) calm: bool,
    /// The position slot's owner trips now.
    pub(super) led_astray: bool,
    /// The vehicle leaves its reference, and the attitude owner has not proven itself.
    pub(super) leaving: bool,
}

impl Mode {
    /// The mode at this tick.
    pub(super) fn next(self, seen: &Observation, limits: &ModeLimits) -> Self {
        let now_ns = seen.now_ns;
        let elapsed = |since_ns: u64| now_ns.saturating_sub(since_ns);
        match self {
            Self::Cut => Self::Cut,
            Self::Recover { since_ns, brakes: false } if seen.led_astray && seen.leaving => {
                Self::Recover { since_ns, brakes: true }
            }
            Self::Recover { since_ns, brakes } => {
                let is_well = seen.calm && !(brakes && seen.leaving);
                let over = is_well || elapsed(since_ns) >= limits.recover_max_ns;
                match (over, now_ns < seen.valid_until_ns) {
                    (false, _) => self,
                    (true, true) => Self::Normal,
                    (true, false) => Self::Level { since_ns: now_ns, tilted_since_ns: None },
                }
            }
            _ if seen.led_astray && seen.leaving => {
                Self::Recover { since_ns: now_ns, brakes: true }
            }
            _ if seen.out_of_hand => Self::Recover { since_ns: now_ns, brakes: false },
            _ if seen.fresh => Self::Normal,
            Self::Normal if now_ns < seen.valid_until_ns => self,
            Self::Normal if !seen.wild => Self::Hold { since_ns: seen.valid_until_ns },
            Self::Hold { since_ns } if !seen.wild && elapsed(since_ns) < seen.hold_ns => self,
            Self::Normal | Self::Hold { .. } => {
                Self::Level { since_ns: now_ns, tilted_since_ns: seen.tilted.then_some(now_ns) }
            }
            Self::Level { since_ns, tilted_since_ns } => {
                let tilted_since_ns = seen.tilted.then(|| tilted_since_ns.unwrap_or(now_ns));
                let tipped = tilted_since_ns.is_some_and(|at| elapsed(at) >= limits.tip_over_ns);
                if tipped || elapsed(since_ns) >= limits.level_max_ns {
                    Self::Cut
                } else {
                    Self::Level { since_ns, tilted_since_ns }
                }
            }
        }
    }

    /// 0 normal, 1 hold, 2 level, 3 cut, 4 recover, as on the wire.
    #[must_use]
    pub fn code(self) -> u32 {
        match self {
            Self::Normal => 0,
            Self::Hold { .. } => 1,
            Self::Level { .. } => 2,
            Self::Cut => 3,
            Self::Recover { .. } => 4,
        }
    }

    /// Whether the gate brakes the vehicle along its reference.
    pub(super) fn brakes(self) -> bool {
        matches!(self, Self::Recover { brakes: true, .. })
    }

    /// Code, start, start of the tilt or whether it brakes; `u64::MAX` stands for none.
    pub(super) fn to_words(self) -> [u64; 3] {
        let (since, third) = match self {
            Self::Normal | Self::Cut => (u64::MAX, None),
            Self::Hold { since_ns } => (since_ns, None),
            Self::Recover { since_ns, brakes } => (since_ns, Some(u64::from(brakes))),
            Self::Level { since_ns, tilted_since_ns } => (since_ns, tilted_since_ns),
        };
        [u64::from(self.code()), since, third.unwrap_or(u64::MAX)]
    }

    /// The mode of [`to_words`](Self::to_words); an unknown code cuts.
    pub(super) fn from_words([code, since_ns, third]: [u64; 3]) -> Self {
        match code {
            0 => Self::Normal,
            1 => Self::Hold { since_ns },
            2 => Self::Level { since_ns, tilted_since_ns: (third != u64::MAX).then_some(third) },
            4 => Self::Recover { since_ns, brakes: third == 1 },
            _ => Self::Cut,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: ModeLimits =
        ModeLimits { level_max_ns: 2000, tip_over_ns: 200, recover_max_ns: 1000 };
    const HOLD: Mode = Mode::Hold { since_ns: 100 };

    fn at(now_ns: u64) -> Observation {
        Observation {
            now_ns,
            fresh: false,
            valid_until_ns: 100,
            hold_ns: 20,
            tilted: false,
            out_of_hand: false,
            wild: false,
            calm: false,
            led_astray: false,
            leaving: false,
        }
    }

    fn tilted_at(now_ns: u64) -> Observation {
        Observation { tilted: true, ..at(now_ns) }
    }

    fn level(since_ns: u64, tilted_since_ns: Option<u64>) -> Mode {
        Mode::Level { since_ns, tilted_since_ns }
    }

    #[test]
    fn normal_stays_while_the_command_is_valid_however_tilted() {
        assert_eq!(Mode::Normal.next(&at(99), &LIMITS), Mode::Normal);
        assert_eq!(Mode::Normal.next(&tilted_at(99), &LIMITS), Mode::Normal);
    }

    #[test]
    fn normal_becomes_hold_when_the_validity_ends_even_if_the_tick_is_late() {
        assert_eq!(Mode::Normal.next(&at(100), &LIMITS), HOLD);
        assert_eq!(Mode::Normal.next(&at(115), &LIMITS), HOLD);
    }

    #[test]
    fn hold_becomes_level_when_its_time_is_over() {
        assert_eq!(HOLD.next(&at(119), &LIMITS), HOLD);
        assert_eq!(HOLD.next(&at(120), &LIMITS), level(120, None));
        assert_eq!(HOLD.next(&tilted_at(120), &LIMITS), level(120, Some(120)));
    }

    #[test]
    fn nothing_is_held_of_a_vehicle_that_leans_or_turns_too_far() {
        let wild = |now_ns| Observation { wild: true, ..at(now_ns) };
        assert_eq!(Mode::Normal.next(&wild(99), &LIMITS), Mode::Normal);
        assert_eq!(Mode::Normal.next(&wild(100), &LIMITS), level(100, None));
        assert_eq!(HOLD.next(&wild(110), &LIMITS), level(110, None));
    }

    #[test]
    fn a_valid_command_returns_from_every_mode_but_cut() {
        let fresh = Observation { fresh: true, ..tilted_at(3000) };
        for mode in [Mode::Normal, HOLD, level(120, Some(130))] {
            assert_eq!(mode.next(&fresh, &LIMITS), Mode::Normal);
        }
        assert_eq!(Mode::Cut.next(&fresh, &LIMITS), Mode::Cut);
    }

    #[test]
    fn level_becomes_cut_after_its_longest_time() {
        assert_eq!(level(120, None).next(&at(2119), &LIMITS), level(120, None));
        assert_eq!(level(120, None).next(&at(2120), &LIMITS), Mode::Cut);
    }

    #[test]
    fn level_becomes_cut_after_an_unbroken_tilt_only() {
        let tilted = level(120, None).next(&tilted_at(300), &LIMITS);
        assert_eq!(tilted, level(120, Some(300)));
        assert_eq!(tilted.next(&tilted_at(499), &LIMITS), tilted);
        assert_eq!(tilted.next(&tilted_at(500), &LIMITS), Mode::Cut);
        assert_eq!(tilted.next(&at(499), &LIMITS), level(120, None));
    }

    #[test]
    fn a_vehicle_that_two_unproven_owners_lead_astray_is_braked_and_left_to_them_then() {
        let astray = |now_ns| Observation { led_astray: true, leaving: true, ..at(now_ns) };
        let valid = |seen| Observation { valid_until_ns: 5000, ..seen };
        let brakes = Mode::Recover { since_ns: 50, brakes: true };
        let levels = Mode::Recover { since_ns: 50, brakes: false };
        for mode in [Mode::Normal, level(20, None), levels] {
            assert_eq!(mode.next(&astray(50), &LIMITS), brakes);
        }
        let leaves = Observation { leaving: false, ..astray(50) };
        assert_eq!(Mode::Normal.next(&leaves, &LIMITS), Mode::Normal, "it is where it should be");
        let calm = |now_ns| valid(Observation { calm: true, ..at(now_ns) });
        let under_way = Observation { leaving: true, ..calm(60) };
        assert_eq!(brakes.next(&under_way, &LIMITS), brakes);
        assert_eq!(levels.next(&under_way, &LIMITS), Mode::Normal, "it only levels");
        assert_eq!(brakes.next(&calm(60), &LIMITS), Mode::Normal);
        let last = Observation { leaving: true, ..calm(1050) };
        assert_eq!(brakes.next(&last, &LIMITS), Mode::Normal, "it may not be able to");
    }

    #[test]
    fn cut_stays() {
        assert_eq!(Mode::Cut.next(&at(0), &LIMITS), Mode::Cut);
    }

    #[test]
    fn labels_bring_back_each_mode_and_unknown_labels_cut() {
        let recover = |brakes| Mode::Recover { since_ns: 7, brakes };
        let levels = [level(1, None), level(1, Some(2))];
        let all = [Mode::Normal, HOLD, Mode::Cut, recover(false), recover(true)];
        for mode in all.into_iter().chain(levels) {
            assert_eq!(Mode::from_words(mode.to_words()), mode);
        }
        assert_eq!(Mode::from_words([5, 0, 0]), Mode::Cut);
    }
}
