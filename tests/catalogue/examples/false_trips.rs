//! Flies every controller as an owner that is watched for the whole flight, where much is asked of it: gusts, pushes,
//! orders to go somewhere and to fold, and a vehicle that is not what its controllers believe. A trip is a false one if
//! the same flight passes without the monitor.
//!
//! `false_trips [attitude|position] [python] [SEEDS]`: the shipped controllers with 50 seeds if nothing is given;
//! `python` adds those in Python, which need the environment of `services/attitude-python/README.md`. Run it after
//! `cargo build --release --workspace --examples --bins`.
#![expect(clippy::print_stdout, reason = "its table is for people")]

use catalogue::limits::upper_limit;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use scenario::services::names_for;
use serde_json::Value;
use shared_types::Slot;
use std::collections::BTreeMap;
use std::error::Error;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// The scenarios with a position loop, and those of the attitude loop alone.
const SCENARIOS: [(&str, bool); 4] =
    [("hover", true), ("figure8-morph", true), ("attitude-step", false), ("disturbance", false)];

/// Uniform draws of what a flight meets.
struct Draws(ChaCha8Rng);

impl Draws {
    fn number(&mut self, least: f64, most: f64) -> f64 {
        // The upper 53 bits are a number from 0 to 1 without rounding.
        let share = (self.0.next_u64() >> 11) as f64 / (1_u64 << 53) as f64;
        least + share * (most - least)
    }

    fn vector(&mut self, most: f64) -> [f64; 3] {
        core::array::from_fn(|_| self.number(-most, most))
    }
}

/// One controller as the watched owner in one flight.
struct Case {
    slot: Slot,
    controller: String,
    scenario: &'static str,
    seed: u64,
    /// Everything that the seed has drawn, as `morphquad run` takes it.
    arguments: Vec<String>,
}

/// What a seed makes of a flight with a position loop: the ranges of `launcher/campaigns/robustness.toml`, gusts, one
/// disturbance of each kind that a user can order, and in two of three flights orders.
fn far(draws: &mut Draws, seed: u64) -> Vec<String> {
    let [east, north, _] = draws.vector(3.0);
    let gust = draws.number(0.0, 1.5);
    let event = match seed % 6 {
        0 => format!(
            "{{kind=\"pulse\",at_s=4.5,duration_s=0.5,load={{force_w_n={:?}}}}}",
            draws.vector(0.4)
        ),
        1 => format!(
            "{{kind=\"pulse\",at_s=4.5,duration_s=0.2,load={{torque_b_nm={:?}}}}}",
            draws.vector(0.01)
        ),
        2 => format!("{{kind=\"kick\",at_s=4.5,body_rate_b_rad_s={:?}}}", draws.vector(1.0)),
        3 => format!("{{kind=\"payload\",at_s=4.5,mass_kg={:?}}}", draws.number(0.0, 0.03)),
        4 => format!(
            "{{kind=\"rotor_efficiency\",at_s=4.5,rotor={},efficiency={:?}}}",
            1 + seed % 4,
            draws.number(0.85, 1.0)
        ),
        _ => format!("{{kind=\"step\",at_s=4.5,load={{force_w_n={:?}}}}}", draws.vector(0.3)),
    };
    let mut arguments = owned(&[
        "--for",
        "12s",
        "--set",
        &format!(
            "disturbance_injector.script=[{{kind=\"wind\",mean_w_m_s=[{east:?},{north:?},0.0],\
             sigma_m_s=[{gust:?},{gust:?},{:?}]}},{event}]",
            0.3 * gust
        ),
        "--set",
        &format!("plant.mismatch.mass_scale={:?}", draws.number(0.9, 1.1)),
    ]);
    arguments.extend(mismatch(draws));
    if !seed.is_multiple_of(3) {
        let [x_m, y_m, z_m] = draws.vector(1.0);
        let (yaw_deg, morph_deg) = (draws.number(-90.0, 90.0), draws.number(45.0, 160.0));
        let over_s = draws.number(0.3, 2.0);
        arguments.extend(owned(&[
            "--goto",
            &format!("{x_m:.3},{y_m:.3},{:.3},{yaw_deg:.1}@4s", 1.5 + 0.5 * z_m),
            "--morph",
            &format!("{morph_deg:.1}@7s,over={over_s:.2}s"),
        ]));
    }
    arguments
}

