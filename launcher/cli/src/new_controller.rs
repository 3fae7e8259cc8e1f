//! `morphquad new-controller`.

use super::conclude;
use super::options::NewControllerArguments;
use super::refusal::Done;
use launcher::exit;
use launcher::new_controller::{NewController, NewControllerError};
use std::io::Write;

/// Writes a crate and says how to fly it.
pub(super) fn run(arguments: &NewControllerArguments, out: &mut dyn Write) -> Done {
    let NewControllerArguments { name, slot, dir, path } = arguments.clone();
    let new = NewController { name, slot, dir, path };
    let done = new.write().map(|dir| {
        let (slot, name, dir) = (&new.slot, &new.name, dir.display());
        let text = format!(
            "{dir}: a controller for the {slot} slot; build it and let it fly:\n  \
             cargo build --release --manifest-path {dir}/Cargo.toml\n  \
             morphquad swap {slot} --to {dir}/target/release/{name}"
        );
        (text, exit::PASS)
    });
    conclude(done, NewControllerError::exit_code, out)
}
