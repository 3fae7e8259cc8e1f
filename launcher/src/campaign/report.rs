//! What a campaign leaves behind: one table, figures over all cases, the worst with their commands.

use super::{Axis, Campaign, Case, Outcome, Verdict};
use crate::exit;
use crate::results::{Columns, Kind, ResultsError, ResultsFolder, Table, Value};
use parquet::errors::ParquetError;
use serde_json::json;
use thiserror::Error;

/// Why the results are not all there.
#[derive(Debug, Error, miette::Diagnostic)]
pub enum ReportError {
    /// A file cannot be written.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Results(#[from] ResultsError),
    /// The Parquet writer refuses.
    #[error("cannot write Parquet: {0}")]
    #[diagnostic(help("the CSV file beside it is complete; please report this"))]
    Parquet(#[from] ParquetError),
}

/// Every case as a row: its number, its parameters, its outcome.
#[must_use]
pub fn table(axes: &[Axis], flown: &[(Case, Outcome)]) -> Columns {
    let mut headings = vec![("case".to_owned(), Kind::Whole), ("seed".to_owned(), Kind::Whole)];
    let kinds: Vec<Kind> = axes.iter().map(kind).collect();
    headings.extend(axes.iter().zip(&kinds).map(|(axis, kind)| (axis.key.clone(), *kind)));
    headings.extend(Outcome::headings());
    let mut columns = Columns::new(headings);
    for (number, (case, outcome)) in (0_u64..).zip(flown) {
        let values = case.values.iter().zip(&kinds);
        let values = values.map(|(text, kind)| kind.read(text).unwrap_or(Value::Missing));
        let head = [Value::Whole(number), Value::Whole(case.seed)];
        columns.push(head.into_iter().chain(values).chain(outcome.cells().iter().cloned()));
    }
    columns
}

/// A parameter is a number if all its values are.
fn kind(axis: &Axis) -> Kind {
    let numeric = axis.values.iter().all(|value| value.parse::<f64>().is_ok());
    if numeric { Kind::Number } else { Kind::Text }
}

/// Writes the table as `name`.csv and `name`.parquet.
///
/// # Errors
/// [`ReportError`].
pub fn write(name: &str, columns: &Columns, folder: &mut ResultsFolder) -> Result<(), ReportError> {
    folder.replace(&format!("{name}.csv"), &columns.to_csv())?;
    folder.replace(&format!("{name}.parquet"), &columns.to_parquet()?)?;
    Ok(())
}

/// Places of the worst cases, the worst first.
#[must_use]
pub fn worst(flown: &[(Case, Outcome)], count: usize) -> Vec<usize> {
    let mut places: Vec<usize> = (0..flown.len()).collect();
    let rank = |place: &usize| (flown[*place].1.verdict(), flown[*place].1.badness());
    places.sort_by(|a, b| {
        let ((verdict_a, bad_a), (verdict_b, bad_b)) = (rank(a), rank(b));
        verdict_b.cmp(&verdict_a).then(bad_b.total_cmp(&bad_a)).then(a.cmp(b))
    });
    places.truncate(count);
    places
}

/// How many cases ended how.
#[must_use]
pub fn counts(flown: &[(Case, Outcome)]) -> [(Verdict, usize); 5] {
    Verdict::ALL.map(|verdict| {
        let count = flown.iter().filter(|(_, outcome)| outcome.verdict() == verdict).count();
        (verdict, count)
    })
}

/// 0; 4 if a component failed in a case, and 2 if the scenario refuses every one.
#[must_use]
pub fn exit_code(flown: &[(Case, Outcome)]) -> u8 {
    let mut verdicts = flown.iter().map(|(_, outcome)| outcome.verdict());
    if verdicts.clone().any(|verdict| verdict == Verdict::Failed) {
        exit::CRASHED
    } else if verdicts.all(|verdict| verdict == Verdict::Refused) {
        exit::USAGE
    } else {
        exit::PASS
    }
}

/// Median, 95 % and largest of one column over all cases that have it; none if no case has.
#[must_use]
pub fn spread(flown: &[(Case, Outcome)], heading: &str) -> Option<[f64; 3]> {
    let mut values: Vec<f64> =
        flown.iter().filter_map(|(_, outcome)| outcome.cell(heading).number()).collect();
    values.sort_by(f64::total_cmp);
    let last = values.len().checked_sub(1)?;
    let median = f64::midpoint(values[last / 2], values[values.len() / 2]);
    // The smallest value that so many per cent do not exceed.
    let at_95 = values[(values.len() * 95).div_ceil(100) - 1];
    Some([median, at_95, values[last]])
}

/// Columns told over all cases, with a factor for display and a unit.
const SPREADS: [(&str, &str, f64, &str); 4] = [
    ("position_rms_m", "position rms", 1e3, "mm"),
    ("position_max_m", "position max", 1e3, "mm"),
    ("settling_s", "settling", 1.0, "s"),
    ("tilt_max_rad", "tilt max", 1.0, "rad"),
];

/// Counts and spreads for people.
#[must_use]
pub fn figures(flown: &[(Case, Outcome)]) -> String {
    let counts = counts(flown).map(|(verdict, count)| format!("{count} {verdict}")).join(", ");
    let lines = SPREADS.iter().filter_map(|(heading, name, factor, unit)| {
        let spread = spread(flown, heading)?;
        let [median, most, max] = spread.map(|value| format!("{:.4}", value * factor));
        Some(format!("  {name:<13} median {median}, 95 % {most}, largest {max} {unit}\n"))
    });
    format!("  cases         {counts}\n{}", lines.collect::<String>())
}

/// The worst cases, and under each the command that flies it again.
#[must_use]
pub fn worst_cases(
    axes: &[Axis],
    flown: &[(Case, Outcome)],
    count: usize,
    command: &dyn Fn(&Case) -> String,
) -> String {
    let headings = ["case", "seed"].into_iter().chain(axes.iter().map(|axis| axis.key.as_str()));
    let mut table = Table::new(headings.chain(["outcome", "position max [mm]", "reason"]));
    let worst = worst(flown, count);
    for &place in &worst {
        let (case, outcome) = &flown[place];
        let max = outcome.cell("position_max_m").number();
        let max = max.map_or_else(String::new, |max| format!("{:.1}", max * 1e3));
        let head = [place.to_string(), case.seed.to_string()];
        let told = [outcome.verdict().to_string(), max, outcome.cell("reason").to_cell()];
        table.push(head.into_iter().chain(case.values.iter().cloned()).chain(told));
    }
    let commands = worst.iter().map(|place| format!("  {}\n", command(&flown[*place].0)));
    let commands: String = commands.collect();
    format!("worst cases\n{table}\nto fly them again with a recording\n{commands}")
}

/// Everything above for machines.
#[must_use]
pub fn to_json(
    axes: &[Axis],
    flown: &[(Case, Outcome)],
    count: usize,
    command: &dyn Fn(&Case) -> String,
) -> serde_json::Value {
    let outcomes: serde_json::Map<_, _> = counts(flown)
        .into_iter()
        .map(|(verdict, count)| (verdict.word().to_owned(), count.into()))
        .collect();
    let spreads: serde_json::Map<_, _> = SPREADS
        .iter()
        .filter_map(|(heading, ..)| {
            let [median, most, max] = spread(flown, heading)?;
            let told = json!({"median": median, "percent_95": most, "max": max});
            Some(((*heading).to_owned(), told))
        })
        .collect();
    let told = |place: usize| {
        let (case, outcome) = &flown[place];
        let set: Vec<String> = case.settings(axes).collect();
        json!({
            "case": place,
            "seed": case.seed,
            "set": set,
            "outcome": outcome.verdict().word(),
            "reason": outcome.cell("reason").to_cell(),
            "position_max_m": outcome.cell("position_max_m").number(),
            "hash": outcome.cell("hash").to_cell(),
            "command": command(case),
        })
    };
    let worst: Vec<_> = worst(flown, count).into_iter().map(told).collect();
    json!({"cases": flown.len(), "outcomes": outcomes, "spread": spreads, "worst": worst})
}

impl Campaign {
    /// The table of all cases.
    #[must_use]
    pub fn table(&self) -> Columns {
        table(&self.axes, &self.flown)
    }

