//! A run's own corner of the machine: a folder in memory, a prefix, and locks that tell who lives.
//!
//! Every process of a run holds a shared lock on the folder's `run.lock`; the launcher also holds
//! `launcher.lock` exclusively. Whoever gets `run.lock` exclusively may wipe: the last process to
//! leave, or the next run that finds a dead one. Whoever gets `launcher.lock` leads, see
//! [`leader`](crate::leader).

pub use crate::namespace_error::NamespaceError;

use crate::leader::{LeadError, LeaderLock};
use crate::namespace_error::failed;
use rustix::fs::{FlockOperation, flock};
use std::fs::{self, DirBuilder, File, OpenOptions};
use std::io;
use std::os::unix::fs::{DirBuilderExt, MetadataExt as _, OpenOptionsExt};
use std::path::{Path, PathBuf};

/// Where run folders live: memory, so that nothing survives a reboot.
pub const BASE: &str = "/dev/shm";
const FOLDER_PREFIX: &str = "mq-";
const UNBORN_PREFIX: &str = ".mq-";
const OBJECT_PREFIX: &str = "mqshm-";

/// Membership of a run. Dropping it leaves; the last to leave wipes.
#[derive(Debug)]
pub struct Membership {
    folder: PathBuf,
    run_lock: File,
    leader_lock: Option<LeaderLock>,
}

impl Membership {
    /// Founds a run: creates its folder, readable by the owner alone, and joins as the launcher.
    ///
    /// The folder appears under its final name only when it is already locked, so that no sweep
    /// can take it for dead.
    ///
    /// # Errors
    /// The folder cannot be created or locked.
    pub fn found(id: &str) -> Result<Self, LeadError> {
        let base = Path::new(BASE);
        let unborn = base.join(format!("{UNBORN_PREFIX}{id}"));
        let folder = base.join(format!("{FOLDER_PREFIX}{id}"));
        DirBuilder::new().mode(0o700).create(&unborn).map_err(failed("create", &unborn))?;
        let run_lock = lock_file(&unborn.join("run.lock"), FlockOperation::LockShared)?;
        let mut leader_lock = LeaderLock::take(&unborn)?;
        leader_lock.announce(&unborn)?;
        let ipc = unborn.join("ipc");
        DirBuilder::new().mode(0o700).create(&ipc).map_err(failed("create", &ipc))?;
        let config = unborn.join("iceoryx2.toml");
        fs::write(&config, ipc_config(id, &folder)).map_err(failed("write", &config))?;
        fs::rename(&unborn, &folder).map_err(failed("rename", &unborn))?;
        Ok(Self { folder, run_lock, leader_lock: Some(leader_lock) })
    }

    /// Joins a run whose launcher has died, as its next launcher. Its processes hear of it with
    /// [`announce_lead`](Self::announce_lead).
    ///
    /// # Errors
    /// Somebody leads it, there is no such run, or it is being wiped.
    pub fn take_over(folder: &Path) -> Result<Self, LeadError> {
        let mut joined = Self::join(folder)?;
        joined.leader_lock = Some(LeaderLock::take(folder)?);
        Ok(joined)
    }

    /// Lets the run's processes know that this one leads them now.
    ///
    /// # Errors
    /// The folder cannot be written.
    pub fn announce_lead(&mut self) -> Result<(), NamespaceError> {
        let folder = &self.folder;
        self.leader_lock.as_mut().map_or(Ok(()), |lock| lock.announce(folder))
    }

    /// Joins a run that exists.
    ///
    /// # Errors
    /// There is no such run, or it is being wiped.
    pub fn join(folder: &Path) -> Result<Self, NamespaceError> {
        let run_lock = lock_file(&folder.join("run.lock"), FlockOperation::NonBlockingLockShared)?;
        Ok(Self { folder: folder.to_path_buf(), run_lock, leader_lock: None })
    }

    /// The run's folder.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The run's name.
    #[must_use]
    pub fn name(&self) -> String {
        run_id(&self.folder)
    }

    /// The transport's configuration of this run.
    #[must_use]
    pub fn ipc_config(&self) -> PathBuf {
        self.folder.join("iceoryx2.toml")
    }
}

impl Drop for Membership {
    fn drop(&mut self) {
        // Converting the lock is not atomic, but two last ones both try and one of them wins.
        if flock(&self.run_lock, FlockOperation::NonBlockingLockExclusive).is_ok() {
            wipe(&self.folder);
        }
    }
}

/// A run that nobody is in any more.
struct Dead {
    folder: PathBuf,
    /// Keeps others from taking it for dead too while it is wiped.
    _lock: Option<File>,
}

