//! `morphquad new-controller`.

mod template;

use super::conclude;
use super::options::NewControllerArguments;
use super::refusal::Done;
use host::exit;
use std::io::Write;
use template::{NewController, NewControllerError};

/// Writes a crate and prints how to fly it.
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
