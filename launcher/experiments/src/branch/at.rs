//! Where a branch begins.

use core::fmt;
use core::str::FromStr;
use runtime::Rate;
use shared_types::time::ns_from_s;

/// `@1234`, a tick of the plant, or `@12.5s` or `@500ms`, a time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum At {
    /// Release of this index of the plant.
    Tick(u64),
    /// Logical time \[ns\].
    Time(u64),
}

impl At {
    /// The instant, given the plant's rate \[ns\].
    #[must_use]
    pub fn instant_ns(self, plant: Option<Rate>) -> u64 {
        match self {
            Self::Tick(tick) => plant.map_or(0, |rate| rate.release_ns(tick)),
            Self::Time(t_ns) => t_ns,
        }
    }
}

impl fmt::Display for At {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Tick(tick) => write!(f, "@{tick}"),
            Self::Time(t_ns) => write!(f, "@{}s", *t_ns as f64 / 1e9),
        }
    }
}

impl FromStr for At {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("`{text}` is no instant: write @1234 for a plant tick, or @12.5s");
        let at = text.strip_prefix('@').ok_or_else(wrong)?;
        if at.bytes().all(|byte| byte.is_ascii_digit()) {
            return at.parse().map(Self::Tick).map_err(|_| wrong());
        }
        let seconds = at.strip_suffix('s').and_then(|s| s.parse::<f64>().ok());
        let time = seconds.or_else(|| Some(humantime::parse_duration(at).ok()?.as_secs_f64()));
        match time {
            Some(t_s) if (0.0..=1e6).contains(&t_s) => Ok(Self::Time(ns_from_s(t_s))),
            _ => Err(wrong()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_numbers_and_times_end_in_s() {
        assert_eq!("@1234".parse(), Ok(At::Tick(1234)));
        assert_eq!("@12.5s".parse(), Ok(At::Time(12_500_000_000)));
        assert_eq!("@500ms".parse(), Ok(At::Time(500_000_000)));
        assert_eq!("@0".parse(), Ok(At::Tick(0)));
        let plant = Rate::from_hz(1000.0).ok();
        assert_eq!(At::Tick(1234).instant_ns(plant), 1_234_000_000);
        for bad in ["1234", "@", "@12.5", "@-1s", "@nans", "@1e9s", "@99999999999999999999"] {
            assert!(bad.parse::<At>().is_err(), "{bad}");
        }
        for text in ["@1234", "@12.5s", "@0.001s"] {
            assert_eq!(text.parse::<At>().map(|at| at.to_string()), Ok(text.to_owned()));
        }
    }
}
