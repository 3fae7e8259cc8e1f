//! Arguments of `run`, and of every command that takes a scenario.

use super::duration::duration;
use super::scenario_name::ScenarioOr;
use super::{Format, LiveFlags};
use clap::Args;
use clap::builder::StringValueParser;
use core::time::Duration;
use document::ScenarioError;
use protocol::topic::known;
use record::named::LATEST;
use replay::timing_of;
use scenario::{Override, Scenario, shipped};
use simulate::{Pin, RunOptions, Speed};
use std::io::IsTerminal as _;
use std::path::{Path, PathBuf};

/// A scenario and what to change in it.
#[derive(Debug, Clone, Args)]
pub struct ScenarioArguments {
    /// Name of a shipped scenario, or path of a scenario file; `-` is standard input
    #[arg(default_value = "figure8-morph", hide_possible_values = true)]
    #[arg(value_parser = ScenarioOr(StringValueParser::new()))]
    pub scenario: String,
    /// Simulated time, or logical time that follows the wall clock
    #[arg(long, value_name = "lockstep|realtime")]
    pub clock: Option<String>,
    /// Logical time of the flight: 20s, 500ms, 2m
    #[arg(long = "for", value_name = "DURATION", allow_hyphen_values = true, value_parser = duration)]
    pub duration: Option<Duration>,
    /// Seed of everything random
    #[arg(long, value_name = "N")]
    #[arg(value_parser = clap::value_parser!(u64).range(..=i64::MAX as u64))]
    pub seed: Option<u64>,
    /// Rate of one loop, for example `attitude-mpc=500`
    #[arg(long, value_name = "NAME=HZ")]
    pub rate: Vec<String>,
    /// Controller that fills a slot, for example `attitude=attitude-lqr`; `check` names them
    #[arg(long, value_name = "SLOT=NAME", value_delimiter = ',')]
    pub controller: Vec<String>,
    /// Any key of the scenario, for example `start.morph_angle_deg=120`
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Logical seconds per wall second
    #[arg(long, value_name = "N|max")]
    pub speed: Option<String>,
    /// Another controller for a slot at a time, for example `attitude=attitude-mpc@4.2s,shadow=1s`
    #[arg(long, value_name = "SLOT=NAME@TIME")]
    pub swap: Vec<String>,
    /// Another instance to keep warm beside a slot's owner, for example `attitude=attitude-pid`
    #[arg(long, value_name = "SLOT=NAME")]
    pub standby: Vec<String>,
    /// Kill or stop a process at a time, for example `kill:estimator@4.2s`
    #[arg(long, value_name = "kill|stop:NAME@TIME")]
    pub fault: Vec<String>,
    /// What a loop or topic does to time, for example `attitude:step=12ms@2s..3s`, a file of such entries, or a
    /// recording whose time it is to take
    #[arg(long, value_name = "NAME:KIND[=TIME][@FROM..TO]|FILE")]
    pub timing: Vec<String>,
    /// Realtime: refuse to fly unless the system grants priority, locked memory and processors
    #[arg(long)]
    pub strict: bool,
    /// Leave the plan at a time and rest at a place, for example `1,0,2@3s`
    #[arg(long, value_name = "X,Y,Z[,YAW]@TIME", allow_hyphen_values = true)]
    pub goto: Vec<String>,
    /// Leave the morph schedule at a time, for example `120@3s,over=2s`
    #[arg(long, value_name = "DEGREES@TIME")]
    pub morph: Vec<String>,
}

impl ScenarioArguments {
    /// The flags as edits: the particular ones after `--set`, so that they win.
    ///
    /// # Errors
    /// A flag that is no edit of any scenario.
    pub fn overrides(&self) -> Result<Vec<Override>, ScenarioError> {
        let set = self.set.iter().map(|argument| Override::set(argument));
        let rate = self.rate.iter().map(|argument| Override::rate(argument));
        let swap = self.swap.iter().map(|argument| Override::swap(argument));
        let fault = self.fault.iter().map(|argument| Override::fault(argument));
        let standby = self.standby.iter().map(|argument| Override::standby(argument));
        let assigned = self.controller.iter().map(|argument| Override::controller(argument));
        let goto = self.goto.iter().map(|argument| Override::goto(argument));
        let morph = self.morph.iter().map(|argument| Override::morph(argument));
        let timing = self.timing.iter().map(|argument| timing(argument));
        let scripted = swap.chain(standby).chain(fault).chain(goto).chain(morph).chain(timing);
        let all = set.chain(rate).chain(assigned).chain(scripted);
        let mut overrides = all.collect::<Result<Vec<_>, _>>()?;
        overrides.extend(self.strict.then(|| Override::set("realtime.strict=true")).transpose()?);
        overrides.extend(self.clock.as_deref().map(Override::clock));
        overrides.extend(self.duration.map(Override::duration));
        overrides.extend(self.seed.map(Override::seed));
        overrides.extend(self.speed.as_deref().map(Override::speed));
        Ok(overrides)
    }
}

