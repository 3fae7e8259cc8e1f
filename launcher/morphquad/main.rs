//! The `morphquad` executable: the launcher, and every process it starts.

use record::build::{self, Build};
use std::process::ExitCode;

fn main() -> ExitCode {
    // Started as `/proc/self/exe`, a process would be called `exe` in `ps` and `top`.
    host::name_thread("morphquad");
    build::declare(Build {
        git: env!("MORPHQUAD_GIT"),
        rustc: env!("MORPHQUAD_RUSTC"),
        crates: env!("MORPHQUAD_CRATES"),
    });
    let code = cli::execute(std::env::args_os(), &mut std::io::stdout(), &mut std::io::stderr());
    ExitCode::from(code)
}