/// The same without a position loop: the step, and a pulse after it.
fn near(draws: &mut Draws, scenario: &str) -> Vec<String> {
    let morph_deg = draws.number(45.0, 160.0);
    let mut arguments = owned(&[
        "--for",
        "3s",
        "--set",
        "pilot.at_s=1.0",
        "--set",
        &format!("start.morph_angle_deg={morph_deg:?}"),
    ]);
    if scenario == "disturbance" {
        arguments.extend(owned(&[
            "--set",
            "disturbance_injector.script=[{kind=\"rd\",at_s=1.3,duration_s=0.01,scale_nm=0.1,rd=[1.0,1.0,0.1]}]",
        ]));
    }
    arguments.extend(mismatch(draws));
    arguments
}

fn mismatch(draws: &mut Draws) -> Vec<String> {
    owned(&[
        "--set",
        &format!("plant.mismatch.inertia_scale={:?}", draws.number(0.8, 1.25)),
        "--set",
        &format!("plant.mismatch.rotor_lag_s={:?}", draws.number(0.015, 0.02)),
    ])
}

fn owned(arguments: &[&str]) -> Vec<String> {
    arguments.iter().map(|argument| (*argument).to_owned()).collect()
}

fn cases(slots: &[Slot], python: bool, seeds: u64) -> Vec<Case> {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut cases = Vec::new();
    for &slot in slots {
        let in_python = format!("../../services/attitude-python/{}_pd.py", slot.label());
        let in_python = python.then(|| here.join(in_python).display().to_string());
        for controller in names_for(slot.role()).map(str::to_owned).chain(in_python) {
            for (scenario, has_position) in SCENARIOS {
                if !has_position && slot == Slot::Position {
                    continue;
                }
                for seed in 1..=seeds {
                    let mut draws = Draws(ChaCha8Rng::seed_from_u64(seed));
                    let arguments = if has_position {
                        far(&mut draws, seed)
                    } else {
                        near(&mut draws, scenario)
                    };
                    let controller = controller.clone();
                    cases.push(Case { slot, controller, scenario, seed, arguments });
                }
            }
        }
    }
    cases
}

/// What a flight came to.
#[derive(Debug)]
struct Flown {
    passed: bool,
    flipped: bool,
    taken_back: bool,
    outcome: String,
}

/// Flies a case; the owner has a rollback window without an end, so that it is watched throughout.
fn fly(morphquad: &Path, case: &Case, is_watched: bool) -> Result<Flown, Box<dyn Error>> {
    let Case { slot, controller, scenario, seed, arguments } = case;
    let output = Command::new(morphquad)
        .args(["run", scenario, "--in-process", "--no-record", "--format", "json"])
        .args(["--seed", &seed.to_string()])
        .args(["--set", &format!("monitor.enabled={is_watched}")])
        .args(["--set", "rehearsal.wall_max_s=600"])
        .arg("--swap")
        .arg(format!(
            "{}={controller}@50ms,shadow=400ms,rollback=60s,no-rehearsal,force",
            slot.label()
        ))
        .args(arguments)
        .stdin(Stdio::null())
        .output()?;
    let stderr = String::from_utf8_lossy(&output.stderr);
    let summary: Value = serde_json::from_slice(&output.stdout)
        .map_err(|error| format!("no summary ({error}): {stderr}"))?;
    let swap = summary["swaps"].get(0).ok_or("no swap")?;
    Ok(Flown {
        passed: summary["line"].as_str().is_some_and(|line| line.starts_with("PASSED")),
        flipped: swap["flipped_s"].is_number(),
        taken_back: swap["ended"] == "taken-back",
        outcome: swap["outcome"].as_str().unwrap_or_default().to_owned(),
    })
}