/// `--timing` of an entry, a file of entries, or a recording.
fn timing(argument: &str) -> Result<Override, ScenarioError> {
    if !document::is_recording(Path::new(argument)) {
        return Override::timing(argument);
    }
    let entries = timing_of(Path::new(argument)).map_err(|error| error.to_string());
    Override::recorded_timing(argument, entries)
}

/// What to fly and how.
#[derive(Debug, Clone, Args)]
pub struct RunArguments {
    /// The scenario.
    #[command(flatten)]
    pub scenario: ScenarioArguments,
    /// Folder for the recording
    #[arg(long, value_name = "DIR", default_value = "recordings", conflicts_with = "no_record")]
    pub record: PathBuf,
    /// Name of the recording; the id of the run if left out
    #[arg(long, value_name = "NAME", conflicts_with = "no_record", value_parser = recording_name)]
    pub name: Option<String>,
    /// Record nothing
    #[arg(long)]
    pub no_record: bool,
    /// Fly in one thread, without processes and shared memory but for executables that a script has take
    /// over: the same flight, faster
    #[arg(long, conflicts_with = "disorder")]
    pub in_process: bool,
    /// Where the processes run: on one processor (auto in lockstep, where it is fastest, but for the
    /// monitor of a flight that is not recorded), on any (auto in realtime, none), or on a given one
    #[arg(long, value_name = "auto|none|CPU", default_value = "auto", value_parser = pin)]
    pub pin: Pin,
    /// Start order, pauses, processors and priorities by chance, for tests that want disorder
    #[arg(long, value_name = "SEED", hide = true)]
    pub disorder: Option<u64>,
    /// Form of the summary
    #[arg(long, value_enum, default_value = "text")]
    pub format: Format,
    /// For viewers.
    #[command(flatten)]
    pub live: LiveFlags,
}

impl RunArguments {
    pub(crate) fn options(&self, scenario: Scenario) -> RunOptions {
        // A flight that is over before the page is there cannot be watched, unless it is to be so.
        let settings = &scenario.settings().scenario;
        let is_to_be_watched = self.live.live.is_some() && settings.speed.is_none();
        let unpaced = if is_to_be_watched { Speed::Times(1.0) } else { Speed::Max };
        let speed = settings.pace().map_or(unpaced, Speed::Times);
        let record = (!self.no_record).then(|| self.record.clone());
        let name = self.name.clone();
        let progress = std::io::stderr().is_terminal();
        let (pin, disorder) = (self.pin, self.disorder);
        RunOptions {
            scenario,
            speed,
            record,
            name,
            pin,
            disorder,
            progress,
            live: self.live.options(),
        }
    }
}

/// Longest name of a recording \[bytes\]: with its ending and what `recover` adds a file can still have it.
const NAME_BYTES: usize = 200;

/// A name that is one file in any folder, and means nothing else where a recording is named.
fn recording_name(text: &str) -> Result<String, String> {
    let name = text.strip_suffix(".mcap").unwrap_or(text);
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
    if !name.starts_with(|c: char| c.is_ascii_alphanumeric()) || !name.chars().all(is_plain) {
        let reason =
            "a name begins with a letter or a digit, and has letters, digits, `-`, `_` and `.`";
        return Err(reason.to_owned());
    }
    if name.len() > NAME_BYTES {
        return Err(format!("a name has at most {NAME_BYTES} characters"));
    }
    let is_taken = name == LATEST || shipped::names().any(|it| it == name) || known(name).is_some();
    if is_taken {
        return Err(
            "it would not mean this recording: it is a scenario, a topic or `latest`".to_owned()
        );
    }
    Ok(name.to_owned())
}

fn pin(text: &str) -> Result<Pin, String> {
    match text {
        "auto" => Ok(Pin::Auto),
        "none" => Ok(Pin::None),
        cpu => cpu.parse().map(Pin::Cpu).map_err(|_| {
            format!("`{cpu}` is not a valid CPU: write auto, none or a number from 0")
        }),
    }
}
