//! `morphquad bench watch`: flights watched and not, or stretches of one flight.

use super::bar;
use crate::options::{Format, WatchArguments, scenario_words};
use bench::loops::{self, LoopsPlan};
use bench::peer::load::Load;
use bench::place::Place;
use bench::watch::{self, WatchReport};
use bench::{BenchError, turns};
use core::time::Duration;
use host::exit;
use scenario::{Override, Scenario};
use std::fmt::Write as _;
use std::path::Path;

/// How long a stretch of a watched flight is, unless told otherwise.
const STRETCH: Duration = Duration::from_secs(3);

/// Measures; 1 if the limit is certainly passed.
pub(super) fn measure(arguments: &WatchArguments) -> Result<(String, u8), BenchError> {
    let place = super::place(&arguments.place)?;
    let folder = tempfile::tempdir().map_err(|source| BenchError::System {
        action: "make a folder for recordings".to_owned(),
        source,
    })?;
    let (report, flown) = if arguments.live {
        within_a_flight(arguments, &place, folder.path())?
    } else {
        (flights(arguments, folder.path())?, exit::PASS)
    };
    let (overall, most) = (report.overall(), arguments.max_ratio);
    let certainly = overall.and_then(|change| Some((change.between?, most?)));
    let failed = certainly.is_some_and(|([low, _], most)| low > most);
    let code = if failed { exit::GATE_FAILED } else { flown };
    let text = if arguments.format == Format::Json {
        serde_json::json!({ "place": place, "watch": report, "overall": overall }).to_string()
    } else {
        told(&report, arguments, &place)
    };
    Ok((text, code))
}

/// Flights without and with somebody who asks, in turn.
fn flights(arguments: &WatchArguments, folder: &Path) -> Result<WatchReport, BenchError> {
    Scenario::load(&arguments.scenario.scenario, &arguments.scenario.overrides()?)?;
    let words = scenario_words(&arguments.scenario, "5s");
    let words: Vec<String> = words.into_iter().chain(arguments.place.words()).collect();
    let rounds = usize::from(arguments.rounds);
    let bar = bar(2 * rounds, "flights");
    let report = watch::measure(&words, rounds, folder, &|| bar.inc(1))?;
    bar.finish_and_clear();
    Ok(report)
}

/// One flight, to which viewers come and go; and the flight's own exit code where it ended badly.
fn within_a_flight(
    arguments: &WatchArguments,
    place: &Place,
    folder: &Path,
) -> Result<(WatchReport, u8), BenchError> {
    let rounds = usize::from(arguments.rounds);
    let stretch = arguments.scenario.duration.unwrap_or(STRETCH);
    let load = |edits: Vec<Override>| -> Result<Scenario, BenchError> {
        let mut overrides = arguments.scenario.overrides()?;
        overrides.push(Override::duration(turns::flight_for(rounds, stretch)));
        overrides.extend(edits);
        Ok(Scenario::load(&arguments.scenario.scenario, &overrides)?)
    };
    let scenario = load(loops::edits(place, false)?)?;
    scenario.require_candidates()?;
    let plan = LoopsPlan {
        alone: load(loops::edits_alone(scenario.settings().scenario.duration_s)?)?,
        scenario,
        place: place.clone(),
        load: Load::None,
        warm_up_ns: 0,
        record: Some(folder.to_owned()),
        with_floor: false,
        progress: false,
    };
    let bar = bar(2 * rounds, "stretches");
    let (report, summary) = turns::measure(&plan, rounds, stretch, &|| bar.inc(1))?;
    bar.finish_and_clear();
    let code = match summary.exit_code() {
        code @ (exit::INTERRUPTED | exit::CRASHED | exit::UNFIT) => code,
        _ => exit::PASS,
    };
    Ok((report, code))
}

fn told(report: &WatchReport, arguments: &WatchArguments, place: &Place) -> String {
    let how = if arguments.live {
        format!(
            "stretches of one recorded flight, watched: on its live page ({} answers) and by a viewer of \
             every topic ({} messages)",
            report.answers, report.received
        )
    } else {
        format!(
            "flights, watched: recorded, and asked how it goes twice a second ({} answers)",
            report.answers
        )
    };
    let mut text = format!(
        "{how};\nx is the median of the rounds' ratios; {}\n\n{}",
        place.told(),
        report.table()
    );
    // A string takes everything.
    if let Some(change) = report.overall() {
        let _ = writeln!(text, "\nall together {:.3} x, 95 % {}", change.ratio, change.told());
        if let Some(most) = arguments.max_ratio {
            let verdict = match change.between {
                Some([low, _]) if low > most => "FAILS",
                Some([_, high]) if high <= most => "holds",
                _ => "cannot be told in so few rounds",
            };
            let _ = writeln!(text, "at most {most} x: {verdict}");
        }
    }
    text
}
