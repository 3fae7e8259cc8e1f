//! What distinguishes a recording from any other file.

use std::fs::File;
use std::io::Read as _;
use std::path::Path;

/// True for a file that begins as every recording does, whole or not; nothing is taken out of a pipe.
#[must_use]
pub fn is_recording(path: &Path) -> bool {
    let mut begin = [0; mcap::MAGIC.len()];
    let is_file = path.metadata().is_ok_and(|found| found.is_file());
    is_file
        && File::open(path).and_then(|mut file| file.read_exact(&mut begin)).is_ok()
        && begin == mcap::MAGIC
}
