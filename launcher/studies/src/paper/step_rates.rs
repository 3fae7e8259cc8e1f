//! Test I: 50, 100 and 150 Hz, step of all angles to 0.2 rad, {20, 3}.

use super::measure::{crossing_s, deviation_rad, peak_rad, recovery_s};
use super::rig::{Experiment, Trajectory, World};
use super::{Check, Findings, PaperError, Run, SIZES, Section, TARGET_RAD, Test, cell, difference};
use attitude_mpc::TorqueBound;
use figures::results::Table;
use nalgebra::Vector3;
use vehicle::MorphAngle;

/// Rate \[Hz\], our `r_w`, and the paper's time \[s\] and peak \[rad\] of roll.
pub(super) const PRINTED: [(f64, f64, f64, f64); 3] =
    [(50.0, 10.0, 0.07, 0.209), (100.0, 0.25, 0.04, 0.208), (150.0, 0.02, 0.03, 0.202)];
/// What does not count as beyond the target \[rad\].
pub(super) const CREEP_RAD: f64 = 1e-5;
/// The one `r_w` for all rates.
const ONE_WEIGHT: f64 = 0.25;

pub(super) fn run() -> Result<Findings, PaperError> {
    let mut runs = Vec::new();
    let mut checks = Vec::new();
    let mut sections = vec![
        tuned(&mut runs, &mut checks)?,
        one_weight(&mut runs)?,
        every_size(&mut runs)?,
        among_rotors(&mut runs)?,
        lag_limits(&mut checks)?,
    ];
    sections[3].remarks.extend(ROTOR_REMARKS);
    checks.push(Check::bounds(&runs));
    let title = "Test I: operation frequencies, step of all angles to 0.2 rad, {Np, Nc} = {20, 3}";
    Ok(Findings { test: Test::One, title, sections, checks, runs, figures: Vec::new() })
}

/// Name of the run of the paper's loop.
pub(super) fn name(rate_hz: f64) -> String {
    format!("linear {rate_hz} Hz min")
}

/// When roll reaches the target, unless it only creeps up to it, and its peak.
pub(super) fn roll(trajectory: &Trajectory) -> (Option<f64>, f64) {
    let path = &trajectory.gamma_rad;
    let peak = peak_rad(path, 0);
    (crossing_s(path, 0, TARGET_RAD).filter(|_| peak > TARGET_RAD + CREEP_RAD), peak)
}

const HEADINGS: [&str; 8] = [
    "rate [Hz]",
    "r_w",
    "time: paper [s]",
    "ours",
    "difference",
    "peak: paper [rad]",
    "ours",
    "difference",
];

fn tuned(runs: &mut Vec<Run>, checks: &mut Vec<Check>) -> Result<Section, PaperError> {
    let mut table = Table::new(HEADINGS);
    for (rate, weight, time_s, peak) in PRINTED {
        let experiment = Experiment::paper(rate, weight, MorphAngle::MIN);
        let run = Run::new(name(rate), &experiment)?;
        let (time, peaked) = roll(&run.trajectory);
        table.push(compared(rate, weight, (time, time_s), (peaked, peak)));
        // What was printed has two and three decimals.
        let holds = time.is_some_and(|time| (time - time_s).abs() <= 0.005)
            && (peaked - peak).abs() <= 0.0005;
        let found = format!("{} s, {peaked:.4} rad", cell(time, 4));
        let claim =
            format!("{rate} Hz: reaches 0.2 rad in {time_s} s, peaks at {peak} rad, as printed");
        checks.push(Check::new(claim, found, holds));
        runs.push(run);
    }
    Ok(Section::new("test1-rates", "Smallest vehicle, linear plant as in the paper, roll", table)
        .remark("Time: first crossing of 0.2 rad, linear between samples; peak: over the samples. All three axes are alike.")
        .remark("The paper prints neither r_w nor bounds. Chosen: |u|, |du| <= m g L (yaw twice that), and an r_w per rate for which both columns round to the printed digits."))
}

fn compared(
    rate: f64,
    weight: f64,
    (time, time_s): (Option<f64>, f64),
    (peaked, peak): (f64, f64),
) -> [String; 8] {
    [
        rate.to_string(),
        weight.to_string(),
        time_s.to_string(),
        cell(time, 4),
        difference(time, time_s, 4),
        peak.to_string(),
        format!("{peaked:.4}"),
        difference(Some(peaked), peak, 4),
    ]
}

