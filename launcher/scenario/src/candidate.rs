//! The processes that can be asked to take a slot over.

use crate::services;
use document::suggestion;
use rustix::fs::{Access, access};
use shared_types::Slot;
use std::ffi::OsStr;
use std::fs::File;
use std::io::Read as _;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};

/// As much of a script's first line as the system reads \[bytes\].
const MAX_FIRST_LINE_BYTES: u64 = 255;

/// Length of the head of a program that names its machine \[bytes\].
const ELF_HEAD: u64 = 20;

/// How executables begin that are services by their name alone.
const PREFIX: &str = "morphquad-";

/// What shall take a slot over.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Candidate {
    /// A service inside the executable.
    Service(&'static str),
    /// Another executable, by its absolute path.
    Executable(PathBuf),
}

/// Why a name has no candidate: what is wrong, and what to do.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NoCandidate {
    /// What is wrong with the name.
    pub what: String,
    /// What to do about it.
    pub remedy: String,
}

impl Candidate {
    /// The candidate with the name `to`: a service that fills the slot, the path of an executable, or
    /// `morphquad-TO` beside this executable or on the search path.
    ///
    /// # Errors
    /// No candidate does, or it is of another role.
    pub fn find(slot: Slot, to: &str) -> Result<Self, NoCandidate> {
        let known = services::names_for(slot.role());
        if let Some(service) = known.into_iter().find(|name| *name == to) {
            return Ok(Self::Service(service));
        }
        if to.contains('/') {
            return executable(Path::new(to)).map(Self::Executable);
        }
        if let Some(role) = services::role_of(to) {
            let what = format!("{to} fills {}, not {}", role.label(), slot.label());
            return Err(NoCandidate { what, remedy: remedy(slot, to) });
        }
        let own = std::env::current_exe().unwrap_or_default();
        let path = std::env::var_os("PATH").unwrap_or_default();
        beside_or_on(own.parent(), &path, &format!("{PREFIX}{to}"))
            .map(Self::Executable)
            .ok_or_else(|| {
                let what = format!("no controller for the {} slot is called {to}", slot.label());
                NoCandidate { what, remedy: remedy(slot, to) }
            })
    }

    /// What it is called in `ps`.
    #[must_use]
    pub fn name(&self) -> &str {
        match self {
            Self::Service(name) => name,
            Self::Executable(path) => name_of(path.to_str().unwrap_or("unnamed")),
        }
    }
}

/// What a candidate is called that is asked for as `to`: the last part of a path, less our prefix.
#[must_use]
pub fn name_of(to: &str) -> &str {
    let last = to.rsplit('/').next().unwrap_or(to);
    last.strip_prefix(PREFIX).unwrap_or(last)
}

fn remedy(slot: Slot, to: &str) -> String {
    let known: Vec<&str> = services::names_for(slot.role()).collect();
    format!("{}, or give the path of an executable", suggestion(to, known.into_iter()))
}

/// The absolute path of something that can be started.
fn executable(path: &Path) -> Result<PathBuf, NoCandidate> {
    let refuse = |what: &str, remedy: &str| {
        let what = format!("{} {what}", path.display());
        Err(NoCandidate { what, remedy: remedy.to_owned() })
    };
    match path.metadata() {
        Err(error) => {
            refuse(&format!("cannot be started: {error}"), "give the path of an executable")
        }
        Ok(facts) if !facts.is_file() => refuse("is not a file", "give the path of an executable"),
        Ok(facts) if facts.permissions().mode() & 0o111 == 0 => {
            refuse("is not executable", "build it, or `chmod +x` it")
        }
        Ok(_) => match missing_interpreter(path) {
            Some(name) => refuse(
                &format!("needs {name}, which is not installed"),
                "install it, or name another one in the first line of the script",
            ),
            None => Ok(path.canonicalize().unwrap_or_else(|_| path.to_path_buf())),
        },
    }
}

