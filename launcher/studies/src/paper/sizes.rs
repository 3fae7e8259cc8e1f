//! Test III: the three sizes without and with the disturbance, 100 Hz, {20, 3}.

use super::measure::{deviation_rad, recovery_s};
use super::rig::{Blow, Experiment};
use super::step_rates::{ROTOR_CASES, among, outcome, roll};
use super::{Check, Findings, PaperError, Run, SIZES, Section, TARGET_RAD, Test, cell};
use figures::results::Table;
use nalgebra::Vector3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use vehicle::VehicleParameters;

const RATE_HZ: f64 = 100.0;
/// The `r_w` for which the disturbance is gone at the time that the paper gives.
pub(super) const WEIGHT: f64 = 0.05;
/// Instant of the disturbance \[s\].
pub(super) const STRUCK_S: f64 = 0.3;
/// Torque of rd = 1 \[N m\].
const TORQUE_NM: f64 = 0.1;
/// Random disturbances tried.
const SEEDS: u64 = 20;
/// One standard deviation of each component of rd.
const RD: Vector3<f64> = Vector3::new(1.0, 1.0, 0.1);

pub(super) fn run() -> Result<Findings, PaperError> {
    let mut runs = Vec::new();
    let mut checks = Vec::new();
    let sections = vec![
        undisturbed(&mut runs)?,
        disturbed(&mut runs, &mut checks)?,
        readings(&mut runs)?,
        seeds(&mut runs, &mut checks)?,
        among_rotors(&mut runs)?,
    ];
    checks.push(Check::bounds(&runs));
    let title = "Test III: sizes and robustness, 100 Hz, {Np, Nc} = {20, 3}";
    Ok(Findings { test: Test::Three, title, sections, checks, runs, figures: Vec::new() })
}

/// Name of the undisturbed run, and of the disturbed one.
pub(super) fn name(size: &str, struck: bool) -> String {
    format!("linear {size}{}", if struck { ", struck" } else { "" })
}

fn paper(beta: vehicle::MorphAngle) -> Experiment {
    Experiment { duration_s: 0.6, ..Experiment::paper(RATE_HZ, WEIGHT, beta) }
}

fn undisturbed(runs: &mut Vec<Run>) -> Result<Section, PaperError> {
    let mut table = Table::new([
        "size",
        "r_w",
        "bound on u and du [N m]",
        "bound / I [rad/s2]",
        "time [s]",
        "peak [rad]",
        "within 4 mrad [s]",
        "error at 0.6 s [rad]",
    ]);
    let vehicle = VehicleParameters::default();
    for weight in [WEIGHT, 0.25] {
        for (size, beta) in SIZES {
            let mut experiment = paper(beta);
            experiment.law.increment_weight = weight;
            let mut called = name(size, false);
            if weight > WEIGHT {
                called.push_str(", r_w 0.25");
            }
            let run = Run::new(called, &experiment)?;
            let path = &run.trajectory.gamma_rad;
            let bound = run.trajectory.samples[0].output.torque_bound_nm.x;
            let (time, peak) = roll(&run.trajectory);
            table.push([
                size.to_owned(),
                weight.to_string(),
                format!("{bound:.4}"),
                format!("{:.0}", bound / vehicle.inertia_kg_m2(beta).x),
                cell(time, 4),
                format!("{peak:.4}"),
                cell(recovery_s(path, &experiment.target_rad, 0.0), 2),
                format!("{:.1e}", deviation_rad(path, 0, TARGET_RAD, 0.6)),
            ]);
            runs.push(run);
        }
    }
    Ok(Section::new("test3-sizes", "Without disturbance, linear plant, roll", table)
        .remark("The paper shows curves within their bounds and \"very small tracking error\", no numbers. A dash: the angle creeps up to 0.2 rad from below."))
}

