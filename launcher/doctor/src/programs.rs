//! What is installed: this executable, others that its flights may start, and what reads recordings.

use super::Finding;
use core::time::Duration;
use host::{LAYOUT_ARGUMENT, layout_hash};
use scenario::candidate::installed;
use std::io::Read as _;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::mpsc;
use std::thread::{self, Builder};

/// How long an executable may take to identify itself.
const LIMIT: Duration = Duration::from_millis(500);
/// Most that is read of what it prints.
const PRINTED_MAX: u64 = 4096;

pub(super) fn checks() -> Vec<Finding> {
    thread::scope(|scope| {
        let beside = Builder::new().spawn_scoped(scope, python);
        let mut findings = vec![version(), controllers(), other_builds()];
        findings.push(beside.ok().and_then(|it| it.join().ok()).unwrap_or_else(python));
        findings
    })
}

fn version() -> Finding {
    let (version, git) = (env!("CARGO_PKG_VERSION"), record::build::declared().git);
    Finding::ok("version", format!("morphquad {version} ({git}), layout {:016x}", layout_hash()))
}

/// Executables that flights may start by name: they must lay samples out as this one does.
fn controllers() -> Finding {
    let name = "controllers";
    let found = installed(|name| name.starts_with("morphquad-"));
    let with = |layout: fn(Option<u64>) -> bool| {
        let of_layout = found.iter().filter(|path| layout(layout_of(path)));
        of_layout.map(|path| path.display().to_string()).collect::<Vec<_>>().join(", ")
    };
    let others = with(|layout| layout.is_some_and(|layout| layout != layout_hash()));
    if !others.is_empty() {
        let problem = format!("{others} cannot join flights of this build");
        return Finding::fail(
            name,
            problem,
            "build them again from the same source, or remove them",
        );
    }
    let silent = with(|layout| layout.is_none());
    if !silent.is_empty() {
        let remedy = "nothing, if they are controllers in another language";
        return Finding::warn(name, format!("{silent} do not report their layout"), remedy);
    }
    Finding::ok(
        name,
        format!("{} beside this executable and on PATH, all of its layout", found.len()),
    )
}

fn other_builds() -> Finding {
    let own = std::env::current_exe().unwrap_or_default();
    let others = installed(|name| name == "morphquad");
    let others =
        others.iter().filter(|path| **path != own && layout_of(path) != Some(layout_hash()));
    let others: Vec<_> = others.map(|path| path.display().to_string()).collect();
    let found = if others.is_empty() { "none on PATH".to_owned() } else { others.join(", ") };
    let remedy = "runs, `ps` and recordings of different builds refuse each other: install one; it may also be this build that did not answer within half a second";
    Finding::warn_if(!others.is_empty(), "other builds", found, remedy)
}

/// For readers of recordings and for controllers in Python.
fn python() -> Finding {
    let name = "python";
    let remedy = "install Python 3.11 or later; only scripts that read recordings and Python controllers need it";
    let output = output_of(Path::new("python3"), "--version").unwrap_or_default();
    let Some(version) = output.trim().strip_prefix("Python ") else {
        return Finding::warn(name, "no python3 on PATH that answers within half a second", remedy);
    };
    let mut parts = version.split('.').map(|part| part.parse::<u32>().unwrap_or(0));
    let version_ = (parts.next().unwrap_or(0), parts.next().unwrap_or(0));
    Finding::warn_if(version_ < (3, 11), name, format!("Python {version}"), remedy)
}

/// Hash of the layouts that an executable prints.
fn layout_of(path: &Path) -> Option<u64> {
    u64::from_str_radix(output_of(path, LAYOUT_ARGUMENT)?.trim(), 16).ok()
}

/// What an executable prints for one argument, if it ends in time.
fn output_of(executable: &Path, argument: &str) -> Option<String> {
    let mut command = Command::new(executable);
    command.arg(argument).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::null());
    let mut child = command.spawn().ok()?;
    let stdout = child.stdout.take()?;
    let (sender, receiver) = mpsc::sync_channel(1);
    // A process that it has started may keep the pipe open for ever: then only this thread waits.
    let reader = Builder::new().spawn(move || {
        let mut printed = Vec::new();
        let read = stdout.take(PRINTED_MAX).read_to_end(&mut printed);
        let _ = sender.send(read.map(|_| printed));
    });
    let printed = reader.ok().and_then(|_| receiver.recv_timeout(LIMIT).ok()?.ok());
    // It may be anything; it was started here and is ended here.
    let _ = child.kill();
    let _ = child.wait();
    Some(String::from_utf8_lossy(&printed?).into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_executable_that_prints_something_else_has_no_layout() {
        assert_eq!(layout_of(Path::new("/bin/echo")), None);
        assert_eq!(layout_of(Path::new("/no/such/executable")), None);
    }

    #[test]
    fn an_executable_whose_child_keeps_the_pipe_open_is_not_waited_for() {
        use std::os::unix::fs::PermissionsExt as _;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("lingers");
        std::fs::write(&path, "#!/bin/sh\nsleep 5 &\necho 1\n").unwrap();
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o700)).unwrap();
        let begin_ns = runtime::clock::mono_now_ns();
        assert_eq!(layout_of(&path), None);
        let took_ns = runtime::clock::mono_now_ns() - begin_ns;
        assert!(took_ns < 4_000_000_000, "{took_ns} ns");
    }
}
