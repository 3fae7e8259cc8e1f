//! The `morphquad` executable: the launcher, and every process it starts.

use std::process::ExitCode;

fn main() -> ExitCode {
    let code =
        launcher::cli::execute(std::env::args_os(), &mut std::io::stdout(), &mut std::io::stderr());
    ExitCode::from(code)
}
