//! What viewers of the live page cost a flight. They come and go within one flight, so that
//! both kinds of stretch have the same processes in the same places, and nearly the same mood of the machine.

use crate::onlooker::Onlooker;
use crate::report::{FigureP99, WatchReport};
use bench::BenchError;
use bench::loops::{self, LoopsPlan, Measured};
use bench::measure::Moment;
use bench::series::Series;
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
pub(crate) fn flight_for(rounds: usize, stretch: Duration) -> Duration {
    let stretches = u32::try_from(2 * rounds).unwrap_or(u32::MAX);
    // To start a server takes its time as well.
    2 * BEGIN + (stretch + 2 * SETTLE).saturating_mul(stretches)
}

/// Flies, and lets viewers come and go meanwhile.
pub(crate) fn measure(
    plan: &LoopsPlan,
    rounds: usize,
    stretch: Duration,
) -> Result<(WatchReport, Summary), BenchError> {
    let (flying, over) = mpsc::channel();
    let (measured, turns) = thread::scope(|scope| {
        let turns = scope.spawn(move || take_turns(&over, rounds, stretch));
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
            Some(p99s(&measured, found.span_ns))
        };
        if let (Some(alone), Some(watched)) = (of(false), of(true)) {
            report.take(&alone, &watched);
        }
    }
    Ok((report, measured.summary))
}

/// Comes and goes until the rounds are done or the flight is over.
fn take_turns(over: &Receiver<()>, rounds: usize, stretch: Duration) -> Turns {
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
        }
    }
    turns
}

/// The figures of a stretch, as those of a flight.
fn p99s(measured: &Measured, [from_ns, to_ns]: [u64; 2]) -> Vec<FigureP99> {
    let start_ns = measured.start_mono_ns;
    let within = |t_s: f64| {
        let at_ns = start_ns as f64 + t_s * 1e9;
        (from_ns as f64..to_ns as f64).contains(&at_ns)
    };
    let mut all = Vec::new();
    for (name, steps) in &measured.steps {
        let moments = || steps.moments.iter().filter(|moment| within(moment.t_s));
        let of = |figure: fn(&Moment) -> f64| p99_us(moments().map(figure));
        let figures = [("lateness", of(|m| m.lateness_us)), ("compute", of(|m| m.compute_us))];
        all.extend(
            figures.into_iter().filter_map(|(figure, us)| Some((name.clone(), figure, us?))),
        );
    }
    for (name, chains) in &measured.chains {
        let chains = chains.warm.iter().filter(|chain| within(chain.release_ns as f64 * 1e-9));
        let us = chains.map(|chain| chain.from_publication_ns() as f64 * 1e-3);
        all.extend(p99_us(us).map(|us| (name.clone(), "path", us)));
    }
    all
}

/// What 99 % of the durations do not exceed; none of none \[us\].
fn p99_us(durations_us: impl Iterator<Item = f64>) -> Option<f64> {
    let ns = |us: f64| shared_types::time::ns_from_s(us * 1e-6);
    durations_us.map(ns).collect::<Series>().quantiles().map(|quantiles| quantiles.p99_us)
}
