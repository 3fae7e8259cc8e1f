//! `morphquad replay`: a recording again, compared with itself, another setting or another build.

use super::options::{Format, ReplayArguments};
use super::refusal::{Done, Failure};
use crate::components;
use crate::exit;
use crate::record::read::RecordedFlight;
use crate::replay::{self, ReplayError, With};
use crate::scenario::{Override, suggestion};
use indicatif::ProgressBar;
use serde_json::{Map, Value};
use shared_types::Role;
use std::io::{self, IsTerminal as _, Write};
use std::path::Path;

/// Why a replay said nothing.
enum Refusal {
    /// The command line does not make sense.
    Usage(String),
    Replay(ReplayError),
}

impl<E: Into<ReplayError>> From<E> for Refusal {
    fn from(error: E) -> Self {
        Self::Replay(error.into())
    }
}

/// What a replay said, and whether all was as it should be.
#[derive(Default)]
struct Answer {
    text: String,
    json: Map<String, Value>,
    differs: bool,
}

impl Answer {
    fn add(&mut self, key: &str, text: &dyn core::fmt::Display, json: Value, differs: bool) {
        self.text += &text.to_string();
        self.text.push('\n');
        self.json.insert(key.to_owned(), json);
        self.differs |= differs;
    }
}

/// Replays and says what came of it.
pub(super) fn run(arguments: &ReplayArguments, out: &mut dyn Write) -> Done {
    let answer = answer(arguments).map_err(|refusal| match refusal {
        Refusal::Usage(what) => Failure::plain(&what, exit::USAGE),
        Refusal::Replay(ReplayError::Scenario(error)) => Failure::report(error, exit::USAGE),
        Refusal::Replay(error) => Failure::plain(&error, code_of(&error)),
    })?;
    match arguments.format {
        Format::Text => out.write_all(answer.text.as_bytes())?,
        Format::Json => writeln!(out, "{}", Value::Object(answer.json))?,
    }
    out.flush()?;
    Ok(if answer.differs { exit::GATE_FAILED } else { exit::PASS })
}

/// A file that cannot be read, however it came to that, was asked for wrongly.
fn code_of(error: &ReplayError) -> u8 {
    match error {
        ReplayError::Record(_) => exit::UNFIT,
        ReplayError::Interrupted => exit::INTERRUPTED,
        _ => exit::USAGE,
    }
}

fn answer(arguments: &ReplayArguments) -> Result<Answer, Refusal> {
    let roles = arguments.service.iter().map(|name| role(name)).collect::<Result<Vec<_>, _>>()?;
    if !roles.is_empty()
        && !arguments.verify
        && arguments.with.is_none()
        && arguments.outputs.is_none()
    {
        let what = "--hash is of the whole flight: leave --service away, or add --verify";
        return Err(Refusal::Usage(what.to_owned()));
    }
    let overrides =
        arguments.set.iter().map(|set| Override::set(set)).collect::<Result<Vec<_>, _>>();
    let overrides = overrides.map_err(ReplayError::Scenario)?;
    let with = arguments.with.as_deref().map(|with| controller(with, &roles, &overrides));
    let with = with.transpose()?;
    if !overrides.is_empty() && with.is_none() && arguments.outputs.is_none() {
        let what = "--set changes the controller that --with or --outputs names: add one of them";
        return Err(Refusal::Usage(what.to_owned()));
    }
    let flight = RecordedFlight::open(&arguments.file)?;
    let mut answer = Answer::default();
    let file = flight.path().display().to_string();
    answer.json.insert("file".to_owned(), file.into());
    if arguments.hash {
        let hashes = replay::hashes(&flight)?;
        answer.add("hashes", &hashes, hashes.to_json(), !hashes.agree());
    }
    if arguments.verify {
        let bar = progress(roles.len());
        let verified = replay::verify(&flight, &roles, |service| {
            bar.set_message(service.role.label());
            bar.inc(1);
        });
        bar.finish_and_clear();
        let verified = verified?;
        answer.add("verify", &verified, verified.to_json(), !verified.identical());
    }
    if let Some((role, with)) = with {
        let departure = replay::depart(&flight, role, &with)?;
        answer.add("with", &departure, departure.to_json(role), false);
    }
    if let Some(path) = &arguments.outputs {
        write_outputs(&flight, &roles, &overrides, path)?;
    }
    Ok(answer)
}

fn write_outputs(
    flight: &RecordedFlight,
    roles: &[Role],
    overrides: &[Override],
    path: &Path,
) -> Result<(), Refusal> {
    let [role] = *roles else {
        let what = "--outputs writes those of one service: name it with --service";
        return Err(Refusal::Usage(what.to_owned()));
    };
    Ok(replay::write_outputs(flight, role, overrides, path)?)
}

/// Role by its own name or that of its service.
fn role(name: &str) -> Result<Role, Refusal> {
    let by_label = Role::STEPPING.into_iter().find(|role| role.label() == name);
    components::role_of(name).or(by_label).ok_or_else(|| {
        let labels = Role::STEPPING.into_iter().map(Role::label);
        let remedy = suggestion(name, labels.chain(components::names()));
        Refusal::Usage(format!("--service {name}: no service has this name; {remedy}"))
    })
}

/// Who replays in whose place.
fn controller(with: &str, roles: &[Role], overrides: &[Override]) -> Result<(Role, With), Refusal> {
    if let Ok(role) = role(with) {
        return if roles.iter().all(|other| *other == role) {
            let named = components::names().into_iter().find(|name| *name == with);
            Ok((role, With::Service { name: named, overrides: overrides.to_vec() }))
        } else {
            let what = format!("--with {with} replaces {}, not what --service names", role.label());
            Err(Refusal::Usage(what))
        };
    }
    if !Path::new(with).is_file() {
        let what =
            format!("--with {with}: neither a service nor an executable; give the path of one");
        return Err(Refusal::Usage(what));
    }
    if !overrides.is_empty() {
        let what = "--set changes a service of this build; another executable has its own settings";
        return Err(Refusal::Usage(what.to_owned()));
    }
    let [role] = *roles else {
        let what = format!("--with {with}: say with --service which one it replays");
        return Err(Refusal::Usage(what));
    };
    Ok((role, With::Executable(with.into())))
}

/// A bar over services, on a terminal only.
fn progress(asked_for: usize) -> ProgressBar {
    if !io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let services = if asked_for == 0 { Role::STEPPING.len() } else { asked_for };
    ProgressBar::new(services as u64)
}
