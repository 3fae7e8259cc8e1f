//! One event on its way, and what it adds to the disturbance.

use crate::event::{Event, Load};
use crate::gust;
use noise::{Noise, NoiseMemory, Source};
use shared_types::time::ns_from_s;
use std::f64::consts::TAU;

/// What acts on the vehicle from a sample's instant until the next one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Disturbance {
    /// Wind velocity \[m/s\] in W.
    pub wind_w_m_s: [f64; 3],
    /// Force at the centre of mass \[N\] in W.
    pub force_w_n: [f64; 3],
    /// Torque \[N m\] in B.
    pub torque_b_nm: [f64; 3],
    /// Jump of the body rate \[rad/s\] in B, once, at the sample's instant.
    pub body_rate_kick_b_rad_s: [f64; 3],
    /// Mass attached at the centre of mass \[kg\].
    pub payload_kg: f64,
    /// Thrust of each rotor relative to a healthy one; 1 front, 2 left, 3 rear, 4 right.
    pub rotor_efficiency: [f64; 4],
}

impl Disturbance {
    /// Nothing acts.
    pub const CALM: Self = Self {
        wind_w_m_s: [0.0; 3],
        force_w_n: [0.0; 3],
        torque_b_nm: [0.0; 3],
        body_rate_kick_b_rad_s: [0.0; 3],
        payload_kg: 0.0,
        rotor_efficiency: [1.0; 4],
    };

    fn add(&mut self, load: &Load, factor: f64) {
        add(&mut self.wind_w_m_s, &load.wind_w_m_s, factor);
        add(&mut self.force_w_n, &load.force_w_n, factor);
        add(&mut self.torque_b_nm, &load.torque_b_nm, factor);
    }
}

fn add(sum: &mut [f64; 3], vector: &[f64; 3], factor: f64) {
    for (slot, x) in sum.iter_mut().zip(vector) {
        *slot += factor * x;
    }
}

shared_types::memory! {
    /// One event's state as plain numbers.
    #[derive(PartialEq)]
    pub struct EventMemory {
        /// Samples it has contributed to.
        pub emitted: u64,
        /// Gust of unit variance, or the drawn rd.
        pub values: [f64; 3],
        /// Noise generator.
        pub noise: NoiseMemory,
    }
}

/// How many samples a burst has, and what keeps its impulse where they do not fill its length.
#[derive(Debug, Clone, Copy)]
struct Burst {
    samples: u64,
    stretch: f64,
}

impl Burst {
    /// Samples in [`from_ns`, `from_ns` + length) at `rate_hz`, one at least.
    fn new(from_ns: u64, length_s: f64, rate_hz: f64) -> Self {
        // floor(k 10¹² / r) ≥ t holds from k = ceil(t r / 10¹²) on, with r in millihertz.
        let millihertz = u128::from(rounded(rate_hz * 1e3));
        let first_at = |t_ns: u64| (u128::from(t_ns) * millihertz).div_ceil(1_000_000_000_000);
        let count = first_at(from_ns.saturating_add(ns_from_s(length_s))) - first_at(from_ns);
        let samples = u64::try_from(count).unwrap_or(u64::MAX).max(1);
        Self { samples, stretch: length_s * rate_hz / samples as f64 }
    }
}

/// An event on its way.
#[derive(Debug, Clone)]
pub(crate) struct Player {
    event: Event,
    from_ns: u64,
    until_ns: u64,
    burst: Option<Burst>,
    emitted: u64,
    values: [f64; 3],
    noise: Noise,
}

impl Player {
    pub(crate) fn new(event: Event, rate_hz: f64, seed: u64, place: u64) -> Self {
        let (from_s, until_s) = event.span_s();
        let from_ns = ns_from_s(from_s);
        Self {
            event,
            from_ns,
            until_ns: until_s.map_or(u64::MAX, ns_from_s),
            burst: event.burst_s().map(|length_s| Burst::new(from_ns, length_s, rate_hz)),
            emitted: 0,
            values: [0.0; 3],
            noise: Noise::new(seed, Source::DISTURBANCE, place),
        }
    }

    /// An event from one instant to another, whatever its own times are.
    pub(crate) fn between(
        event: Event,
        (from_ns, until_ns): (u64, u64),
        rate_hz: f64,
        (seed, stream): (u64, u64),
    ) -> Self {
        let player = Self::new(event, rate_hz, seed, stream);
        let burst = event.burst_s().map(|length_s| Burst::new(from_ns, length_s, rate_hz));
        Self { from_ns, until_ns, burst, ..player }
    }

