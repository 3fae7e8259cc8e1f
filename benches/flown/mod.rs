//! The executable that a bench flies is the bench itself, so that `cargo bench` builds all that it needs.

use std::process::{Command, ExitCode};

/// Is set for a flight and, because children inherit it, for every process of the flight.
const FLOWN: &str = "MORPHQUAD_FLOWN_BY_BENCH";

/// `morphquad`, without arguments.
pub(crate) fn morphquad() -> Command {
    let mut command = Command::new("/proc/self/exe");
    command.env(FLOWN, "1");
    command
}

/// Runs the command line of `morphquad` if this process was started by [`morphquad`], or by a process that
/// was; `None` in the bench itself.
pub(crate) fn run_if_flown() -> Option<ExitCode> {
    std::env::var_os(FLOWN)?;
    host::name_thread("morphquad");
    let code = cli::execute(std::env::args_os(), &mut std::io::stdout(), &mut std::io::stderr());
    Some(ExitCode::from(code))
}
