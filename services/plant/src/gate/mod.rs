//! The last check before the rotors: what is in range, and what to do when no controller commands.
//!
//! The gate sees commands, the plant's own inertial readings and the morph angle, and, to go somewhere when no controller
//! commands, the estimate and the reference; never the truth.
//! It starts airborne at trim: hover thrust, valid for as long as a HOLD may last. Start with
//! [`Mode`] for the state machine, then [`Gate::judge`] and [`Gate::tick`].

mod command;
mod config;
mod level;
mod mode;
mod navigation;

use garde::Validate;
use runtime::backup;
use shared_types::{Reference, StateEstimate};
use thiserror::Error;
use vehicle::{MorphAngle, ParameterError, VehicleParameters, Wrench};

pub use command::{Command, GateCounters, UnprovenRange};
pub use config::GateConfig;
pub use mode::Mode;

use crate::sensors::ImuSample;
use command::{CommandRange, Refusal};
use level::{Aim, LevelLaw, MAX_STEP_S, UpFilter, descent_thrust_n};
use mode::{ModeLimits, Observation};
use navigation::{Navigation, NavigationMemory};

/// Largest gyro bias that is believed: more would be a wrong estimate \[rad/s\].
const BIAS_MAX_RAD_S: f64 = 0.1;

/// Share of the tilt at which LEVEL brakes hard up to which it tilts the vehicle itself.
const AIMED_SHARE: f64 = 0.8;

/// Speed away from its reference below which a vehicle has been braked, and is left to an unproven attitude owner again:
/// the set points of the position slot's fallback bring it back \[m/s\].
const LEAVING_M_S: f64 = 0.1;

/// Largest share of one reading in the filter, however long there was none before it.
const MAX_CORRECTION: f64 = 0.1;

/// A gate that cannot be built.
#[derive(Debug, Error)]
pub enum GateError {
    /// A limit is out of its range.
    #[error("the gate's configuration is not usable:\n{0}")]
    Config(#[from] garde::Report),
    /// No vehicle has these parameters.
    #[error(transparent)]
    Vehicle(#[from] ParameterError),
}

/// What the gate sees at one plant tick.
#[derive(Debug, Clone, Copy)]
pub struct GateInput<'a> {
    /// The tick's logical instant \[ns\].
    pub now_ns: u64,
    /// The command that counts from now on, if it is another than at the last tick; one that
    /// [`Gate::judge`] has let through, or lies between such.
    pub command: Option<Command>,
    /// The command that is held is that of an owner that has tripped, and no other command takes its place.
    pub is_revoked: bool,
    /// The owner of the attitude slot trips now, or what it follows does: what it has commanded until here is not to be
    /// trusted.
    pub tripped: bool,
    /// The owner of the position slot trips now.
    pub led_astray: bool,
    /// What the owner of the attitude slot is held to, if it has not proven itself.
    pub unproven: Option<&'a UnprovenRange>,
    /// The plant's own inertial reading, if there is a new one.
    pub reading: Option<ImuSample>,
    /// Measured β \[rad\]; the last usable one stands in for a NaN.
    pub morph_angle_rad: f64,
    /// The last estimate of the vehicle's state that there is.
    pub estimate: Option<&'a StateEstimate>,
    /// What the vehicle was to follow last.
    pub reference: Option<&'a Reference>,
}

/// What the gate decided.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GateOutput {
    /// The wrench to allocate; always finite.
    pub wrench: Wrench,
    pub mode: Mode,
    /// What happened since start.
    pub counters: GateCounters,
}

