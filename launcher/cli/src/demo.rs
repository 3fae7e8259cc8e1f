//! `morphquad demo`: a flight to press buttons on.

use super::flown::summary;
use super::options::{DemoArguments, Format};
use super::refusal::{Done, Failure};
use document::ScenarioError;
use host::exit;
use scenario::{Override, Scenario, shipped};
use simulate::{LiveOptions, Pin, RunOptions, Speed};
use std::io::{self, IsTerminal as _, Write};
use std::path::PathBuf;
use tempfile::TempDir;

/// What makes a controller that no vehicle bears: its rate loop is eight times as slow as it should be.
const BAD: &str = "attitude_pid.rate_time_s=[0.1, 0.1, 0.2]";

/// What to fly, and the folder with what configures the bad controller.
fn prepare(arguments: &DemoArguments) -> Result<(RunOptions, TempDir), Failure> {
    let load = |edits: &[Override]| Scenario::from_text("demo", shipped::DEMO, edits);
    let wrong = |error: ScenarioError| Failure::report(error, exit::USAGE);
    let set = arguments.set.iter().map(|argument| Override::set(argument));
    let mut edits = set.collect::<Result<Vec<_>, _>>().map_err(wrong)?;
    edits.extend(arguments.duration.map(Override::duration));
    let scenario = load(&edits).map_err(wrong)?;
    edits.push(Override::set(BAD).map_err(wrong)?);
    let worse = load(&edits).map_err(wrong)?;
    let folder = tempfile::tempdir()?;
    // The launcher may be elsewhere than where the folder's name begins.
    let config = folder.path().canonicalize()?.join("bad-controller.toml");
    std::fs::write(&config, worse.to_toml())?;
    let speed = scenario.settings().scenario.pace().map_or(Speed::Max, Speed::Times);
    let DemoArguments { listen, no_open, .. } = *arguments;
    let options = RunOptions {
        scenario,
        speed,
        record: Some(PathBuf::from("recordings")),
        name: None,
        progress: io::stderr().is_terminal(),
        pin: Pin::Auto,
        disorder: None,
        live: Some(LiveOptions { listen, open: !no_open, demo: Some(config) }),
    };
    Ok((options, folder))
}

/// Ends with the verdict of the flight.
pub(super) fn run(arguments: &DemoArguments, out: &mut dyn Write) -> Done {
    let (options, _folder) = prepare(arguments)?;
    eprintln!("morphquad: Ctrl-C ends the demo; it is recorded into recordings/");
    let summary = summary(flight::run(&options))?;
    super::show_summary(&summary, Format::Text, out)
}
