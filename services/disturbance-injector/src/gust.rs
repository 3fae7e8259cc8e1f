//! Turbulence that is valid at hover.
//!
//! Each axis is a first-order Gauss-Markov process with the correlation time L/V, the shape of
//! Dryden's longitudinal spectrum [MIL-F-8785C, 3.7]. The textbook takes V from the airspeed alone,
//! so that at hover the gusts freeze; here V = max(|mean wind|, 1 m/s), for the vehicle is not seen.

use noise::Noise;

/// Least airspeed in the correlation time \[m/s\].
const MIN_AIRSPEED: f64 = 1.0;

/// V of the correlation time \[m/s\].
pub(crate) fn airspeed(mean_w_m_s: &[f64; 3]) -> f64 {
    let [x, y, z] = mean_w_m_s;
    (x * x + y * y + z * z).sqrt().max(MIN_AIRSPEED)
}

/// A draw from the stationary distribution, of unit variance on each axis.
pub(crate) fn start(noise: &mut Noise) -> [f64; 3] {
    noise.normal3()
}

/// x(t + dt) = a x + √(1 − a²) n with a = exp(−V dt/L): exact for every dt.
pub(crate) fn advance(
    gust: &[f64; 3],
    dt_s: f64,
    airspeed_m_s: f64,
    length_m: &[f64; 3],
    noise: &mut Noise,
) -> [f64; 3] {
    let n = noise.normal3();
    std::array::from_fn(|i| {
        let decay = airspeed_m_s * dt_s / length_m[i];
        // √(1 − a²) without cancellation for small dt.
        libm::exp(-decay) * gust[i] + (-libm::expm1(-2.0 * decay)).sqrt() * n[i]
    })
}
