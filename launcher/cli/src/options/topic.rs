//! Arguments of `morphquad topic`.

use super::duration::duration;
use super::{Format, RunChoice};
use clap::{ArgGroup, Args, Subcommand, ValueEnum};
use core::time::Duration;
use std::path::PathBuf;

pub(super) const LIST_EXAMPLES: &str = "\
Examples:
  morphquad topic list
  morphquad topic list --format json

With a running flight, HZ is what came within --for; without one it stays empty.";

pub(super) const ECHO_EXAMPLES: &str = "\
Examples:
  morphquad topic echo state_estimate
  morphquad topic echo truth imu --count 5 --format jsonl
  morphquad topic echo recordings/7f3a.mcap attitude_report --from 2s --count 1
  morphquad topic echo latest truth --field 'position_w_m[2]' --field velocity_w_m_s
  morphquad topic echo recordings/7f3a.mcap events

Live, the launcher hands on copies of what it records: no loop has to do with it. A client that reads too slowly \
loses samples and gets their number. With --field a line has the instant from which the sample is in effect, \
then the values. Without --count it goes on to the end of the flight. \
Ends with 2 for an unknown topic or file, or if no run or several are active.";

pub(super) const HZ_EXAMPLES: &str = "\
Examples:
  morphquad topic hz
  morphquad topic hz imu wrench_command --for 5s
  morphquad topic hz recordings/7f3a.mcap

HZ and the intervals are logical, WALL counts by when samples were published. A gap is a sequence number \
that never came.";

pub(super) const INFO_EXAMPLES: &str = "\
Examples:
  morphquad topic info wrench_command
  morphquad topic info recordings/7f3a.mcap
  morphquad topic info recordings/7f3a.mcap imu --format json

Of a topic: who writes and reads it, and its fields. Of a recording: what is in it, topic by topic.";

pub(super) const EXPORT_EXAMPLES: &str = "\
Examples:
  morphquad topic export recordings/7f3a.mcap --csv
  morphquad topic export recordings/7f3a.mcap truth reference --parquet --out tables

A file for each topic, TOPIC.csv or TOPIC.parquet, with a column for each number: `t_s`, the instant from \
which a sample is in effect, then every field by its name; `field[2]` is an element of a list.";

/// What to do with topics.
#[derive(Debug, Clone, Subcommand)]
pub enum TopicCommand {
    /// Name the topics, and how often they come in a running flight
    #[command(after_help = LIST_EXAMPLES)]
    List(TopicListArguments),
    /// Show samples, field by field
    #[command(after_help = ECHO_EXAMPLES)]
    Echo(TopicEchoArguments),
    /// Measure how often samples come, and what is missing
    #[command(after_help = HZ_EXAMPLES)]
    Hz(TopicHzArguments),
    /// Tell about a topic or a recording
    #[command(after_help = INFO_EXAMPLES)]
    Info(TopicInfoArguments),
    /// Write the topics of a recording as tables
    #[command(after_help = EXPORT_EXAMPLES)]
    Export(TopicExportArguments),
}

/// Form of samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum SampleFormat {
    /// For people
    Text,
    /// One list of objects, complete at the end
    Json,
    /// An object a line, as they come
    Jsonl,
}

/// Which topics there are.
#[derive(Debug, Clone, Args)]
pub struct TopicListArguments {
    /// How long to count
    #[arg(long = "for", value_name = "DURATION", default_value = "500ms", allow_hyphen_values = true, value_parser = duration)]
    pub duration: Duration,
    /// The run.
    #[command(flatten)]
    pub run: RunChoice,
    /// Form of the list
    #[arg(long, value_enum, default_value = "text")]
    pub format: Format,
}

/// Which samples to show.
#[derive(Debug, Clone, Args)]
pub struct TopicEchoArguments {
    /// Topics or `events`, all if there are none, and perhaps a recording to take them from
    #[arg(value_name = "TOPIC|FILE")]
    pub what: Vec<String>,
    /// No more than so many samples
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub count: Option<u64>,
    /// One of so many samples of a topic
    #[arg(long, value_name = "N", default_value = "1", value_parser = clap::value_parser!(u64).range(1..))]
    pub every: u64,
    /// Nothing released before, in logical time
    #[arg(long, value_name = "DURATION", allow_hyphen_values = true, value_parser = duration)]
    pub from: Option<Duration>,
    /// This field alone, such as `position_w_m[2]`; may be given several times
    #[arg(long = "field", value_name = "FIELD")]
    pub fields: Vec<String>,
    /// The run.
    #[command(flatten)]
    pub run: RunChoice,
    /// Form of the samples
    #[arg(long, value_enum, default_value = "text")]
    pub format: SampleFormat,
}

/// What to count.
#[derive(Debug, Clone, Args)]
pub struct TopicHzArguments {
    /// Topics, all if there are none, and perhaps a recording to take them from
    #[arg(value_name = "TOPIC|FILE")]
    pub what: Vec<String>,
    /// How long to count what comes; 2s if left out
    #[arg(long = "for", value_name = "DURATION", allow_hyphen_values = true, value_parser = duration)]
    pub duration: Option<Duration>,
    /// The run.
    #[command(flatten)]
    pub run: RunChoice,
    /// Form of the table
    #[arg(long, value_enum, default_value = "text")]
    pub format: Format,
}

/// What to describe.
#[derive(Debug, Clone, Args)]
pub struct TopicInfoArguments {
    /// Topics, or a recording
    #[arg(value_name = "TOPIC|FILE", required = true)]
    pub what: Vec<String>,
    /// Form of the result
    #[arg(long, value_enum, default_value = "text")]
    pub format: Format,
}

/// Which tables to write.
#[derive(Debug, Clone, Args)]
#[command(group(ArgGroup::new("form").required(true)))]
pub struct TopicExportArguments {
    /// The recording, and topics if not all
    #[arg(value_name = "FILE|TOPIC", required = true)]
    pub what: Vec<String>,
    /// As comma-separated text
    #[arg(long, group = "form")]
    pub csv: bool,
    /// As Apache Parquet
    #[arg(long, group = "form")]
    pub parquet: bool,
    /// Folder for the tables; the recording's name without its ending if left out
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Form of the list of what was written
    #[arg(long, value_enum, default_value = "text")]
    pub format: Format,
}