/// Why the system will hardly start a file that may be executed, as far as that can be seen without trying; none if
/// nothing is in its way. A system can be taught to start more (`binfmt_misc`), so only the system can decide.
#[must_use]
pub fn unstartable(path: &Path) -> Option<&'static str> {
    if access(path, Access::EXEC_OK).is_err() {
        return Some("lies where nothing may be executed");
    }
    let theirs = head(path, ELF_HEAD)?;
    if theirs.is_empty() {
        Some("is empty")
    } else if theirs.starts_with(b"\xef\xbb\xbf#!") {
        Some("begins with a byte-order mark, which hides the `#!` of its first line")
    } else if theirs.starts_with(b"\x7fELF") {
        let ours = head(Path::new("/proc/self/exe"), ELF_HEAD)?;
        (machine(&theirs) != machine(&ours)).then_some("is for another machine")
    } else {
        (!theirs.starts_with(b"#!")).then_some("is neither a program nor a script with a `#!`")
    }
}

/// The first bytes of a file; none of one that cannot be read.
fn head(path: &Path, bytes: u64) -> Option<Vec<u8>> {
    let mut head = Vec::new();
    File::open(path).ok()?.take(bytes).read_to_end(&mut head).ok()?;
    Some(head)
}

/// Class and byte order, and machine, in the header of a program.
fn machine(elf: &[u8]) -> Option<(&[u8], &[u8])> {
    elf.get(4..6).zip(elf.get(18..20))
}

/// The program that has to run a script and cannot be found; none for what runs by itself.
fn missing_interpreter(path: &Path) -> Option<String> {
    // What cannot be read is for the system to judge.
    let head = head(path, MAX_FIRST_LINE_BYTES)?;
    let line = head.strip_prefix(b"#!")?.split(|byte| *byte == b'\n').next()?;
    let mut arguments = str::from_utf8(line).ok()?.split_whitespace();
    let interpreter = arguments.next()?;
    if Path::new(interpreter).file_name() != Some(OsStr::new("env")) {
        return (!Path::new(interpreter).exists()).then(|| interpreter.to_owned());
    }
    let name = arguments.find(|word| !word.starts_with('-') && !word.contains('='))?;
    let path = std::env::var_os("PATH").unwrap_or_default();
    let is_there = std::env::split_paths(&path).any(|folder| folder.join(name).is_file());
    (!is_there).then(|| name.to_owned())
}

fn beside_or_on(own: Option<&Path>, path: &OsStr, name: &str) -> Option<PathBuf> {
    let folders = own.map(Path::to_path_buf).into_iter().chain(std::env::split_paths(path));
    folders.map(|folder| folder.join(name)).find_map(|path| executable(&path).ok())
}

/// Every executable beside this one or on the search path whose name is one of those meant.
#[must_use]
pub fn installed(is_meant: impl Fn(&str) -> bool) -> Vec<PathBuf> {
    let own = std::env::current_exe().unwrap_or_default();
    let path = std::env::var_os("PATH").unwrap_or_default();
    let folders =
        own.parent().map(Path::to_path_buf).into_iter().chain(std::env::split_paths(&path));
    let entries = folders.filter_map(|folder| std::fs::read_dir(folder).ok()).flatten().flatten();
    let meant = entries.filter(|entry| entry.file_name().to_str().is_some_and(&is_meant));
    let mut found: Vec<_> = meant.filter_map(|entry| executable(&entry.path()).ok()).collect();
    found.sort();
    found.dedup();
    found
}