    pub(crate) fn memory(&self) -> EventMemory {
        EventMemory { emitted: self.emitted, values: self.values, noise: self.noise.memory() }
    }

    /// Continues from what [`memory`](Self::memory) gave.
    pub(crate) fn go_on(&mut self, memory: &EventMemory) {
        self.emitted = memory.emitted;
        self.values = memory.values;
        self.noise.restore(&memory.noise);
    }

    pub(crate) fn reseed(&mut self, seed: u64) {
        self.noise.reseed(seed);
    }

    /// As before its first sample.
    fn rewind(&mut self) {
        self.emitted = 0;
        self.values = [0.0; 3];
        self.noise.seek(0);
    }

    fn is_live(&self, now_ns: u64) -> bool {
        let unfinished = self.burst.is_none_or(|burst| self.emitted < burst.samples);
        (self.from_ns..self.until_ns).contains(&now_ns) && unfinished
    }

    /// Adds what the event does at `now_ns`, `dt_s` after the last step.
    pub(crate) fn play(&mut self, now_ns: u64, dt_s: f64, total: &mut Disturbance) {
        if !self.is_live(now_ns) {
            return;
        }
        self.draw(dt_s);
        self.emitted += 1;
        let age_s = (now_ns - self.from_ns) as f64 * 1e-9;
        match &self.event {
            Event::Constant(e) => total.add(&e.load, 1.0),
            Event::Step(e) => total.add(&e.load, 1.0),
            Event::Pulse(e) => total.add(&e.load, 1.0),
            Event::Sine(e) => {
                total.add(&e.load, libm::sin(TAU * e.frequency_hz * age_s + e.phase_rad));
            }
            Event::Ramp(e) => total.add(&e.load, (age_s / (e.until_s - e.at_s)).min(1.0)),
            Event::Rd(e) => {
                let stretch = self.burst.map_or(1.0, |burst| burst.stretch);
                add(&mut total.torque_b_nm, &self.values, e.scale_nm * stretch);
            }
            Event::Kick(e) => add(&mut total.body_rate_kick_b_rad_s, &e.body_rate_b_rad_s, 1.0),
            Event::Wind(e) => {
                let gust = std::array::from_fn(|i| e.sigma_m_s[i] * self.values[i]);
                add(&mut total.wind_w_m_s, &e.mean_w_m_s, 1.0);
                add(&mut total.wind_w_m_s, &gust, 1.0);
            }
            Event::Payload(e) => total.payload_kg += e.mass_kg,
            Event::RotorEfficiency(e) => {
                if let Some(rotor) = total.rotor_efficiency.get_mut(usize::from(e.rotor) - 1) {
                    *rotor *= e.efficiency;
                }
            }
        }
    }

    /// Brings the random values of this sample.
    fn draw(&mut self, dt_s: f64) {
        let first = self.emitted == 0;
        match &self.event {
            Event::Rd(e) if first => {
                let [x, y, z] = self.noise.normal3();
                self.values = e.rd.unwrap_or([x, y, 0.1 * z]);
            }
            Event::Wind(_) if first => self.values = gust::start(&mut self.noise),
            Event::Wind(e) => {
                let airspeed = gust::airspeed(&e.mean_w_m_s);
                let noise = &mut self.noise;
                self.values = gust::advance(&self.values, dt_s, airspeed, &e.length_m, noise);
            }
            _ => {}
        }
    }

    /// Goes on from the memory of whatever was at this place in a script whose last step was at `last_ns`.
    pub(crate) fn take_over(&mut self, memory: &EventMemory, last_ns: u64) {
        if memory.noise.stream == self.noise.stream() {
            self.noise.restore(&memory.noise);
        }
        if self.from_ns <= last_ns && memory.emitted > 0 {
            self.emitted = memory.emitted;
            self.values = memory.values;
        } else {
            self.rewind();
            if self.from_ns < last_ns {
                self.emitted = self.burst.map_or(0, |burst| burst.samples);
            }
        }
    }
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "scripted numbers are finite and not negative; `as` saturates anyway"
)]
fn rounded(number: f64) -> u64 {
    number.round() as u64
}
