//! `morphquad replay`: a recording again, compared with itself, another setting or another build.

use super::options::{Format, ReplayArguments};
use super::refusal::{Done, Failure};
use ::replay::{self, ReplayError, Selection, With};
use document::suggestion;
use host::exit;
use indicatif::ProgressBar;
use record::read::{ReadError, RecordedFlight};
use scenario::{Override, services};
use serde_json::{Map, Value};
use shared_types::Role;
use std::io::{self, IsTerminal as _, Write};
use std::path::Path;

/// Why a replay has no result.
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

/// What a replay found, and whether all was as it should be.
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

/// Replays and shows the result.
pub(super) fn run(arguments: &ReplayArguments, out: &mut dyn Write) -> Done {
    let answer = answer(arguments).map_err(|refusal| match refusal {
        Refusal::Usage(what) => Failure::plain(&what, exit::USAGE),
        Refusal::Replay(ReplayError::Scenario(error)) => Failure::report(error, exit::USAGE),
        Refusal::Replay(error) => Failure::plain(&error, code_of(&error)),
    })?;
    let written = match arguments.format {
        Format::Text => out.write_all(answer.text.as_bytes()),
        Format::Json => writeln!(out, "{}", Value::Object(answer.json)),
    };
    let code = if answer.differs { exit::FAILED } else { exit::PASS };
    crate::finished(written.and_then(|()| out.flush()), code)
}

/// A file that cannot be read, however it came to that, was asked for wrongly.
fn code_of(error: &ReplayError) -> u8 {
    match error {
        ReplayError::Record(_) | ReplayError::Read(ReadError::TooLong { .. }) => exit::UNFIT,
        ReplayError::Interrupted => exit::INTERRUPTED,
        _ => exit::USAGE,
    }
}

fn answer(arguments: &ReplayArguments) -> Result<Answer, Refusal> {
    let selection =
        arguments.service.iter().map(|name| selected(name)).collect::<Result<Vec<_>, _>>()?;
    if !selection.is_empty()
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
    let with = arguments.with.as_deref().map(|with| controller(with, &selection, &overrides));
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
        let bar = progress(selection.len());
        let verified = replay::verify(&flight, &selection, |service| {
            bar.set_message(service.instance.to_string());
            bar.inc(1);
        });
        bar.finish_and_clear();
        let verified = verified?;
        answer.add("verify", &verified, verified.to_json(), !verified.identical());
    }
    if let Some((service, with)) = with {
        let departure = replay::depart(&flight, &service, &with)?;
        answer.add("with", &departure, departure.to_json(service.role), false);
    }
    if let Some(path) = &arguments.outputs {
        write_outputs(&flight, &selection, &overrides, path)?;
    }
    Ok(answer)
}

fn write_outputs(
    flight: &RecordedFlight,
    selection: &[Selection],
    overrides: &[Override],
    path: &Path,
) -> Result<(), Refusal> {
    let [service] = selection else {
        let what = "--outputs writes those of one service: name it with --service";
        return Err(Refusal::Usage(what.to_owned()));
    };
    Ok(replay::write_outputs(flight, service, overrides, path)?)
}

/// Role by its own name or that of its service.
fn role(name: &str) -> Result<Role, Refusal> {
    let by_label = Role::STEPPING.into_iter().find(|role| role.label() == name);
    services::role_of(name).or(by_label).ok_or_else(|| {
        let labels = Role::STEPPING.into_iter().map(Role::label);
        let remedy = suggestion(name, labels.chain(services::names()));
        Refusal::Usage(format!("--service {name}: no service has this name; {remedy}"))
    })
}

/// `NAME`, `NAME@SEAT` or `ROLE@SEAT`: the service that a replay is about.
fn selected(text: &str) -> Result<Selection, Refusal> {
    let (name, seat) = match text.rsplit_once('@') {
        Some((name, seat)) => (name, Some(seat)),
        None => (text, None),
    };
    let role = role(name)?;
    let seat = seat.map(|seat| {
        let index = seat.parse().ok().filter(|index| *index < role.seats());
        index.ok_or_else(|| {
            let last = role.seats() - 1;
            let what = format!("--service {text}: {} has seats 0 to {last}", role.label());
            Refusal::Usage(what)
        })
    });
    // Of a role that one service alone fills, its name adds nothing to the role.
    let named = services::names_for(role).find(|known| *known == name);
    let several = services::names_for(role).count() > 1;
    Ok(Selection { role, name: named.filter(|_| several), seat: seat.transpose()? })
}

/// The controller that replays, and the service that it replaces.
fn controller(
    with: &str,
    selection: &[Selection],
    overrides: &[Override],
) -> Result<(Selection, With), Refusal> {
    if let Ok(role) = role(with) {
        if selection.len() > 1 || selection.iter().any(|service| service.role != role) {
            let what = format!("--with {with} replaces {}, not what --service names", role.label());
            return Err(Refusal::Usage(what));
        }
        let name = services::names().find(|name| *name == with);
        let service = selection.first().copied().unwrap_or_else(|| Selection::all_of(role));
        return Ok((service, With::Service { name, overrides: overrides.to_vec() }));
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
    let [service] = *selection else {
        let what = format!(
            "--with {with}: an executable is another build of morphquad; name with --service, for example `--service attitude`, which service it replays"
        );
        return Err(Refusal::Usage(what));
    };
    Ok((service, With::Executable(with.into())))
}

/// A bar over services, on a terminal only.
fn progress(asked_for: usize) -> ProgressBar {
    if !io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let services = if asked_for == 0 { Role::STEPPING.len() } else { asked_for };
    ProgressBar::new(services as u64)
}
