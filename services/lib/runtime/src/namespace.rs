//! A run's own corner of the machine: a folder in memory, a prefix, and locks that tell who lives.
//!
//! Every process of a run holds a shared lock on the folder's `run.lock`; the launcher also holds
//! `launcher.lock` exclusively. The process that gets `run.lock` exclusively may wipe: the last one to
//! leave, or the next run that finds a dead one. Whether a run is dead can only be found out by trying for
//! that lock, so those who look take turns, by a lock on the folder itself: two at once would each take
//! the other for a member.
//! The process that gets `launcher.lock` leads, see [`leader`](crate::leader).

pub use crate::namespace_error::NamespaceError;

use crate::clock::{mono_now_ns, sleep_until};
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
/// How long another process may look at a run, or wipe it, before it is passed over \[ns\].
const TURN_NS: u64 = 1_000_000_000;

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
        Self::found_in(Path::new(BASE), id)
    }

    fn found_in(base: &Path, id: &str) -> Result<Self, LeadError> {
        let unborn = base.join(format!("{UNBORN_PREFIX}{id}"));
        let folder = base.join(format!("{FOLDER_PREFIX}{id}"));
        DirBuilder::new().mode(0o700).create(&unborn).map_err(failed("create", &unborn))?;
        let run_lock = join_lock(OpenOptions::new().create(true), &unborn)?;
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
        let run_lock = join_lock(&mut OpenOptions::new(), folder)?;
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

/// What a folder among those of the runs is.
enum Found {
    /// A run that has members, or that another process has looked at for so long that nothing else is known.
    Alive,
    /// A run without members, which no other process can join, look at or wipe as long as this is kept. The lock
    /// is given back before the turn.
    Dead { _lock: Option<Held>, _turn: Held },
    /// Something else, or a run that is being founded.
    Other,
}

impl Found {
    fn in_folder(folder: &Path) -> Self {
        let name = folder.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        let unborn = name.starts_with(UNBORN_PREFIX);
        // A folder about to be born has no lock for an instant; a minute makes it a dead one.
        if !folder.is_dir()
            || !(unborn || name.starts_with(FOLDER_PREFIX))
            || (unborn && !older_than_a_minute(folder))
        {
            return Self::Other;
        }
        let turn = match File::open(folder).map(Held::within_a_turn) {
            Ok(Some(turn)) => turn,
            Ok(None) => return Self::Alive,
            Err(_) => return Self::Other,
        };
        match OpenOptions::new().read(true).write(true).open(folder.join("run.lock")).map(Held::now)
        {
            Ok(Some(lock)) => Self::Dead { _lock: Some(lock), _turn: turn },
            Ok(None) => Self::Alive,
            Err(error)
                if error.kind() == io::ErrorKind::NotFound && older_than_a_minute(folder) =>
            {
                Self::Dead { _lock: None, _turn: turn }
            }
            Err(_) => Self::Other,
        }
    }
}

/// An exclusive lock that is given back when this is dropped, also if a process that is being started has the file
/// open as well.
struct Held(File);

impl Held {
    /// None if another process holds the lock.
    fn now(file: File) -> Option<Self> {
        flock(&file, FlockOperation::NonBlockingLockExclusive).is_ok().then_some(Self(file))
    }

    /// None if another process holds the lock for too long.
    fn within_a_turn(file: File) -> Option<Self> {
        let give_up_ns = mono_now_ns() + TURN_NS;
        while flock(&file, FlockOperation::NonBlockingLockExclusive).is_err() {
            if mono_now_ns() > give_up_ns {
                return None;
            }
            sleep_until(mono_now_ns() + 100_000);
        }
        Some(Self(file))
    }
}

impl Drop for Held {
    fn drop(&mut self) {
        // The kernel does it too, with the last descriptor.
        let _ = flock(&self.0, FlockOperation::Unlock);
    }
}

fn folders(base: &Path) -> impl Iterator<Item = (PathBuf, Found)> + use<> {
    let entries = fs::read_dir(base).into_iter().flatten().flatten().map(|entry| entry.path());
    entries.map(|folder| {
        let found = Found::in_folder(&folder);
        (folder, found)
    })
}

/// Removes what dead runs left behind and returns their folders.
#[must_use]
pub fn sweep_dead_runs() -> Vec<PathBuf> {
    sweep(Path::new(BASE))
}

fn sweep(base: &Path) -> Vec<PathBuf> {
    let swept = folders(base).filter_map(|(folder, found)| {
        matches!(found, Found::Dead { .. }).then(|| {
            wipe(&folder);
            folder
        })
    });
    swept.collect()
}

/// Folders of dead runs, without touching them.
#[must_use]
pub fn dead_runs() -> Vec<PathBuf> {
    dead(Path::new(BASE))
}

fn dead(base: &Path) -> Vec<PathBuf> {
    let dead = folders(base).filter(|(_, found)| matches!(found, Found::Dead { .. }));
    dead.map(|(folder, _)| folder).collect()
}

/// Shared-memory objects of runs that have no folder any more. The process that founds a run makes the
/// folder first, the one that wipes it removes it last; what is older than a minute belongs to no run.
#[must_use]
pub fn orphans() -> Vec<PathBuf> {
    orphans_in(Path::new(BASE))
}

fn orphans_in(base: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(base).into_iter().flatten().flatten();
    let orphans = entries.filter(|entry| {
        let name = entry.file_name();
        let id = name.to_str().and_then(|name| name.strip_prefix(OBJECT_PREFIX));
        let id = id.and_then(|rest| rest.split_once('_')).map(|(id, _)| id);
        let has_folder = |id: &str| {
            [FOLDER_PREFIX, UNBORN_PREFIX]
                .iter()
                .any(|prefix| base.join(format!("{prefix}{id}")).is_dir())
        };
        id.is_some_and(|id| !has_folder(id)) && older_than_a_minute(&entry.path())
    });
    orphans.map(|entry| entry.path()).collect()
}

/// Name and folder of every run of this user that has members.
#[must_use]
pub fn runs_in_the_air() -> Vec<(String, PathBuf)> {
    alive(Path::new(BASE))
}

fn alive(base: &Path) -> Vec<(String, PathBuf)> {
    let own = rustix::process::geteuid().as_raw();
    let alive = folders(base).filter_map(|(folder, found)| {
        let id = folder.file_name()?.to_str()?.strip_prefix(FOLDER_PREFIX)?.to_owned();
        let is_own = fs::metadata(&folder).is_ok_and(|m| m.uid() == own);
        (is_own && matches!(found, Found::Alive)).then_some((id, folder))
    });
    alive.collect()
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
        fs::read_dir(base_of(folder)).into_iter().flatten().flatten().filter(|entry| {
            entry.file_name().to_string_lossy().starts_with(&prefix)
                && entry.metadata().is_ok_and(|m| m.len() == 0)
        })
    };
    let suspects: Vec<_> = empty().map(|entry| entry.path()).collect();
    if suspects.is_empty() {
        return;
    }
    sleep_until(mono_now_ns() + 20_000_000);
    for entry in empty().filter(|entry| suspects.contains(&entry.path())) {
        let _ = fs::remove_file(entry.path());
    }
}