shared_types::memory! {
    /// A [`Gate`] as plain numbers.
    #[derive(PartialEq)]
    pub struct GateMemory {
        /// Mode: code, start \[ns\], start of the tilt \[ns\] or whether it brakes.
        pub mode: [u64; 3],
        /// Last accepted wrench: T \[N\], τ \[N m\].
        pub wrench: [f64; 4],
        /// End of its validity \[ns\].
        pub valid_until_ns: u64,
        /// How long it may be held after that \[ns\].
        pub hold_ns: u64,
        /// Up, seen from the body.
        pub up_b: [f64; 3],
        /// Last usable body rate \[rad/s\].
        pub rate_b_rad_s: [f64; 3],
        /// Instant of that reading \[ns\].
        pub reading_ns: u64,
        /// Where the vehicle is.
        pub navigation: NavigationMemory,
        /// Last usable β \[rad\].
        pub morph_angle_rad: f64,
        /// Instant of the last tick \[ns\].
        pub tick_ns: u64,
        /// Vertical speed, or what the vehicle has gained of it since it was commanded last if it has not been known since
        /// \[m/s\].
        pub climb_m_s: f64,
        /// LEVEL has found the vehicle calm, and need not brake as hard as RECOVER.
        pub levels_gently: bool,
        /// What happened since start.
        pub counters: GateCounters,
    }
}

/// The command in effect, or the last that was.
#[derive(Debug, Clone, Copy)]
struct Held {
    wrench: Wrench,
    valid_until_ns: u64,
    hold_ns: u64,
}

/// Tilt \[rad\] and rate \[rad/s\] beyond which a trip is answered by the gate itself and no command is held, and below
/// which commands count again and LEVEL is gentle.
#[derive(Debug, Clone, Copy)]
struct RecoverBounds {
    enter: [f64; 2],
    leave: [f64; 2],
}

/// The actuation gate.
#[derive(Debug, Clone)]
pub struct Gate {
    vehicle: VehicleParameters,
    range: CommandRange,
    limits: ModeLimits,
    law: LevelLaw,
    recovery: LevelLaw,
    hold_max_ns: u64,
    tip_over_tilt_rad: f64,
    bounds: RecoverBounds,
    filter_time_constant_s: f64,
    mode: Mode,
    held: Held,
    filter: UpFilter,
    navigation: Navigation,
    beta: MorphAngle,
    tick_ns: u64,
    climb_m_s: f64,
    descend_after_ns: u64,
    descend_m_s: f64,
    levels_gently: bool,
    aim_tilt_rad: f64,
    counters: GateCounters,
}

impl Gate {
    /// A gate at 0 ns, in NORMAL, with the vehicle in hover.
    ///
    /// # Errors
    /// A limit out of its range, or a vehicle that cannot be.
    pub fn new(config: &GateConfig, vehicle: &VehicleParameters) -> Result<Self, GateError> {
        config.validate()?;
        vehicle.validate()?;
        let hold_max_ns = config.hold_max_ns();
        let held = Held {
            wrench: Wrench::thrust(vehicle.weight_n()),
            valid_until_ns: hold_max_ns,
            hold_ns: hold_max_ns,
        };
        Ok(Self {
            vehicle: *vehicle,
            range: CommandRange::new(config, vehicle),
            limits: ModeLimits {
                level_max_ns: config.level_max_ns(),
                tip_over_ns: config.tip_over_ns(),
                recover_max_ns: config.recover_max_ns(),
            },
            law: LevelLaw::level(config),
            recovery: LevelLaw::recover(config),
            bounds: RecoverBounds {
                enter: [config.recover_tilt_rad, config.recover_rate_rad_s],
                leave: [config.recovered_tilt_rad, config.recovered_rate_rad_s],
            },
            hold_max_ns,
            tip_over_tilt_rad: config.tip_over_tilt_rad,
            filter_time_constant_s: config.filter_time_constant_s,
            mode: Mode::Normal,
            held,
            filter: UpFilter::new(),
            navigation: Navigation::new(),
            beta: MorphAngle::MIN,
            tick_ns: 0,
            climb_m_s: 0.0,
            descend_after_ns: config.descend_after_ns(),
            descend_m_s: config.descend_m_s,
            levels_gently: false,
            aim_tilt_rad: AIMED_SHARE * config.recover_tilt_rad,
            counters: GateCounters::default(),
        })
    }

