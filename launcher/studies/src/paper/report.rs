//! What was found, for the terminal, for machines and as files.

use super::rig::{Blow, Experiment, Sample, World};
use super::{Check, Findings, Run};
use attitude_mpc::{Basis, HorizonChoice, SolverKind, TorqueBound};
use figures::results::{Document, ResultsError, ResultsFolder, Table, capital};
use nalgebra::Vector3;
use serde_json::{Value, json};
use std::fmt::{self, Write as _};

/// What a remark is wrapped to.
const WIDTH: usize = 100;

/// True if every check holds.
#[must_use]
pub fn holds(findings: &[Findings]) -> bool {
    findings.iter().flat_map(|found| &found.checks).all(|check| check.holds)
}

impl fmt::Display for Findings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}\n{}", self.title, "=".repeat(self.title.chars().count()))?;
        for section in &self.sections {
            writeln!(f, "\n{}\n", section.title)?;
            write!(f, "{}", section.table)?;
            for remark in &section.remarks {
                writeln!(f, "{}", wrapped(remark, "* "))?;
            }
        }
        writeln!(f)?;
        for check in &self.checks {
            let verdict = if check.holds { "holds " } else { "FAILS " };
            writeln!(f, "{}", wrapped(&format!("{}: {}", check.claim, check.found), verdict))?;
        }
        Ok(())
    }
}

/// `text` in lines that begin with `lead`, or as much blank.
fn wrapped(text: &str, lead: &str) -> String {
    let mut lines = lead.to_owned();
    let mut column = lead.len();
    for (index, word) in text.split_whitespace().enumerate() {
        let length = word.chars().count();
        if index > 0 && column + 1 + length > WIDTH {
            let _ = write!(lines, "\n{:1$}", "", lead.len());
            column = lead.len();
        } else if index > 0 {
            lines.push(' ');
            column += 1;
        }
        lines.push_str(word);
        column += length;
    }
    lines
}

/// Everything but the trajectories.
#[must_use]
pub fn summary(findings: &[Findings]) -> Value {
    let test = |found: &Findings| {
        let sections = found.sections.iter().map(|section| {
            let body = json!({
                "title": section.title,
                "rows": section.table.to_json(),
                "remarks": section.remarks,
                "reproducible": section.reproducible,
            });
            (section.name.to_owned(), body)
        });
        json!({
            "test": found.test.number(),
            "title": found.title,
            "checks": found.checks,
            "sections": sections.collect::<serde_json::Map<_, _>>(),
        })
    };
    json!({ "holds": holds(findings), "tests": findings.iter().map(test).collect::<Vec<_>>() })
}

/// All of it as one page: verdicts, what is not matched and why, figures, tables.
#[must_use]
pub fn page(findings: &[Findings]) -> String {
    let checks = || findings.iter().flat_map(|found| &found.checks);
    let held = checks().filter(|check| check.holds).count();
    let remarks = findings.iter().flat_map(|found| &found.sections).flat_map(|s| &s.remarks);
    let unmatched: Vec<_> = remarks.filter_map(|remark| remark.strip_prefix(NOT_MATCHED)).collect();
    let verdict = format!(
        "{held} of {} claims that are checked hold; of {} more the reasons are below why they cannot be matched.",
        checks().count(),
        unmatched.len()
    );
    let mut page = Document::new("morphquad paper").verdict(holds(findings), &verdict);
    page = page.paragraph(
        "Attitude control for morphing quadrotor through model predictive control with constraints (Zhao et \
         al.): Tests I to III run again. Crosses, dotted lines, grey bands and dashed ranges in the figures, and \
         the columns named after the paper, are the printed numbers; everything else is ours.",
    );
    if !unmatched.is_empty() {
        page = page.heading("What cannot be matched");
    }
    for remark in unmatched {
        page = page.paragraph(&capital(remark.trim_start()));
    }
    for found in findings {
        page = page.heading(found.title);
        let mut claims = Table::new(["claim", "found", ""]);
        for Check { claim, found, holds } in &found.checks {
            let verdict = if *holds { "holds" } else { "FAILS" };
            claims.push([claim.as_str(), found, verdict]);
        }
        page = page.table(&claims);
        for (_, figure) in &found.figures {
            page = page.figure(figure);
        }
        for section in &found.sections {
            page = page.subheading(&section.title).table(&section.table);
            for remark in &section.remarks {
                page = page.paragraph(remark);
            }
        }
    }
    page.to_html()
}

/// Begins a remark about what the paper states and is not found.
const NOT_MATCHED: &str = "Not matched:";

/// Writes tables, trajectories and pictures of a test.
///
/// # Errors
/// A file cannot be written.
pub fn write(found: &Findings, folder: &mut ResultsFolder) -> Result<(), ResultsError> {
    for section in &found.sections {
        folder.table(section.name, &section.table)?;
    }
    let name = format!("test{}-trajectories", found.test.number());
    folder.table(&name, &samples(&found.runs))?;
    let runs: Vec<Value> = found.runs.iter().map(run_json).collect();
    folder.write(&format!("{name}.json"), format!("{}\n", Value::from(runs)).as_bytes())?;
    let among_rotors = |run: &&Run| run.experiment.world != World::Linear;
    if found.runs.iter().any(|run| among_rotors(&run)) {
        let table = paths(found.runs.iter().filter(among_rotors));
        folder.table(&format!("test{}-rotors-1khz", found.test.number()), &table)?;
    }
    for (name, figure) in &found.figures {
        folder.figure(name, figure)?;
    }
    Ok(())
}

