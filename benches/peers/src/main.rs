//! morphquad beside what else one would take: the same chain over bare iceoryx2, unix sockets, threads and copper-rs.
//!
//! `cargo run --release --manifest-path benches/peers/Cargo.toml -- --morphquad target/release/morphquad` measures all of
//! them in turns within one run and prints a table. The peers carry the chain's samples and compute nothing; morphquad
//! flies. Run it on a machine that does nothing else, with the right to `SCHED_FIFO`.

#![deny(unsafe_code)]

mod chain;
mod copper;
mod flights;
mod node;
mod peers;
mod record;
mod sockets;
mod table;
mod threads;
mod transport;

use clap::{Parser, Subcommand};
use std::io::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;

/// Everything that can go wrong is for people to read.
type Result<T> = core::result::Result<T, Box<dyn core::error::Error>>;

/// morphquad beside other runtimes, in turns within one run.
#[derive(Debug, Parser)]
struct Options {
    #[command(subcommand)]
    part: Option<Part>,
    /// The executable that flies; without it only the peers are measured.
    #[arg(long, value_name = "PATH")]
    morphquad: Option<PathBuf>,
    /// Rounds in which each takes its turn; figures are medians over them.
    #[arg(long, default_value_t = 3, value_name = "N")]
    rounds: usize,
    /// Length of a realtime flight [s].
    #[arg(long, default_value_t = 8, value_name = "S")]
    realtime_s: u64,
    /// Length of a flight in lockstep [simulated s].
    #[arg(long, default_value_t = 20, value_name = "S")]
    lockstep_s: u64,
    /// How to print.
    #[arg(long, value_enum, default_value_t = Format::Text)]
    format: Format,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Format {
    Text,
    Markdown,
    Json,
}

#[derive(Debug, Subcommand)]
enum Part {
    /// A process of a chain.
    #[command(hide = true)]
    Node(Box<node::Process>),
}

fn run(options: &Options) -> Result<String> {
    if let Some(Part::Node(process)) = &options.part {
        return Ok(serde_json::to_string(&node::be(process)?)?);
    }
    let mut table = table::Table::new(options.morphquad.is_some());
    for round in 1..=options.rounds.max(1) {
        eprintln!("peers: round {round} of {}", options.rounds);
        peers::measure(&mut table, options.realtime_s, options.lockstep_s)?;
        if let Some(morphquad) = &options.morphquad {
            peers::measure_flights(&mut table, morphquad, options.realtime_s, options.lockstep_s)?;
        }
    }
    Ok(match options.format {
        Format::Text => table.text(),
        Format::Markdown => table.markdown(),
        Format::Json => serde_json::to_string_pretty(&table)?,
    })
}

fn main() -> ExitCode {
    match run(&Options::parse()) {
        Ok(text) => match writeln!(std::io::stdout(), "{text}") {
            Ok(()) => ExitCode::SUCCESS,
            Err(_) => ExitCode::FAILURE,
        },
        Err(error) => {
            let _ = writeln!(std::io::stderr(), "peers: {error}");
            ExitCode::FAILURE
        }
    }
}
