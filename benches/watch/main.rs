//! What being watched costs a flight: flights with and without a recording and a client that asks how it goes,
//! or with `--live` stretches of one flight with and without viewers of its live page.
//!
//! `cargo bench --bench watch -- SCENARIO --rounds N --max-ratio X` takes the scenario and the place of
//! `morphquad bench loops`.

mod flights;
#[path = "../flown/mod.rs"]
mod flown;
mod onlooker;
mod report;
mod turns;

use bench::BenchError;
use bench::loops::{self, LoopsPlan};
use bench::peer::load::Load;
use bench::place::Place;
use clap::Parser;
use cli::options::{Format, MeasurePlace, ScenarioArguments, scenario_arguments};
use core::time::Duration;
use host::exit;
use report::WatchReport;
use scenario::{Override, Scenario};
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;
use std::process::ExitCode;

/// What a recording and a client that asks how it goes cost a flight, against flights without.
#[derive(Debug, Parser)]
struct Options {
    /// The scenario; each flight of it takes 5s, each stretch 3s, unless --for says otherwise.
    #[command(flatten)]
    scenario: ScenarioArguments,
    /// Where.
    #[command(flatten)]
    place: MeasurePlace,
    /// Pairs of flights, or of stretches, one of each kind
    #[arg(long, value_name = "N", default_value = "10", value_parser = clap::value_parser!(u16).range(1..=10_000))]
    rounds: u16,
    /// Viewers of `morphquad live` in turns within one flight: its page, and one of every topic
    #[arg(long)]
    live: bool,
    /// End with 1 if the 99 % of the loops are certainly more than this many times those of a flight alone
    #[arg(long, value_name = "RATIO")]
    max_ratio: Option<f64>,
    /// Form of the result
    #[arg(long, value_enum, default_value = "text")]
    format: Format,
    /// Lead the flight in this process, whose children are then `morphquad`.
    #[arg(long, hide = true, requires = "live")]
    lead: bool,
    /// What cargo passes to every bench.
    #[arg(long, hide = true)]
    bench: bool,
}

/// Default length of a stretch of a watched flight.
const STRETCH: Duration = Duration::from_secs(3);

/// Measures; 1 if the limit is certainly passed.
fn measure(options: &Options) -> Result<(String, u8), BenchError> {
    let place = Place::take(options.place.policy, options.place.priority, options.place.cpus())?;
    let folder = tempfile::tempdir().map_err(|source| BenchError::System {
        action: "make a folder for recordings".to_owned(),
        source,
    })?;
    let (report, flown) = if options.live {
        within_a_flight(options, &place, folder.path())?
    } else {
        (one_by_one(options, folder.path())?, exit::PASS)
    };
    let (overall, most) = (report.overall(), options.max_ratio);
    let certainly = overall.and_then(|change| Some((change.between?, most?)));
    let failed = certainly.is_some_and(|([low, _], most)| low > most);
    let code = if failed { exit::FAILED } else { flown };
    let text = if options.format == Format::Json {
        serde_json::json!({ "place": place, "watch": report, "overall": overall }).to_string()
    } else {
        to_text(&report, options, &place)
    };
    Ok((text, code))
}

/// Flights without and with a client that asks, in turn.
fn one_by_one(options: &Options, folder: &Path) -> Result<WatchReport, BenchError> {
    Scenario::load(&options.scenario.scenario, &options.scenario.overrides()?)?;
    let arguments = scenario_arguments(&options.scenario, "5s");
    let arguments: Vec<String> = arguments.into_iter().chain(options.place.arguments()).collect();
    let rounds = usize::from(options.rounds);
    flights::measure(&arguments, rounds, folder)
}

/// One flight, to which viewers come and go; and the flight's own exit code where it ended badly.
fn within_a_flight(
    options: &Options,
    place: &Place,
    folder: &Path,
) -> Result<(WatchReport, u8), BenchError> {
    let rounds = usize::from(options.rounds);
    let stretch = options.scenario.duration.unwrap_or(STRETCH);
    let load = |edits: Vec<Override>| -> Result<Scenario, BenchError> {
        let mut overrides = options.scenario.overrides()?;
        overrides.push(Override::duration(turns::flight_for(rounds, stretch)));
        overrides.extend(edits);
        Ok(Scenario::load(&options.scenario.scenario, &overrides)?)
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
    let (report, summary) = turns::measure(&plan, rounds, stretch)?;
    let code = match summary.exit_code() {
        code @ (exit::INTERRUPTED | exit::CRASHED | exit::UNFIT) => code,
        _ => exit::PASS,
    };
    Ok((report, code))
}

fn to_text(report: &WatchReport, options: &Options, place: &Place) -> String {
    let how = if options.live {
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
        place.to_line(),
        report.table()
    );
    // A string takes everything.
    if let Some(change) = report.overall() {
        let _ = writeln!(text, "\nall together {:.3} x, 95 % {}", change.ratio, change.interval());
        if let Some(most) = options.max_ratio {
            let verdict = match change.between {
                Some([low, _]) if low > most => "FAILS",
                Some([_, high]) if high <= most => "holds",
                _ => "cannot be seen in so few rounds",
            };
            let _ = writeln!(text, "at most {most} x: {verdict}");
        }
    }
    text
}

/// A flight's processes are started as `morphquad`, as which this executable is started by a process that is
/// one itself: so the process that leads a flight is started so as well.
fn lead_anew() -> ExitCode {
    let led = flown::morphquad().args(std::env::args_os().skip(1)).arg("--lead").status();
    led.ok()
        .and_then(|status| status.code())
        .and_then(|code| u8::try_from(code).ok())
        .map_or(ExitCode::from(exit::UNFIT), ExitCode::from)
}

fn main() -> ExitCode {
    let leads = std::env::args_os().any(|argument| argument == "--lead");
    if !leads && let Some(code) = flown::run_if_flown() {
        return code;
    }
    let options = Options::parse();
    if options.live && !options.lead {
        return lead_anew();
    }
    match measure(&options) {
        Ok((text, code)) => {
            // A closed pipe changes nothing.
            let _ = writeln!(std::io::stdout(), "{text}");
            ExitCode::from(code)
        }
        Err(error) => {
            let _ = writeln!(std::io::stderr(), "{error}");
            ExitCode::from(error.exit_code())
        }
    }
}
