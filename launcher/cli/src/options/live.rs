//! Arguments of `live` and `run --live`.

use super::RunChoice;
use clap::Args;
use simulate::LiveOptions;
use std::net::{Ipv4Addr, SocketAddr};
use std::path::PathBuf;

pub(crate) const EXAMPLES: &str = "\
Examples:
  morphquad run --live
  morphquad live
  morphquad live --listen 127.0.0.1:0 --every-sample --no-open

Serves a running flight, any number of times: to a browser as a page with buttons, and over the Foxglove \
WebSocket protocol, where no client can write. A browser that opens the address as printed, with its token, \
may give orders. Ends with the run; with 2 for an address that cannot be used.";

/// Where Foxglove and Lichtblick look first.
pub(super) const ADDRESS: &str = "127.0.0.1:8765";
/// Above this, viewers warn.
const RATE_HZ: f64 = 50.0;

/// Which run, and where to show it.
#[derive(Debug, Clone, Args)]
pub(crate) struct LiveArguments {
    #[command(flatten)]
    pub(crate) run: RunChoice,
    /// Where the WebSocket listens; the page has the port after it, or a free one
    #[arg(long, value_name = "ADDRESS:PORT", default_value = ADDRESS, value_parser = listen)]
    pub(crate) listen: SocketAddr,
    /// Samples per second of flight that viewers get of each fast topic
    #[arg(long, value_name = "HZ", default_value_t = RATE_HZ, value_parser = rate)]
    pub(crate) rate: f64,
    /// Send viewers every sample
    #[arg(long, conflicts_with = "rate")]
    pub(crate) every_sample: bool,
    /// Only print the addresses
    #[arg(long)]
    pub(crate) no_open: bool,
    /// Leave a processor to the flight
    #[arg(long, value_name = "CPU", hide = true)]
    pub(crate) away_from: Option<usize>,
    /// Buttons of a demo, with the scenario that configures its bad controller
    #[arg(long, value_name = "FILE", hide = true)]
    pub(crate) demo: Option<PathBuf>,
}

/// Whether to serve a flight while it flies.
#[derive(Debug, Clone, Copy, Args)]
pub struct LiveFlags {
    /// Fly at the pace of the clock and serve the flight while it flies: a page in the browser with buttons, and
    /// a Foxglove WebSocket at this address, the page at the port after it, or a free one
    #[arg(
        long,
        value_name = "ADDRESS:PORT",
        value_parser = listen,
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = ADDRESS,
        conflicts_with = "in_process"
    )]
    pub live: Option<SocketAddr>,
    /// With --live, only print the addresses
    #[arg(long, requires = "live")]
    pub no_open: bool,
}

impl LiveFlags {
    pub(crate) fn options(self) -> Option<LiveOptions> {
        self.live.map(|listen| LiveOptions { listen, open: !self.no_open, demo: None })
    }
}

/// An address by number; `localhost` and a port alone stand for this machine's own.
pub(super) fn listen(text: &str) -> Result<SocketAddr, String> {
    let port = text.strip_prefix("localhost:").or(text.strip_prefix(':')).unwrap_or(text);
    let loopback = || Some(SocketAddr::from((Ipv4Addr::LOCALHOST, port.parse().ok()?)));
    text.parse().ok().or_else(loopback).ok_or_else(|| {
        format!(
            "write for example {ADDRESS}, or a port alone; 0.0.0.0:8765 shows the flight to the whole network"
        )
    })
}

fn rate(text: &str) -> Result<f64, String> {
    let rate_hz: Option<f64> = text.parse().ok();
    let rate_hz = rate_hz.filter(|rate_hz| (0.1..=100_000.0).contains(rate_hz));
    rate_hz.ok_or_else(|| "give a rate from 0.1 to 100000 Hz, or --every-sample".to_owned())
}

#[cfg(test)]
mod tests {
    use super::listen;

    #[test]
    fn a_port_alone_and_localhost_are_this_machine_and_what_is_no_address_is_shown_one() {
        for (text, address) in [
            ("8765", "127.0.0.1:8765"),
            (":0", "127.0.0.1:0"),
            ("localhost:9000", "127.0.0.1:9000"),
            ("0.0.0.0:8765", "0.0.0.0:8765"),
            ("[::1]:8765", "[::1]:8765"),
        ] {
            assert_eq!(listen(text).map(|found| found.to_string()).as_deref(), Ok(address));
        }
        for bad in ["", "127.0.0.1", "localhost", "elsewhere:8765", "65536", "-1", "::1"] {
            let error = listen(bad).unwrap_err();
            assert!(error.contains("127.0.0.1:8765"), "{bad}: {error}");
        }
    }
}
