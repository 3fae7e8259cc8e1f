//! The solvers of the control laws against public ones, on recorded closed loops and on programs
//! of our own flights.
//!
//! `cargo bench --bench qp -- --help` lists the options. One thread, pinned; every solver sees the
//! same ticks in the same order. A series is replayed from its start again and again; the figure of
//! a tick is its best replay (hot caches), and the table gives median, 99th percentile and maximum
//! over ticks. A tick with a new Hessian includes taking it over.

mod contenders;
mod count;
#[path = "../flight/mod.rs"]
mod flight;
mod live;
mod measure;
mod peers;
mod report;
#[path = "../../services/lib/qp/tests/sequences/mod.rs"]
mod sequences;
mod series;

use clap::{Parser, ValueEnum};
use contenders::Entry;
use measure::Effort;
use series::Group;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// The quadratic programs of the control laws, ours against public solvers.
#[derive(Debug, Parser)]
struct Options {
    /// Further files of sequences, or folders of them (*.bin); the format is described in
    /// services/lib/qp/tests/sequences/README.md.
    #[arg(long, value_name = "PATH")]
    data: Vec<PathBuf>,
    /// Only groups whose name contains this, e.g. "attA" or "n=9".
    #[arg(long, value_name = "PART")]
    only: Vec<String>,
    /// Only solvers whose name contains this.
    #[arg(long, value_name = "PART")]
    solver: Vec<String>,
    /// Seconds for the hot pass of each solver on each group.
    #[arg(long, default_value_t = 1.0, value_name = "S")]
    budget: f64,
    /// A tenth of the time and no instruction counts.
    #[arg(long)]
    quick: bool,
    /// How to print.
    #[arg(long, value_enum, default_value_t = Format::Text)]
    format: Format,
    /// The processor to stay on; the one it starts on if not given.
    #[arg(long, value_name = "CPU")]
    cpu: Option<usize>,
    /// The child that callgrind watches.
    #[arg(long, hide = true)]
    counted: bool,
    /// What cargo passes to every bench.
    #[arg(long, hide = true)]
    bench: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Format {
    Text,
    Json,
}

impl Options {
    fn groups(&self) -> Result<Vec<Group>, Box<dyn core::error::Error>> {
        let own = Path::new(env!("CARGO_MANIFEST_DIR")).join("../services/lib/qp/tests/sequences");
        let mut groups = series::recorded(&[own])?;
        groups.extend(series::recorded(&self.data)?);
        groups.extend(live::groups());
        groups.retain(|group| chosen(&self.only, &group.name));
        if groups.is_empty() {
            return Err(format!("no group is named like --only {:?}", self.only).into());
        }
        Ok(groups)
    }

    fn entries(&self) -> Result<Vec<Entry>, Box<dyn core::error::Error>> {
        let entries: Vec<Entry> =
            contenders::ALL.into_iter().filter(|(name, _)| chosen(&self.solver, name)).collect();
        if entries.is_empty() {
            let names = contenders::ALL.map(|(name, _)| name).join(", ");
            return Err(
                format!("no solver is named like --solver {:?}: {names}", self.solver).into()
            );
        }
        Ok(entries)
    }

    fn effort(&self) -> Effort {
        let share = if self.quick { 0.1 } else { 1.0 };
        let budget_ns =
            core::time::Duration::from_secs_f64(self.budget.max(0.0) * share).as_nanos();
        Effort {
            budget_ns: u64::try_from(budget_ns).unwrap_or(u64::MAX),
            most_replays: 1000,
            cold_ticks: if self.quick { 30 } else { 200 },
        }
    }
}

fn chosen(parts: &[String], name: &str) -> bool {
    parts.is_empty() || parts.iter().any(|part| name.contains(part.as_str()))
}

/// Keeps this thread on one processor, and returns its number.
fn pin(cpu: Option<usize>) -> Result<usize, Box<dyn core::error::Error>> {
    use rustix::thread::{CpuSet, sched_getcpu, sched_setaffinity};
    let cpu = cpu.unwrap_or_else(sched_getcpu);
    let mut set = CpuSet::new();
    if cpu >= CpuSet::MAX_CPU {
        return Err(format!("--cpu {cpu} must be below {}", CpuSet::MAX_CPU).into());
    }
    set.set(cpu);
    sched_setaffinity(None, &set)
        .map_err(|error| format!("this process may not run on --cpu {cpu}: {error}"))?;
    Ok(cpu)
}

fn run(options: &Options) -> Result<(), Box<dyn core::error::Error>> {
    // Cargo starts a bench in the folder of its package; paths are meant from the workspace's.
    std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))?;
    let (groups, entries) = (options.groups()?, options.entries()?);
    if options.counted {
        // No clock and no processor number here: valgrind maps no vdso to ask for them.
        count::replay(&groups, &entries);
        return Ok(());
    }
    let cpu = pin(options.cpu)?;
    let floor = measure::floor(&groups[0], &mut contenders::Null);
    let mut results = Vec::new();
    for group in &groups {
        let one = |entry: &Entry| measure::figures(group, *entry, options.effort());
        results.push(entries.iter().map(one).collect::<Vec<_>>());
    }
    let counts = if options.quick {
        Err("no instruction counts with --quick".to_owned())
    } else {
        let arguments: Vec<String> = std::env::args().skip(1).collect();
        count::instructions(&groups, &entries, &arguments)
    };
    if let Ok(counts) = &counts {
        for (figures, counts) in results.iter_mut().flatten().zip(counts.iter().flatten()) {
            figures.instructions = Some(*counts);
        }
    }
    let report = report::Report { cpu, floor, groups: &groups, results, counts: counts.err() };
    let text = match options.format {
        Format::Text => report.text()?,
        Format::Json => report.json(),
    };
    Ok(std::io::stdout().write_all(text.as_bytes())?)
}

fn main() -> ExitCode {
    match run(&Options::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            let _ = writeln!(std::io::stderr(), "{error}");
            ExitCode::FAILURE
        }
    }
}
