//! The gate's limits for another kind, against controllers that may fly and some that may not, each
//! running free beside an owner that flies a noisy axis through quiet air, gusts and a manoeuvre.

use slot::gate::Phase;
use slot::{Axis, Gate, GateLimits, Pair, Refusal};

/// Inertia \[kg m²\] and largest torque \[N m\] of the axis.
const INERTIA_KG_M2: f64 = 0.01;
const TORQUE_NM: f64 = 0.5;
const DT_S: f64 = 0.01;

/// What is done to a candidate's torque before it is seen, with the owner's last one.
type Spoil = fn(f64, f64) -> f64;

/// PID on the angle, tuned for a bandwidth ω and damping 0.8: K = J ω², D = 1.6 J ω, I = K ω / 10.
#[derive(Clone, Copy)]
struct Pid {
    bandwidth_rad_s: f64,
    /// What is wrong with it.
    factor: f64,
    integral: f64,
}

impl Pid {
    fn new(bandwidth_rad_s: f64, factor: f64) -> Self {
        Self { bandwidth_rad_s, factor, integral: 0.0 }
    }

    fn torque_nm(&mut self, error_rad: f64, rate_rad_s: f64) -> f64 {
        let omega = self.bandwidth_rad_s;
        let k = INERTIA_KG_M2 * omega * omega;
        self.integral += 0.1 * k * omega * error_rad * DT_S;
        let torque = k * error_rad - 1.6 * INERTIA_KG_M2 * omega * rate_rad_s + self.integral;
        (self.factor * torque).clamp(-TORQUE_NM, TORQUE_NM)
    }
}

/// Air and task.
#[derive(Clone, Copy, Debug)]
enum Weather {
    Quiet,
    Gusts,
    Manoeuvre,
}

/// Uniform noise in ±1, the same each time.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }
}

/// Two seconds of shadowing behind a second of flight.
fn shadow(candidate: Pid, weather: Weather) -> Result<(), Refusal> {
    spoilt(candidate, weather, |torque, _| torque)
}

fn spoilt(candidate: Pid, weather: Weather, spoil: Spoil) -> Result<(), Refusal> {
    let axes = ["T", "τx", "τy", "τz"].map(|name| Axis { name, min: -TORQUE_NM, max: TORQUE_NM });
    let mut gate = Gate::new(axes, GateLimits::OTHER_KIND, false);
    let (mut owner, mut candidate) = (Pid::new(10.0, 1.0), candidate);
    let (mut angle, mut rate, mut noise, mut before) = (0.0, 0.0, Noise(7), 0.0);
    for k in 0..300_u64 {
        let t_s = k as f64 * DT_S;
        let (wind_nm, wanted_rad) = match weather {
            Weather::Quiet => (0.0, 0.0),
            Weather::Gusts => (0.03 * (libm::sin(6.0 * t_s) + 0.5 * libm::sin(17.0 * t_s)), 0.0),
            Weather::Manoeuvre => (0.0, 0.2 * libm::sin(3.0 * t_s)),
        };
        let (error, seen) = (wanted_rad - angle + 1e-3 * noise.next(), rate + 1e-2 * noise.next());
        let u_owner = owner.torque_nm(error, seen);
        if k >= 100 {
            let u_candidate = spoil(candidate.torque_nm(error, seen), before);
            let pair = Pair {
                effective_ns: k * 10_000_000,
                candidate: [0.0, u_candidate, 0.0, 0.0],
                owner: [0.0, u_owner, 0.0, 0.0],
                u_max: [TORQUE_NM; 4],
            };
            gate.compare(Phase::Free, &pair)?;
        }
        before = u_owner;
        rate += (u_owner + wind_nm) / INERTIA_KG_M2 * DT_S;
        angle += rate * DT_S;
    }
    gate.verdict().map(|_| ())
}

const WEATHERS: [Weather; 3] = [Weather::Quiet, Weather::Gusts, Weather::Manoeuvre];

#[test]
fn controllers_near_the_owners_bandwidth_may_fly() {
    for weather in WEATHERS {
        for bandwidth_rad_s in [7.5, 9.0, 10.0, 11.0, 12.0] {
            let verdict = shadow(Pid::new(bandwidth_rad_s, 1.0), weather);
            assert!(verdict.is_ok(), "{bandwidth_rad_s} rad/s, {weather:?}: {verdict:?}");
        }
    }
}

#[test]
fn a_wrong_sign_may_not_fly_however_quiet_the_air() {
    for weather in WEATHERS {
        // In a slow manoeuvre another bandwidth's phase hides what the noise shows elsewhere.
        let bandwidths: &[f64] =
            if matches!(weather, Weather::Manoeuvre) { &[10.0] } else { &[7.0, 10.0, 14.0] };
        for &bandwidth_rad_s in bandwidths {
            let verdict = shadow(Pid::new(bandwidth_rad_s, -1.0), weather);
            assert!(verdict.is_err(), "{bandwidth_rad_s} rad/s, {weather:?}: {verdict:?}");
        }
    }
}

#[test]
fn a_gain_thrice_too_large_or_far_too_small_may_not_fly_however_quiet_the_air() {
    for weather in WEATHERS {
        for factor in [0.05, 3.0, 10.0] {
            let verdict = shadow(Pid::new(10.0, factor), weather);
            assert!(verdict.is_err(), "times {factor}, {weather:?}");
        }
    }
}

#[test]
fn a_frozen_a_biased_and_a_contrary_output_may_not_fly_however_quiet_the_air() {
    let spoils: [(&str, Spoil); 4] = [
        ("frozen", |_, _| 0.001),
        ("a tenth too much", |torque, _| torque + 0.1 * TORQUE_NM),
        ("a tenth too little", |torque, _| torque - 0.1 * TORQUE_NM),
        ("contrary to what is applied", |torque, before| 2.0 * before - torque),
    ];
    for weather in WEATHERS {
        for (what, spoil) in spoils {
            let verdict = spoilt(Pid::new(10.0, 1.0), weather, spoil);
            assert!(verdict.is_err(), "{what}, {weather:?}");
        }
    }
}
