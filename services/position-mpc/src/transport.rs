//! Set points under way: what a delay of more than a period asks of the prediction.

use mpc::LaggedAxis;

/// Set points and inputs that the law remembers, the last ones first.
pub(crate) const HISTORY: usize = 16;

/// Whole periods that a set point may be under way: the input before those is needed as well, and the one before that.
const PERIODS_MAX: u8 = 14;

/// Longest delay in periods, the one that the sampled model knows included.
pub(crate) const DELAY_MAX_PERIODS: f64 = PERIODS_MAX as f64 + 1.0;

/// The way of one input to the vehicle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Transport {
    /// Whole periods before the one in which a command takes effect.
    pub(crate) periods: usize,
    /// Lag, drag and the rest of the delay, at most a period; gain 1.
    pub(crate) axis: LaggedAxis,
}

impl Transport {
    /// `way` with any delay, in samples of `period_s` \[s\]: a delay of exactly a period is one that the sampled model knows.
    pub(crate) fn new(way: LaggedAxis, period_s: f64) -> Self {
        let delay_s = way.delay_s;
        let fits = |periods: &u8| delay_s <= (f64::from(*periods) + 1.0 + 1e-9) * period_s;
        let periods = (0..PERIODS_MAX).find(fits).unwrap_or(PERIODS_MAX);
        let delay_s = (delay_s - f64::from(periods) * period_s).clamp(0.0, period_s);
        Self { periods: periods.into(), axis: LaggedAxis { delay_s, ..way } }
    }

    /// Brings an axis to the sample at which the next command begins to act.
    ///
    /// `z` are the increments of (10) at this sample, \[Δy, Δy', g Δa, g Δu\] with the input that acts now; `moves(j)` is
    /// g Δu(k−1−j). Returns what y and y' gain on the way. What disturbs the vehicle is in the increments, so that it
    /// is carried on as the prediction itself does.
    pub(crate) fn carry(
        &self,
        z: &mut [f64; 4],
        moves: impl Fn(usize) -> f64,
        period_s: f64,
    ) -> [f64; 2] {
        let mut gained = [0.0; 2];
        for j in (0..self.periods).rev() {
            *z = self.axis.advance(*z, moves(j), period_s);
            gained = [gained[0] + z[0], gained[1] + z[1]];
        }
        gained
    }
}

/// Time \[s\] until an attitude loop of period `tick_s` \[s\] acts on a set point that reaches it after `latency_s` \[s\],
/// in the mean over the set points that it takes, one every `period_s` \[s\].
pub(crate) fn transport_s(latency_s: f64, tick_s: f64, period_s: f64) -> f64 {
    if tick_s <= period_s {
        libm::ceil(latency_s / tick_s - 1e-9) * tick_s
    } else {
        // It takes the last of several and holds it: half a tick of waiting and half a tick of holding.
        latency_s + tick_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn late(delay_s: f64) -> LaggedAxis {
        LaggedAxis { gain: 1.0, lag_s: 0.035, delay_s, drag_per_s: 0.4 }
    }

    #[test]
    fn a_delay_is_whole_periods_and_a_rest_within_one() {
        let parts = |delay_s: f64| {
            let Transport { periods, axis } = Transport::new(late(delay_s), 0.02);
            (periods, axis.delay_s)
        };
        for (delay_s, periods, rest_s) in [
            (0.0, 0, 0.0),
            (0.010, 0, 0.010),
            (0.020, 0, 0.020),
            (0.021, 1, 0.001),
            (0.060, 2, 0.020),
        ] {
            let (whole, rest) = parts(delay_s);
            assert_eq!(whole, periods, "{delay_s}");
            assert!((rest - rest_s).abs() < 1e-15, "{delay_s}: {rest}");
        }
        assert_eq!(parts(0.3).0, 14);
    }

    #[test]
    fn an_axis_is_carried_to_where_the_late_commands_take_it() {
        let (period_s, gain, disturbance) = (0.02, 9.81, 0.7);
        let way = Transport::new(late(0.047), period_s);
        let commands = |k: i32| 0.1 * libm::sin(0.4 * f64::from(k));
        // The axis itself, with its gain, a constant disturbance and commands that are two periods late.
        let physical = LaggedAxis { gain, ..way.axis };
        let mut state = [0.0, 0.0, 0.0, commands(-3)];
        let mut path = vec![];
        for k in 0..40 {
            path.push(state);
            let [y, rate, actuator, held] = physical.advance(state, commands(k - 2), period_s);
            let pushed = 0.5 * disturbance * period_s * period_s;
            state = [y + pushed, rate + disturbance * period_s, actuator, held];
        }
        let k = 30;
        let (now, before): ([f64; 4], [f64; 4]) = (path[k], path[k - 1]);
        let increment = |i: usize| now[i] - before[i];
        let mut z = [increment(0), increment(1), gain * increment(2), gain * increment(3)];
        let moves = |j: usize| {
            let at = 29 - i32::try_from(j).unwrap();
            gain * (commands(at) - commands(at - 1))
        };
        let [y, rate] = way.carry(&mut z, moves, period_s);
        assert!((now[0] + y - path[k + 2][0]).abs() < 1e-12);
        assert!((now[1] + rate - path[k + 2][1]).abs() < 1e-12);
        assert!((z[3] - gain * (commands(29) - commands(28))).abs() < 1e-12);
    }

    #[test]
    fn a_set_point_waits_for_the_next_tick_of_the_attitude_loop() {
        let waits = |latency_s, tick_s, time_s: f64| {
            (transport_s(latency_s, tick_s, 0.02) - time_s).abs() < 1e-12
        };
        assert!(waits(0.001, 0.010, 0.010));
        assert!(waits(0.020, 0.010, 0.020));
        assert!(waits(0.032, 0.010, 0.040));
        assert!(waits(0.001, 0.040, 0.041));
    }
}
