//! One command for all of it: `cargo bench --bench table` runs the benches of solve, step, wire, recorder and
//! hop, and the count of instructions, and writes `bench-results.md` (or `MORPHQUAD_TABLE=FILE`) with every
//! figure and the facts of the machine.

use doctor;
use record::Machine;
use serde_json::Value;
use std::error::Error;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

/// What is run, in order.
const BENCHES: [&str; 6] = ["solve", "step", "wire", "recorder", "hop", "counts"];
/// What of the machine explains figures.
const FACTS: [&str; 12] = [
    "version",
    "kernel",
    "preemption",
    "processors",
    "hypervisor",
    "load",
    "governor",
    "idle states",
    "clock source",
    "clock",
    "timers",
    "steal",
];

/// A figure of criterion, with its interval of confidence \[ns\].
struct Row {
    name: String,
    mean_ns: f64,
    interval_ns: [f64; 2],
}

fn main() -> Result<(), Box<dyn Error>> {
    // Cargo starts a bench in the folder of its package; paths are meant from the workspace's.
    std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))?;
    let cargo = std::env::var("CARGO").unwrap_or_else(|_| "cargo".to_owned());
    let mut own_output = String::new();
    for bench in BENCHES {
        let output = Command::new(&cargo).args(["bench", "--quiet", "--bench", bench]).output()?;
        if !output.status.success() {
            let why = String::from_utf8_lossy(&output.stderr);
            return Err(format!("the bench {bench} failed: {}", why.trim()).into());
        }
        own_output += &own_lines(bench, &String::from_utf8_lossy(&output.stdout));
    }
    let mut rows = Vec::new();
    collect(&target().join("criterion"), &mut rows);
    rows.sort_by(|a, b| a.name.cmp(&b.name));
    let file = std::env::var("MORPHQUAD_TABLE").unwrap_or_else(|_| "bench-results.md".to_owned());
    std::fs::write(&file, text(&rows, &own_output)?)?;
    writeln!(std::io::stdout(), "{} figures in {file}", rows.len())?;
    Ok(())
}

/// What a bench prints besides criterion's lines, which begin with a group or are indented.
fn own_lines(bench: &str, output: &str) -> String {
    let is_own = |line: &&str| {
        let criterions =
            ["time:", "thrpt:", "change:", "Found", "Benchmarking", "Performance", "No change"];
        bench == "counts"
            || (line.contains(": ")
                && !line.starts_with(' ')
                && !criterions.iter().any(|c| line.contains(c)))
    };
    output.lines().filter(is_own).map(|line| format!("{line}\n")).collect()
}

/// Where criterion leaves what it has measured.
fn target() -> PathBuf {
    let beside = std::env::current_exe().ok();
    let of_exe = beside.as_deref().and_then(|exe| exe.ancestors().nth(3)).map(Path::to_path_buf);
    std::env::var_os("CARGO_TARGET_DIR").map(PathBuf::from).or(of_exe).unwrap_or("target".into())
}

/// Every `new/estimates.json` below a folder.
fn collect(folder: &Path, rows: &mut Vec<Row>) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if path.is_dir() && entry.file_name() != "new" {
            collect(&path, rows);
        } else if path.is_dir() {
            rows.extend(row(&path));
        }
    }
}

fn row(new: &Path) -> Option<Row> {
    let json = |file: &str| -> Option<Value> {
        serde_json::from_str(&std::fs::read_to_string(new.join(file)).ok()?).ok()
    };
    let name = json("benchmark.json")?["full_id"].as_str()?.to_owned();
    let mean = json("estimates.json")?["mean"].clone();
    let bound = |key: &str| mean["confidence_interval"][key].as_f64();
    Some(Row {
        name,
        mean_ns: mean["point_estimate"].as_f64()?,
        interval_ns: [bound("lower_bound")?, bound("upper_bound")?],
    })
}

fn text(rows: &[Row], own_output: &str) -> Result<String, std::fmt::Error> {
    let mut out =
        String::from("# Benches\n\nWritten by `cargo bench --bench table`.\n\n## Machine\n\n");
    let Machine { cpu_model, .. } = Machine::read();
    writeln!(out, "| fact | value |\n|---|---|\n| processor model | {cpu_model} |")?;
    let examined = doctor::examine(&std::env::temp_dir());
    for finding in examined.findings.iter().filter(|finding| FACTS.contains(&finding.check)) {
        writeln!(out, "| {} | {} |", finding.check, finding.found)?;
    }
    writeln!(
        out,
        "\n## Means, with 95 % intervals\n\n| bench | ns | from | to |\n|---|---:|---:|---:|"
    )?;
    for Row { name, mean_ns, interval_ns: [from, to] } in rows {
        writeln!(out, "| `{name}` | {mean_ns:.1} | {from:.1} | {to:.1} |")?;
    }
    writeln!(out, "\n## What the benches say besides\n\n```text\n{}```", own_output)?;
    Ok(out)
}
