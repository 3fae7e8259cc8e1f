//! What a machine did to the time of the loops, as `[[timing]]` of a scenario: how late each began and how long its steps
//! took, as often as it was measured.

use super::measure::Steps;
use super::series::Series;
use std::fmt::Write as _;

/// The entries as TOML, for `run --timing FILE`; loops on a second seat are left out, which no entry can name.
#[must_use]
pub fn entries(steps: &[(String, Steps)]) -> String {
    let mut text =
        "# Measured by `morphquad bench loops`; flown by `morphquad run --timing FILE`.\n"
            .to_owned();
    for (name, steps) in steps.iter().filter(|(name, _)| !name.contains('@')) {
        for (key, series) in [("start_late_s", &steps.begin), ("step_s", &steps.compute)] {
            if !series.is_empty() {
                // A string takes everything.
                let _ = write!(text, "\n[[timing]]\nloop = {name:?}\n{key} = {}\n", drawn(series));
            }
        }
    }
    text
}

fn drawn(series: &Series) -> String {
    let (mut values, mut weights) = (Vec::new(), Vec::new());
    for (ns, count) in series.bins() {
        values.push(format!("{:?}", ns as f64 / 1e9));
        weights.push(count.to_string());
    }
    format!("{{ values_s = [{}], weights = [{}] }}", values.join(", "), weights.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;
    use scenario::{Override, Scenario};
    use timing::{Duration, LoopEffect};

    #[test]
    fn what_was_measured_is_drawn_as_often_as_it_was_measured() {
        let steps = Steps {
            begin: [2000, 2000, 2000, 9000].into_iter().collect(),
            compute: core::iter::once(12_000).collect(),
            ..Steps::default()
        };
        let text =
            entries(&[("attitude-mpc".to_owned(), steps), ("x@1".to_owned(), Steps::default())]);
        let folder = tempfile::TempDir::new().unwrap();
        let path = folder.path().join("timing.toml");
        std::fs::write(&path, text).unwrap();
        let edit = Override::timing(path.to_str().unwrap()).unwrap();
        let script = Scenario::load("hover", &[edit]).unwrap().timing().unwrap();
        let effects: Vec<LoopEffect> = script.loops().iter().map(|e| e.effect.clone()).collect();
        // To three digits, rounded up.
        assert_eq!(
            effects,
            [
                LoopEffect::StartLate(Duration::weighted(&[(2000, 3.0), (9007, 1.0)])),
                LoopEffect::Step(Duration::weighted(&[(12_007, 1.0)])),
            ]
        );
    }
}
