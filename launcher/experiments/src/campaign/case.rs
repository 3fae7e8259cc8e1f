//! One flight of many: what is changed in the scenario, and the command that flies it again.

use document::ScenarioError;
use scenario::settings::Clock;
use scenario::{Override, Scenario};

/// The clock of every case, whatever the scenario sets.
const LOCKSTEP: &str = "lockstep";

/// One parameter with the values that it takes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Axis {
    /// Dotted key of the scenario.
    pub key: String,
    /// In TOML.
    pub values: Vec<String>,
}

/// The scenario that all flights share.
#[derive(Debug, Clone)]
pub struct Base {
    /// Shipped name, or path.
    pub name: String,
    /// Its text, read once.
    pub text: String,
    /// `KEY=VALUE` for every flight.
    pub set: Vec<String>,
}

/// What one flight has of its own.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Case {
    /// Seed of everything random.
    pub seed: u64,
    /// A value in TOML for each axis, in their order.
    pub values: Vec<String>,
}

impl Base {
    /// The scenario of a case.
    ///
    /// # Errors
    /// The scenario refuses a value.
    pub fn scenario(&self, axes: &[Axis], case: &Case) -> Result<Scenario, ScenarioError> {
        let own = case.settings(axes).map(|setting| Override::set(&setting));
        let edits = own.chain([Ok(Override::seed(case.seed))]).collect::<Result<Vec<_>, _>>()?;
        self.with(edits)
    }

    /// Seed of the scenario itself.
    ///
    /// # Errors
    /// The scenario cannot be flown.
    pub fn own_seed(&self) -> Result<u64, ScenarioError> {
        Ok(self.shared()?.settings().scenario.seed)
    }

    /// The scenario that all cases share.
    pub(super) fn shared(&self) -> Result<Scenario, ScenarioError> {
        self.with(Vec::new())
    }

    fn with(&self, own: Vec<Override>) -> Result<Scenario, ScenarioError> {
        let set = self.set.iter().map(|setting| Override::set(setting));
        let mut edits = set.collect::<Result<Vec<_>, _>>()?;
        edits.extend(own);
        edits.push(Override::clock(LOCKSTEP));
        Scenario::from_text(&self.name, &self.text, &edits)
    }

    /// The command line that flies a case alone and records it.
    #[must_use]
    pub fn command(&self, axes: &[Axis], case: &Case) -> String {
        let mut arguments = vec!["morphquad run".to_owned(), quoted(&self.name)];
        for setting in self.set.iter().cloned().chain(case.settings(axes)) {
            arguments.extend(["--set".to_owned(), quoted(&setting)]);
        }
        arguments.push(format!("--seed {}", case.seed));
        // Lockstep is the default of a scenario.
        let own = Scenario::from_text(&self.name, &self.text, &[]);
        if own.is_ok_and(|scenario| scenario.settings().scenario.clock == Clock::Realtime) {
            arguments.push(format!("--clock {LOCKSTEP}"));
        }
        arguments.join(" ")
    }
}

impl Case {
    /// Every combination: the last axis changes before the one before it, seeds before all.
    #[must_use]
    pub fn all(axes: &[Axis], seeds: &[u64]) -> Vec<Self> {
        let mut combinations: Vec<Vec<String>> = vec![Vec::new()];
        for axis in axes {
            let extended = combinations.iter().flat_map(|values| {
                axis.values.iter().map(|v| values.iter().chain([v]).cloned().collect())
            });
            combinations = extended.collect();
        }
        let cases = combinations
            .iter()
            .flat_map(|values| seeds.iter().map(|&seed| Self { seed, values: values.clone() }));
        cases.collect()
    }

    /// `KEY=VALUE` of every axis.
    pub fn settings<'a>(&'a self, axes: &'a [Axis]) -> impl Iterator<Item = String> + 'a {
        axes.iter().zip(&self.values).map(|(axis, value)| format!("{}={value}", axis.key))
    }
}

/// An argument, quoted so that a shell passes it unchanged.
#[must_use]
pub fn quoted(argument: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "_-./=,:+".contains(c);
    if !argument.is_empty() && argument.chars().all(plain) {
        return argument.to_owned();
    }
    format!("'{}'", argument.replace('\'', r"'\''"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn axes() -> Vec<Axis> {
        let axis = |key: &str, values: &[&str]| Axis {
            key: key.to_owned(),
            values: values.iter().map(|v| (*v).to_owned()).collect(),
        };
        vec![axis("vehicle.mass_kg", &["0.5", "0.6"]), axis("pilot.yaw", &["\"fixed\""])]
    }

    #[test]
    fn every_combination_comes_once_seeds_first() {
        let cases = Case::all(&axes(), &[1, 2]);
        let seen: Vec<_> = cases.iter().map(|c| (c.values[0].as_str(), c.seed)).collect();
        assert_eq!(seen, [("0.5", 1), ("0.5", 2), ("0.6", 1), ("0.6", 2)]);
        assert_eq!(Case::all(&[], &[7]), [Case { seed: 7, values: Vec::new() }]);
    }

    #[test]
    fn the_command_quotes_what_a_shell_would_take_apart() {
        let base = Base { name: "a b.toml".into(), text: String::new(), set: Vec::new() };
        let case = Case { seed: 3, values: vec!["0.5".into(), "\"fi'xed\"".into()] };
        assert_eq!(
            base.command(&axes(), &case),
            r#"morphquad run 'a b.toml' --set vehicle.mass_kg=0.5 --set 'pilot.yaw="fi'\''xed"' --seed 3"#
        );
    }

    #[test]
    fn a_scenario_in_realtime_is_flown_in_lockstep_here_and_by_its_command() {
        let text = scenario::shipped::text("hover").unwrap();
        let text = text.replace("clock = \"lockstep\"", "clock = \"realtime\"");
        let base = Base { name: "hover.toml".into(), text, set: Vec::new() };
        let case = Case { seed: 3, values: Vec::new() };
        let scenario = base.scenario(&[], &case).unwrap();
        assert_eq!(scenario.settings().scenario.clock, Clock::Lockstep);
        assert_eq!(base.command(&[], &case), "morphquad run hover.toml --seed 3 --clock lockstep");
    }

    #[test]
    fn the_command_of_a_case_has_the_time_that_its_loops_take() {
        let text = "[[timing]]\nloop = \"attitude\"\nstep_s = 0.001\n".to_owned();
        let base = Base { name: "late.toml".into(), text, set: Vec::new() };
        let axis = Axis { key: "timing.0.step_s".into(), values: vec!["0.012".into()] };
        let case = Case { seed: 3, values: axis.values.clone() };
        let expected = "morphquad run late.toml --set timing.0.step_s=0.012 --seed 3";
        assert_eq!(base.command(&[axis], &case), expected);
        let set = vec!["timing=[{ loop = \"attitude\", stopped = true }]".to_owned()];
        let base = Base { name: "hover".into(), text: String::new(), set };
        let command = base.command(&[], &Case { seed: 3, values: Vec::new() });
        assert!(command.contains("stopped = true") && command.ends_with(" --seed 3"), "{command}");
    }
}
