//! The last lines that a process has written to its standard error.

use crate::drain::{Drain, Lines, Sink, text};
use std::collections::VecDeque;
use std::io;
use std::os::fd::OwnedFd;

/// Lines that are kept.
const LINES: usize = 12;
/// Bytes of a line that are kept together.
const LINE_BYTES: usize = 4096;

/// What has been read so far.
#[derive(Debug)]
struct Tail {
    kept: VecDeque<String>,
    lines: Lines,
}

impl Tail {
    fn text(&self) -> String {
        let rest = Some(text(self.lines.rest())).filter(|rest| !rest.is_empty());
        self.kept.iter().cloned().chain(rest).collect::<Vec<_>>().join("\n")
    }
}

impl Sink for Tail {
    fn take(&mut self, bytes: &[u8]) {
        let Self { kept, lines } = self;
        lines.cut(bytes, |line| {
            if kept.len() == LINES {
                kept.pop_front();
            }
            kept.push_back(text(line));
        });
    }
}

/// The last lines of one process; none of a process that shares the standard error of another.
#[derive(Debug, Default)]
pub(crate) struct LastStderr(Option<Drain<Tail>>);

impl LastStderr {
    /// Reads the pipe until its other end is closed everywhere.
    pub(crate) fn of(pipe: OwnedFd) -> io::Result<Self> {
        let tail = Tail { kept: VecDeque::new(), lines: Lines::new(LINE_BYTES) };
        Ok(Self(Some(Drain::start(pipe, tail)?)))
    }

    /// What has been read until now.
    pub(crate) fn so_far(&self) -> String {
        self.0.as_ref().map(|drain| drain.look(Tail::text)).unwrap_or_default()
    }

    /// Everything that a process has written that has ended.
    pub(crate) fn complete(&self) -> String {
        if let Some(drain) = &self.0 {
            drain.catch_up();
        }
        self.so_far()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::File;
    use std::io::Write as _;

    fn pipe() -> (LastStderr, File) {
        let (reader, writer) = io::pipe().expect("a pipe");
        (LastStderr::of(reader.into()).expect("a reader"), File::from(OwnedFd::from(writer)))
    }

    #[test]
    fn all_that_is_in_the_pipe_is_read_although_its_other_end_stays_open() {
        let (stderr, mut writer) = pipe();
        writer.write_all(b"one\ntwo\nhalf a li").expect("room");
        assert_eq!(stderr.complete(), "one\ntwo\nhalf a li");
        writer.write_all(b"ne\n").expect("room");
        assert_eq!(stderr.complete(), "one\ntwo\nhalf a line");
    }

    #[test]
    fn the_last_lines_are_kept_and_a_line_without_end_is_cut() {
        let (stderr, mut writer) = pipe();
        for line in 0..100 {
            writeln!(writer, "line {line}").expect("room");
        }
        let text = stderr.complete();
        assert_eq!(text.lines().count(), LINES);
        assert!(text.starts_with("line 88\n") && text.ends_with("\nline 99"), "{text}");
        for _ in 0..20 {
            writer.write_all(&[b'x'; 10_000]).expect("room");
        }
        drop(writer);
        let text = stderr.complete();
        assert!(text.len() <= (LINES + 1) * (LINE_BYTES + 1), "{} bytes", text.len());
    }
}