impl Dead {
    /// The run of a folder, if it is dead.
    fn of(folder: PathBuf) -> Option<Self> {
        let name = folder.file_name()?.to_str()?;
        let unborn = name.starts_with(UNBORN_PREFIX);
        if !folder.is_dir() || !(unborn || name.starts_with(FOLDER_PREFIX)) {
            return None;
        }
        // A folder about to be born has no lock for an instant; a minute makes it a dead one.
        if unborn && !older_than_a_minute(&folder) {
            return None;
        }
        let lock = OpenOptions::new().read(true).write(true).open(folder.join("run.lock"));
        let (dead, lock) = match lock {
            Ok(file) => {
                (flock(&file, FlockOperation::NonBlockingLockExclusive).is_ok(), Some(file))
            }
            Err(error) => {
                (error.kind() == io::ErrorKind::NotFound && older_than_a_minute(&folder), None)
            }
        };
        dead.then_some(Self { folder, _lock: lock })
    }

    fn all() -> impl Iterator<Item = Self> {
        let entries = fs::read_dir(BASE).into_iter().flatten().flatten();
        entries.filter_map(|entry| Self::of(entry.path()))
    }
}

/// Removes what dead runs left behind and returns their folders.
#[must_use]
pub fn sweep_dead_runs() -> Vec<PathBuf> {
    let swept = Dead::all().map(|dead| {
        wipe(&dead.folder);
        dead.folder
    });
    swept.collect()
}

/// Folders of dead runs, without touching them.
#[must_use]
pub fn dead_runs() -> Vec<PathBuf> {
    Dead::all().map(|dead| dead.folder).collect()
}

/// Shared-memory objects of runs that have no folder any more. Whoever founds a run makes the folder
/// first, whoever wipes one removes it last; what is older than a minute is nobody's.
#[must_use]
pub fn orphans() -> Vec<PathBuf> {
    let entries = fs::read_dir(BASE).into_iter().flatten().flatten();
    let orphans = entries.filter(|entry| {
        let name = entry.file_name();
        let id = name.to_str().and_then(|name| name.strip_prefix(OBJECT_PREFIX));
        let id = id.and_then(|rest| rest.split_once('_')).map(|(id, _)| id);
        let has_folder = |id: &str| {
            [FOLDER_PREFIX, UNBORN_PREFIX]
                .iter()
                .any(|prefix| Path::new(BASE).join(format!("{prefix}{id}")).is_dir())
        };
        id.is_some_and(|id| !has_folder(id)) && older_than_a_minute(&entry.path())
    });
    orphans.map(|entry| entry.path()).collect()
}

/// Name and folder of every run of this user that somebody is in.
#[must_use]
pub fn runs_in_the_air() -> Vec<(String, PathBuf)> {
    let own = rustix::process::geteuid().as_raw();
    let dead = dead_runs();
    let entries = fs::read_dir(BASE).into_iter().flatten().flatten();
    let living = entries.filter_map(|entry| {
        let id = entry.file_name().to_str()?.strip_prefix(FOLDER_PREFIX)?.to_owned();
        let is_own = entry.metadata().is_ok_and(|m| m.is_dir() && m.uid() == own);
        (is_own && !dead.contains(&entry.path())).then(|| (id, entry.path()))
    });
    living.collect()
}

/// As [`runs_in_the_air`], after a sweep of the dead ones.
#[must_use]
pub fn living_runs() -> Vec<(String, PathBuf)> {
    let _ = sweep_dead_runs();
    runs_in_the_air()
}

fn older_than_a_minute(path: &Path) -> bool {
    fs::metadata(path)
        .and_then(|m| m.modified())
        .is_ok_and(|t| t.elapsed().is_ok_and(|age| age.as_secs() > 60))
}

/// Removes shared-memory objects that a process killed while creating them left empty: the
/// transport would wait for them forever. An object that somebody is creating right now gets its
/// size within microseconds.
pub fn remove_unborn_objects(folder: &Path) {
    let prefix = ipc_prefix(&run_id(folder));
    let empty = || {
        fs::read_dir(BASE).into_iter().flatten().flatten().filter(|entry| {
            entry.file_name().to_string_lossy().starts_with(&prefix)
                && entry.metadata().is_ok_and(|m| m.len() == 0)
        })
    };
    let suspects: Vec<_> = empty().map(|entry| entry.path()).collect();
    if suspects.is_empty() {
        return;
    }
    crate::clock::sleep_until(crate::clock::mono_now_ns() + 20_000_000);
    for entry in empty().filter(|entry| suspects.contains(&entry.path())) {
        let _ = fs::remove_file(entry.path());
    }
}

fn run_id(folder: &Path) -> String {
    let name = folder.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    name.trim_start_matches('.').trim_start_matches(FOLDER_PREFIX).to_owned()
}

/// Removes a run's shared-memory objects, then its folder (lock file last, with the folder).
fn wipe(folder: &Path) {
    let prefix = ipc_prefix(&run_id(folder));
    if let Ok(entries) = fs::read_dir(BASE) {
        for entry in entries.flatten() {
            if entry.file_name().to_string_lossy().starts_with(&prefix) {
                // Best effort: another user's file stays, and is not of this run.
                let _ = fs::remove_file(entry.path());
            }
        }
    }
    let _ = fs::remove_dir_all(folder);
}

