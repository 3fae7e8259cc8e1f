//! Programs that the two control laws pose in a flight of their own.

use mpc::Program;

use crate::flight::{Laws, fly, laws};
use crate::series::{Group, Series, Tick};

/// Adds a program to the latest series, or begins another if the rows are new.
fn add(series: &mut Vec<Series>, program: &Program<'_>) {
    let known = series.last().is_some_and(|last| last.rows == *program.rows);
    if !known {
        let (hessian, rows) = (program.zeta.clone(), program.rows.clone());
        series.push(Series { hessian, rows, ticks: Vec::new(), recorded: None });
    }
    let Some(last) = series.last_mut() else { return };
    let in_force = match last.ticks.len() {
        0 => &last.hessian,
        count => last.hessian_at(count - 1),
    };
    let hessian = (*in_force != *program.zeta).then(|| program.zeta.clone());
    let (lower, upper) = (program.lower.clone(), program.upper.clone());
    last.ticks.push(Tick { hessian, f: program.eta.clone(), lower, upper });
}

/// One group per law.
pub(crate) fn groups() -> Vec<Group> {
    let recorded = fly();
    let Laws { mut attitude, mut position } = laws();
    let mut series = [Vec::new(), Vec::new()];
    for input in &recorded.attitude {
        attitude.step(input);
        add(&mut series[0], &attitude.program());
    }
    for sample in &recorded.position {
        position.step(&sample.input());
        add(&mut series[1], &position.program());
    }
    let group = |(law, series): (&str, Vec<Series>)| {
        let n = series.first().map_or(0, Series::n);
        Group { name: format!("own flight, {law} n={n}"), series }
    };
    ["attitude", "position"].into_iter().zip(series).map(group).collect()
}
