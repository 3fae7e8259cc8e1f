//! What has been flown so far, on disk: a line per finished case, appended in one write.
//!
//! Whatever kills the campaign, the file is a sequence of whole lines and at most one torn one at
//! its end, which is cut off when the campaign goes on.

use super::Outcome;
use rustix::fs::{FlockOperation, flock};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::{self, Read as _, Write as _};
use std::path::{Path, PathBuf};

/// Name of the journal in the campaign's folder.
const NAME: &str = "journal.jsonl";

/// What a journal belongs to; another campaign or another build must not go on with it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Identity {
    /// Hash of the scenario's text and all cases.
    pub campaign: String,
    /// Hash of the executable.
    pub build: String,
}

/// One finished case.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    /// Hash of scenario, case and build.
    key: String,
    /// The outcome's cells.
    cells: Vec<String>,
}

/// Why a journal cannot be used.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
pub enum JournalError {
    /// The file cannot be read or written.
    #[error("cannot {action} `{}`: {source}", path.display())]
    #[diagnostic(help("name a folder on a disk with room that you may write to: --out DIR"))]
    File {
        /// What was tried.
        action: &'static str,
        /// The journal.
        path: PathBuf,
        /// The error of the operating system.
        source: io::Error,
    },
    /// Another campaign is writing.
    #[error("another campaign is writing `{}`", .0.display())]
    #[diagnostic(help("wait for it, or name another folder: --out DIR"))]
    Busy(PathBuf),
    /// It belongs to something else.
    #[error("`{}` was begun {} and has {} finished cases", path.display(), what, finished)]
    #[diagnostic(help(
        "to throw them away and begin anew, add --restart; to keep them, name another folder: --out DIR"
    ))]
    Changed {
        /// The journal.
        path: PathBuf,
        /// By what it was begun.
        what: &'static str,
        /// Cases that would be lost.
        finished: usize,
    },
    /// A line in the middle is none of ours.
    #[error("line {line} of `{}` is damaged", path.display())]
    #[diagnostic(help("to begin anew, add --restart; or name another folder: --out DIR"))]
    Damaged {
        /// The journal.
        path: PathBuf,
        /// Counted from 1.
        line: usize,
    },
}

/// An open journal, locked against other campaigns.
#[derive(Debug)]
pub struct Journal {
    file: File,
    path: PathBuf,
    finished: BTreeMap<String, Outcome>,
}

impl Journal {
    /// Opens the journal in `folder`, or begins one. With `restart` what is there is thrown away.
    ///
    /// # Errors
    /// [`JournalError`]; nothing has been changed then.
    pub fn open(folder: &Path, identity: &Identity, restart: bool) -> Result<Self, JournalError> {
        let path = folder.join(NAME);
        let failed = |action| {
            let path = path.clone();
            move |source| JournalError::File { action, path, source }
        };
        let mut options = OpenOptions::new();
        let mut file =
            options.read(true).append(true).create(true).open(&path).map_err(failed("open"))?;
        flock(&file, FlockOperation::NonBlockingLockExclusive)
            .map_err(|_| JournalError::Busy(path.clone()))?;
        let mut bytes = Vec::new();
        if !restart {
            file.read_to_end(&mut bytes).map_err(failed("read"))?;
        }
        // What follows the last line feed was torn off.
        let whole = bytes.iter().rposition(|byte| *byte == b'\n').map_or(0, |at| at + 1);
        let finished = read(&bytes[..whole], identity, &path)?;
        file.set_len(whole as u64).map_err(failed("write"))?;
        let mut journal = Self { file, path, finished };
        if whole == 0 {
            journal.append(identity)?;
        }
        Ok(journal)
    }

    /// Outcome of a case that has been flown.
    #[must_use]
    pub fn finished(&self, key: &str) -> Option<&Outcome> {
        self.finished.get(key)
    }

    /// Adds a finished case.
    ///
    /// # Errors
    /// It cannot be written in full.
    pub fn add(&mut self, key: &str, outcome: &Outcome) -> Result<(), JournalError> {
        self.append(&Entry { key: key.to_owned(), cells: outcome.to_text() })
    }

