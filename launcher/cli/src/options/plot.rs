//! Arguments of `morphquad plot`.

use super::duration::duration;
use clap::Args;
use core::time::Duration;
use std::path::PathBuf;

pub(super) const EXAMPLES: &str = "\
Examples:
  morphquad plot truth.position_w_m
  morphquad plot latest 'truth.position_w_m[2],reference.points[0].position_w_m[2]' --out heights.pdf
  morphquad plot mpc pid 'truth.position_w_m[0]' --out both.svg
  morphquad plot recordings/7f3a.mcap imu.specific_force_b_m_s2 --from 4s --to 6s

A signal is a topic and a field, as `morphquad topic info TOPIC` names them; of a list or a group every number is drawn. \
Signals with commas between them share a panel, and so do the same signals of several recordings. Ends with 2 for an unknown signal or file.";

/// What to draw.
#[derive(Debug, Clone, Args)]
pub struct PlotArguments {
    /// The recordings, the latest if left out, and what to draw, a panel for each
    #[arg(value_name = "[FILE...] TOPIC.FIELD[,...]", required = true)]
    pub words: Vec<String>,
    /// Picture to write, as PNG, SVG or PDF by its ending; the first FILE with the ending .png if left out
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Nothing in effect before, in logical time
    #[arg(long, value_name = "DURATION", allow_hyphen_values = true, value_parser = duration)]
    pub from: Option<Duration>,
    /// Nothing in effect after
    #[arg(long, value_name = "DURATION", allow_hyphen_values = true, value_parser = duration)]
    pub to: Option<Duration>,
}
