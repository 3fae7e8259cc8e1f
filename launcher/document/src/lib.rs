//! The text of a scenario: merged from a file and the flags of a command, with a place for every value.
//!
//! A [`Problem`] names key, place and remedy. What keys there are and what they mean is the business of `scenario`.

mod document;
mod problem;
mod recording_magic;
mod shell;
mod suggest;
mod trajectory_file;

pub use document::{COMMAND_LINE, Document, Edit, Renamed, Texts, Value};
pub use problem::{Complaint, Place, Problem, ScenarioError};
pub use recording_magic::is_recording;
pub use shell::{shell_path, shell_word};
pub use suggest::remedy as suggestion;
pub use trajectory_file::Table;