/// Flights of one controller in one scenario.
#[derive(Debug, Default)]
struct Row {
    flights: u32,
    commanded: u32,
    passed: u32,
    tripped: u32,
    falsely: u32,
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let is_known = |argument: &String| {
        Slot::named(argument).is_some() || argument == "python" || argument.parse::<u64>().is_ok()
    };
    if let Some(unknown) = arguments.iter().find(|argument| !is_known(argument)) {
        return Err(
            format!("`{unknown}` is neither a slot, a number of seeds, nor `python`").into()
        );
    }
    let only = arguments.iter().find_map(|argument| Slot::named(argument));
    let slots: Vec<Slot> =
        Slot::ALL.into_iter().filter(|slot| only.is_none_or(|only| only == *slot)).collect();
    let seeds = arguments.iter().find_map(|argument| argument.parse().ok()).unwrap_or(50);
    let has_python = arguments.iter().any(|argument| argument == "python");
    let cases = cases(&slots, has_python, seeds);
    let morphquad = executable()?;
    let (next, rows) = (AtomicUsize::new(0), Mutex::new(BTreeMap::<(String, &str), Row>::new()));
    std::thread::scope(|scope| {
        for _ in 0..std::thread::available_parallelism().map_or(1, usize::from) {
            scope.spawn(|| {
                while let Some(case) = cases.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let watched = fly(&morphquad, case, true).expect("a flight");
                    let falsely = watched.taken_back
                        && fly(&morphquad, case, false).expect("a flight").passed;
                    note(case, &watched, falsely, &mut rows.lock().expect("no panic"));
                }
            });
        }
    });
    let mut all = Row::default();
    println!(
        "{:<60} {:>7} {:>9} {:>6} {:>7} {:>7}",
        "owner", "flights", "commanded", "passed", "tripped", "falsely"
    );
    for ((owner, scenario), row) in &rows.into_inner().expect("no panic") {
        let name = format!("{owner} in {scenario}");
        let Row { flights, commanded, passed, tripped, falsely } = row;
        println!("{name:<60} {flights:>7} {commanded:>9} {passed:>6} {tripped:>7} {falsely:>7}");
        all.flights += flights;
        all.commanded += commanded;
        all.falsely += falsely;
    }
    println!(
        "{} false trips in {} flights whose owner commanded (at most {:.2} % at 95 %), of {} flown",
        all.falsely,
        all.commanded,
        100.0 * upper_limit(all.falsely, all.commanded),
        all.flights
    );
    Ok(())
}

fn note(case: &Case, flown: &Flown, falsely: bool, rows: &mut BTreeMap<(String, &str), Row>) {
    let Case { slot, controller, scenario, seed, .. } = case;
    let name = Path::new(controller).file_name().unwrap_or_default().to_string_lossy();
    let row = rows.entry((format!("{} {name}", slot.label()), *scenario)).or_default();
    row.flights += 1;
    row.commanded += u32::from(flown.flipped);
    row.passed += u32::from(flown.passed);
    row.tripped += u32::from(flown.taken_back);
    row.falsely += u32::from(falsely);
    if flown.taken_back || !flown.flipped {
        let word = if falsely { "FALSE" } else { "" };
        println!("{} {name} in {scenario}, seed {seed}: {} {word}", slot.label(), flown.outcome);
    }
}

/// The executable `morphquad` of this build.
fn executable() -> Result<PathBuf, Box<dyn Error>> {
    let own = std::env::current_exe()?;
    let built = own.parent().and_then(Path::parent).ok_or("a target folder")?;
    Ok(built.join("morphquad"))
}