fn disturbed(runs: &mut Vec<Run>, checks: &mut Vec<Check>) -> Result<Section, PaperError> {
    let mut table = Table::new([
        "size",
        "recovery: paper [s]",
        "ours",
        "largest deviation: roll [rad]",
        "yaw [rad]",
        "largest |u| / bound",
    ]);
    let mut found = Vec::new();
    for (size, beta) in SIZES {
        let struck = Blow::Torque(RD * TORQUE_NM);
        let experiment = Experiment { blow: Some((STRUCK_S, struck)), ..paper(beta) };
        let run = Run::new(name(size, true), &experiment)?;
        let path = &run.trajectory.gamma_rad;
        let recovery = recovery_s(path, &experiment.target_rad, STRUCK_S);
        let [roll, yaw] = [0, 2].map(|axis| deviation_rad(path, axis, TARGET_RAD, STRUCK_S));
        let after = run.trajectory.samples.iter().filter(|sample| sample.t_s > STRUCK_S);
        let used = after.map(|sample| sample.output.torque_nm.x.abs()).fold(0.0, f64::max);
        let bound = run.trajectory.samples[0].output.torque_bound_nm.x;
        table.push([
            size.to_owned(),
            "0.05-0.07".to_owned(),
            cell(recovery, 2),
            format!("{roll:.4}"),
            format!("{yaw:.4}"),
            format!("{:.2}", used / bound),
        ]);
        found.push((recovery, roll));
        runs.push(run);
    }
    let recoveries: Vec<String> = found.iter().map(|(recovery, _)| cell(*recovery, 2)).collect();
    checks.push(Check::new(
        "the disturbance is gone within 0.05 to 0.07 s at every size",
        format!("{} s for min, med, max", recoveries.join(", ")),
        found.iter().all(|(r, _)| r.is_some_and(|s| (0.05 - 1e-9..=0.07 + 1e-9).contains(&s))),
    ));
    checks.push(Check::new(
        "the larger the vehicle, the smaller the deviation",
        format!("{:.4}, {:.4}, {:.4} rad", found[0].1, found[1].1, found[2].1),
        found[0].1 > found[1].1 && found[1].1 > found[2].1,
    ));
    Ok(Section::new("test3-disturbance", "Disturbed at 0.3 s, linear plant, r_w 0.05", table)
        .remark("Read as: rd = (1, 1, 0.1) times 0.1 N m, a torque over one sample; recovered: all angles back within 4 mrad of 0.2 rad. The paper gives neither unit nor length of rd.")
        .remark("The paper's reason, the longer arm, is not ours: the bound on the torque per inertia falls with size. The larger inertia is what keeps the deviation small.")
        .remark("Not matched: \"and stabilize faster\". The larger vehicles deviate less and take as long."))
}

fn readings(runs: &mut Vec<Run>) -> Result<Section, PaperError> {
    let kinds = [
        ("torque over one sample, 0.1 rd N m", Blow::Torque(RD * TORQUE_NM)),
        ("torque over one sample, 1 rd N m", Blow::Torque(RD)),
        ("jump of the rate, rd rad/s", Blow::Rate(RD)),
        ("jump of the angle, rd rad", Blow::Angle(RD)),
    ];
    let mut table = Table::new([
        "rd = (1, 1, 0.1) read as",
        "size",
        "recovery [s]",
        "deviation of roll [rad]",
        "outcome",
    ]);
    for (kind, blow) in kinds {
        for (size, beta) in SIZES {
            let experiment = Experiment { blow: Some((STRUCK_S, blow)), ..paper(beta) };
            let run = Run::new(format!("linear {size}, {kind}"), &experiment)?;
            let path = &run.trajectory.gamma_rad;
            let lost_s = run.trajectory.lost_s;
            let outcome = lost_s.map_or_else(
                || "comes back".to_owned(),
                |lost| format!("lost at {lost:.2} s: pitch beyond 1.2 rad"),
            );
            let recovery = recovery_s(path, &experiment.target_rad, STRUCK_S);
            table.push([
                kind.to_owned(),
                size.to_owned(),
                cell(recovery.filter(|_| lost_s.is_none()), 2),
                format!("{:.4}", deviation_rad(path, 0, TARGET_RAD, STRUCK_S)),
                outcome,
            ]);
            runs.push(run);
        }
    }
    Ok(Section::new("test3-readings", "What else the disturbance could be", table)
        .remark("Only the first fits the printed 0.05 to 0.07 s with deviations that fall with size: 1 N m tumbles the small vehicle (beyond 1.2 rad of pitch (5) has no meaning), a jump of the rate is hardly seen and grows with size, a jump of the angle is the same for all and takes 0.15 s and more."))
}

