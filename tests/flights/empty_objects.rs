//! Objects in shared memory that a killed process has made and left empty: the transport waits for them without an end.

use crate::common::processes::{Running, is_dead, left_in_shared_memory, ps};
use crate::common::time::wait_until;
use rustix::process::Signal;
use std::collections::BTreeSet;
use std::fs::OpenOptions;
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};

/// One more connection to each reader there is, from a writer that there is not, as it is before it has its size.
fn empty_connections(run: &str) -> BTreeSet<PathBuf> {
    let of_reader = |path: &Path| {
        let name = path.file_name()?.to_str()?;
        let (writer, reader) = name.strip_suffix(".connection")?.rsplit_once('_')?;
        let (others, _) = writer.rsplit_once('_')?;
        Some(path.with_file_name(format!("{others}_1_{reader}.connection")))
    };
    left_in_shared_memory(run).iter().filter_map(|path| of_reader(path)).collect()
}

fn make_empty(path: &Path) -> bool {
    OpenOptions::new().write(true).create_new(true).mode(0o200).open(path).is_ok()
}

/// A process that is killed as it makes an object can leave it empty after the launcher has removed such, and before it
/// has freed what another dead one has left.
#[test]
fn an_object_that_was_left_empty_does_not_stop_the_launcher_for_good() {
    let slowly = ["hover", "--clock", "realtime", "--speed", "0.1", "--for", "60s"];
    let mut running = Running::start_and_fly(&slowly);
    let run = running.id().to_owned();
    let paths = empty_connections(&run);
    assert!(paths.len() > 10, "{paths:?}");
    let dead = running.signal("attitude-mpc", Signal::KILL);
    wait_until("it is dead", || is_dead(dead));
    // Until each was removed and is there again, without a pause in which the launcher could go on.
    let mut times = vec![0; paths.len()];
    let mut are_again = || {
        for (times, path) in times.iter_mut().zip(&paths) {
            *times += usize::from(make_empty(path));
        }
        times.iter().all(|times| *times > 1)
    };
    assert!((0..1_000_000).any(|_| are_again()), "the launcher removes them for the first death");
    wait_until("another one commands", || {
        let status = ps(&run);
        let processes = status.as_ref().and_then(|status| status["processes"].as_array());
        let mut owners = processes.into_iter().flatten().filter(|p| p["state"] == "owner");
        owners.any(|p| p["name"] == "attitude-mpc" && p["pid"] != dead)
    });
    running.interrupt_until_it_ends();
    wait_until("nothing is left", || left_in_shared_memory(&run).is_empty());
}
