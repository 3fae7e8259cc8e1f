//! Why a command ends without a result: printed for people once and, if they asked for JSON, for machines.

use anstream::{AutoStream, ColorChoice};
use clap::error::ErrorKind;
use core::fmt::Display;
use miette::{Diagnostic, Report};
use serde_json::json;
use std::ffi::OsString;
use std::io::{self, Write};

/// How a command ends: an exit code after its result, or without one.
pub(super) type Done = Result<u8, Failure>;

/// Why there is no result.
#[derive(Debug)]
pub(super) enum Failure {
    /// The command complains.
    Refused(Box<Refusal>),
    /// The result could not be written.
    Unwritten(io::Error),
}

/// A complaint with the exit code that it calls for.
#[derive(Debug)]
pub(super) struct Refusal {
    /// For people, with everything that helps.
    message: String,
    /// What is wrong, in a line.
    error: String,
    help: Option<String>,
    /// File, or `command line`, with line and column.
    at: Option<String>,
    code: u8,
}

impl From<io::Error> for Failure {
    fn from(error: io::Error) -> Self {
        Self::Unwritten(error)
    }
}

impl Failure {
    /// A complaint that is complete in its sentence.
    pub(super) fn plain(error: &impl Display, code: u8) -> Self {
        let error = error.to_string();
        let message = format!("morphquad: {error}");
        Self::Refused(Box::new(Refusal { message, error, help: None, at: None, code }))
    }

    /// A complaint with a place or a remedy.
    pub(super) fn report<E: Diagnostic + Send + Sync + 'static>(error: E, code: u8) -> Self {
        let help = error.help().map(|help| help.to_string());
        let at = place(&error);
        let sentence = error.to_string();
        let message = format!("{:?}", Report::new(error));
        Self::Refused(Box::new(Refusal { message, error: sentence, help, at, code }))
    }

    /// A command line that means nothing; help that was asked for is no failure.
    pub(super) fn usage(error: &clap::Error, code: u8) -> Self {
        let rendered = error.render().to_string();
        let mut parts = rendered.splitn(2, "\n\n");
        let line = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
        let first = line(parts.next().unwrap_or_default().trim_start_matches("error: "));
        // Of a command without its arguments, all that is printed is how to use it.
        let shows_help = error.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand;
        let first = if shows_help { "arguments are missing".to_owned() } else { first };
        let help = parts.next().map(line);
        // A terminal can be configured to have no colours, for example by `NO_COLOR`.
        let plain = AutoStream::choice(&io::stderr()) == ColorChoice::Never;
        let message = if plain { rendered.clone() } else { error.render().ansi().to_string() };
        Self::Refused(Box::new(Refusal { message, error: first, help, at: None, code }))
    }
}

impl Refusal {
    /// What the command ends with.
    pub(super) fn code(&self) -> u8 {
        self.code
    }

    /// Writes it and gives the exit code.
    pub(super) fn write(
        &self,
        in_json: bool,
        out: &mut dyn Write,
        diagnostics: &mut dyn Write,
    ) -> io::Result<u8> {
        writeln!(diagnostics, "{}", self.message.trim_end())?;
        if in_json {
            let Self { error, help, at, code, .. } = self;
            let object = json!({"error": error, "help": help, "at": at, "exit": code});
            writeln!(out, "{object}")?;
            out.flush()?;
        }
        Ok(self.code)
    }
}

/// Where the first label of a complaint points to.
fn place(error: &dyn Diagnostic) -> Option<String> {
    let label = error.labels()?.next()?;
    let found = error.source_code()?.read_span(label.inner(), 0, 0).ok()?;
    let (line, column) = (found.line() + 1, found.column() + 1);
    Some(format!("{}:{line}:{column}", found.name().unwrap_or_default()))
}

/// True if the arguments ask for `--format json`, also where the rest of them means nothing.
pub(super) fn asks_for_json(arguments: &[OsString]) -> bool {
    let two = arguments.windows(2).any(|pair| pair[0] == "--format" && pair[1] == "json");
    two || arguments.iter().any(|argument| argument == "--format=json")
}
