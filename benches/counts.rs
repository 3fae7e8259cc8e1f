//! Instructions of the hot kernels, counted by valgrind: the same on a loud machine as on a quiet one.
//!
//! `cargo bench --bench counts` compares with `benches/counts.toml` and fails if a kernel needs more than
//! it did, by more than what libraries of another machine explain. After a change that is meant,
//! `MORPHQUAD_COUNTS=write cargo bench --bench counts` writes the file anew. Without valgrind (Debian:
//! `apt install valgrind`) it prints a note and counts nothing. Steps run without a look at the clock, whose fast path
//! valgrind does not have.

#[allow(dead_code, reason = "each bench uses its own part")]
mod tape;

use core::hint::black_box;
use record::encode;
use shared_types::{Role, StateEstimate};
use std::collections::BTreeMap;
use std::error::Error;
use std::io::Write as _;
use std::path::Path;
use std::process::{Command, ExitCode, Stdio};
use tape::{Flight, Replay};

/// Steps or samples of a kernel that are counted together.
const COUNTED: u64 = 240;
/// Logical time of the flight from which they get their inputs \[s\].
const FLOWN_S: f64 = 6.0;
/// By how much a count may differ: the C library copies memory as the processor likes it.
const TOLERANCE: f64 = 0.02;

type Counts = BTreeMap<String, u64>;

/// Kernels by name: a step of each loop, and a sample's way into a recording.
fn kernels() -> impl Iterator<Item = &'static str> {
    Role::STEPPING.into_iter().map(Role::label).chain(["encode"])
}

fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1);
    let done = match (arguments.next().as_deref(), arguments.next()) {
        (Some("--kernel"), Some(name)) => run(&name).map(|()| true),
        _ => compare(),
    };
    match done {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            let _ = writeln!(std::io::stderr(), "counts: {error}");
            ExitCode::FAILURE
        }
    }
}

/// The kernel, in the process that valgrind watches.
fn run(name: &str) -> Result<(), Box<dyn Error>> {
    if name == "encode" {
        counted_encode();
        return Ok(());
    }
    let flight = Flight::fly_for("figure8-morph", FLOWN_S)?;
    let node = flight.graph.nodes().iter().find(|node| node.role.label() == name);
    let mut replay = flight.replay(*node.ok_or("no such loop")?)?;
    // The first steps of a flight are not like the others.
    replay.step(COUNTED / 4);
    counted_steps(&mut replay);
    Ok(())
}

#[inline(never)]
fn counted_steps(replay: &mut Replay<'_>) {
    black_box(&mut *replay).step(COUNTED);
}

#[inline(never)]
fn counted_encode() {
    let (mut sample, mut out) = (StateEstimate::default(), Vec::with_capacity(4096));
    for sequence in 0..COUNTED {
        out.clear();
        sample.header.sequence = sequence;
        encode(black_box(&sample), &mut out);
        black_box(&out);
    }
}

fn has_valgrind() -> bool {
    let mut command = Command::new("valgrind");
    command.arg("--version").stdout(Stdio::null()).stderr(Stdio::null());
    command.status().is_ok_and(|status| status.success())
}

/// Counts every kernel and compares; true if none needs more than it did.
fn compare() -> Result<bool, Box<dyn Error>> {
    let mut out = std::io::stdout();
    if !has_valgrind() {
        writeln!(out, "no valgrind, so nothing is counted: `apt install valgrind`")?;
        return Ok(true);
    }
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("counts.toml");
    let counts = kernels()
        .map(|name| Ok((name.to_owned(), count(name)?)))
        .collect::<Result<Counts, Box<dyn Error>>>()?;
    if std::env::var("MORPHQUAD_COUNTS").is_ok_and(|what| what == "write") {
        let head = "# Instructions of a step, or of a sample's encoding: see counts.rs.\n";
        std::fs::write(&path, head.to_owned() + &toml::to_string(&counts)?)?;
    }
    let known: Counts = toml::from_str(&std::fs::read_to_string(&path)?)?;
    let mut good = true;
    writeln!(out, "{:<14}{:>12}{:>12}{:>9}", "kernel", "counted", "known", "change")?;
    for (name, counted) in &counts {
        let known = known.get(name).copied().unwrap_or(0);
        let change = *counted as f64 / known.max(1) as f64 - 1.0;
        let verdict = match change {
            change if change > TOLERANCE => "  more: see what has changed",
            change if change < -TOLERANCE => "  less: write the file anew",
            _ => "",
        };
        good &= change <= TOLERANCE;
        writeln!(out, "{name:<14}{counted:>12}{known:>12}{:>8.2}%{verdict}", 100.0 * change)?;
    }
    Ok(good)
}

/// Instructions of one step of a kernel.
fn count(name: &str) -> Result<u64, Box<dyn Error>> {
    let folder = tempfile::tempdir()?;
    let file = folder.path().join("out");
    let status = Command::new("valgrind")
        .args(["--tool=callgrind", "--collect-atstart=no", "--toggle-collect=*counted_*"])
        .arg(format!("--callgrind-out-file={}", file.display()))
        .arg(std::env::current_exe()?)
        .args(["--kernel", name])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status()?;
    if !status.success() {
        return Err(format!("valgrind could not run {name}: {status}").into());
    }
    let text = std::fs::read_to_string(file)?;
    let total = text.lines().find_map(|line| line.strip_prefix("totals: "));
    let total: u64 = total.ok_or("callgrind gave no totals")?.trim().parse()?;
    if total == 0 {
        return Err(format!("callgrind did not find {name}").into());
    }
    Ok(total / COUNTED)
}
