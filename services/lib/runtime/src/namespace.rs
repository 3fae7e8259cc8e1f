//! A run's own corner of the machine: a folder in memory, a prefix, and locks that show which processes live.
//!
//! Every process of a run holds a shared lock on the folder's `run.lock`; the launcher also holds
//! `launcher.lock` exclusively. The process that gets `run.lock` exclusively may wipe: the last one to
//! leave, or the next run that finds a dead one. Whether a run is dead can only be found out by trying for
//! that lock, so processes that look take turns, by a lock on the folder itself: two at once would each take
//! the other for a member.
//! The process that gets `launcher.lock` leads, see [`leader`](crate::leader).

mod look;
mod names;
mod reservation;
mod segment;
mod spare;

pub use crate::namespace_error::NamespaceError;
pub use look::{
    active_runs, dead_runs, living_runs, orphans, remove_incomplete_objects, sweep_dead_runs,
};
pub use names::BASE;
pub use reservation::Reservation;
pub use spare::SpareLinks;

use crate::leader::{LeadError, LeaderLock};
use crate::namespace_error::failed;
use names::{
    FOLDER_PREFIX, FOUNDING_PREFIX, object_prefix, open_own_folder, random_digits, run_of_folder,
};
use rustix::fs::{FlockOperation, flock};
use std::fs::{self, DirBuilder, File, OpenOptions};
use std::os::unix::fs::{DirBuilderExt as _, OpenOptionsExt as _};
use std::path::{Path, PathBuf};

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
        let secret = random_digits().map_err(failed("name a folder in", base))?;
        let founding = base.join(format!("{FOUNDING_PREFIX}{secret}"));
        DirBuilder::new().mode(0o700).create(&founding).map_err(failed("create", &founding))?;
        let founded = Self::fill_and_rename(id, &founding, base);
        if founded.is_err() {
            let _ = fs::remove_dir_all(&founding);
        }
        founded
    }

    fn fill_and_rename(id: &str, founding: &Path, base: &Path) -> Result<Self, LeadError> {
        let folder = base.join(format!("{FOLDER_PREFIX}{id}"));
        let run_lock = join_lock(OpenOptions::new().create(true), founding)?;
        let mut leader_lock = LeaderLock::take(founding)?;
        leader_lock.announce(founding)?;
        let ipc = founding.join("ipc");
        DirBuilder::new().mode(0o700).create(&ipc).map_err(failed("create", &ipc))?;
        let config = founding.join("iceoryx2.toml");
        // The names of the objects cannot be guessed, so that no other user makes one of them first.
        let secret = random_digits().map_err(failed("name the objects of", founding))?;
        let prefix = format!("{}{secret}_", object_prefix(id));
        fs::write(&config, ipc_config(&prefix, &folder)).map_err(failed("write", &config))?;
        segment::make_private(base, &prefix)
            .map_err(failed("make a segment for", founding))
            .and_then(|()| fs::rename(founding, &folder).map_err(failed("rename", founding)))
            .inspect_err(|_| segment::remove(base, &prefix))?;
        Ok(Self { folder, run_lock, leader_lock: Some(leader_lock) })
    }

    /// Joins a run whose launcher has died, as its next launcher. Its processes learn of it with
    /// [`announce_lead`](Self::announce_lead).
    ///
    /// # Errors
    /// Another process leads it, there is no such run, it is another user's, or it is being wiped.
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
    /// There is no such run, it is another user's, or it is being wiped.
    pub fn join(folder: &Path) -> Result<Self, NamespaceError> {
        open_own_folder(folder).map_err(failed("join", folder))?;
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
        let name = self.folder.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        run_of_folder(name).unwrap_or(name).to_owned()
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
            look::wipe(&self.folder);
        }
    }
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
fn ipc_config(prefix: &str, folder: &Path) -> String {
    format!(
        "[global]\nprefix = \"{prefix}\"\nroot-path = \"{}/ipc\"\n\n\
         [global.service]\ncleanup-dead-nodes-on-open = false\n\n\
         [global.node]\ncleanup-dead-nodes-on-creation = false\n\
         cleanup-dead-nodes-on-destruction = false\n\n\
         [defaults.publish-subscribe]\nsubscriber-expired-connection-buffer = 8\n",
        folder.display()
    )
}

#[cfg(test)]
mod tests {
    use super::look::{alive, dead, orphans_in, sweep};
    use super::*;
    use std::os::unix::fs::{PermissionsExt as _, chown, symlink};
    use std::time::UNIX_EPOCH;

