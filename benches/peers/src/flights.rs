//! The same figures of morphquad's own executable, which flies a vehicle, its filter and both MPCs meanwhile.

use crate::Result;
use crate::table::Realtime;
use nix::sys::resource::{UsageWho, getrusage};
use serde_json::Value;
use std::os::unix::fs::MetadataExt as _;
use std::path::Path;
use std::process::Command;

const SCENARIO: &str = "figure8-morph";
/// The chain's rates: attitude loop at 500 Hz, position loop at 100 Hz.
const RATES: [&str; 6] = [
    "attitude_mpc.rate_hz=500",
    "attitude_mpc.prediction_horizon=60",
    "attitude_mpc.control_horizon=6",
    "position_mpc.rate_hz=100",
    "position_mpc.prediction_horizon=50",
    "position_mpc.control_horizon=5",
];
/// The path from sensor to motor, as `bench loops` calls it.
const PATH: &str = "imu > estimator > attitude-mpc > gate";

/// Rate of the attitude loop's commands \[Hz\], and length of a flight with a swap \[s\].
const COMMANDS_HZ: u64 = 500;
const SWAP_S: u64 = 12;

/// A flight in lockstep.
#[derive(Debug)]
pub struct Lockstep {
    /// Simulated seconds per second.
    pub speed: f64,
    /// Of the recording, per simulated second.
    pub bytes_per_s: Option<f64>,
    pub hash: String,
}

fn run(morphquad: &Path, arguments: &[&str]) -> Result<Value> {
    let mut command = Command::new(morphquad);
    command.args(arguments).args(["--format", "json"]);
    for rate in RATES {
        command.args(["--set", rate]);
    }
    let output =
        command.output().map_err(|e| format!("cannot start {}: {e}", morphquad.display()))?;
    serde_json::from_slice(&output.stdout).map_err(|_| {
        let stderr = String::from_utf8_lossy(&output.stderr);
        format!("{} {}: {stderr}", morphquad.display(), arguments.join(" ")).into()
    })
}

/// Flies by simulated time, in processes or in one.
pub fn lockstep(
    morphquad: &Path,
    seconds: u64,
    in_process: bool,
    record: Option<&Path>,
) -> Result<Lockstep> {
    let duration = format!("{seconds}s");
    let mut arguments = vec!["run", SCENARIO, "--for", &duration];
    if in_process {
        arguments.push("--in-process");
    }
    let folder = record.map(|folder| folder.display().to_string());
    match &folder {
        Some(folder) => arguments.extend(["--record", folder]),
        None => arguments.push("--no-record"),
    }
    let result = run(morphquad, &arguments)?;
    let bytes_per_s = match result["recording"].as_str() {
        Some(file) => Some(512.0 * std::fs::metadata(file)?.blocks() as f64 / seconds as f64),
        None => None,
    };
    Ok(Lockstep {
        speed: result["real_time_factor"].as_f64().ok_or("no real_time_factor")?,
        bytes_per_s,
        hash: result["hash"].as_str().unwrap_or_default().to_owned(),
    })
}

/// Flies by the wall clock. What a start costs the processor is in both flights and falls away.
pub fn realtime(morphquad: &Path, seconds: u64, fifo: bool) -> Result<Realtime> {
    let policy = if fifo { "realtime.policy=fifo" } else { "realtime.policy=other" };
    let fly = |seconds: u64| -> Result<(f64, u64)> {
        let before_s = children_s()?;
        let duration = format!("{seconds}s");
        let arguments = [
            "run",
            SCENARIO,
            "--clock",
            "realtime",
            "--no-record",
            "--for",
            &duration,
            "--set",
            policy,
        ];
        let result = run(morphquad, &arguments)?;
        let lost = result["missed_commands"].as_u64().ok_or("no missed_commands")?;
        Ok((children_s()? - before_s, lost))
    };
    let ((long_s, lost), (short_s, _)) = (fly(seconds + 2)?, fly(2)?);
    let duration = format!("{seconds}s");
    let policy = if fifo { "fifo" } else { "other" };
    let arguments =
        ["bench", "loops", SCENARIO, "--for", &duration, "--policy", policy, "--no-floor"];
    let result = run(morphquad, &arguments)?;
    let paths = result["report"]["paths"].as_array().ok_or("no paths")?;
    let path = paths.iter().find(|path| path["name"] == PATH).ok_or("no path to the gate")?;
    let of = |key: &str| path["total"]["flown"][key].as_f64().ok_or("no quantile");
    Ok(Realtime {
        p50_us: of("p50_us")?,
        p99_us: of("p99_us")?,
        cpu_ms: 1e3 * (long_s - short_s) / seconds as f64,
        lost,
        late: None,
    })
}

/// How many commands were missed or doubled in a flight in which the attitude controller is replaced, and of how many.
pub fn swap(morphquad: &Path) -> Result<[u64; 2]> {
    let swap = ["--swap", "attitude=attitude-lqr@4s"];
    let duration = format!("{SWAP_S}s");
    let arguments = ["run", SCENARIO, "--for", &duration, "--clock", "realtime", "--no-record"];
    let result = run(morphquad, &[&arguments[..], &swap[..]].concat())?;
    let of = |key: &str| result[key].as_u64().ok_or_else(|| format!("no {key}"));
    Ok([of("missed_commands")? + of("duplicated_ticks")?, SWAP_S * COMMANDS_HZ])
}

/// Processor time of all processes that have ended \[s\].
fn children_s() -> Result<f64> {
    let usage = getrusage(UsageWho::RUSAGE_CHILDREN)?;
    let s = |time: nix::sys::time::TimeVal| time.tv_sec() as f64 + time.tv_usec() as f64 * 1e-6;
    Ok(s(usage.user_time()) + s(usage.system_time()))
}
