//! Shared memory, what dead runs have left there, and the disk that records.

use super::Finding;
use runtime::clock::mono_now_ns;
use runtime::namespace::{BASE, active_runs, dead_runs, orphans, sweep_dead_runs};
use rustix::fs::{fdatasync, statvfs};
use scenario::needs;
use std::fs::{self, File};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::mpsc;
use std::thread::Builder;
use std::time::Duration;

/// Room for an hour or so of recording \[MB\].
const RECORDING_MB: u64 = 2048;
/// What leaves a flight room \[MB/s\].
const ENOUGH_RATE: f64 = 20.0;
/// Size of the trial \[MB\], and how long it may take: what takes longer does not keep up with a flight.
const TRIAL_MB: usize = 2;
const TRIAL_LIMIT: Duration = Duration::from_millis(1200);

/// What to do about a disk.
const ELSEWHERE: &str = "record elsewhere with --record, or not with --no-record";

pub(super) fn shared_memory() -> Vec<Finding> {
    vec![size(), free(), writable(), leftovers(), living()]
}

fn size() -> Finding {
    let Ok(stat) = statvfs(BASE) else {
        return Finding::fail(
            "shm size",
            format!("{BASE} is not there"),
            format!("mount a tmpfs on {BASE}"),
        );
    };
    let mb = stat.f_blocks.saturating_mul(stat.f_frsize) >> 20;
    let remedy =
        format!("`mount -o remount,size=512m {BASE}`, or `--shm-size 512m` of the container");
    if mb < needs::SHARED_MEMORY_MB {
        return Finding::fail("shm size", format!("{mb} MB"), remedy);
    }
    Finding::warn_if(mb < needs::LOCKED_MEMORY_MB, "shm size", format!("{mb} MB"), remedy)
}

fn free() -> Finding {
    let mb = needs::free_shared_memory_mb().unwrap_or(0);
    let (lockstep_mb, realtime_mb) = (needs::SHARED_MEMORY_MB, needs::LOCKED_MEMORY_MB);
    let found = format!(
        "{mb} MB free; a flight may need {lockstep_mb} MB, and in realtime with its memory locked or reserved {realtime_mb} MB"
    );
    if mb < needs::SHARED_MEMORY_MB {
        return Finding::fail(
            "shm free",
            found,
            format!("remove what fills {BASE}; --fix removes dead runs"),
        );
    }
    let remedy =
        format!("remove what fills {BASE}, or fly with `--set realtime.lock_memory=false`");
    Finding::warn_if(mb < realtime_mb, "shm free", found, remedy)
}

fn writable() -> Finding {
    // It is removed at once.
    match tempfile::Builder::new().prefix(".mq-doctor-").tempdir_in(BASE) {
        Ok(_) => Finding::ok("shm access", "runs can be founded"),
        Err(error) => {
            Finding::fail("shm access", format!("{BASE}: {error}"), format!("`chmod 1777 {BASE}`"))
        }
    }
}

fn leftovers() -> Finding {
    let (runs, objects) = (dead_runs().len(), orphans().len());
    let found = match (runs, objects) {
        (0, 0) => "none".to_owned(),
        _ => format!("{runs} dead runs and {objects} objects without a run"),
    };
    Finding::warn_if(
        runs + objects > 0,
        "leftovers",
        found,
        "`morphquad doctor --fix` removes them",
    )
}

fn living() -> Finding {
    let count = active_runs().len();
    let found = format!("{count} active");
    Finding::warn_if(
        count > 0,
        "other runs",
        found,
        "`morphquad ps` shows them; they share the processors",
    )
}

pub(super) fn fix() -> Vec<String> {
    let orphans = orphans();
    let mut done: Vec<_> = sweep_dead_runs()
        .into_iter()
        .map(|folder| format!("removed the dead run {} and its objects", folder.display()))
        .collect();
    let removed = orphans.iter().filter(|path| fs::remove_file(path).is_ok()).count();
    if removed > 0 {
        done.push(format!("removed {removed} objects without a run from {BASE}"));
    }
    done
}

