//! Pages and pictures are written where the user wants them, but never over a flight.

use super::refusal::Failure;
use document::is_recording;
use host::exit;
use std::fs;
use std::path::Path;

/// Writes a page; `flag` is what the user has named the file with.
pub(super) fn write_page(path: &Path, page: impl AsRef<[u8]>, flag: &str) -> Result<(), Failure> {
    if is_recording(path) {
        let reason = format!(
            "{} is a recording, which must not be replaced: give {flag} another name",
            path.display()
        );
        return Err(Failure::plain(&reason, exit::USAGE));
    }
    fs::write(path, page).map_err(|error| {
        let path = path.display();
        let reason = format!("cannot write {path}: {error}; give {flag} a file that you may write");
        Failure::plain(&reason, exit::UNFIT)
    })
}
