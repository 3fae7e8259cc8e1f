//! my-attitude-controller as a process of a run: `morphquad swap attitude --to PATH`.

use my_attitude_controller::Controller;
use std::process::ExitCode;

fn main() -> ExitCode {
    host::controller("my-attitude-controller", Controller::new)
}