/// The folder of the recordings, or the first one above that is there.
fn existing(folder: &Path) -> PathBuf {
    let absolute = std::path::absolute(folder).unwrap_or_else(|_| folder.to_path_buf());
    let existing = absolute.ancestors().find(|path| path.is_dir());
    existing.map_or_else(|| PathBuf::from("/"), Path::to_path_buf)
}

pub(super) fn disk(recordings: &Path) -> Vec<Finding> {
    let folder = existing(recordings);
    let place = folder.display().to_string();
    let free_mb =
        statvfs(&folder).map_or(0, |stat| stat.f_bavail.saturating_mul(stat.f_frsize) >> 20);
    let other = ELSEWHERE;
    let room = format!("{free_mb} MB free in {place}");
    let room = if free_mb < 64 {
        Finding::fail("disk room", room, other)
    } else {
        Finding::warn_if(free_mb < RECORDING_MB, "disk room", room, other)
    };
    vec![room, rate(&folder, &place, TRIAL_LIMIT)]
}

fn rate(folder: &Path, place: &str, limit: Duration) -> Finding {
    let (name, other) = ("disk rate", ELSEWHERE);
    let path = folder.join(format!(".morphquad-doctor-{}", std::process::id()));
    let (sender, receiver) = mpsc::channel();
    let trial = path.clone();
    // A disk that hangs must not hang its examination.
    let begun = Builder::new().spawn(move || {
        let written = write(&trial);
        // Before the result is sent: the process that examines may be gone a moment later, and this thread with it.
        let _ = fs::remove_file(&trial);
        let _ = sender.send(written);
    });
    if let Err(error) = begun {
        return Finding::fail(name, format!("not tried: no thread can be started: {error}"), other);
    }
    match receiver.recv_timeout(limit) {
        Ok(Ok(rate)) => {
            let found = format!("{rate:.0} MB/s in {place}; a flight writes 1 to 2 MB/s");
            Finding::warn_if(rate < ENOUGH_RATE, name, found, other)
        }
        Ok(Err(error)) => Finding::fail(name, format!("{place}: {error}"), other),
        Err(_) => {
            let _ = fs::remove_file(&path);
            let found = format!("{TRIAL_MB} MB took more than {limit:.1?} in {place}");
            Finding::fail(name, found, other)
        }
    }
}

/// Rate at which a file reaches the disk \[MB/s\].
fn write(path: &Path) -> std::io::Result<f64> {
    let block = vec![0x5a_u8; 1 << 20];
    let mut file = File::create_new(path)?;
    let start_ns = mono_now_ns();
    for _ in 0..TRIAL_MB {
        file.write_all(&block)?;
    }
    fdatasync(&file)?;
    let took_s = (mono_now_ns() - start_ns).max(1) as f64 * 1e-9;
    Ok(TRIAL_MB as f64 / took_s)
}

#[cfg(test)]
mod tests {
    use super::super::Verdict;
    use super::*;

    #[test]
    fn a_folder_that_is_not_there_yet_is_judged_by_the_one_above_and_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        let findings = disk(&folder.path().join("recordings/of/today"));
        assert!(findings.iter().all(|finding| finding.found.contains("MB")), "{findings:?}");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn a_folder_that_cannot_be_written_fails() {
        // Also for the superuser: no user can make files in there.
        let finding = rate(Path::new("/proc/self"), "/proc/self", TRIAL_LIMIT);
        assert_eq!(finding.verdict, Verdict::Fail);
    }

    #[test]
    fn a_disk_that_does_not_take_the_trial_in_time_fails() {
        let folder = tempfile::tempdir().unwrap();
        let finding = rate(folder.path(), "the disk", Duration::ZERO);
        assert_eq!(finding.verdict, Verdict::Fail, "{finding:?}");
    }
}
