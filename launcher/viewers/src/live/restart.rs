//! How this process gives back the memory that viewers have made it hold: it is replaced by another one in its place.
//!
//! The library that serves them keeps what it owes to a viewer that sends pings and never reads, without a limit and for
//! as long as that viewer stays; nothing but the end of the process frees it.

use super::token::Token;
use core::fmt::{Display, Formatter};
use std::fs;
use std::net::SocketAddr;

/// Memory that a server may hold before it restarts \[kB\]. Without viewers it holds some 20 MB, and a few MB more for each
/// viewer that is a whole backlog behind.
const MEMORY_MAX_KB: u64 = 512 << 10;

/// What a server keeps across a restart: its run, where it listens, and the token of its page.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Place {
    pub(super) run: String,
    pub(super) viewers: SocketAddr,
    pub(super) page: SocketAddr,
    pub(super) token: Token,
}

impl Place {
    /// Reads what [`Display`] has written; none for any other text.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        let mut parts = text.split(' ');
        let run = parts.next()?.to_owned();
        let viewers = parts.next()?.parse().ok()?;
        let page = parts.next()?.parse().ok()?;
        let token = Token::known(parts.next()?)?;
        Some(Self { run, viewers, page, token })
    }

    /// Id of the run.
    #[must_use]
    pub fn run(&self) -> &str {
        &self.run
    }
}

impl Display for Place {
    fn fmt(&self, f: &mut Formatter<'_>) -> core::fmt::Result {
        write!(f, "{} {} {} {}", self.run, self.viewers, self.page, self.token.as_str())
    }
}

/// True if this process holds more memory than it may.
pub(super) fn holds_too_much() -> bool {
    let held_kb = fs::read_to_string("/proc/self/status").map_or(0, |text| held_kb(&text));
    held_kb > MEMORY_MAX_KB
}

/// Memory of its own, in use or swapped out, by `proc_pid_status(5)`.
fn held_kb(status: &str) -> u64 {
    let of = |line: &str| {
        let (key, value) = line.split_once(':')?;
        let is_held = ["RssAnon", "VmSwap"].contains(&key);
        value.trim().strip_suffix(" kB").filter(|_| is_held)?.parse::<u64>().ok()
    };
    status.lines().filter_map(of).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_is_read_as_it_is_written_and_nothing_else_is() {
        let token = Token::random().unwrap();
        let [viewers, page] = ["127.0.0.1:8765", "[::1]:9"].map(|address| address.parse().unwrap());
        let place = Place { run: "7f3a".to_owned(), viewers, page, token };
        assert_eq!(Place::parse(&place.to_string()), Some(place));
        for other in
            ["", "7f3a 127.0.0.1:8765 [::1]:9", "7f3a 127.0.0.1:8765 [::1]:9 short", "a b c d"]
        {
            assert_eq!(Place::parse(other), None, "{other}");
        }
    }

    #[test]
    fn the_memory_of_a_process_is_its_own_in_use_and_swapped_out() {
        let status = "Name:\tmorphquad\nVmHWM:\t 9000 kB\nRssAnon:\t 345 kB\nRssShmem:\t 7 kB\nVmSwap:\t 5 kB\n";
        assert_eq!((held_kb(status), held_kb("")), (350, 0));
        assert!(!holds_too_much());
    }
}
