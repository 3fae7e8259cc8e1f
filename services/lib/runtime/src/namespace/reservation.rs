//! Memory of a run's objects that is its own before anything is written to it.
//!
//! The transport gives its objects their size, but a page of them is taken from the machine only when a process writes to
//! it. A program that fills `/dev/shm` before that, as any user may, ends the process by SIGBUS. Where memory is locked all
//! pages are taken at once; this does it where it may not be locked.

use super::look::objects_of;
use rustix::fs::{FallocateFlags, OFlags, fallocate};
use rustix::io::retry_on_intr;
use std::collections::BTreeSet;
use std::fs::OpenOptions;
use std::io;
use std::os::unix::fs::{DirEntryExt as _, MetadataExt as _, OpenOptionsExt as _};
use std::path::{Path, PathBuf};

/// Which objects of a run have their memory.
#[derive(Debug)]
pub struct Reservation {
    folder: PathBuf,
    reserved: BTreeSet<u64>,
}

impl Reservation {
    /// None of those of the run in `folder`.
    #[must_use]
    pub fn new(folder: &Path) -> Self {
        Self { folder: folder.to_path_buf(), reserved: BTreeSet::new() }
    }

    /// Memory that the run's objects have taken, reserved or touched \[MB\].
    #[must_use]
    pub fn taken_mb(&self) -> u64 {
        let own = rustix::process::geteuid().as_raw();
        let objects = objects_of(&self.folder).filter_map(|entry| entry.metadata().ok());
        let taken = objects.filter(|found| found.uid() == own).map(|found| found.blocks());
        // In units of 512 bytes, whatever the file system has.
        taken.sum::<u64>() >> 11
    }

    /// Takes the memory of all objects that the run has by now.
    ///
    /// # Errors
    /// There is not so much; objects that have been reserved keep what they have.
    pub fn extend(&mut self) -> io::Result<()> {
        let own = rustix::process::geteuid().as_raw();
        let flags = OFlags::NOFOLLOW | OFlags::NONBLOCK;
        let mut options = OpenOptions::new();
        options.read(true).write(true).custom_flags(flags.bits().cast_signed());
        for entry in objects_of(&self.folder) {
            if self.reserved.contains(&entry.ino()) {
                continue;
            }
            // Its process may have removed it meanwhile, and another user may have made one of this name.
            let Ok(object) = options.open(entry.path()) else { continue };
            let Ok(found) = object.metadata() else { continue };
            // One that is just being made has no size yet.
            if found.is_file() && found.uid() == own && found.len() > 0 {
                retry_on_intr(|| fallocate(&object, FallocateFlags::empty(), 0, found.len()))?;
                self.reserved.insert(found.ino());
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::names::object_prefix;
    use super::*;
    use std::fs::File;

    #[test]
    fn objects_that_a_run_has_made_so_far_have_their_memory() {
        let base = tempfile::tempdir_in(super::super::BASE).unwrap();
        let object = |run: &str, name: &str| {
            let path = base.path().join(format!("{}{name}", object_prefix(run)));
            let file = File::create(&path).unwrap();
            file.set_len(1 << 20).unwrap();
            path
        };
        let blocks = |path: &Path| std::fs::metadata(path).unwrap().blocks();
        let mut reservation = Reservation::new(&base.path().join("mq-ours"));
        let (first, foreign) = (object("ours", "first"), object("other", "first"));
        reservation.extend().unwrap();
        assert_eq!([&first, &foreign].map(|path| blocks(path)), [2048, 0]);
        assert_eq!(reservation.taken_mb(), 1);
        let second = object("ours", "second");
        assert_eq!(blocks(&second), 0);
        reservation.extend().unwrap();
        assert_eq!(blocks(&second), 2048);
    }
}
