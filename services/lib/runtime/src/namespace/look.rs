//! Which runs live, which are dead, and what the dead have left.

use super::names::{
    BASE, FOLDER_PREFIX, is_being_founded, open_own_folder, run_of_folder, run_of_object,
};
use crate::clock::{mono_now_ns, sleep_until};
use rustix::fs::{FlockOperation, flock};
use std::fs::{self, File, OpenOptions};
use std::io;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};

/// How long another process of this user may look at a run, or wipe it, before it is passed over \[ns\].
const TURN_NS: u64 = 1_000_000_000;

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
        let is_founding = is_being_founded(name);
        if !is_founding && run_of_folder(name).is_none() {
            return Self::Other;
        }
        let Ok(opened) = open_own_folder(folder) else { return Self::Other };
        // While a run is being founded its folder has no lock for an instant; after a minute its founder is dead.
        if is_founding && !older_than_a_minute(folder) {
            return Self::Other;
        }
        let alive = if is_founding { Self::Other } else { Self::Alive };
        let Some(turn) = Held::within_a_turn(opened) else { return alive };
        let lock = OpenOptions::new().read(true).write(true).open(folder.join("run.lock"));
        match lock.map(Held::now) {
            Ok(Some(lock)) => Self::Dead { _lock: Some(lock), _turn: turn },
            Ok(None) => alive,
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

pub(super) fn sweep(base: &Path) -> Vec<PathBuf> {
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

pub(super) fn dead(base: &Path) -> Vec<PathBuf> {
    let dead = folders(base).filter(|(_, found)| matches!(found, Found::Dead { .. }));
    dead.map(|(folder, _)| folder).collect()
}

/// Shared-memory objects of this user's runs that have no folder any more. The process that founds a run makes the
/// folder first, the one that wipes it removes it last; what is older than a minute belongs to no run.
#[must_use]
pub fn orphans() -> Vec<PathBuf> {
    orphans_in(Path::new(BASE))
}

pub(super) fn orphans_in(base: &Path) -> Vec<PathBuf> {
    let own = rustix::process::geteuid().as_raw();
    let entries = fs::read_dir(base).into_iter().flatten().flatten();
    let orphans = entries.filter(|entry| {
        let name = entry.file_name();
        let id = name.to_str().and_then(run_of_object);
        // What cannot be looked at may be one.
        let has_folder =
            |id: &str| match fs::symlink_metadata(base.join(format!("{FOLDER_PREFIX}{id}"))) {
                Ok(found) => found.is_dir() && found.uid() == own,
                Err(error) => error.kind() != io::ErrorKind::NotFound,
            };
        id.is_some_and(|id| !has_folder(id))
            && entry.metadata().is_ok_and(|found| found.uid() == own)
            && older_than_a_minute(&entry.path())
    });
    orphans.map(|entry| entry.path()).collect()
}

/// Name and folder of every run of this user that has members.
#[must_use]
pub fn active_runs() -> Vec<(String, PathBuf)> {
    alive(Path::new(BASE))
}

pub(super) fn alive(base: &Path) -> Vec<(String, PathBuf)> {
    let alive = folders(base).filter(|(_, found)| matches!(found, Found::Alive));
    let named = alive.filter_map(|(folder, _)| {
        let id = run_of_folder(folder.file_name()?.to_str()?)?.to_owned();
        Some((id, folder))
    });
    named.collect()
}

/// As [`active_runs`], after a sweep of the dead ones.
#[must_use]
pub fn living_runs() -> Vec<(String, PathBuf)> {
    let _ = sweep_dead_runs();
    active_runs()
}

fn older_than_a_minute(path: &Path) -> bool {
    fs::symlink_metadata(path)
        .and_then(|m| m.modified())
        .is_ok_and(|t| t.elapsed().is_ok_and(|age| age.as_secs() > 60))
}

/// Removes shared-memory objects that a process killed while creating them left empty: the
/// transport would wait for them forever. An object that a process is creating right now gets its
/// size within microseconds. What another user has put among them goes too, as far as this one may remove it: the
/// transport would wait for it, or use it.
pub fn remove_incomplete_objects(folder: &Path) {
    let own = rustix::process::geteuid().as_raw();
    let is_foreign = |entry: &fs::DirEntry| entry.metadata().is_ok_and(|found| found.uid() != own);
    for entry in objects_of(folder).filter(is_foreign) {
        let _ = fs::remove_file(entry.path());
    }
    let empty = || {
        objects_of(folder).filter(|entry| {
            entry.metadata().is_ok_and(|found| found.len() == 0 && found.uid() == own)
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

/// The run's shared-memory objects, beside its folder.
pub(super) fn objects_of(folder: &Path) -> impl Iterator<Item = fs::DirEntry> + use<> {
    let name = folder.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    let id = run_of_folder(name).map(str::to_owned);
    let base = folder.parent().unwrap_or_else(|| Path::new(BASE));
    let entries = fs::read_dir(base).into_iter().flatten().flatten();
    entries.filter(move |entry| {
        id.is_some() && entry.file_name().to_str().and_then(run_of_object) == id.as_deref()
    })
}

/// Removes a run's shared-memory objects, then its folder (lock file last, with the folder). A run that was not yet
/// founded has no objects.
pub(super) fn wipe(folder: &Path) {
    for entry in objects_of(folder) {
        // What another user has put there cannot be removed, and stays.
        let _ = fs::remove_file(entry.path());
    }
    let _ = fs::remove_dir_all(folder);
}