const NUMBERS: [&str; 5] = ["u", "du", "u_max", "du_max", "du_relaxed"];

fn numbers(sample: &Sample) -> [Vector3<f64>; 5] {
    let output = &sample.output;
    [
        output.torque_nm,
        sample.increment_nm(),
        output.torque_bound_nm,
        output.increment_bound_nm,
        output.relaxation_nm,
    ]
}

/// All control samples of all runs, one below the other.
fn samples(runs: &[Run]) -> Table {
    let angles = ["run", "t_s", "phi_rad", "theta_rad", "psi_rad"].map(String::from);
    let torques =
        NUMBERS.iter().flat_map(|name| ["x", "y", "z"].map(|axis| format!("{name}_{axis}_nm")));
    let mut table = Table::new(angles.into_iter().chain(torques).chain(["iterations".to_owned()]));
    for run in runs {
        for sample in &run.trajectory.samples {
            let all = numbers(sample);
            let vectors = std::iter::once(&sample.gamma_rad).chain(&all);
            let cells = vectors.flat_map(|vector| vector.iter().map(f64::to_string));
            let head = [run.name.clone(), sample.t_s.to_string()];
            let tail = [sample.output.iterations.to_string()];
            table.push(head.into_iter().chain(cells).chain(tail));
        }
    }
    table
}

/// Angles each millisecond, to a nanoradian.
fn paths<'a>(runs: impl Iterator<Item = &'a Run>) -> Table {
    let mut table = Table::new(["run", "t_s", "phi_rad", "theta_rad", "psi_rad"]);
    for run in runs {
        for (t_s, gamma) in &run.trajectory.gamma_rad {
            let angles = gamma.iter().map(|angle| format!("{angle:.9}"));
            table.push([run.name.clone(), format!("{t_s:.3}")].into_iter().chain(angles));
        }
    }
    table
}

fn run_json(run: &Run) -> Value {
    let Run { name, experiment, trajectory } = run;
    let column = |value: &dyn Fn(&Sample) -> Value| -> Vec<Value> {
        trajectory.samples.iter().map(value).collect()
    };
    let mut columns = serde_json::Map::new();
    columns.insert("t_s".into(), column(&|sample| sample.t_s.into()).into());
    columns.insert("gamma_rad".into(), column(&|sample| three(&sample.gamma_rad)).into());
    for (index, name) in NUMBERS.iter().enumerate() {
        let values = column(&|sample| three(&numbers(sample)[index]));
        columns.insert(format!("{name}_nm"), values.into());
    }
    json!({
        "run": name,
        "experiment": experiment_json(experiment),
        "lost_s": trajectory.lost_s,
        "unsolved": trajectory.unsolved,
        "samples": columns,
    })
}

fn three(vector: &Vector3<f64>) -> Value {
    json!([vector.x, vector.y, vector.z])
}

/// The bases of an input as numbers.
fn functions(basis: Basis) -> Value {
    match basis {
        Basis::Laguerre { pole, terms } => json!([pole, terms]),
        Basis::Blocks { terms, samples } => json!({"blocks": terms, "samples": samples}),
    }
}

fn experiment_json(experiment: &Experiment) -> Value {
    let law = &experiment.law;
    let horizon = match law.horizon {
        HorizonChoice::Samples(horizon) => json!([horizon.prediction, horizon.control]),
        HorizonChoice::Seconds(seconds) => json!({ "s": seconds }),
    };
    let world = match experiment.world {
        World::Linear => json!("linear"),
        World::Rotors { lag_s, delay_ns } => json!({ "lag_s": lag_s, "delay_ns": delay_ns }),
    };
    let blow = experiment.blow.map(|(at_s, blow)| {
        let (kind, value) = match blow {
            Blow::Torque(value) => ("torque_nm", value),
            Blow::Rate(value) => ("rate_rad_s", value),
            Blow::Angle(value) => ("angle_rad", value),
        };
        json!({ "at_s": at_s, kind: three(&value) })
    });
    json!({
        "rate_hz": law.rate_hz,
        "horizon": horizon,
        "laguerre": law.laguerre.map(|bases| bases.map(functions)),
        "increment_weight": law.increment_weight,
        "yaw_weight_factor": law.yaw_weight_factor,
        "scale_weight_with_inertia": law.scale_weight_with_inertia,
        "modelled_rotor_lag_s": law.rotor_lag_s,
        "modelled_delay_s": law.command_delay_s,
        "solver": match law.solver {
            SolverKind::ActiveSet => "active-set",
            SolverKind::Hildreth => "hildreth",
            SolverKind::HildrethConverged => "hildreth-converged",
        },
        "morph_angle_deg": experiment.morph_angle.degrees(),
        "bounds": match law.torque_bound {
            TorqueBound::Paper => "paper",
            TorqueBound::Rotors => "rotors",
            TorqueBound::RotorThrusts => "rotor-thrusts",
        },
        "world": world,
        "target_rad": three(&experiment.target_rad),
        "disturbance": blow,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_remark_is_wrapped_under_its_own_beginning() {
        let text = wrapped(&"word ".repeat(30), "* ");
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), 2);
        assert!(lines[0].starts_with("* word") && lines[1].starts_with("  word"));
        assert!(lines.iter().all(|line| line.chars().count() <= WIDTH));
    }
}
