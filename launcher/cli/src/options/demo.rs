//! Arguments of `morphquad demo`.

use super::duration::duration;
use super::live::{ADDRESS, listen};
use clap::Args;
use core::time::Duration;
use std::net::SocketAddr;

pub(super) const EXAMPLES: &str = "\
Examples:
  morphquad demo
  morphquad demo --for 10m

Opens a page on which a vehicle flies, with a button each for a gust, the arms, a swap, a bad swap that is refused, and the \
killing of a controller. Records into recordings/, 2 MB for each second. Ctrl-C ends it.";

/// How to show it.
#[derive(Debug, Clone, Args)]
pub struct DemoArguments {
    /// Length of the flight; three minutes if left out
    #[arg(long = "for", value_name = "DURATION", allow_hyphen_values = true, value_parser = duration)]
    pub duration: Option<Duration>,
    /// Any key of the scenario, for example `pilot.period_s=7`
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Where the WebSocket for viewers listens; the page has the port after it, or a free one
    #[arg(long, value_name = "ADDRESS:PORT", default_value = ADDRESS, value_parser = listen)]
    pub listen: SocketAddr,
    /// Only print the addresses
    #[arg(long)]
    pub no_open: bool,
}