/// rd by seed, as the paper draws it.
fn random_rd(seed: u64) -> Vector3<f64> {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    let normals: [f64; 3] = core::array::from_fn(|_| StandardNormal.sample(&mut generator));
    Vector3::from(normals).component_mul(&RD)
}

fn seeds(runs: &mut Vec<Run>, checks: &mut Vec<Check>) -> Result<Section, PaperError> {
    let mut table = Table::new([
        "seed",
        "rd x",
        "y",
        "z",
        "recovery: min [s]",
        "med [s]",
        "max [s]",
        "deviation: min [rad]",
        "med [rad]",
        "max [rad]",
    ]);
    let (mut ordered, mut slowest) = (0, 0.0_f64);
    for seed in 1..=SEEDS {
        let rd = random_rd(seed);
        let (mut recoveries, mut deviations) = (Vec::new(), Vec::new());
        for (size, beta) in SIZES {
            let struck = Blow::Torque(rd * TORQUE_NM);
            let experiment = Experiment { blow: Some((STRUCK_S, struck)), ..paper(beta) };
            let run = Run::new(format!("linear {size}, seed {seed}"), &experiment)?;
            let path = &run.trajectory.gamma_rad;
            let recovery = recovery_s(path, &experiment.target_rad, STRUCK_S);
            slowest = slowest.max(recovery.unwrap_or(f64::INFINITY));
            recoveries.push(cell(recovery, 2));
            deviations.push(
                (0..3)
                    .map(|axis| deviation_rad(path, axis, TARGET_RAD, STRUCK_S))
                    .fold(0.0, f64::max),
            );
            runs.push(run);
        }
        ordered += u64::from(deviations.is_sorted_by(|a, b| a > b));
        let deviations = deviations.into_iter().map(|deviation| format!("{deviation:.4}"));
        let head = [seed.to_string()].into_iter().chain(rd.iter().map(|rd| format!("{rd:.3}")));
        table.push(head.chain(recoveries).chain(deviations));
    }
    checks.push(Check::new(
        "random rd: recovered within 0.1 s, the larger the vehicle the smaller the deviation",
        format!("slowest {slowest:.2} s; ordered for {ordered} of {SEEDS} seeds"),
        ordered == SEEDS && slowest <= 0.1 + 1e-9,
    ));
    Ok(Section::new("test3-seeds", "Random rd: normal, standard deviation 1 (yaw 0.1), linear plant", table)
        .remark("The paper draws rd at random and shows one draw. Large draws take longer than its 0.07 s, small ones hardly leave the band of 4 mrad."))
}

fn among_rotors(runs: &mut Vec<Run>) -> Result<Section, PaperError> {
    let mut table = Table::new([
        "law and vehicle",
        "size",
        "recovery [s]",
        "deviation of roll [rad]",
        "outcome",
    ]);
    for (label, world, law) in ROTOR_CASES {
        for (size, beta) in SIZES {
            let mut experiment = among((world, law), RATE_HZ, WEIGHT, beta);
            experiment.target_rad = Vector3::zeros();
            experiment.blow = Some((STRUCK_S, Blow::Torque(RD * TORQUE_NM)));
            let run = Run::new(format!("{label}, {size}, struck"), &experiment)?;
            let path = &run.trajectory.gamma_rad;
            let recovery = recovery_s(path, &experiment.target_rad, STRUCK_S);
            table.push([
                label.to_owned(),
                size.to_owned(),
                cell(recovery, 3),
                format!("{:.4}", deviation_rad(path, 0, 0.0, STRUCK_S)),
                outcome(&run),
            ]);
            runs.push(run);
        }
    }
    Ok(Section::new("test3-rotors", "Disturbed in hover, nonlinear plant with rotors", table)
        .remark("In hover, because the step itself already takes what the rotors have. The smallest vehicle is thrown by 0.1 rad in the sample of the torque, before any law can answer."))
}
