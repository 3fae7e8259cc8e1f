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
/// Of the transport's objects in shared memory the one that belongs to a service, and not to a
/// process: it lists the connections.
const OF_SERVICE: &str = "dynamic";

/// Links to the files of the services that a run has.
#[derive(Debug)]
pub struct SpareLinks {
    folder: PathBuf,
    /// The folder of the transport that lists the services.
    services: PathBuf,
    /// When that folder was changed last, as far as it is known.
    changed: Option<SystemTime>,
    files: Vec<SpareLink>,
}

#[derive(Debug)]
struct SpareLink {
    file: PathBuf,
    link: PathBuf,
    inode: u64,
}

impl SpareLink {
    /// True if the file that processes look for is the one that they have open.
    fn is_in_place(&self) -> bool {
        inode_of(&self.file) == Some(self.inode)
    }

    fn has_link(&self) -> bool {
        inode_of(&self.link) == Some(self.inode)
    }

    fn put_back(&self) -> io::Result<()> {
        if !self.has_link() {
            return Err(io::Error::new(io::ErrorKind::NotFound, "their second links are gone too"));
        }
        // In one step: there is no instant without a file of this name.
        let next = self.link.with_extension("next");
        fs::hard_link(&self.link, &next)?;
        fs::rename(&next, &self.file).inspect_err(|_| drop(fs::remove_file(&next)))
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
            _ => make_folder(&spare)?,
        }
        // A process that opens a service looks for it in the list first, which is therefore put back last.
        let objects = objects_of(folder)
            .filter(|entry| Path::new(&entry.file_name()).extension() == Some(OF_SERVICE.as_ref()));
        let listed = fs::read_dir(&services)?.collect::<io::Result<Vec<_>>>()?;
        let own = rustix::process::geteuid().as_raw();
        let mut files = Vec::new();
        for entry in objects.chain(listed) {
            // Another user may have made an object of a run's name.
            let Ok(found) = entry.metadata() else { continue };
            if found.is_file() && found.uid() == own {
                let (file, link) = (entry.path(), spare.join(entry.file_name()));
                fs::hard_link(&file, &link)?;
                files.push(SpareLink { file, link, inode: found.ino() });
            }
        }
        let changed = changed(&services);
        Ok(Self { folder: spare, services, changed, files })
    }

    /// True if every file is in its place, as far as that is seen: without `all_files`, at one look at the list of
    /// services, in which an object in shared memory that was removed alone is missed.
    #[must_use]
    pub fn are_in_place(&mut self, all_files: bool) -> bool {
        let changed = changed(&self.services);
        if !all_files && changed == self.changed {
            return true;
        }
        self.changed = changed;
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

    /// Makes links anew that were removed, as long as their files are in place.
    ///
    /// # Errors
    /// One cannot be made.
    pub fn renew(&self) -> io::Result<()> {
        let mut done = Ok(());
        for file in self.files.iter().filter(|file| file.is_in_place() && !file.has_link()) {
            match make_folder(&self.folder) {
                Err(error) if error.kind() != io::ErrorKind::AlreadyExists => return Err(error),
                _ => done = done.and(fs::hard_link(&file.file, &file.link)),
            }
        }
        done
    }
}

fn make_folder(folder: &Path) -> io::Result<()> {
    DirBuilder::new().mode(0o700).create(folder)
}

fn inode_of(path: &Path) -> Option<u64> {
    fs::symlink_metadata(path).map(|found| found.ino()).ok()
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
        assert!(spare.are_in_place(true) && spare.are_in_place(false));
        let inodes = || files.each_ref().map(|file| fs::metadata(file).unwrap().ino());
        let before = inodes();
        fs::remove_file(&files[0]).unwrap();
        fs::remove_file(&files[1]).unwrap();
        fs::write(&files[1], "of another service").unwrap();
        assert!(!spare.are_in_place(false));
        spare.put_back().unwrap();
        assert!(spare.are_in_place(true) && spare.are_in_place(false));
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
        assert!(files[1].exists() && !spare.are_in_place(true));
    }

    #[test]
    fn a_service_whose_link_is_removed_loses_no_file_and_gets_another_link() {
        let (_base, folder, files) = run();
        let mut spare = SpareLinks::make(&folder).unwrap();
        fs::remove_dir_all(folder.join(SPARE)).unwrap();
        assert!(spare.are_in_place(true));
        spare.put_back().unwrap();
        assert!(files.iter().all(|file| file.exists()));
        spare.renew().unwrap();
        fs::remove_file(&files[0]).unwrap();
        spare.put_back().unwrap();
        assert!(files.iter().all(|file| file.exists()) && spare.are_in_place(true));
        fs::remove_dir_all(folder.join(SPARE)).unwrap();
        fs::remove_file(&files[1]).unwrap();
        spare.put_back().unwrap_err();
    }

    #[test]
    fn a_service_of_another_program_does_not_make_every_look_a_long_one() {
        let (_base, folder, _files) = run();
        let mut spare = SpareLinks::make(&folder).unwrap();
        fs::write(folder.join("ipc").join("services").join("b.service"), "foreign").unwrap();
        assert!(spare.are_in_place(false));
        assert_eq!(changed(&spare.services), spare.changed);
    }

    /// Where the tests run as root, they can act as another user.
    #[test]
    fn an_object_of_another_user_is_not_linked() {
        if !rustix::process::geteuid().is_root() {
            return;
        }
        let (base, folder, files) = run();
        let foreign = base.path().join(format!("{}foreign.dynamic", object_prefix("spare")));
        fs::write(&foreign, "").unwrap();
        std::os::unix::fs::chown(&foreign, Some(65534), None).unwrap();
        let spare = SpareLinks::make(&folder).unwrap();
        assert_eq!(spare.files.len(), files.len());
    }
}