    /// A place of its own for the runs of a test: no other test sweeps it.
    fn base() -> tempfile::TempDir {
        tempfile::tempdir_in(BASE).unwrap()
    }

    fn object(base: &Path, id: &str, name: &str) -> PathBuf {
        base.join(format!("{}{name}", object_prefix(id)))
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
        let long_ago = UNIX_EPOCH;
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
        let run = Membership::found_in(base.path(), "incomplete").unwrap();
        let [empty, filled] =
            ["empty", "filled"].map(|name| object(base.path(), "incomplete", name));
        let foreign = object(base.path(), "incomplete-other", "empty");
        fs::write(&empty, "").unwrap();
        fs::write(&filled, "segment").unwrap();
        fs::write(&foreign, "").unwrap();
        remove_incomplete_objects(run.folder());
        assert_eq!([&empty, &filled, &foreign].map(|path| path.exists()), [false, true, true]);
    }

    #[test]
    fn no_other_user_may_look_into_a_run() {
        let base = base();
        let run = Membership::found_in(base.path(), "private").unwrap();
        let mode = fs::metadata(run.folder()).unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o700);
    }

    /// A folder of an earlier minute, as a run leaves it that died before it had a lock.
    fn old_folder(path: &Path) {
        DirBuilder::new().mode(0o700).create(path).unwrap();
        File::open(path).unwrap().set_modified(UNIX_EPOCH).unwrap();
    }

    #[test]
    fn a_folder_named_after_a_living_run_takes_nothing_of_it_along() {
        let base = base();
        let living = Membership::found_in(base.path(), "living").unwrap();
        let segment = object(base.path(), "living", "segment");
        fs::write(&segment, "samples").unwrap();
        for name in ["mq-mq-living", ".mq-mq-living", "..mq-living", "mq-living_", ".mq-living"] {
            old_folder(&base.path().join(name));
        }
        // Only one of these names can be one of ours: of a run that died while it was founded.
        assert_eq!(sweep(base.path()), [base.path().join(".mq-living")]);
        assert!(segment.exists() && living.folder().exists());
    }

    #[test]
    fn what_is_open_to_others_or_a_link_is_no_run() {
        let base = base();
        let away = base.path().join("away");
        old_folder(&away);
        symlink(&away, base.path().join("mq-link")).unwrap();
        let open = base.path().join("mq-open");
        old_folder(&open);
        fs::set_permissions(&open, fs::Permissions::from_mode(0o755)).unwrap();
        File::create(base.path().join("mq-file")).unwrap();
        assert_eq!(sweep(base.path()), [] as [PathBuf; 0]);
        assert!(away.exists() && open.exists());
    }

    /// Where the tests run as root, they can act as another user.
    #[test]
    fn folders_locks_and_objects_of_another_user_are_neither_waited_for_nor_removed() {
        const OTHER: u32 = 65534;
        if !rustix::process::geteuid().is_root() {
            return;
        }
        let base = base();
        let foreign = base.path().join("mq-foreign");
        old_folder(&foreign);
        let lock = File::open(&foreign).unwrap();
        flock(&lock, FlockOperation::LockExclusive).unwrap();
        let left = object(base.path(), "gone", "left");
        File::create(&left).unwrap().set_modified(UNIX_EPOCH).unwrap();
        for path in [&foreign, &left] {
            chown(path, Some(OTHER), None).unwrap();
        }
        // What it had waited for in vain would count as alive.
        assert_eq!((dead(base.path()), alive(base.path())), (vec![], vec![]));
        assert_eq!(sweep(base.path()), [] as [PathBuf; 0]);
        assert_eq!(orphans_in(base.path()), [] as [PathBuf; 0]);
        assert!(foreign.exists() && left.exists());
    }

    #[test]
    fn the_names_of_a_runs_objects_cannot_be_guessed() {
        let base = base();
        let configs = ["one", "two"].map(|id| {
            let run = Membership::found_in(base.path(), id).unwrap();
            let text = fs::read_to_string(run.ipc_config()).unwrap();
            let prefix = text.lines().find_map(|line| line.strip_prefix("prefix = ")).unwrap();
            prefix.trim_matches('"').strip_prefix(&object_prefix(id)).unwrap().to_owned()
        });
        assert!(configs.iter().all(|secret| secret.len() == 17), "{configs:?}");
        assert_ne!(configs[0], configs[1]);
    }
}