fn ipc_prefix(id: &str) -> String {
    format!("{OBJECT_PREFIX}{id}_")
}

fn lock_file(path: &Path, operation: FlockOperation) -> Result<File, NamespaceError> {
    let file = OpenOptions::new()
        .read(true)
        .write(true)
        .create(!matches!(operation, FlockOperation::NonBlockingLockShared))
        .truncate(false)
        .mode(0o600)
        .open(path)
        .map_err(failed("open", path))?;
    flock(&file, operation).map_err(|e| failed("lock", path)(e.into()))?;
    Ok(file)
}

/// Transport settings: sweeping dead peers is the launcher's business alone. A reader keeps room
/// for as many departed writers as a service has seats for them: each look at an empty port walks
/// over that room, which the transport sizes for 128.
fn ipc_config(id: &str, folder: &Path) -> String {
    format!(
        "[global]\nprefix = \"{}\"\nroot-path = \"{}/ipc\"\n\n\
         [global.service]\ncleanup-dead-nodes-on-open = false\n\n\
         [global.node]\ncleanup-dead-nodes-on-creation = false\n\
         cleanup-dead-nodes-on-destruction = false\n\n\
         [defaults.publish-subscribe]\nsubscriber-expired-connection-buffer = 8\n",
        ipc_prefix(id),
        folder.display()
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    fn id(name: &str) -> String {
        format!("test-{name}-{}", std::process::id())
    }

    #[test]
    fn the_last_to_leave_wipes_and_not_the_first() {
        let launcher = Membership::found(&id("leave")).unwrap();
        let folder = launcher.folder().to_path_buf();
        let child = Membership::join(&folder).unwrap();
        drop(launcher);
        assert!(folder.exists());
        drop(child);
        assert!(!folder.exists());
    }

    #[test]
    fn a_living_run_is_never_swept_and_a_dead_one_is() {
        let living = Membership::found(&id("living")).unwrap();
        let dead = Membership::found(&id("dead")).unwrap();
        let dead_folder = dead.folder().to_path_buf();
        let stray = Path::new(BASE).join(format!("{}stray", ipc_prefix(&id("dead"))));
        fs::write(&stray, "left behind").unwrap();
        // Closing the files without leaving is what SIGKILL does.
        let Membership { run_lock, .. } = &dead;
        flock(run_lock, FlockOperation::Unlock).unwrap();
        let swept = sweep_dead_runs();
        assert!(swept.contains(&dead_folder) || !dead_folder.exists());
        assert!(!stray.exists());
        assert!(living.folder().exists());
        let listed: Vec<_> = living_runs().into_iter().map(|(_, folder)| folder).collect();
        assert!(listed.contains(&living.folder().to_path_buf()) && !listed.contains(&dead_folder));
    }

    #[test]
    fn looking_for_the_dead_removes_nothing_and_finds_objects_without_a_run() {
        let dead = Membership::found(&id("look")).unwrap();
        flock(&dead.run_lock, FlockOperation::Unlock).unwrap();
        let object = |id: &str| Path::new(BASE).join(format!("{}left", ipc_prefix(id)));
        let [of_run, orphan, young] = [id("look"), id("orphan"), id("young")].map(|id| object(&id));
        let long_ago = std::time::UNIX_EPOCH;
        for (path, old) in [(&of_run, true), (&orphan, true), (&young, false)] {
            let file = File::create(path).unwrap();
            if old {
                file.set_modified(long_ago).unwrap();
            }
        }
        let (found, left) = (dead_runs(), orphans());
        assert!(found.contains(&dead.folder().to_path_buf()) || !dead.folder().exists());
        assert!(left.contains(&orphan) && !left.contains(&young));
        assert!(!left.contains(&of_run) || !dead.folder().exists());
        assert!(!runs_in_the_air().iter().any(|(_, folder)| folder == dead.folder()));
        for path in [&of_run, &orphan, &young] {
            let _ = fs::remove_file(path);
        }
    }

    /// The transport waits for ever for an object whose maker died before giving it a size.
    #[test]
    fn an_object_that_stays_empty_is_removed_and_a_filled_one_and_another_runs_stay() {
        let run = Membership::found(&id("unborn")).unwrap();
        let other = id("unborn-other");
        let object = |id: &str, name| Path::new(BASE).join(format!("{}{name}", ipc_prefix(id)));
        let [empty, filled] = ["empty", "filled"].map(|name| object(&id("unborn"), name));
        let foreign = object(&other, "empty");
        fs::write(&empty, "").unwrap();
        fs::write(&filled, "segment").unwrap();
        fs::write(&foreign, "").unwrap();
        remove_unborn_objects(run.folder());
        let left = [&empty, &filled, &foreign].map(|path| path.exists());
        fs::remove_file(&foreign).unwrap();
        assert_eq!(left, [false, true, true]);
    }

    #[test]
    fn nobody_else_may_look_into_a_run() {
        let run = Membership::found(&id("private")).unwrap();
        let mode = fs::metadata(run.folder()).unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o700);
    }
}
