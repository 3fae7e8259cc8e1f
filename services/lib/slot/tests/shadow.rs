//! The gate's limits for another kind, against controllers that may fly and some that may not, each
//! running free beside an owner that flies a noisy axis through quiet air, gusts and a manoeuvre.

use slot::gate::Phase;
use slot::{Axis, Gate, GateLimits, Pair, Refusal};

/// Inertia \[kg m²\] and largest torque \[N m\] of the axis.
const INERTIA_KG_M2: f64 = 0.01;
const TORQUE_NM: f64 = 0.5;
const DT_S: f64 = 0.01;

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
    let axes = ["T", "τx", "τy", "τz"].map(|name| Axis { name, min: -TORQUE_NM, max: TORQUE_NM });
    let mut gate = Gate::new(axes, GateLimits::OTHER_KIND, false);
    let (mut owner, mut candidate) = (Pid::new(10.0, 1.0), candidate);
    let (mut angle, mut rate, mut noise) = (0.0, 0.0, Noise(7));
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
            let u_candidate = candidate.torque_nm(error, seen);
            let pair = Pair {
                effective_ns: k * 10_000_000,
                candidate: [0.0, u_candidate, 0.0, 0.0],
                owner: [0.0, u_owner, 0.0, 0.0],
            };
            gate.compare(Phase::Free, &pair)?;
        }
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
    // What follows a quick manoeuvre far more sharply would be a bump there, and is fine elsewhere.
    for (weather, fine) in
        [(Weather::Quiet, true), (Weather::Gusts, true), (Weather::Manoeuvre, false)]
    {
        assert_eq!(shadow(Pid::new(15.0, 1.0), weather).is_ok(), fine, "{weather:?}");
    }
}

#[test]
fn a_wrong_sign_may_not_fly_however_quiet_the_air() {
    for weather in WEATHERS {
        for bandwidth_rad_s in [7.0, 10.0, 14.0] {
            let verdict = shadow(Pid::new(bandwidth_rad_s, -1.0), weather);
            assert!(
                matches!(verdict, Err(Refusal::WrongSlope { value, .. }) if value < 0.0),
                "{bandwidth_rad_s} rad/s, {weather:?}: {verdict:?}"
            );
        }
    }
}

#[test]
fn a_gain_wrong_by_ten_may_not_fly_however_quiet_the_air() {
    for weather in WEATHERS {
        for factor in [0.1, 10.0] {
            let verdict = shadow(Pid::new(10.0, factor), weather);
            assert!(verdict.is_err(), "times {factor}, {weather:?}");
        }
    }
}