    /// The command as it may be followed at `now_ns`; what may not is counted.
    pub fn judge(&mut self, now_ns: u64, command: &Command) -> Option<Command> {
        self.range.judge(command, now_ns).map_err(|refusal| self.counters.refuse(refusal)).ok()
    }

    /// As [`judge`](Self::judge), for an owner that has not proven itself: what it asks for beyond `range` is not
    /// refused but reduced.
    pub fn judge_unproven(
        &mut self,
        now_ns: u64,
        command: &Command,
        range: &UnprovenRange,
    ) -> Option<Command> {
        let is_finite = command.wrench.is_finite();
        let wrench =
            if is_finite { range.within(&command.wrench, self.beta) } else { command.wrench };
        let judged = self.judge(now_ns, &Command { wrench, ..*command });
        self.counters.reduced += u64::from(judged.is_some() && wrench != command.wrench);
        judged
    }

    /// Counts a command whose writer has no seat in the slot.
    pub fn refuse_stray(&mut self) {
        self.counters.refuse(Refusal::WrongOwner);
    }

    /// One plant tick. Nothing in the input can make it panic or let a number that is not finite
    /// through.
    pub fn tick(&mut self, input: &GateInput) -> GateOutput {
        self.beta = MorphAngle::saturating_from_rad(input.morph_angle_rad).unwrap_or(self.beta);
        let tick_s = input.now_ns.saturating_sub(self.tick_ns) as f64 * 1e-9;
        self.estimate_up(input, tick_s);
        let command = input.command.filter(|command| command.wrench.is_finite());
        if let Some(command) = &command {
            self.held = Held {
                wrench: self.range.within(&command.wrench),
                valid_until_ns: self.range.valid_until_ns(command),
                hold_ns: command.validity_ns.min(self.hold_max_ns),
            };
        }
        if input.is_revoked {
            self.held.valid_until_ns = self.held.valid_until_ns.min(input.now_ns);
            self.held.hold_ns = 0;
        }
        self.change_mode(input, tick_s, command.is_some());

        let mut wrench = match self.mode {
            Mode::Normal | Mode::Hold { .. } => self.held.wrench,
            Mode::Level { .. } | Mode::Recover { .. } => {
                let (law, aim) = match self.aim(input) {
                    // It has to follow, and needs the faster law for it.
                    Some(aim) => (&self.recovery, aim),
                    None if self.levels_gently => (&self.law, Aim::level(&self.vehicle)),
                    None => (&self.recovery, Aim::level(&self.vehicle)),
                };
                law.wrench(&self.vehicle, &self.filter, &aim, self.beta, input.now_ns)
            }
            Mode::Cut => Wrench::thrust(0.0),
        };
        if self.descends(input.now_ns) {
            wrench.thrust_n = descent_thrust_n(&self.vehicle, self.climb_m_s, self.descend_m_s);
        }
        // Only a damaged memory gets here with a NaN.
        if !wrench.is_finite() {
            self.mode = Mode::Cut;
            wrench = Wrench::thrust(0.0);
        }
        GateOutput { wrench, mode: self.mode, counters: self.counters }
    }

