//! The orthonormal functions that the paper announces and never uses: fewer unknowns per horizon.

use super::measure::{overshoot_percent, recovery_s};
use super::rig::{Experiment, Trajectory};
use super::step_rates::roll;
use super::{Check, PaperError, Run, Section, TARGET_RAD, cell, label};
use attitude_mpc::{Basis, Horizon, HorizonChoice};
use figures::results::Table;
use vehicle::MorphAngle;

/// Pole a and number N of functions on each axis.
type Functions = (f64, usize);

/// {Np, Nc}, and the functions tried with them.
const CASES: [((usize, usize), [Functions; 4]); 2] = [
    ((20, 3), [(0.0, 3), (0.2, 3), (0.2, 2), (0.5, 3)]),
    ((30, 6), [(0.0, 6), (0.2, 3), (0.5, 3), (0.5, 4)]),
];

/// The paper's loop at 100 Hz with a horizon and, unless classic, functions.
pub(super) fn experiment(pair: (usize, usize), functions: Option<Functions>) -> Experiment {
    let mut experiment = Experiment::paper(100.0, 0.25, MorphAngle::MIN);
    experiment.law.horizon =
        HorizonChoice::Samples(Horizon { prediction: pair.0, control: pair.1 });
    experiment.law.laguerre = functions.map(|(pole, terms)| [Basis::Laguerre { pole, terms }; 3]);
    experiment
}

pub(super) fn section(runs: &mut Vec<Run>, checks: &mut Vec<Check>) -> Result<Section, PaperError> {
    let mut table = Table::new([
        "{Np,Nc}",
        "a",
        "N",
        "unknowns",
        "time [s]",
        "overshoot [%]",
        "settled [s]",
        "from the classic form [rad]",
    ]);
    let mut equal = 0.0_f64;
    for (pair, functions) in CASES {
        let classic = Run::new(format!("classic {}", label(pair)), &experiment(pair, None))?;
        table.push(row(pair, None, &classic, &classic.trajectory));
        for (pole, terms) in functions {
            let name = format!("Laguerre {} a {pole} N {terms}", label(pair));
            let run = Run::new(name, &experiment(pair, Some((pole, terms))))?;
            if pole <= 0.0 && terms == pair.1 {
                equal = equal.max(apart(&run.trajectory, &classic.trajectory));
            }
            table.push(row(pair, Some((pole, terms)), &run, &classic.trajectory));
            runs.push(run);
        }
        runs.push(classic);
    }
    checks.push(Check::new(
        "Laguerre functions with a = 0, N = Nc give the classic form's angles to 1e-12 rad",
        format!("{equal:.1e} rad apart at most"),
        equal <= 1e-12,
    ));
    Ok(Section::new("test2-laguerre", "Laguerre functions instead of one unknown per move, linear plant, 100 Hz, r_w 0.25", table)
        .remark("The abstract and the conclusion promise them, section III never uses them. Bounds are kept for as long as the functions last, at least on the first Nc samples as in the classic form."))
}

fn row(
    pair: (usize, usize),
    functions: Option<Functions>,
    run: &Run,
    classic: &Trajectory,
) -> [String; 8] {
    let path = &run.trajectory.gamma_rad;
    [
        label(pair),
        functions.map_or_else(|| "-".into(), |(pole, _)| pole.to_string()),
        functions.map_or_else(|| "-".into(), |(_, terms)| terms.to_string()),
        (3 * functions.map_or(pair.1, |(_, terms)| terms)).to_string(),
        cell(roll(&run.trajectory).0, 4),
        format!("{:.2}", overshoot_percent(path, 0, TARGET_RAD).max(0.0)),
        cell(recovery_s(path, &run.experiment.target_rad, 0.0), 2),
        if functions.is_some() {
            format!("{:.1e}", apart(&run.trajectory, classic))
        } else {
            "-".into()
        },
    ]
}

/// Largest difference of any angle at any sample \[rad\].
fn apart(one: &Trajectory, other: &Trajectory) -> f64 {
    let pairs = one.samples.iter().zip(&other.samples);
    pairs.map(|(a, b)| (a.gamma_rad - b.gamma_rad).amax()).fold(0.0, f64::max)
}