/// A share of something: `1%` or `0.01`; `None` unless finite and not negative.
#[must_use]
pub fn share(text: &str) -> Option<f64> {
    let number = |text: &str| text.trim().parse::<f64>().ok();
    let share = match text.strip_suffix('%') {
        Some(percent) => number(percent)? / 100.0,
        None => number(text)?,
    };
    (share.is_finite() && share >= 0.0).then_some(share)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::{self, Permissions};

    fn refusal(slot: Slot, to: &str) -> String {
        let NoCandidate { what, remedy } = Candidate::find(slot, to).unwrap_err();
        format!("{what}: {remedy}")
    }

    #[test]
    fn a_service_is_known_to_its_own_slot_alone() {
        let found = Candidate::find(Slot::Attitude, "attitude-mpc").unwrap();
        assert_eq!((&found, found.name()), (&Candidate::Service("attitude-mpc"), "attitude-mpc"));
        assert!(refusal(Slot::Position, "attitude-mpc").contains("attitude-mpc fills attitude"));
        assert!(refusal(Slot::Attitude, "plant").contains("plant fills plant, not attitude"));
        assert!(refusal(Slot::Attitude, "atitude-mpc").contains("did you mean `attitude-mpc`?"));
    }

    #[test]
    fn an_executable_is_found_by_its_path_and_as_a_command_of_ours() {
        let folder = tempfile::TempDir::new().unwrap();
        let path = folder.path().canonicalize().unwrap().join("morphquad-mine");
        let shown = path.display().to_string();
        assert!(refusal(Slot::Attitude, &shown).contains("cannot be started"));
        fs::write(&path, "").unwrap();
        fs::set_permissions(&path, Permissions::from_mode(0o644)).unwrap();
        assert!(refusal(Slot::Attitude, &shown).contains("is not executable"));
        assert_eq!(beside_or_on(Some(folder.path()), OsStr::new(""), "morphquad-mine"), None);
        fs::set_permissions(&path, Permissions::from_mode(0o755)).unwrap();
        let found = Candidate::find(Slot::Attitude, &shown).unwrap();
        assert_eq!((&found, found.name()), (&Candidate::Executable(path.clone()), "mine"));
        let on_path = std::env::join_paths(["/nowhere".as_ref(), folder.path()]).unwrap();
        for found in [
            beside_or_on(Some(folder.path()), OsStr::new(""), "morphquad-mine"),
            beside_or_on(None, &on_path, "morphquad-mine"),
        ] {
            assert_eq!(found.as_ref(), Some(&path));
        }
        let folder_itself = folder.path().display().to_string();
        assert!(refusal(Slot::Position, &folder_itself).contains("is not a file"));
    }

    #[test]
    fn what_the_system_will_not_start_is_seen_without_trying() {
        let folder = tempfile::TempDir::new().unwrap();
        let path = folder.path().join("controller");
        let own = fs::read("/proc/self/exe").unwrap();
        let foreign = [&own[..18], &[0xff, 0xff], &own[20..64]].concat();
        for (bytes, why) in [
            (&b""[..], Some("empty")),
            (b"\xef\xbb\xbf#!/bin/sh\n", Some("byte-order mark")),
            (b"print(1)\n", Some("neither a program nor a script")),
            (&foreign, Some("another machine")),
            (&own[..64], None),
            (b"#!/bin/sh\n", None),
        ] {
            fs::write(&path, bytes).unwrap();
            fs::set_permissions(&path, Permissions::from_mode(0o755)).unwrap();
            let reason = unstartable(&path);
            assert_eq!(reason.is_some(), why.is_some(), "{reason:?}");
            assert!(why.is_none_or(|why| reason.unwrap().contains(why)), "{reason:?}");
        }
        // As on a mount that executes nothing.
        fs::set_permissions(&path, Permissions::from_mode(0o644)).unwrap();
        assert!(unstartable(&path).unwrap().contains("nothing may be executed"));
    }

    #[test]
    fn a_script_without_its_interpreter_is_refused_with_a_remedy() {
        let folder = tempfile::TempDir::new().unwrap();
        let path = folder.path().join("controller.py");
        let first_line = |line: &str| {
            fs::write(&path, format!("{line}\nprint(1)\n")).unwrap();
            fs::set_permissions(&path, Permissions::from_mode(0o755)).unwrap();
            Candidate::find(Slot::Attitude, &path.display().to_string())
        };
        for (line, missing) in [
            ("#!/nowhere/bin/python3 -u", "/nowhere/bin/python3"),
            ("#!/usr/bin/env no-such-python", "no-such-python"),
            ("#!/usr/bin/env -S A=1 no-such-python -u", "no-such-python"),
        ] {
            let NoCandidate { what, remedy } = first_line(line).unwrap_err();
            assert!(what.ends_with(&format!("needs {missing}, which is not installed")), "{what}");
            assert!(remedy.contains("install it"), "{remedy}");
        }
        for line in ["#!/bin/sh", "#!/usr/bin/env sh", "no script", "#!"] {
            assert!(first_line(line).is_ok(), "{line}");
        }
    }

    #[test]
    fn a_share_is_a_percentage_or_a_number() {
        for (text, expected) in [("1%", 0.01), ("0.01", 0.01), ("10 %", 0.1), ("0%", 0.0)] {
            assert_eq!(share(text).map(f64::to_bits), Some(f64::to_bits(expected)), "{text}");
        }
        for text in ["", "%", "-1%", "nan", "inf%", "one"] {
            assert_eq!(share(text), None, "{text}");
        }
    }
}
