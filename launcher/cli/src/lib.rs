//! The command line: what can be asked for, and the way from an argument to an exit code.
//!
//! Results go to stdout, everything else to stderr. [`options`] is the grammar; [`check`] and
//! [`list`] are whole commands, the others are handed on.

mod adopt;
mod bar;
mod bench;
mod branch;
mod browser;
mod campaign;
pub mod check;
mod completions;
mod demo;
mod doctor;
mod flown;
mod keep_safe;
pub mod list;
mod live;
mod new_controller;
pub mod options;
mod orders;
mod pages;
mod paper;
mod plot;
mod proc;
mod ps;
mod recordings;
mod recover;
mod refusal;
mod rehearse;
mod replay;
mod report;
mod scenarios;
mod study;
mod top;
mod topic;
mod trace;
mod types;
mod view;

pub use options::{
    AdoptArguments, BranchArguments, CampaignArguments, DoctorArguments, Format, PaperArguments,
    ProcArguments, PsArguments, ReplayArguments, ReportArguments, RetireArguments,
    RollbackArguments, RunArguments, RunChoice, ScenarioArguments, StandbyArguments, SwapArguments,
    TraceArguments, ViewArguments,
};

use document::ScenarioError;
use host::exit;
use host::{LAYOUT_ARGUMENT, layout_hash};
use options::{CheckFormat, Cli, Command};
use refusal::{Done, Failure, asks_for_json};
use scenario::Scenario;
use simulate::Summary;
use std::ffi::OsString;
use std::io::{self, Write};

/// Runs one command and gives its exit code. A complaint goes to `diagnostics` and, where JSON is
/// asked for, as an object with `error` and `exit` to `out` too.
pub fn execute(
    arguments: impl Iterator<Item = OsString>,
    out: &mut dyn Write,
    diagnostics: &mut dyn Write,
) -> u8 {
    proc::count_allocations();
    let mut arguments: Vec<OsString> = arguments.collect();
    for (old, new) in with_names_of_today(&mut arguments) {
        // Whether or not it is read.
        let _ = writeln!(diagnostics, "morphquad: `{old}` is now `{new}`");
    }
    if arguments.get(1).is_some_and(|argument| argument == LAYOUT_ARGUMENT) {
        let written = writeln!(out, "{:016x}", layout_hash());
        return if written.is_ok() { exit::PASS } else { exit::UNFIT };
    }
    let done = match Cli::of(&arguments) {
        Ok(cli) => dispatch(cli.command, out, diagnostics),
        Err(error) if error.use_stderr() => Err(Failure::usage(&error, exit::USAGE)),
        Err(help) => {
            // A closed pipe changes nothing.
            let _ = help.print();
            return exit::PASS;
        }
    };
    let result = done.or_else(|failure| match failure {
        Failure::Refused(refusal) => {
            let written = refusal.write(asks_for_json(&arguments), out, diagnostics);
            // Refused it is, whether or not the answer is read.
            written.or_else(|error| match error.kind() {
                io::ErrorKind::BrokenPipe => Ok(refusal.code()),
                _ => Err(error),
            })
        }
        Failure::Unwritten(error) => Err(error),
    });
    match result {
        Ok(code) => code,
        // A reader that has seen enough, such as `head`, is no failure.
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => exit::PASS,
        Err(error) => {
            let _ = writeln!(diagnostics, "morphquad: cannot write the result: {error}");
            exit::UNFIT
        }
    }
}

/// Options that had another name before, and what they are called now.
const RENAMED: [(&str, &str); 1] = [("--crew", "--controller")];

/// Gives options the names of today, and returns those that had another.
fn with_names_of_today(arguments: &mut [OsString]) -> Vec<(&'static str, &'static str)> {
    let mut found = Vec::new();
    for (old, new) in RENAMED {
        for argument in arguments.iter_mut() {
            let value = argument.to_str().and_then(|text| text.strip_prefix(old));
            if let Some(value) = value.filter(|value| value.is_empty() || value.starts_with('=')) {
                *argument = format!("{new}{value}").into();
                found.push((old, new));
            }
        }
    }
    found.dedup();
    found
}