fn one_weight(runs: &mut Vec<Run>) -> Result<Section, PaperError> {
    let mut table = Table::new(HEADINGS);
    for (rate, _, time_s, peak) in PRINTED {
        let experiment = Experiment::paper(rate, ONE_WEIGHT, MorphAngle::MIN);
        let run = Run::new(format!("linear {rate} Hz min, one r_w"), &experiment)?;
        let (time, peaked) = roll(&run.trajectory);
        table.push(compared(rate, ONE_WEIGHT, (time, time_s), (peaked, peak)));
        runs.push(run);
    }
    Ok(Section::new("test1-one-weight", "The same with one r_w for all rates", table).remark(
        "Not matched: with one r_w only the peaks come near the printed ones, the times do not. \
         The loop depends on rho = r_w (I/dt^2)^2 and on u_max dt^2/I, and dt^-4 spans a factor \
         of 81 between 50 and 150 Hz.",
    ))
}

fn every_size(runs: &mut Vec<Run>) -> Result<Section, PaperError> {
    let mut table = Table::new([
        "rate [Hz]",
        "size",
        "r_w",
        "time [s]",
        "peak [rad]",
        "at equal rho: r_w",
        "time [s]",
        "peak [rad]",
    ]);
    for (rate, weight, ..) in PRINTED {
        for (size, beta) in SIZES {
            let fixed = Experiment::paper(rate, weight, beta);
            let mut scaled = fixed;
            scaled.law.scale_weight_with_inertia = true;
            let [fixed, scaled] = [
                Run::new(format!("linear {rate} Hz {size}, fixed r_w"), &fixed)?,
                Run::new(format!("linear {rate} Hz {size}, equal rho"), &scaled)?,
            ];
            let inertia = vehicle::VehicleParameters::default().inertia_kg_m2(beta).x / 1e-4;
            let [(time, peak), (scaled_time, scaled_peak)] =
                [&fixed, &scaled].map(|run| roll(&run.trajectory));
            table.push([
                rate.to_string(),
                size.to_owned(),
                weight.to_string(),
                cell(time, 4),
                format!("{peak:.4}"),
                format!("{:.5}", weight / (inertia * inertia)),
                cell(scaled_time, 4),
                format!("{scaled_peak:.4}"),
            ]);
            runs.extend([fixed, scaled]);
        }
    }
    Ok(Section::new("test1-sizes", "Every size, linear plant, roll", table)
        .remark("A dash: the angle creeps up to 0.2 rad from below. A fixed r_w makes the larger vehicles sluggish; equal rho is what flies."))
}

/// The law of a loop among rotors.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Law {
    /// The paper's, that knows neither lag nor delay.
    Paper,
    /// The one that flies.
    Flight,
    /// The one that flies, with bounds on each rotor's thrust instead of boxes on the torque.
    FlightByRotor,
}

/// Names, vehicles and laws of the loops among rotors.
pub(super) const ROTOR_CASES: [(&str, World, Law); 4] = [
    ("paper's law, rotors without lag", World::PROMPT, Law::Paper),
    ("paper's law, rotors as they are", World::FLIGHT, Law::Paper),
    ("flight law, rotors as they are", World::FLIGHT, Law::Flight),
    ("flight law, bounds per rotor", World::FLIGHT, Law::FlightByRotor),
];

const ROTOR_REMARKS: [&str; 4] = [
    "Rotors: thrusts in [0, m g] each, lag 15 ms, command 1 ms late, allocation keeps roll and pitch, then thrust, then yaw; 1 kHz integration.",
    "Box bounds on the torque are necessary, not sufficient: the rotors share them with thrust. A step of 0.2 rad on three axes at once asks for more than they have at hover thrust, so the axes differ; roll alone is listed too.",
    "Bounds per rotor: 0 <= F <= m g for each at the thrust of hover, in place of boxes on the torque.",
    "The paper's law does not know the lag (next table) and swings on, held only by its bounds. The flight law predicts lag and delay; its r_w grows with the square of the rate, 5 at 100 Hz, so it is slower there than the paper's.",
];

/// The experiment of a case of [`ROTOR_CASES`].
pub(super) fn among(case: (World, Law), rate: f64, weight: f64, beta: MorphAngle) -> Experiment {
    let (world, law) = case;
    let mut base = match law {
        Law::Paper => Experiment::paper(rate, weight, beta),
        Law::Flight | Law::FlightByRotor => Experiment::flight(rate, beta),
    };
    if law == Law::FlightByRotor {
        base.law.torque_bound = TorqueBound::RotorThrusts;
    }
    Experiment { world, duration_s: 1.0, ..base }
}

