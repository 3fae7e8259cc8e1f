//! `morphquad types`.

use super::options::TypesArguments;
use super::refusal::{Done, Failure};
use host::exit;
use protocol::samples;
use std::io::Write;

/// Writes the samples as another language declares them.
pub(super) fn run(arguments: &TypesArguments, out: &mut dyn Write) -> Done {
    let text = samples::python();
    match &arguments.out {
        None => out.write_all(text.as_bytes())?,
        Some(path) => std::fs::write(path, text).map_err(|error| {
            let path = path.display();
            let what = format!("cannot write {path}: {error}; give --out another file");
            Failure::plain(&what, exit::UNFIT)
        })?,
    }
    Ok(exit::PASS)
}