fn dispatch(command: Command, out: &mut dyn Write, diagnostics: &mut dyn Write) -> Done {
    match command {
        Command::List(arguments) => list::list(arguments.format, out)?,
        Command::Check(arguments) => {
            let scenario = load(&arguments.scenario, diagnostics)?;
            match arguments.format {
                CheckFormat::Text => check::print(&scenario, out)?,
                CheckFormat::Toml => out.write_all(scenario.to_complete_toml().as_bytes())?,
                CheckFormat::Json => check::print_json(&scenario, out)?,
            }
        }
        Command::Run(arguments) => {
            let scenario = load(&arguments.scenario, diagnostics)?;
            if arguments.live.live.is_some() && scenario.settings().scenario.is_unpaced() {
                let warning = "speed max: the flight may be over before its page is open; --speed 1 has the clock's pace";
                writeln!(diagnostics, "morphquad: {warning}")?;
            }
            return fly(scenario, &arguments, out);
        }
        Command::Demo(arguments) => return demo::run(&arguments, out),
        Command::Scenario(command) => return scenarios::run(&command, out),
        Command::Ps(arguments) => return ps::run(&arguments, out),
        Command::Swap(arguments) => return orders::swap(&arguments, out),
        Command::Rehearse(arguments) => return rehearse::run(&arguments, out),
        Command::Rollback(arguments) => return orders::roll_back(&arguments, out),
        Command::Retire(arguments) => return orders::retire(&arguments, out),
        Command::Standby(arguments) => return orders::stand_by(&arguments, out),
        Command::Stop(arguments) => return orders::stop(&arguments, out),
        Command::Live(arguments) => return live::run(&arguments, out),
        Command::Goto(arguments) => return orders::go_to(&arguments, out),
        Command::Morph(arguments) => return orders::morph(&arguments, out),
        Command::Disturb(arguments) => return orders::disturb(&arguments, out),
        Command::Top(arguments) => return top::run(&arguments, out),
        Command::Topic(command) => return topic::run(&command, out, diagnostics),
        Command::Adopt(arguments) => return adopt::adopt(&arguments, out),
        Command::Paper(arguments) => return paper::reproduce(&arguments, out),
        Command::Campaign(arguments) => return campaign::run(&arguments, out),
        Command::Replay(arguments) => return replay(&arguments, out),
        Command::Doctor(arguments) => return doctor::run(&arguments, out),
        Command::Trace(arguments) => return trace::run(&arguments, out),
        Command::Report(arguments) => return report::run(&arguments, out, diagnostics),
        Command::Plot(arguments) => return plot::run(&arguments, out),
        Command::View(arguments) => return view::run(&arguments, out, diagnostics),
        Command::Recordings(command) => return recordings::run(&command, out),
        Command::Bench(command) => return bench::run(&command, out),
        Command::BenchPeer => return Ok(bench::be_peer()),
        Command::Study(command) => return study::run(&command, out),
        Command::NewController(arguments) => return new_controller::run(&arguments, out),
        Command::Types(arguments) => return types::run(&arguments, out),
        Command::Completions(arguments) => return completions::completions(&arguments, out),
        Command::Man(arguments) => return pages::man(&arguments, out),
        Command::Recover(arguments) => return recover::run(&arguments, out),
        Command::Layout(arguments) => return pages::layout(&arguments, out),
        Command::Proc(arguments) => {
            return Ok(proc::run(&arguments.service, arguments.place));
        }
    }
    Ok(exit::PASS)
}

/// Flies a recording again, or takes its flight up in the middle.
fn replay(arguments: &ReplayArguments, out: &mut dyn Write) -> Done {
    match arguments.branch.branch {
        Some(at) => branch::run(arguments, at, out),
        None => replay::run(arguments, out),
    }
}