    fn estimate_up(&mut self, input: &GateInput, tick_s: f64) {
        let reading_s = input.now_ns.saturating_sub(self.filter.reading_ns) as f64 * 1e-9;
        self.tick_ns = input.now_ns;
        // Over the step that ends now the rate was the last one read.
        self.filter.predict(tick_s, &self.navigation.gyro_bias_b().cap_magnitude(BIAS_MAX_RAD_S));
        let is_usable = |reading: &&ImuSample| self.filter.read(input.now_ns, reading);
        let usable = input.reading.as_ref().filter(is_usable);
        let gravity = self.vehicle.gravity_m_s2;
        self.navigation.advance(input.now_ns, input.estimate, usable, gravity);
        self.counters.bad_readings += u64::from(input.reading.is_some() && usable.is_none());
        let Some(reading) = usable else { return };
        let force_b = &reading.specific_force_b_m_s2;
        if matches!(self.mode, Mode::Level { .. } | Mode::Recover { .. }) {
            let step_s = reading_s.min(MAX_STEP_S);
            let faster_m_s = self.filter.climbing_m_s2(force_b, gravity) * step_s;
            // What is gained from the last known speed on, or from that at the last command.
            self.climb_m_s = self.navigation.climb_m_s().unwrap_or(self.climb_m_s + faster_m_s);
        } else {
            let share = (reading_s / self.filter_time_constant_s).min(MAX_CORRECTION);
            self.filter.correct(force_b, gravity, share);
        }
    }

    /// Where a calm vehicle goes without a controller, and one that is braked: along the reference, and to rest where it
    /// descends; none where it does not know where the vehicle is.
    fn aim(&self, input: &GateInput) -> Option<Aim> {
        let follows = self.levels_gently || self.mode.brakes();
        let believed = self.navigation.believed().filter(|_| follows)?;
        let weighs = backup::Vehicle {
            weight_n: self.vehicle.weight_n(),
            gravity_m_s2: self.vehicle.gravity_m_s2,
        };
        let reference = input.reference.filter(|_| !self.descends(input.now_ns));
        let [thrust_n, roll_rad, pitch_rad, _] =
            backup::setpoint(input.now_ns, weighs, 0.0, Some(&believed), reference);
        Some(Aim::tilted([roll_rad, pitch_rad], self.aim_tilt_rad, thrust_n))
    }

    /// True once LEVEL has carried the vehicle for as long as it is to.
    fn descends(&self, now_ns: u64) -> bool {
        matches!(self.mode, Mode::Level { since_ns, .. }
            if now_ns.saturating_sub(since_ns) >= self.descend_after_ns)
            && !self.filter.is_blind(now_ns)
    }

    fn change_mode(&mut self, input: &GateInput, tick_s: f64, fresh: bool) {
        let seen = Observation {
            now_ns: input.now_ns,
            fresh,
            valid_until_ns: self.held.valid_until_ns,
            hold_ns: self.held.hold_ns,
            tilted: self.filter.tilt_rad() > self.tip_over_tilt_rad,
            out_of_hand: input.tripped && !self.is_within(self.bounds.enter)
                || input.unproven.is_some_and(|range| self.overturns(range, tick_s)),
            wild: !self.is_within(self.bounds.enter),
            calm: self.is_within(self.bounds.leave),
            led_astray: input.led_astray,
            leaving: input.unproven.is_some() && self.is_leaving(input),
        };
        let next = self.mode.next(&seen, &self.limits);
        let leaves_normal = self.mode == Mode::Normal && next != Mode::Normal;
        self.counters.safe_mode_episodes += u64::from(leaves_normal);
        self.mode = next;
        // Once calm it stays gentle until the vehicle is wild: noise at one bound does not change the law to and fro.
        let is_level = matches!(next, Mode::Level { .. });
        if !is_level && !matches!(next, Mode::Recover { .. }) {
            self.climb_m_s = 0.0;
        }
        self.levels_gently = is_level && (seen.calm || self.levels_gently && !seen.wild);
    }

    /// True if the vehicle leaves its reference, as far as the gate knows.
    fn is_leaving(&self, input: &GateInput) -> bool {
        let known = self.navigation.believed().zip(input.reference);
        known.is_some_and(|(believed, reference)| {
            backup::leaving_m_s(input.now_ns, &believed, reference) > LEAVING_M_S
        })
    }

