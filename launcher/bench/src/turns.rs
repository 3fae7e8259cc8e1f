//! `morphquad bench watch --live`: what viewers cost a flight. They come and go within one flight, so that
//! both kinds of stretch have the same processes in the same places, and nearly the same mood of the machine.

use super::BenchError;
use super::loops::{self, LoopsPlan, Measured};
use super::measure::Moment;
use super::onlooker::Onlooker;
use super::watch::{Told, WatchReport};
use core::time::Duration;
use protocol::control::runs;
use runtime::clock::mono_now_ns;
use runtime::leader::leading;
use simulate::Summary;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::thread;

/// After viewers have come or gone, what is not counted.
const SETTLE: Duration = Duration::from_millis(500);
/// Before the first stretch, for the flight to begin.
const BEGIN: Duration = Duration::from_secs(2);
/// How often the page asks.
const LOOK_EVERY: Duration = Duration::from_millis(200);

/// A part of the flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Stretch {
    round: usize,
    watched: bool,
    /// On the host's clock \[ns\].
    span_ns: [u64; 2],
}

/// What the viewers got.
#[derive(Debug, Default)]
struct Turns {
    stretches: Vec<Stretch>,
    answers: u64,
    received: u64,
}

/// How long the flight must be for so many rounds of two stretches.
#[must_use]
pub fn flight_for(rounds: usize, stretch: Duration) -> Duration {
    let stretches = u32::try_from(2 * rounds).unwrap_or(u32::MAX);
    // To start a server takes its time as well.
    2 * BEGIN + (stretch + 2 * SETTLE).saturating_mul(stretches)
}

/// Flies, and lets viewers come and go meanwhile.
///
/// # Errors
/// [`BenchError`] if nothing was measured.
pub fn measure(
    plan: &LoopsPlan,
    rounds: usize,
    stretch: Duration,
    done: &(dyn Fn() + Sync),
) -> Result<(WatchReport, Summary), BenchError> {
    let (flying, over) = mpsc::channel();
    let (measured, turns) = thread::scope(|scope| {
        let turns = scope.spawn(move || take_turns(&over, rounds, stretch, done));
        let measured = loops::measure(plan);
        drop(flying);
        (measured, turns.join().unwrap_or_default())
    });
    let measured = measured?;
    let mut report =
        WatchReport { answers: turns.answers, received: turns.received, ..WatchReport::default() };
    for round in 0..rounds {
        let of = |watched| {
            let mut all = turns.stretches.iter();
            let found = all.find(|s| (s.round, s.watched) == (round, watched))?;
            Some(told(&measured, found.span_ns))
        };
        if let (Some(alone), Some(watched)) = (of(false), of(true)) {
            report.take(&alone, &watched);
        }
    }
    Ok((report, measured.summary))
}

/// Comes and goes until the rounds are done or the flight is over.
fn take_turns(
    over: &Receiver<()>,
    rounds: usize,
    stretch: Duration,
    done: &(dyn Fn() + Sync),
) -> Turns {
    let mut turns = Turns::default();
    let waits = |time| over.recv_timeout(time) == Err(RecvTimeoutError::Timeout);
    let own = || {
        let mut living = runs::living().into_iter();
        living.find(|run| leading(run.folder()) == Some(std::process::id()))
    };
    let mut run = None;
    while run.is_none() && waits(LOOK_EVERY) {
        run = own();
    }
    let Some(run) = run.filter(|_| waits(BEGIN)) else { return turns };
    for round in 0..rounds {
        // What drifts in the flight, drifts to the favour of neither.
        let order = if round.is_multiple_of(2) { [false, true] } else { [true, false] };
        for watched in order {
            let onlooker = watched.then(|| Onlooker::of(run.id())).flatten();
            if watched && onlooker.is_none() || !waits(SETTLE) {
                return turns;
            }
            let from_ns = mono_now_ns();
            let until_ns = from_ns + u64::try_from(stretch.as_nanos()).unwrap_or(u64::MAX);
            while mono_now_ns() < until_ns {
                turns.answers += u64::from(onlooker.as_ref().is_some_and(Onlooker::look));
                if !waits(LOOK_EVERY) {
                    return turns;
                }
            }
            turns.received += onlooker.as_ref().map_or(0, Onlooker::received);
            turns.stretches.push(Stretch { round, watched, span_ns: [from_ns, mono_now_ns()] });
            done();
        }
    }
    turns
}

/// The figures of a stretch, as those of a flight.
fn told(measured: &Measured, [from_ns, to_ns]: [u64; 2]) -> Vec<Told> {
    let start_ns = measured.start_mono_ns;
    let within = |t_s: f64| {
        let at_ns = start_ns as f64 + t_s * 1e9;
        (from_ns as f64..to_ns as f64).contains(&at_ns)
    };
    let mut all = Vec::new();
    for (name, steps) in &measured.steps {
        let moments = || steps.moments.iter().filter(|moment| within(moment.t_s));
        let of = |figure: fn(&Moment) -> f64| p99(moments().map(figure).collect());
        let figures = [("lateness", of(|m| m.lateness_us)), ("compute", of(|m| m.compute_us))];
        all.extend(
            figures.into_iter().filter_map(|(figure, us)| Some((name.clone(), figure, us?))),
        );
    }
    for (name, chains) in &measured.chains {
        let chains = chains.warm.iter().filter(|chain| within(chain.release_ns as f64 * 1e-9));
        let us = chains.map(|chain| chain.from_publication_ns() as f64 * 1e-3);
        all.extend(p99(us.collect()).map(|us| (name.clone(), "path", us)));
    }
    all
}

/// What 99 % of the values do not exceed; none of none.
fn p99(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let rank = (values.len() * 99).div_ceil(100);
    values.get(rank.checked_sub(1)?).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ninety_nine_of_a_hundred_values_are_at_most_the_99_percent() {
        assert_eq!(p99((1..=1000).rev().map(f64::from).collect()), Some(990.0));
        assert_eq!(p99(vec![3.0, 5.0, 4.0]), Some(5.0));
        assert_eq!(p99(Vec::new()), None);
    }

    #[test]
    fn a_flight_is_long_enough_for_all_its_stretches() {
        let flight = flight_for(20, Duration::from_secs(3));
        assert_eq!(flight, Duration::from_secs(4 + 40 * 4));
    }
}