/// Flies and shows how it went; a reader that has gone away changes nothing of it.
fn fly(scenario: Scenario, arguments: &RunArguments, out: &mut dyn Write) -> Done {
    let options = arguments.options(scenario);
    let named = options.record.as_deref().zip(options.name.as_deref());
    let named = named.map(|(folder, name)| folder.join(format!("{name}.mcap")));
    if let Some(path) = named.filter(|path| path.exists()) {
        let reason = format!("{} is there already: choose another --name", path.display());
        return Err(Failure::plain(&reason, exit::USAGE));
    }
    let flown = if arguments.in_process {
        simulate::run_in_process(&options)
    } else {
        flight::run(&options)
    };
    let summary = flown::summary(flown)?;
    show_summary(&summary, arguments.format, out)
}

/// Shows how a flight went, and gives its exit code.
fn show_summary(summary: &Summary, format: Format, out: &mut dyn Write) -> Done {
    let written = match format {
        Format::Text => writeln!(out, "{summary}"),
        Format::Json => writeln!(out, "{}", summary.to_json()),
    };
    finished(written.and_then(|()| out.flush()), summary.exit_code())
}

/// Ends a command whose result has been written, or could not be: a reader that has gone makes no pass of a fail.
fn finished(written: io::Result<()>, code: u8) -> Done {
    match written {
        Err(error) if code == exit::PASS => Err(error.into()),
        _ => Ok(code),
    }
}

/// Ends a command: its text to `out`, or its complaint with the code that it calls for.
fn conclude<E: miette::Diagnostic + Send + Sync + 'static>(
    done: Result<(String, u8), E>,
    exit_code: impl FnOnce(&E) -> u8,
    out: &mut dyn Write,
) -> Done {
    let (text, code) = done.map_err(|error| {
        let code = exit_code(&error);
        Failure::report(error, code)
    })?;
    finished(writeln!(out, "{}", text.trim_end()).and_then(|()| out.flush()), code)
}

/// Stands for a scenario that is read from standard input.
const STANDARD_INPUT: &str = "-";

/// Loads a scenario and warns of what is doubtful about it.
fn load(arguments: &ScenarioArguments, diagnostics: &mut dyn Write) -> Result<Scenario, Failure> {
    let scenario = load_quietly(arguments).map_err(|error| Failure::report(error, exit::USAGE))?;
    for warning in scenario.warnings() {
        writeln!(diagnostics, "{:?}", miette::Report::new(warning.clone()))?;
    }
    Ok(scenario)
}

