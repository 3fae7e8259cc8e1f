//! The text of a scenario.

use super::shipped;
use document::{Problem, ScenarioError, is_recording, shell_word, suggestion};
use std::fs::File;
use std::io::{self, Read};
use std::net::SocketAddr;
use std::os::unix::fs::FileTypeExt as _;
use std::path::Path;

/// Longest text of a scenario \[bytes\].
pub(super) const MAX_BYTES: u64 = 4 << 20;

/// Reads the text at a path.
///
/// # Errors
/// What is there instead, and what may have been meant.
pub(super) fn read(path: &str) -> Result<String, ScenarioError> {
    let is_named_so = Path::new(path).extension().is_some_and(|kind| kind == "mcap");
    let is_recording = is_recording(Path::new(path));
    if is_named_so || is_recording {
        let what = if is_recording { "is a recording" } else { "is named like a recording" };
        let what = format!("{what}, and what flies is a scenario");
        let remedy = format!(
            "`morphquad view {path}` shows one, `report {path}` judges it, `replay {path} --verify` flies it again",
            path = shell_word(path)
        );
        return Err(Problem::new(path, what, remedy, None).into());
    }
    text_of(path).map_err(|error| {
        let is_name = !path.contains('/') && Path::new(path).extension().is_none();
        if path.parse::<u16>().is_ok() || path.parse::<SocketAddr>().is_ok() {
            let remedy = format!("an address belongs to its flag: --live={path}");
            return ScenarioError::from(Problem::new(path, "is not a scenario", remedy, None));
        }
        if is_name && error.kind() == std::io::ErrorKind::NotFound {
            let remedy = suggestion(path, shipped::names());
            return Problem::new(path, "no scenario has this name", remedy, None).into();
        }
        let remedy = format!(
            "give the path of a scenario file, or one of the shipped names {}",
            shipped::names().collect::<Vec<_>>().join(", ")
        );
        Problem::new(path, format!("cannot be read: {error}"), remedy, None).into()
    })
}

/// The text of a file or a pipe. A device may have no end, and a file may have any length.
pub(super) fn text_of(path: &str) -> io::Result<String> {
    let kind = std::fs::metadata(path)?.file_type();
    if kind.is_char_device() || kind.is_block_device() {
        return Err(io::Error::other("it is a device, and not a text"));
    }
    read_all(File::open(path)?)
}

/// The text of a scenario from wherever it comes, up to the largest size that one has.
///
/// # Errors
/// It cannot be read, is no text, or is too long.
pub(super) fn read_all(from: impl Read) -> io::Result<String> {
    let mut text = String::new();
    let length = from.take(MAX_BYTES + 1).read_to_string(&mut text)?;
    if length as u64 > MAX_BYTES {
        let reason = format!("it is longer than {} MB", MAX_BYTES >> 20);
        return Err(io::Error::other(reason));
    }
    Ok(text)
}

/// True without any value, however many sections there are.
pub(super) fn has_no_value(table: &toml::Table) -> bool {
    table.values().all(|value| value.as_table().is_some_and(has_no_value))
}
