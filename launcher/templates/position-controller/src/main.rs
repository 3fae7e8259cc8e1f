//! my-position-controller as a process of a run: `morphquad swap position --to PATH`.

use my_position_controller::Controller;
use std::process::ExitCode;

fn main() -> ExitCode {
    host::controller("my-position-controller", Controller::new)
}
