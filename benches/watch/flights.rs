//! Flights without and with a recording and a client that asks how it goes, in turn, so that the machine's
//! moods meet both alike.

use crate::flown;
use crate::report::{FigureP99, WatchReport};
use bench::BenchError;
use bench::fleet::{Flight, Flown};
use bench::report::LoopsReport;
use bench::series::Rank;
use core::time::Duration;
use protocol::control::client::Conversation;
use protocol::control::{Request, runs};
use std::path::Path;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::thread;

/// From one question about the flight to the next, as `top` asks.
const ASK_EVERY: Duration = Duration::from_millis(500);
/// Figures of each loop that are compared.
const FIGURES: [&str; 2] = ["lateness", "compute"];

/// Flies this many rounds of two flights, and watches one of each.
pub(crate) fn measure(
    arguments: &[String],
    rounds: usize,
    folder: &Path,
) -> Result<WatchReport, BenchError> {
    let mut report = WatchReport::default();
    for round in 0..rounds {
        // The first of the two finds the machine as the other has left it.
        let order = if round.is_multiple_of(2) { [false, true] } else { [true, false] };
        let mut flown = [None, None];
        for watched in order {
            flown[usize::from(watched)] =
                Some(fly(arguments, watched.then_some(folder), &mut report)?);
        }
        if let [Some(alone), Some(watched)] = flown {
            report.take(&p99s(&alone), &p99s(&watched));
        }
    }
    Ok(report)
}

fn fly(
    arguments: &[String],
    folder: Option<&Path>,
    report: &mut WatchReport,
) -> Result<LoopsReport, BenchError> {
    let mut arguments = arguments.to_vec();
    arguments.extend(folder.map(|folder| format!("--record={}", folder.display())));
    let flight = Flight::start(flown::morphquad(), &arguments)?;
    let (going, over) = mpsc::channel();
    let (flown, answers) = thread::scope(|scope| {
        let asking = folder.map(|_| scope.spawn(move || keep_asking(&over)));
        let flown = flight.wait();
        drop(going);
        (flown, asking.and_then(|asking| asking.join().ok()).unwrap_or(0))
    });
    report.answers += answers;
    if let Some(folder) = folder {
        wipe(folder);
    }
    match flown? {
        Flown::Measured(report) => Ok(*report),
        Flown::Refused(why) | Flown::Lost(why) => {
            Err(BenchError::Peer(format!("did not fly to its end: {why}")))
        }
    }
}

/// Asks every run for its status, as `ps` does; returns the number of answers.
fn keep_asking(over: &Receiver<()>) -> u64 {
    let mut answers = 0;
    while over.recv_timeout(ASK_EVERY) == Err(RecvTimeoutError::Timeout) {
        for run in runs::living() {
            let asked = Conversation::ask(&run, &Request::Ps);
            answers +=
                u64::from(asked.is_ok_and(|mut conversation| conversation.receive().is_ok()));
        }
    }
    answers
}

/// A recording is measured and not kept.
fn wipe(folder: &Path) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let _ = std::fs::remove_file(entry.path());
    }
}

fn p99s(report: &LoopsReport) -> Vec<FigureP99> {
    let mut all = Vec::new();
    for l in &report.loops {
        for name in FIGURES {
            if let Some(figure) = l.figures.get(name) {
                all.push((l.name.clone(), name, figure.flown.at(Rank::P99)));
            }
        }
    }
    for path in &report.paths {
        all.push((path.name.clone(), "path", path.total.flown.at(Rank::P99)));
    }
    all
}
