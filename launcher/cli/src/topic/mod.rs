//! `morphquad topic`: topics of a running flight, and of a recording.

mod echo;
mod export;
mod hz;
mod info;
mod list;

use super::options::{RunChoice, TopicCommand};
use super::refusal::{Done, Failure};
use document::suggestion;
use host::exit;
use miette::Diagnostic;
use protocol::control::runs::{self, FindError, Run};
use protocol::topic::known;
use protocol::topic::live::ListenError;
use record::named::{Unnamed, named as named_recording};
use record::read::{ReadError, RecordedFlight};
use shared_types::{TopicInfo, topics};
use std::io::Write;
use std::path::{Path, PathBuf};
use thiserror::Error;
use viewers::export::ExportError;

/// Why a topic cannot be shown.
#[derive(Debug, Error, Diagnostic)]
pub(super) enum Trouble {
    #[error("no topic is called {name}, and no file either: {remedy}")]
    Unknown { name: String, remedy: String },
    #[error("two recordings, {} and {}: name one", .0.display(), .1.display())]
    TwoFiles(PathBuf, PathBuf),
    #[error("{0} is for a run, and a recording is read: leave it away")]
    OfRun(&'static str),
    #[error("name a recording: `morphquad topic export FILE --csv`")]
    NoFile,
    #[error("events are words, not samples: `morphquad topic echo {EVENTS}` shows them")]
    Events,
    #[error("{topic} has no field `{field}`: {remedy}")]
    NoField { topic: &'static str, field: String, remedy: String },
    #[error("--field {0}: name the topics that have it; words of `{EVENTS}` have no fields")]
    FieldOfAll(String),
    #[error(transparent)]
    Unnamed(#[from] Unnamed),
    #[error(transparent)]
    Find(#[from] FindError),
    #[error(transparent)]
    Listen(#[from] ListenError),
    #[error(transparent)]
    Read(#[from] ReadError),
    #[error(transparent)]
    Export(#[from] ExportError),
}

impl Trouble {
    fn exit_code(&self) -> u8 {
        match self {
            Self::Listen(_) | Self::Export(ExportError::Write { .. }) => exit::UNFIT,
            _ => exit::USAGE,
        }
    }
}

fn refuse<E>(error: E) -> Failure
where
    Trouble: From<E>,
{
    let trouble = Trouble::from(error);
    let code = trouble.exit_code();
    Failure::report(trouble, code)
}

/// Stands for the log of the launcher, where a topic is asked for.
const EVENTS: &str = "events";

/// Topics, and perhaps a recording.
struct What {
    topics: Vec<&'static TopicInfo>,
    /// Events are named among them.
    events: bool,
    file: Option<PathBuf>,
}

impl What {
    /// As [`What::of`], for commands that count samples.
    fn of_samples(arguments: &[String]) -> Result<Self, Failure> {
        let what = Self::of(arguments)?;
        if what.events { Err(refuse(Trouble::Events)) } else { Ok(what) }
    }

    /// Refuses a run where a recording is named: one of them would be left out.
    fn require_no_run_beside_a_file(&self, run: &RunChoice) -> Result<(), Failure> {
        match (&self.file, &run.run) {
            (Some(_), Some(_)) => Err(refuse(Trouble::OfRun("--run"))),
            _ => Ok(()),
        }
    }

    /// Separates names of topics from paths.
    fn of(arguments: &[String]) -> Result<Self, Failure> {
        let (mut named, mut file): (Vec<_>, Option<PathBuf>) = (Vec::new(), None);
        let mut events = false;
        for argument in arguments {
            if argument == EVENTS {
                events = true;
                continue;
            }
            if let Some(topic) = known(argument) {
                if !named.iter().any(|other: &&TopicInfo| other.name == topic.name) {
                    named.push(topic);
                }
                continue;
            }
            let path = named_recording(Path::new(argument)).map_err(refuse)?;
            if !path.exists() && !argument.contains(['/', '.']) {
                let names = topics::all().into_iter().map(|topic| topic.name);
                let names = names.chain([EVENTS]);
                let remedy = suggestion(argument, names);
                return Err(refuse(Trouble::Unknown { name: argument.clone(), remedy }));
            }
            if let Some(before) = file.replace(path.clone()) {
                return Err(refuse(Trouble::TwoFiles(before, path)));
            }
        }
        Ok(Self { topics: named, events, file })
    }

    /// Nothing is named, which means everything.
    fn is_all(&self) -> bool {
        self.topics.is_empty() && !self.events
    }

    /// The topics named, or all.
    fn topics_or_all(&self) -> Vec<&'static TopicInfo> {
        if self.is_all() { topics::all().to_vec() } else { self.topics.clone() }
    }

    fn wants(&self, topic: &TopicInfo) -> bool {
        self.is_all() || self.topics.iter().any(|wanted| wanted.name == topic.name)
    }

    fn wants_events(&self) -> bool {
        self.is_all() || self.events
    }
}

fn open(path: &Path) -> Result<RecordedFlight, Failure> {
    RecordedFlight::open(path).map_err(refuse)
}

fn find(wanted: Option<&str>) -> Result<Run, Failure> {
    runs::find(wanted).map_err(refuse)
}

/// Does what is asked for.
pub(super) fn run(
    command: &TopicCommand,
    out: &mut dyn Write,
    diagnostics: &mut dyn Write,
) -> Done {
    match command {
        TopicCommand::List(arguments) => list::run(arguments, out, diagnostics),
        TopicCommand::Echo(arguments) => echo::run(arguments, out, diagnostics),
        TopicCommand::Hz(arguments) => hz::run(arguments, out, diagnostics),
        TopicCommand::Info(arguments) => info::run(arguments, out),
        TopicCommand::Export(arguments) => export::run(arguments, out, diagnostics),
    }
}