    fn append(&mut self, line: &impl Serialize) -> Result<(), JournalError> {
        let mut bytes = serde_json::to_vec(line).unwrap_or_default();
        bytes.push(b'\n');
        let before = self.file.metadata().map(|found| found.len());
        self.file.write_all(&bytes).map_err(|source| {
            // A part of a line would run into the next one.
            let _ = before.and_then(|length| self.file.set_len(length));
            JournalError::File { action: "write", path: self.path.clone(), source }
        })
    }
}

/// Reads whole lines: the identity of the campaign, then a case each.
fn read(
    bytes: &[u8],
    identity: &Identity,
    path: &Path,
) -> Result<BTreeMap<String, Outcome>, JournalError> {
    let damaged = |line: usize| JournalError::Damaged { path: path.to_owned(), line: line + 1 };
    let mut lines = bytes.split(|byte| *byte == b'\n').filter(|line| !line.is_empty());
    let Some(head) = lines.next() else { return Ok(BTreeMap::new()) };
    let theirs: Identity = serde_json::from_slice(head).map_err(|_| damaged(0))?;
    if theirs != *identity {
        // What a case is depends on the build as well.
        let what = if theirs.build == identity.build {
            "for another campaign file or scenario"
        } else {
            "by another build of morphquad"
        };
        return Err(JournalError::Changed { path: path.to_owned(), what, finished: lines.count() });
    }
    let entry = |(at, line): (usize, &[u8])| {
        let entry: Entry = serde_json::from_slice(line).map_err(|_| damaged(at + 1))?;
        let outcome = Outcome::from_text(&entry.cells).ok_or_else(|| damaged(at + 1))?;
        Ok((entry.key, outcome))
    };
    lines.enumerate().map(entry).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn identity(build: &str) -> Identity {
        Identity { campaign: "c".to_owned(), build: build.to_owned() }
    }

    fn outcome(reason: &str) -> Outcome {
        Outcome::refused(&reason)
    }

    fn open(folder: &Path) -> Result<Journal, JournalError> {
        Journal::open(folder, &identity("b"), false)
    }

    #[test]
    fn cut_anywhere_it_keeps_the_whole_lines_and_goes_on() {
        let scratch = tempfile::tempdir().unwrap();
        let mut journal = open(scratch.path()).unwrap();
        for key in ["one", "two"] {
            journal.add(key, &outcome(key)).unwrap();
        }
        drop(journal);
        let path = scratch.path().join(NAME);
        let whole = fs::read(&path).unwrap();
        let ends: Vec<usize> = (0..whole.len()).filter(|at| whole[*at] == b'\n').collect();
        for length in 0..=whole.len() {
            fs::write(&path, &whole[..length]).unwrap();
            let mut journal = open(scratch.path()).unwrap();
            assert_eq!(journal.finished("one").is_some(), length > ends[1], "{length}");
            assert_eq!(journal.finished("two").is_some(), length > ends[2], "{length}");
            journal.add("three", &outcome("three")).unwrap();
            drop(journal);
            let again = open(scratch.path()).unwrap();
            assert_eq!(again.finished("three"), Some(&outcome("three")), "{length}");
        }
    }

    #[test]
    fn another_build_another_writer_and_damage_are_reported() {
        let scratch = tempfile::tempdir().unwrap();
        let mut journal = open(scratch.path()).unwrap();
        journal.add("one", &outcome("one")).unwrap();
        assert!(matches!(open(scratch.path()), Err(JournalError::Busy(_))));
        drop(journal);
        let refused = Journal::open(scratch.path(), &identity("other"), false).unwrap_err();
        assert!(refused.to_string().contains("another build") && refused.to_string().contains('1'));
        let path = scratch.path().join(NAME);
        let mut bytes = fs::read(&path).unwrap();
        bytes.splice(0..0, b"nonsense\n".iter().copied());
        fs::write(&path, &bytes).unwrap();
        assert!(matches!(open(scratch.path()), Err(JournalError::Damaged { line: 1, .. })));
        let journal = Journal::open(scratch.path(), &identity("other"), true).unwrap();
        assert!(journal.finished("one").is_none());
    }
}