    /// The command line that flies a case again.
    #[must_use]
    pub fn command(&self, case: &Case) -> String {
        self.base.command(&self.axes, case)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flown() -> Vec<(Case, Outcome)> {
        let case = |seed, value: &str| Case { seed, values: vec![value.to_owned()] };
        let outcome = |word: &str, max: f64| {
            let mut cells = Outcome::refused(&"").to_text();
            cells[0] = word.to_owned();
            cells[8] = max.to_string();
            Outcome::from_text(&cells).unwrap()
        };
        vec![
            (case(1, "1"), outcome("flown", 0.5)),
            (case(2, "1"), outcome("lost", 0.1)),
            (case(1, "2.5"), outcome("flown", 0.6)),
            (case(2, "2.5"), outcome("refused", 0.0)),
        ]
    }

    #[test]
    fn the_worst_come_by_verdict_and_then_by_how_far_they_were_off() {
        assert_eq!(worst(&flown(), 3), [3, 1, 2]);
        assert_eq!(worst(&flown(), 99).len(), 4);
        let axes = [Axis { key: "k".into(), values: vec!["1".into(), "2.5".into()] }];
        let text = worst_cases(&axes, &flown(), 1, &|case| format!("fly {}", case.seed));
        assert!(text.ends_with("  fly 2\n") && text.contains("refused"), "{text}");
    }

    #[test]
    fn counts_and_spreads_are_over_all_cases() {
        let [(_, flown_well), _, (_, lost), (_, refused), (_, failed)] = counts(&flown());
        assert_eq!([flown_well, lost, refused, failed], [2, 1, 1, 0]);
        assert_eq!((exit_code(&flown()), exit_code(&flown()[3..])), (exit::PASS, exit::USAGE));
        assert_eq!(spread(&flown(), "position_max_m"), Some([0.3, 0.6, 0.6]));
        assert_eq!(spread(&flown(), "settling_s"), None);
    }

    #[test]
    fn a_parameter_is_a_number_only_if_all_its_values_are() {
        let axis = |values: &[&str]| Axis {
            key: "k".to_owned(),
            values: values.iter().map(|v| (*v).to_owned()).collect(),
        };
        assert_eq!(kind(&axis(&["1", "2.5"])), Kind::Number);
        assert_eq!(kind(&axis(&["1", "\"max\""])), Kind::Text);
        let table = table(&[axis(&["1", "2.5"])], &flown());
        assert_eq!(table.rows()[2][2], Value::Number(2.5));
        assert_eq!(table.place("outcome"), Some(3));
    }
}
