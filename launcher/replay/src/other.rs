//! Another build replays: a process of its own, and a folder for what it writes that is gone afterwards.

use super::ReplayError;
use super::component_topics::Topics;
use super::tapes::{Tapes, load};
use record::read::RecordedFlight;
use runtime::clock::{mono_now_ns, sleep_until};
use runtime::watch::StopFlags;
use rustix::io::Errno;
use rustix::process::{Pid, test_kill_process};
use shared_types::Role;
use std::fs::{self, File, Permissions};
use std::io;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use tempfile::TempDir;

/// Start of the folder's name, followed by the owner's process id and a suffix that cannot be guessed.
const PREFIX: &str = "morphquad-replay-";
/// Between two looks at whether the other build has ended \[ns\].
const LOOK_EVERY_NS: u64 = 20_000_000;
/// What to do about an executable that is no build of this program.
const REMEDY: &str = "give --with the path of a morphquad executable";

/// Has another build replay `service`, which fills `role`, and reads what came out. A signal ends it.
pub(super) fn outputs_of(
    executable: &Path,
    flight: &RecordedFlight,
    role: Role,
    service: &str,
    topics: &Topics,
) -> Result<Tapes, ReplayError> {
    let name = executable.display().to_string();
    let complain = |reason: String| ReplayError::Other { executable: name.clone(), reason };
    let system = |error: io::Error| complain(format!("{error}; {REMEDY}"));
    let stop = StopFlags::watch_signals().map_err(system)?;
    let scratch = scratch_below(&std::env::temp_dir()).map_err(system)?;
    let (out, stderr_path) = (scratch.path().join("outputs.mcap"), scratch.path().join("said"));
    let child = Command::new(executable)
        .arg("replay")
        .arg(flight.path())
        .args(["--service", service, "--outputs"])
        .arg(&out)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(File::create(&stderr_path).map_err(system)?)
        .spawn()
        .map_err(system)?;
    let status = wait(child, &stop).map_err(system)?.ok_or(ReplayError::Interrupted)?;
    if !status.success() {
        let stderr =
            String::from_utf8_lossy(&fs::read(&stderr_path).unwrap_or_default()).trim().to_owned();
        let stderr = if stderr.is_empty() { "it printed nothing".to_owned() } else { stderr };
        return Err(complain(format!("{stderr} ({status}); {REMEDY}")));
    }
    if !out.is_file() {
        return Err(complain(format!("it wrote no outputs; {REMEDY}")));
    }
    let tapes = load(&RecordedFlight::open(&out)?, role, topics)?.tapes;
    if stop.signalled() { Err(ReplayError::Interrupted) } else { Ok(tapes) }
}

/// Waits for a child; kills it, and gives nothing, once a signal asks this process to stop.
fn wait(mut child: Child, stop: &StopFlags) -> io::Result<Option<ExitStatus>> {
    loop {
        if stop.signalled() {
            child.kill()?;
            child.wait()?;
            return Ok(None);
        }
        if let Some(status) = child.try_wait()? {
            return Ok(Some(status));
        }
        sleep_until(mono_now_ns() + LOOK_EVERY_NS);
    }
}

/// A folder of this process and user below `base`, gone when dropped. Those of processes that have died are wiped.
fn scratch_below(base: &Path) -> io::Result<TempDir> {
    for entry in fs::read_dir(base)?.flatten() {
        let gone = |pid: Pid| test_kill_process(pid) == Err(Errno::SRCH);
        if entry.file_name().to_str().and_then(owner).is_some_and(gone) {
            // Another user's stays, and does no harm.
            let _ = fs::remove_dir_all(entry.path());
        }
    }
    tempfile::Builder::new()
        .prefix(&format!("{PREFIX}{}-", std::process::id()))
        .permissions(Permissions::from_mode(0o700))
        .tempdir_in(base)
}

/// The process that a folder with this name belongs to; none if it is no such folder.
fn owner(folder: &str) -> Option<Pid> {
    let (pid, _) = folder.strip_prefix(PREFIX)?.split_once('-')?;
    Pid::from_raw(pid.parse().ok()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_goes_with_its_owner_and_those_of_the_dead_go_with_the_next() {
        let base = tempfile::tempdir().unwrap();
        let mut dead = Command::new("true").spawn().unwrap();
        dead.wait().unwrap();
        let of = |pid: u32| base.path().join(format!("{PREFIX}{pid}-x"));
        let alive = std::os::unix::process::parent_id();
        let (dead, alive, other) =
            (of(dead.id()), of(alive), base.path().join("morphquad-replay-x"));
        for folder in [&dead, &alive, &other] {
            fs::create_dir(folder).unwrap();
        }
        let scratch = scratch_below(base.path()).unwrap();
        assert!(!dead.exists() && alive.exists() && other.exists());
        let own = scratch.path().to_owned();
        assert_eq!(own.metadata().unwrap().permissions().mode() & 0o777, 0o700);
        drop(scratch);
        assert!(!own.exists());
    }
}
