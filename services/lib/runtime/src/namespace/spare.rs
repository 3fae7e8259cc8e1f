//! A second link to each file of a run's services, so that one that is removed can be put back.
//!
//! Any program of the same user can remove a service by force. Processes that have opened it keep it, but none could open
//! it any more, so that whatever died from then on would stay dead. All files of a run lie in memory, where a link costs
//! no copy, and what is linked goes on being the file that the processes have open.

use super::look::objects_of;
use std::fs::{self, DirBuilder};
use std::io;
use std::os::unix::fs::{DirBuilderExt as _, MetadataExt as _};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// Below the run's folder.
const SPARE: &str = "spare";
/// Of the transport's objects in shared memory the one that belongs to a service, and not to a process: who is connected.
const OF_SERVICE: &str = "dynamic";

/// Links to the files of the services that a run has.
#[derive(Debug)]
pub struct SpareLinks {
    /// The folder of the transport that says which services there are.
    services: PathBuf,
    /// When that folder was changed last, as far as it is known.
    changed: Option<SystemTime>,
    files: Vec<SpareLink>,
}

#[derive(Debug)]
struct SpareLink {
    file: PathBuf,
    link: PathBuf,
}

impl SpareLink {
    /// True if the file that processes look for is the one that this links to.
    fn is_in_place(&self) -> bool {
        let inode = |path: &Path| fs::symlink_metadata(path).map(|found| found.ino()).ok();
        inode(&self.file).is_some_and(|found| inode(&self.link) == Some(found))
    }

    fn put_back(&self) -> io::Result<()> {
        match fs::remove_file(&self.file) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
            _ => fs::hard_link(&self.link, &self.file),
        }
    }
}

impl SpareLinks {
    /// Links all files of the services of the run in `folder`, instead of those that were linked before.
    ///
    /// # Errors
    /// A folder cannot be read or written.
    pub fn make(folder: &Path) -> io::Result<Self> {
        let (spare, services) = (folder.join(SPARE), folder.join("ipc").join("services"));
        match fs::remove_dir_all(&spare) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
            _ => DirBuilder::new().mode(0o700).create(&spare)?,
        }
        let listed = fs::read_dir(&services)?.collect::<io::Result<Vec<_>>>()?;
        let objects = objects_of(folder)
            .filter(|entry| Path::new(&entry.file_name()).extension() == Some(OF_SERVICE.as_ref()));
        let files = listed.into_iter().chain(objects).map(|entry| {
            let (file, link) = (entry.path(), spare.join(entry.file_name()));
            fs::hard_link(&file, &link).map(|()| SpareLink { file, link })
        });
        let files = files.collect::<io::Result<_>>()?;
        let changed = changed(&services);
        Ok(Self { services, changed, files })
    }

    /// True if a service may have been made or removed since the links were made, or put back. One look at a folder:
    /// a file in shared memory that was removed alone is not seen.
    #[must_use]
    pub fn may_be_needed(&self) -> bool {
        changed(&self.services) != self.changed
    }

    /// True if every file is in its place.
    #[must_use]
    pub fn are_all_in_place(&self) -> bool {
        self.files.iter().all(SpareLink::is_in_place)
    }

    /// Puts back what is not in its place any more, also if another program has made a file of that name.
    ///
    /// # Errors
    /// One cannot be put back; the others are.
    pub fn put_back(&mut self) -> io::Result<()> {
        let mut done = Ok(());
        for file in self.files.iter().filter(|file| !file.is_in_place()) {
            done = done.and(file.put_back());
        }
        self.changed = changed(&self.services);
        done
    }
}

fn changed(folder: &Path) -> Option<SystemTime> {
    fs::metadata(folder).and_then(|found| found.modified()).ok()
}

#[cfg(test)]
mod tests {
    use super::super::names::object_prefix;
    use super::*;

    /// A run with one service in a place of its own, and the paths of its two files.
    fn run() -> (tempfile::TempDir, PathBuf, [PathBuf; 2]) {
        let base = tempfile::tempdir_in(super::super::BASE).unwrap();
        let folder = base.path().join("mq-spare");
        let services = folder.join("ipc").join("services");
        fs::create_dir_all(&services).unwrap();
        let object = |name: &str| base.path().join(format!("{}{name}", object_prefix("spare")));
        let files = [services.join("a.service"), object("a.dynamic")];
        for file in files.iter().chain([&object("of-a-process.data")]) {
            fs::write(file, "first").unwrap();
        }
        (base, folder, files)
    }

    #[test]
    fn a_file_that_is_removed_or_made_anew_is_put_back_as_the_one_it_was() {
        let (_base, folder, files) = run();
        let mut spare = SpareLinks::make(&folder).unwrap();
        assert!(spare.are_all_in_place() && !spare.may_be_needed());
        let inodes = || files.each_ref().map(|file| fs::metadata(file).unwrap().ino());
        let before = inodes();
        fs::remove_file(&files[0]).unwrap();
        fs::remove_file(&files[1]).unwrap();
        fs::write(&files[1], "of another service").unwrap();
        assert!(!spare.are_all_in_place());
        spare.put_back().unwrap();
        assert!(spare.are_all_in_place() && !spare.may_be_needed());
        assert_eq!(inodes(), before);
        assert_eq!(fs::read(&files[1]).unwrap(), b"first");
    }

    #[test]
    fn links_are_made_anew_for_the_services_that_are_there() {
        let (_base, folder, files) = run();
        drop(SpareLinks::make(&folder).unwrap());
        fs::remove_file(&files[0]).unwrap();
        let mut spare = SpareLinks::make(&folder).unwrap();
        spare.put_back().unwrap();
        assert!(!files[0].exists() && files[1].exists());
        let kept = fs::read_dir(folder.join(SPARE)).unwrap().count();
        assert_eq!(kept, 1, "objects of processes are no service's");
    }

    #[test]
    fn what_cannot_be_put_back_keeps_nothing_else_from_being_put_back() {
        let (_base, folder, files) = run();
        let mut spare = SpareLinks::make(&folder).unwrap();
        for file in &files {
            fs::remove_file(file).unwrap();
        }
        fs::create_dir(&files[0]).unwrap();
        spare.put_back().unwrap_err();
        assert!(files[1].exists() && !spare.are_all_in_place());
    }
}
