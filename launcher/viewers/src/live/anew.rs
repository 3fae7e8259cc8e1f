//! Beginning anew where it was: how this process gives back what viewers have made it hold.
//!
//! The library that serves them keeps what it owes to a viewer that sends pings and never reads, without a limit and for
//! as long as that viewer stays; nothing but the end of the process frees it.

use super::token::Token;
use core::fmt::{Display, Formatter};
use core::str::FromStr;
use std::fs;
use std::net::SocketAddr;

/// Memory that a server may hold before it begins anew \[bytes\]. Without viewers it holds some 20 MB, and each that is
/// behind by a whole backlog a few more.
const MEMORY_MAX: u64 = 512 << 20;

/// Where a server listens and what its page's address says, which outlive it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Places {
    pub(super) viewers: SocketAddr,
    pub(super) page: SocketAddr,
    pub(super) token: Token,
}

impl Display for Places {
    fn fmt(&self, f: &mut Formatter<'_>) -> core::fmt::Result {
        write!(f, "{} {} {}", self.viewers, self.page, self.token.as_str())
    }
}

/// A text that no server wrote.
#[derive(Debug)]
pub struct NoPlaces;

impl FromStr for Places {
    type Err = NoPlaces;

    fn from_str(text: &str) -> Result<Self, NoPlaces> {
        let mut words = text.split(' ');
        let mut next = || words.next().ok_or(NoPlaces);
        let viewers = next()?.parse().map_err(|_| NoPlaces)?;
        let page = next()?.parse().map_err(|_| NoPlaces)?;
        let token = Token::known(next()?).ok_or(NoPlaces)?;
        Ok(Self { viewers, page, token })
    }
}

/// True if this process holds more memory than it may.
pub(super) fn holds_too_much() -> bool {
    let pages = fs::read_to_string("/proc/self/statm").ok().and_then(|text| resident_pages(&text));
    pages.is_some_and(|pages| pages * rustix::param::page_size() as u64 > MEMORY_MAX)
}

/// The second number of `proc_pid_statm(5)`.
fn resident_pages(statm: &str) -> Option<u64> {
    statm.split(' ').nth(1)?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_read_as_they_are_written_and_nothing_else_is() {
        let token = Token::random().unwrap();
        let [viewers, page] = ["127.0.0.1:8765", "[::1]:9"].map(|address| address.parse().unwrap());
        let places = Places { viewers, page, token };
        assert_eq!(places.to_string().parse::<Places>().ok(), Some(places));
        for other in ["", "127.0.0.1:8765 [::1]:9", "127.0.0.1:8765 [::1]:9 short", "a b c"] {
            assert!(other.parse::<Places>().is_err(), "{other}");
        }
    }

    #[test]
    fn the_memory_of_a_process_is_what_it_has_in_use() {
        assert_eq!(resident_pages("12000 345 200 1 0 99 0\n"), Some(345));
        assert_eq!(resident_pages(""), None);
        assert!(!holds_too_much());
    }
}