fn load_quietly(arguments: &ScenarioArguments) -> Result<Scenario, ScenarioError> {
    let overrides = arguments.overrides()?;
    let scenario = if arguments.scenario == STANDARD_INPUT {
        Scenario::read("standard input", io::stdin(), &overrides)?
    } else {
        Scenario::load(&arguments.scenario, &overrides)?
    };
    scenario.require_candidates()?;
    Ok(scenario)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn morphquad(arguments: &str) -> (u8, String, String) {
        let (mut out, mut diagnostics) = (Vec::new(), Vec::new());
        let argv = std::iter::once("morphquad").chain(arguments.split_whitespace());
        let code = execute(argv.map(OsString::from), &mut out, &mut diagnostics);
        (code, String::from_utf8(out).unwrap(), String::from_utf8(diagnostics).unwrap())
    }

    #[test]
    fn list_names_every_shipped_scenario_on_stdout_alone() {
        let (code, out, diagnostics) = morphquad("list");
        assert_eq!((code, diagnostics.as_str()), (exit::PASS, ""));
        for name in scenario::shipped::names() {
            assert!(out.lines().any(|line| line.starts_with(name)), "{out}");
        }
    }

    #[test]
    fn check_shows_loops_arrows_and_overrides_and_ends_with_ok() {
        let (code, out, diagnostics) =
            morphquad("check figure8-morph --rate attitude-mpc=500 --seed 7 --for 1500ms");
        assert_eq!(code, exit::PASS, "{diagnostics}");
        assert!(out.contains("500 Hz") && out.contains("seed 7") && out.contains("1.5 s"), "{out}");
        assert!(out.contains("wrench_command") && out.contains("1 ms"), "{out}");
        assert!(out.ends_with("ok\n"));
    }

    #[test]
    fn check_shows_the_deadline_of_each_edge_and_how_a_slower_clock_stretches_it() {
        let edge = |out: &str, topic: &str, to: &str| -> Vec<String> {
            let line = out.lines().find(|line| line.starts_with(topic) && line.contains(to));
            let cells = line.unwrap_or_else(|| panic!("no {topic} to {to}: {out}")).split("  ");
            cells.map(str::trim).filter(|cell| !cell.is_empty()).map(str::to_owned).collect()
        };
        let set = "--set realtime.attitude_mpc.deadline.state_estimate_s=0.002";
        let (code, out, _) =
            morphquad(&format!("check figure8-morph --clock realtime --speed 0.1 {set}"));
        assert_eq!(code, exit::PASS);
        let estimate = edge(&out, "state_estimate", "attitude");
        assert_eq!(estimate[3..], ["-", "2 ms", "2 ms", "20 ms"], "{out}");
        let command = edge(&out, "wrench_command", "plant");
        assert_eq!(command[3..], ["1 ms", "-", "1 ms", "10 ms"], "{out}");
        let (_, out, _) = morphquad("check figure8-morph");
        assert_eq!(edge(&out, "imu", "estimator")[3..], ["-", "20 ms", "20 ms"], "{out}");
    }

    #[test]
    fn check_shows_what_is_done_to_a_flight_on_purpose() {
        let script = "--swap attitude=attitude-mpc@4.2s,max-bump=5% --fault kill:estimator@2s \
                      --standby position=position-pid";
        let (code, out, diagnostics) = morphquad(&format!("check hover {script}"));
        assert_eq!(code, exit::PASS, "{diagnostics}");
        let swap = "swap    attitude to attitude-mpc at 4.2 s, shadow 1 s, rollback 0.5 s, bump at most 0.05\n";
        let standby = "standby position position-pid from 0.1 s, shadow 0.5 s\n";
        assert!(out.contains(standby), "{out}");
        assert!(out.contains(swap) && out.contains("fault   kill estimator at 2 s\n"), "{out}");
    }

    #[test]
    fn a_scenario_that_does_not_fly_ends_with_2_and_an_empty_stdout() {
        for bad in [
            "check hoover",
            "check hover --rate rotor=5",
            "run hover --set plant.rate=5",
            "run hover --swap attitude=attitude-mpq@1s",
            "run hover --swap attitude=attitude-mpc@99s",
            "run hover --fault kill:unknown@1s",
            "run hover --standby attitude=unknown",
        ] {
            let (code, out, diagnostics) = morphquad(bad);
            assert_eq!((code, out.as_str()), (exit::USAGE, ""));
            assert!(diagnostics.contains("help:"), "{diagnostics}");
        }
        let scripted = "run hover --in-process --no-record --fault kill:plant@1s";
        let (code, out, diagnostics) = morphquad(scripted);
        assert_eq!((code, out.as_str()), (exit::USAGE, ""));
        assert!(diagnostics.contains("--in-process"), "{diagnostics}");
    }

    #[test]
    fn a_negative_number_after_a_flag_is_refused_as_its_value() {
        for (bad, flag) in [
            ("run --seed -4", "--seed"),
            ("run --pin -1", "--pin"),
            ("run --speed -1", "speed"),
            ("view --port -1", "--port"),
            ("study stability --rate -100", "--rate"),
            ("bench hop --priority -1", "--priority"),
            ("topic echo --count -1", "--count"),
        ] {
            let (code, _, message) = morphquad(bad);
            assert_eq!(code, exit::USAGE, "{bad}: {message}");
            assert!(message.contains(flag) && !message.contains("unexpected"), "{bad}: {message}");
        }
        let (code, _, message) = morphquad("list --no-such-flag -1");
        assert!(code == exit::USAGE && message.contains("unexpected"), "{message}");
    }

    #[test]
    fn an_option_that_would_do_nothing_is_refused() {
        for (idle, flag) in [
            ("topic hz none.mcap --for 5s", "--for"),
            ("topic hz none.mcap --run 1", "--run"),
            ("topic echo none.mcap --run 1", "--run"),
            ("replay none.mcap --branch @1s --out results", "--out"),
            ("bench rate -", "standard input"),
        ] {
            let (code, _, message) = morphquad(idle);
            assert_eq!(code, exit::USAGE, "{idle}: {message}");
            assert!(message.contains(flag), "{idle}: {message}");
        }
    }

    #[test]
    fn a_complaint_is_json_where_json_is_asked_for() {
        let complaint = |arguments: &str| {
            let (code, out, diagnostics) = morphquad(arguments);
            assert_eq!(code, exit::USAGE, "{arguments}");
            assert!(!diagnostics.is_empty(), "{arguments}");
            let object: serde_json::Value = serde_json::from_str(&out).unwrap();
            assert_eq!(object["exit"], 2, "{object}");
            object
        };
        let key = complaint("run hover --set plant.rate_hertz=5 --format json");
        assert!(key["error"].as_str().unwrap().contains("plant.rate_hertz"), "{key}");
        assert!(key["help"].as_str().unwrap().contains("rate_hz"), "{key}");
        assert_eq!(key["at"], "command line:1:13", "{key}");
        for (arguments, named) in [
            ("replay none.mcap --verify --format json", "none.mcap"),
            ("replay none.mcap --branch @1s --format json", "none.mcap"),
            ("replay none.mcap --format=json", "--verify"),
            ("campaign none.toml --format json", "none.toml"),
            ("study stability --rate 7 --format json", "--rate"),
            ("paper --test 4 --format json", "--test"),
            ("study --format json", "study"),
        ] {
            let text = complaint(arguments).to_string();
            assert!(text.contains(named), "{arguments}: {text}");
        }
    }

    #[test]
    fn check_names_the_controllers_and_refuses_unfit_ones_with_those_that_fit() {
        let (code, out, _) =
            morphquad("check hover --controller attitude=attitude-pid,position=position-pid");
        assert_eq!(code, exit::PASS);
        assert!(out.contains("attitude-pid ") && out.contains("position-pid "), "{out}");
        let (_, out, _) =
            morphquad("check hover --controller attitude=attitude-lqr --rate attitude-lqr=250");
        assert!(out.contains("attitude-lqr") && out.contains("250 Hz"), "{out}");
        for old in ["--crew attitude=attitude-pid", "--crew=attitude=attitude-pid"] {
            let (code, out, diagnostics) = morphquad(&format!("check hover {old}"));
            assert!(code == exit::PASS && out.contains("attitude-pid "), "{out}");
            assert_eq!(diagnostics, "morphquad: `--crew` is now `--controller`\n");
        }
        for (bad, remedy) in [
            ("check hover --controller attitude=attitude-lqg", "attitude=attitude-lqr"),
            ("check hover --controller attitude", "position=position-pid"),
            ("check hover --controller height=attitude-lqr", "SLOT=NAME"),
            ("check hover --set controller.attitude=attitude-lqg", "did you mean `attitude-lqr`"),
            ("check hover --set controller.estimator=estimator", "controller"),
            ("check hover --set attitude_lqr.integral_s=[1.0,1.0,0.0]", "0.001"),
        ] {
            let (code, out, diagnostics) = morphquad(bad);
            assert_eq!((code, out.as_str()), (exit::USAGE, ""), "{bad}");
            assert!(diagnostics.contains(remedy), "{bad}: {diagnostics}");
        }
    }

    #[test]
    fn durations_may_be_written_in_minutes_seconds_and_milliseconds() {
        for (text, shown) in
            [("20s", "20 s"), ("500ms", "0.5 s"), ("2m", "120 s"), ("1.5s", "1.5 s")]
        {
            let (code, out, diagnostics) = morphquad(&format!("check hover --for {text}"));
            assert_eq!(code, exit::PASS, "{diagnostics}");
            assert!(out.contains(shown), "{out}");
        }
    }
}
