//! What a controller prints, shown on the launcher's standard error under its name: at most so many lines in a second,
//! and never so that it has to wait for a terminal.

use crate::drain::{Drain, Lines, Sink, text};
use crate::standard_error::show;
use runtime::clock::mono_now_ns;
use std::io;
use std::os::fd::OwnedFd;

/// Lines of one controller that are shown in a second.
const LINES_PER_S: u32 = 100;
/// Bytes of a line that are shown together: with the name they fit into what a pipe takes as a whole, also where each of
/// them is no text and becomes three.
const LINE_BYTES: usize = 1000;
const SECOND_NS: u64 = 1_000_000_000;

/// Which lines are shown, second by second.
#[derive(Debug, Default)]
struct Meter {
    second_from_ns: u64,
    shown: u32,
    left_out: u64,
}

impl Meter {
    /// Whether one more line may be shown, and how many have been left out before it without a report yet.
    fn admit(&mut self, now_ns: u64) -> (bool, u64) {
        let is_new = now_ns >= self.second_from_ns + SECOND_NS;
        if is_new {
            (self.second_from_ns, self.shown) = (now_ns, 0);
        }
        if self.shown < LINES_PER_S {
            self.shown += 1;
            return (true, core::mem::take(&mut self.left_out));
        }
        self.left_out += 1;
        (false, 0)
    }
}

#[derive(Debug)]
struct Relayed<W> {
    name: String,
    lines: Lines,
    meter: Meter,
    to: W,
}

impl<W: FnMut(&str) -> bool> Relayed<W> {
    fn show(&mut self, line: &[u8], now_ns: u64) {
        let (is_admitted, left_out) = self.meter.admit(now_ns);
        self.report_left_out(left_out);
        if is_admitted && !(self.to)(&format!("{}: {}\n", self.name, text(line))) {
            self.meter.left_out += 1;
        }
    }

    fn report_left_out(&mut self, left_out: u64) {
        if left_out > 0 && !(self.to)(&format!("{}: lines left out: {left_out}\n", self.name)) {
            self.meter.left_out += left_out;
        }
    }
}

impl<W: FnMut(&str) -> bool + Send + 'static> Sink for Relayed<W> {
    fn take(&mut self, bytes: &[u8]) {
        let now_ns = mono_now_ns();
        let mut lines = core::mem::replace(&mut self.lines, Lines::new(LINE_BYTES));
        lines.cut(bytes, |line| self.show(line, now_ns));
        self.lines = lines;
    }

    fn end(&mut self) {
        let lines = core::mem::replace(&mut self.lines, Lines::new(LINE_BYTES));
        if !lines.rest().is_empty() {
            self.show(lines.rest(), mono_now_ns());
        }
        let left_out = core::mem::take(&mut self.meter.left_out);
        self.report_left_out(left_out);
    }
}

/// What one controller prints.
#[derive(Debug)]
pub(crate) struct Relay(Drain<Relayed<Show>>);

/// Shows a piece of text; false if it cannot be shown now.
type Show = fn(&str) -> bool;

impl Relay {
    /// Shows what comes through the pipe as that of `name`.
    pub(crate) fn of(pipe: OwnedFd, name: &str) -> io::Result<Self> {
        Ok(Self(Drain::start(pipe, relayed(name, show as Show))?))
    }

    /// Shows the rest of what a controller has printed that has ended.
    pub(crate) fn finish(&self) {
        self.0.finish();
    }
}

fn relayed<W>(name: &str, to: W) -> Relayed<W> {
    Relayed { name: name.to_owned(), lines: Lines::new(LINE_BYTES), meter: Meter::default(), to }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drain::tests::drained;
    use std::io::Write as _;
    use std::sync::mpsc::channel;

    #[test]
    fn every_line_is_shown_under_the_name_and_a_line_without_an_end_at_the_end() {
        let (shown, seen) = channel();
        let (drain, mut writer) =
            drained(relayed("law", move |text: &str| shown.send(text.to_owned()).is_ok()));
        writer.write_all(b"one\ntwo\nrest").expect("room");
        drop(writer);
        drain.finish();
        assert_eq!(seen.try_iter().collect::<String>(), "law: one\nlaw: two\nlaw: rest\n");
    }

    #[test]
    fn of_a_flood_so_many_lines_a_second_are_shown_and_the_others_counted() {
        let mut meter = Meter::default();
        let mut admit = |ms: u64| meter.admit(SECOND_NS + ms * 1_000_000);
        let shown = (0..1000).filter(|_| admit(0).0).count();
        assert_eq!(shown, LINES_PER_S as usize);
        assert_eq!(admit(999), (false, 0));
        assert_eq!(admit(1000), (true, 901));
        assert_eq!(admit(1001), (true, 0));
    }

    #[test]
    fn what_a_terminal_does_not_take_is_counted_and_reported_once_it_does() {
        let (shown, seen) = channel();
        let mut is_stopped = true;
        let mut relay = relayed("law", move |text: &str| {
            !core::mem::take(&mut is_stopped) && shown.send(text.to_owned()).is_ok()
        });
        relay.take(b"one\n");
        relay.take(b"two\n");
        drop(relay);
        assert_eq!(seen.into_iter().collect::<String>(), "law: lines left out: 1\nlaw: two\n");
    }
}