/// Where the run's shared-memory objects are, beside its folder.
fn base_of(folder: &Path) -> &Path {
    folder.parent().unwrap_or_else(|| Path::new(BASE))
}

fn run_id(folder: &Path) -> String {
    let name = folder.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    name.trim_start_matches('.').trim_start_matches(FOLDER_PREFIX).to_owned()
}

/// Removes a run's shared-memory objects, then its folder (lock file last, with the folder).
fn wipe(folder: &Path) {
    let prefix = ipc_prefix(&run_id(folder));
    if let Ok(entries) = fs::read_dir(base_of(folder)) {
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

/// Opens the lock of a run and holds it as a member.
fn join_lock(options: &mut OpenOptions, folder: &Path) -> Result<File, NamespaceError> {
    let path = folder.join("run.lock");
    let file =
        options.read(true).write(true).mode(0o600).open(&path).map_err(failed("open", &path))?;
    flock(&file, FlockOperation::NonBlockingLockShared)
        .map_err(|e| failed("lock", &path)(e.into()))?;
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

    /// A place of its own for the runs of a test: no other test sweeps it.
    fn base() -> tempfile::TempDir {
        tempfile::tempdir_in(BASE).unwrap()
    }

    fn object(base: &Path, id: &str, name: &str) -> PathBuf {
        base.join(format!("{}{name}", ipc_prefix(id)))
    }

    #[test]
    fn the_last_to_leave_wipes_and_not_the_first() {
        let base = base();
        let launcher = Membership::found_in(base.path(), "leave").unwrap();
        let folder = launcher.folder().to_path_buf();
        let child = Membership::join(&folder).unwrap();
        drop(launcher);
        assert!(folder.exists());
        drop(child);
        assert!(!folder.exists());
    }

    #[test]
    fn a_living_run_is_never_swept_and_a_dead_one_is() {
        let base = base();
        let living = Membership::found_in(base.path(), "living").unwrap();
        let killed = Membership::found_in(base.path(), "killed").unwrap();
        let left = object(base.path(), "killed", "left");
        fs::write(&left, "left behind").unwrap();
        // Closing the files without leaving is what SIGKILL does.
        flock(&killed.run_lock, FlockOperation::Unlock).unwrap();
        assert_eq!(sweep(base.path()), [killed.folder()]);
        assert!(!left.exists() && !killed.folder().exists());
        assert_eq!(alive(base.path()), [("living".to_owned(), living.folder().to_path_buf())]);
    }

    #[test]
    fn looking_for_the_dead_removes_nothing_and_finds_objects_without_a_run() {
        let base = base();
        let killed = Membership::found_in(base.path(), "killed").unwrap();
        flock(&killed.run_lock, FlockOperation::Unlock).unwrap();
        let [of_run, orphan, young] =
            ["killed", "orphan", "young"].map(|id| object(base.path(), id, "left"));
        let long_ago = std::time::UNIX_EPOCH;
        for (path, old) in [(&of_run, true), (&orphan, true), (&young, false)] {
            let file = File::create(path).unwrap();
            if old {
                file.set_modified(long_ago).unwrap();
            }
        }
        assert_eq!(dead(base.path()), [killed.folder()]);
        assert_eq!(orphans_in(base.path()), [orphan.as_path()]);
        assert_eq!(alive(base.path()), []);
        assert!([&of_run, &orphan, &young].iter().all(|path| path.exists()));
        assert!(killed.folder().exists());
    }

    #[test]
    fn two_looks_at_a_dead_run_do_not_take_each_other_for_members() {
        let base = base();
        let killed = Membership::found_in(base.path(), "killed").unwrap();
        flock(&killed.run_lock, FlockOperation::Unlock).unwrap();
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    for _ in 0..200 {
                        assert_eq!(dead(base.path()), [killed.folder()]);
                        assert_eq!(alive(base.path()), []);
                    }
                });
            }
        });
        // Of several sweeps one wipes it.
        let sweeps = std::thread::scope(|scope| {
            let sweeps: Vec<_> = (0..4).map(|_| scope.spawn(|| sweep(base.path()).len())).collect();
            sweeps.into_iter().map(|swept| swept.join().unwrap()).sum::<usize>()
        });
        assert_eq!((sweeps, killed.folder().exists()), (1, false));
    }

    /// The transport waits for ever for an object whose maker died before giving it a size.
    #[test]
    fn an_object_that_stays_empty_is_removed_and_a_filled_one_and_another_runs_stay() {
        let base = base();
        let run = Membership::found_in(base.path(), "unborn").unwrap();
        let [empty, filled] = ["empty", "filled"].map(|name| object(base.path(), "unborn", name));
        let foreign = object(base.path(), "unborn-other", "empty");
        fs::write(&empty, "").unwrap();
        fs::write(&filled, "segment").unwrap();
        fs::write(&foreign, "").unwrap();
        remove_unborn_objects(run.folder());
        assert_eq!([&empty, &filled, &foreign].map(|path| path.exists()), [false, true, true]);
    }

    #[test]
    fn nobody_else_may_look_into_a_run() {
        let base = base();
        let run = Membership::found_in(base.path(), "private").unwrap();
        let mode = fs::metadata(run.folder()).unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o700);
    }
}