    /// True if the vehicle will tilt beyond what an unproven owner may, unless RECOVER begins at this tick: braked by
    /// it from the next tick on, after the owner has turned it on as hard as its range allows. The rotors follow with
    /// the lag τ, so that a turn of ω that is accelerated by a until then and braked by b from then on goes on by ω (1
    /// + a/b) τ + ω²/2b + τ² (a² − b²)/2b. Only while a command is applied: what levels the vehicle is not begun anew.
    fn overturns(&self, range: &UnprovenRange, tick_s: f64) -> bool {
        if !matches!(self.mode, Mode::Normal | Mode::Hold { .. })
            || self.filter.is_blind(self.tick_ns)
        {
            return false;
        }
        let lag_s = range.believed.rotor_lag_s;
        let faster_rad_s2 = range.turning_rad_s2(self.beta);
        let slower_rad_s2 = self.recovery.braking_rad_s2(&range.believed, self.beta);
        if slower_rad_s2 <= 0.0 {
            return false;
        }
        let ratio = faster_rad_s2 / slower_rad_s2;
        let rate_rad_s = self.filter.turning_rad_s() + faster_rad_s2 * tick_s;
        let lagging_s = tick_s + (1.0 + ratio) * lag_s;
        let lagging_rad = 0.5 * slower_rad_s2 * (ratio * ratio - 1.0).max(0.0) * lag_s * lag_s;
        let further_rad = rate_rad_s * (lagging_s + 0.5 * rate_rad_s / slower_rad_s2) + lagging_rad;
        self.filter.tilt_after_rad(further_rad.min(core::f64::consts::PI)) > range.tilt_rad
    }

    /// True if tilt \[rad\] and rate about roll and pitch \[rad/s\] are within these, by the gate's own
    /// readings; without any there is nothing that it could bring back.
    fn is_within(&self, [tilt_rad, rate_rad_s]: [f64; 2]) -> bool {
        self.filter.is_blind(self.tick_ns)
            || self.filter.tilt_rad() <= tilt_rad && self.filter.turning_rad_s() <= rate_rad_s
    }

    /// Everything that evolves.
    #[must_use]
    pub fn memory(&self) -> GateMemory {
        let Wrench { thrust_n, torque_b_nm } = self.held.wrench;
        GateMemory {
            mode: self.mode.to_words(),
            wrench: [thrust_n, torque_b_nm.x, torque_b_nm.y, torque_b_nm.z],
            valid_until_ns: self.held.valid_until_ns,
            hold_ns: self.held.hold_ns,
            up_b: self.filter.up_b.into(),
            rate_b_rad_s: self.filter.rate_b.into(),
            reading_ns: self.filter.reading_ns,
            navigation: self.navigation.memory(),
            morph_angle_rad: self.beta.rad(),
            tick_ns: self.tick_ns,
            climb_m_s: self.climb_m_s,
            levels_gently: self.levels_gently,
            counters: self.counters,
        }
    }

    /// Continues from a memory, bit for bit.
    pub fn restore(&mut self, memory: &GateMemory) {
        let [thrust_n, x, y, z] = memory.wrench;
        self.mode = Mode::from_words(memory.mode);
        self.held = Held {
            wrench: Wrench { thrust_n, torque_b_nm: [x, y, z].into() },
            valid_until_ns: memory.valid_until_ns,
            hold_ns: memory.hold_ns,
        };
        self.filter = UpFilter {
            up_b: memory.up_b.into(),
            rate_b: memory.rate_b_rad_s.into(),
            reading_ns: memory.reading_ns,
        };
        self.navigation = Navigation::restore(&memory.navigation);
        self.beta = MorphAngle::saturating_from_rad(memory.morph_angle_rad).unwrap_or(self.beta);
        self.tick_ns = memory.tick_ns;
        self.climb_m_s = memory.climb_m_s;
        self.levels_gently = memory.levels_gently;
        self.counters = memory.counters;
    }
}

#[cfg(test)]
mod flight_tests;
#[cfg(test)]
mod tests;
