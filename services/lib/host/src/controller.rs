//! A controller as an executable of its own.

use crate::{
    BuildError, Config, Flight, HostError, Joined, LAYOUT_ARGUMENT, PlaceArguments, conclude, exit,
    layout_hash,
};
use clap::{CommandFactory as _, FromArgMatches as _, Parser};
use runtime::{Component, Ending, Service};
use shared_types::{Role, Slot};
use std::io::{self, Write as _};
use std::process::ExitCode;

/// Controllers publish their state after each step.
const STATE_EVERY: u64 = 1;

/// A controller for a run of morphquad, which starts it: `morphquad swap SLOT --to PATH`.
#[derive(Debug, Parser)]
#[command(version, max_term_width = 100)]
struct Arguments {
    /// Slot to fly
    #[arg(long, value_name = "attitude|position", value_parser = slot)]
    slot: Role,
    #[command(flatten)]
    place: PlaceArguments,
}

fn slot(text: &str) -> Result<Role, String> {
    let known = Slot::ALL.map(Slot::label).join(" and ");
    Slot::named(text).map(Slot::role).ok_or_else(|| format!("there are the slots {known}"))
}

/// Joins the run that the command line names, has `build` make the controller and flies it to the
/// end of the flight, or until its seat is given up.
///
/// Asked for its `--layout`, it prints which builds it can fly with, and ends.
///
/// `build` gets the flight's rates, latencies and vehicle, and the user's `--config`.
pub fn controller<S, E>(
    name: &'static str,
    build: impl FnOnce(&Flight, &Config) -> Result<S, E>,
) -> ExitCode
where
    S: Service + 'static,
    E: Into<BuildError>,
{
    if std::env::args_os().nth(1).is_some_and(|argument| argument == LAYOUT_ARGUMENT) {
        // The process that asked may have gone.
        let _ = writeln!(io::stdout(), "{:016x}", layout_hash());
        return ExitCode::from(exit::PASS);
    }
    let matches = Arguments::command().name(name).try_get_matches();
    let arguments = match matches.and_then(|matches| Arguments::from_arg_matches(&matches)) {
        Ok(arguments) => arguments,
        Err(error) => {
            // Clap knows whether this is help or a complaint; a closed pipe changes neither.
            let _ = error.print();
            return ExitCode::from(if error.use_stderr() { exit::USAGE } else { exit::PASS });
        }
    };
    ExitCode::from(conclude(name, fly(name, arguments, build)))
}

fn fly<S, E>(
    name: &str,
    arguments: Arguments,
    build: impl FnOnce(&Flight, &Config) -> Result<S, E>,
) -> Result<Ending, HostError>
where
    S: Service + 'static,
    E: Into<BuildError>,
{
    let config = Config::new(arguments.place.config.clone());
    let joined = Joined::join(name, arguments.slot, arguments.place)?;
    let service =
        build(joined.flight(), &config).map_err(|error| HostError::Build(error.into()))?;
    joined.fly(Component::new(service, STATE_EVERY))
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLACE: &str = "my-controller --run /dev/shm/mq-1 --generation 2 --launcher-pid 3";

    fn parse(more: &str) -> Result<Arguments, clap::Error> {
        Arguments::try_parse_from(PLACE.split(' ').chain(more.split_whitespace()))
    }

    #[test]
    fn the_records_of_the_launcher_are_understood() {
        let arguments =
            parse("--slot attitude --seat 1 --await-handover --nice -5 --config a.toml").unwrap();
        assert_eq!((arguments.slot, arguments.place.seat), (Role::Attitude, 1));
        assert!(arguments.place.await_handover && arguments.place.nice == Some(-5));
        assert_eq!(arguments.place.config.as_deref(), Some("a.toml".as_ref()));
        assert_eq!(parse("--slot position").unwrap().slot, Role::Position);
    }

    #[test]
    fn there_is_no_slot_of_another_name() {
        let error = parse("--slot plant").unwrap_err().to_string();
        assert!(error.contains("attitude and position"), "{error}");
        assert!(parse("").is_err());
    }
}