fn among_rotors(runs: &mut Vec<Run>) -> Result<Section, PaperError> {
    let mut table = Table::new([
        "law and vehicle",
        "axes",
        "rate [Hz]",
        "time [s]",
        "peak roll [rad]",
        "pitch",
        "yaw",
        "outcome",
    ]);
    for (label, world, law) in ROTOR_CASES {
        for (rate, weight, ..) in PRINTED {
            for (axes, target) in
                [("all", Vector3::repeat(TARGET_RAD)), ("roll", Vector3::x() * TARGET_RAD)]
            {
                let mut experiment = among((world, law), rate, weight, MorphAngle::MIN);
                experiment.target_rad = target;
                let run = Run::new(format!("{label}, {rate} Hz min, {axes}"), &experiment)?;
                let path = &run.trajectory.gamma_rad;
                let peak = |axis: usize| format!("{:.4}", peak_rad(path, axis));
                table.push([
                    label.to_owned(),
                    axes.to_owned(),
                    rate.to_string(),
                    cell(crossing_s(path, 0, TARGET_RAD), 4),
                    peak(0),
                    peak(1),
                    peak(2),
                    outcome(&run),
                ]);
                runs.push(run);
            }
        }
    }
    Ok(Section::new("test1-rotors", "Smallest vehicle, nonlinear plant with rotors", table)
        .remark("Settled: all angles within 4 mrad of the set point from then on."))
}

/// Largest lag searched for \[s\].
const LAG_END_S: f64 = 0.015;
/// A step that no bound limits \[rad\].
const SMALL_STEP_RAD: f64 = 1e-3;

fn lag_limits(checks: &mut Vec<Check>) -> Result<Section, PaperError> {
    let mut table = Table::new(["rate [Hz]", "r_w", "stable up to a lag of [ms]"]);
    let mut limits_s = Vec::with_capacity(PRINTED.len());
    for (rate, weight, ..) in PRINTED {
        let limit_s = lag_limit_s(rate, weight)?;
        limits_s.push(limit_s);
        let limit = if limit_s < LAG_END_S {
            format!("{:.2}", limit_s * 1e3)
        } else {
            "at least 15".into()
        };
        table.push([rate.to_string(), weight.to_string(), limit]);
    }
    checks.push(Check::new(
        "the paper's law at 100 Hz and r_w 0.25 is unstable with more than 1.7 ms of rotor lag",
        format!("stable up to {:.2} ms", limits_s[1] * 1e3),
        (1.6e-3..1.75e-3).contains(&limits_s[1]),
    ));
    Ok(Section::new("test1-lag", "How much unmodelled lag the paper's law survives", table)
        .remark("Smallest vehicle, nonlinear plant, no delay, roll step of 1 mrad: stable if the error is smaller from 1.5 to 2 s than from 0.2 to 0.4 s. Rotors of this size have 10 to 30 ms; `morphquad study stability` maps lag, inertia and delay."))
}

/// The lag \[s\] at which the answer to a small step no longer dies out, by bisection.
fn lag_limit_s(rate: f64, weight: f64) -> Result<f64, PaperError> {
    let stable = |lag_s: f64| -> Result<bool, PaperError> {
        let mut experiment = Experiment::paper(rate, weight, MorphAngle::MIN);
        experiment.world = World::Rotors { lag_s, delay_ns: 0 };
        experiment.target_rad = Vector3::x() * SMALL_STEP_RAD;
        experiment.duration_s = 2.0;
        let flown = experiment.run()?;
        if flown.lost_s.is_some() {
            return Ok(false);
        }
        let path = flown.gamma_rad;
        let swing = |from_s: f64, to_s: f64| {
            let part: Vec<_> = path.iter().filter(|(t, _)| *t <= to_s).copied().collect();
            deviation_rad(&part, 0, SMALL_STEP_RAD, from_s)
        };
        // Less than the step itself: a swing at its largest grows no more.
        Ok(swing(1.5, 2.0) <= swing(0.2, 0.4).min(SMALL_STEP_RAD))
    };
    if stable(LAG_END_S)? {
        return Ok(LAG_END_S);
    }
    let (mut good, mut bad) = (0.0, LAG_END_S);
    for _ in 0..11 {
        let middle = 0.5 * (good + bad);
        if stable(middle)? { good = middle } else { bad = middle }
    }
    Ok(good)
}

/// Settled, swinging on or lost, as text.
pub(super) fn outcome(run: &Run) -> String {
    let Run { experiment, trajectory, .. } = run;
    if let Some(lost_s) = trajectory.lost_s {
        return format!("unstable, tumbles at {lost_s:.2} s");
    }
    let path = &trajectory.gamma_rad;
    if let Some(settled_s) = recovery_s(path, &experiment.target_rad, 0.0) {
        return format!("settled at {settled_s:.3} s");
    }
    let last = experiment.duration_s - 0.5;
    let swing = (0..3)
        .map(|axis| deviation_rad(path, axis, experiment.target_rad[axis], last))
        .fold(0.0, f64::max);
    format!("unstable, swings by {swing:.2} rad")
}
