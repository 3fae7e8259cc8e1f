//! What a campaign leaves behind: one table, figures over all cases, the worst with their commands.

use super::outcome::{NEVER, RANKING};
use super::{Axis, Campaign, Case, Outcome, Verdict};
use ::verdict::Grade;
use core::cmp::Ordering;
use figures::results::{Columns, Kind, ResultsError, ResultsFolder, Table, Value};
use host::exit;
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
        let worse = bad_b.iter().zip(&bad_a).map(|(b, a)| b.total_cmp(a));
        let worse = worse.fold(Ordering::Equal, Ordering::then);
        verdict_b.cmp(&verdict_a).then(worse).then(a.cmp(b))
    });
    places.truncate(count);
    places
}

/// How many cases ended how.
#[must_use]
pub fn counts(flown: &[(Case, Outcome)]) -> [(Verdict, usize); 6] {
    Verdict::ALL.map(|verdict| {
        let count = flown.iter().filter(|(_, outcome)| outcome.verdict() == verdict).count();
        (verdict, count)
    })
}

/// 0 if every case that could be flown passed; 5 if a scripted swap was refused or taken back in one, 1 if one did not
/// pass, 4 if a component failed in one, and 2 if the scenario refuses them all.
#[must_use]
pub fn exit_code(flown: &[(Case, Outcome)]) -> u8 {
    let [passed, .., refused, crashed] = counts(flown).map(|(_, count)| count);
    if crashed > 0 {
        exit::CRASHED
    } else if refused == flown.len() {
        exit::USAGE
    } else if passed + refused < flown.len() {
        exit::FAILED
    } else if failed_swaps(flown) > 0 {
        exit::SWAP_FAILED
    } else {
        exit::PASS
    }
}

/// In how many cases that passed a swap of the script was refused or taken back.
fn failed_swaps(flown: &[(Case, Outcome)]) -> usize {
    flown.iter().filter(|(_, outcome)| outcome.passed_without_a_swap()).count()
}

/// The line that the output begins with: how the worst case came out, and why.
#[must_use]
pub fn line(what: &str, flown: &[(Case, Outcome)]) -> String {
    let passed = counts(flown)[0].1;
    let mut all = format!("{what}: {passed} of {} cases passed", flown.len());
    let without = failed_swaps(flown);
    if without > 0 {
        all = format!("{all}, {without} of them with a scripted swap that failed");
    }
    let Some((place, (_, outcome))) = worst(flown, 1).first().map(|at| (*at, &flown[*at])) else {
        return format!("{}  {all}", Grade::Passed);
    };
    let (verdict, reason) = (outcome.verdict(), outcome.cell("reason").to_cell());
    format!("{verdict}  {all}; the worst is case {place}, {verdict}: {reason}")
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

/// Columns summarized over all cases, with a factor for display and a unit.
const SPREADS: [(&str, &str, f64, &str); 4] = [
    ("position_rms_m", "position rms", 1e3, "mm"),
    ("position_max_m", "position max", 1e3, "mm"),
    ("settling_s", "settling", 1.0, "s"),
    ("tilt_max_rad", "tilt max", 1.0, "rad"),
];

/// A number in the unit of display, which is `factor` times its own.
fn shown(value: f64, factor: f64) -> String {
    if value.is_finite() { format!("{:.4}", value * factor) } else { NEVER.to_owned() }
}

/// Counts and spreads for people.
#[must_use]
pub fn figures(flown: &[(Case, Outcome)]) -> String {
    let counts = counts(flown).map(|(verdict, count)| format!("{count} {verdict}")).join(", ");
    let lines = SPREADS.iter().filter_map(|(heading, name, factor, unit)| {
        let spread = spread(flown, heading)?;
        let [median, most, max] = spread.map(|value| shown(value, *factor));
        Some(format!("  {name:<13} median {median}, 95 % {most}, largest {max} {unit}\n"))
    });
    format!("  cases         {counts}\n{}", lines.collect::<String>())
}

/// One outcome in a line, for people.
#[must_use]
pub fn in_a_line(outcome: &Outcome) -> String {
    let spreads = SPREADS.iter().filter_map(|(heading, name, factor, unit)| {
        let value = outcome.cell(heading).number()?;
        let unit = if value.is_finite() { format!(" {unit}") } else { String::new() };
        Some(format!(", {name} {}{unit}", shown(value, *factor)))
    });
    let counts = ["constraint_violations", "unsolved_steps"].map(|heading| {
        format!(", {} {}", outcome.cell(heading).to_cell(), heading.replace('_', " "))
    });
    format!("{}{}{}", outcome.verdict(), spreads.collect::<String>(), counts.concat())
}

/// Heading and factor for display of each column of the ranking.
const RANKED: [(&str, f64); 3] =
    [("position max [mm]", 1e3), ("settling [ms]", 1e3), ("final error [mrad]", 1e3)];

/// The worst cases, and under each the command that flies it again.
#[must_use]
pub fn worst_cases(
    axes: &[Axis],
    flown: &[(Case, Outcome)],
    count: usize,
    command: &dyn Fn(&Case) -> String,
) -> String {
    let headings = ["case", "seed"].into_iter().chain(axes.iter().map(|axis| axis.key.as_str()));
    let worst = worst(flown, count);
    let ranked: Vec<_> = RANKED
        .iter()
        .zip(RANKING)
        .filter(|(_, key)| worst.iter().any(|&at| flown[at].1.cell(key).number().is_some()))
        .collect();
    let units = ranked.iter().map(|((name, _), _)| *name);
    let mut table = Table::new(headings.chain(["outcome"]).chain(units).chain(["reason"]));
    for &place in &worst {
        let (case, outcome) = &flown[place];
        let shown = |((_, factor), key): &(&(&str, f64), &str)| match outcome.cell(key).number() {
            Some(value) if value.is_finite() => format!("{:.1}", value * factor),
            Some(_) => NEVER.to_owned(),
            None => String::new(),
        };
        let head = [place.to_string(), case.seed.to_string()];
        let cells = [outcome.verdict().to_string()].into_iter().chain(ranked.iter().map(shown));
        let cells = cells.chain([outcome.cell("reason").to_cell()]);
        table.push(head.into_iter().chain(case.values.iter().cloned()).chain(cells));
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
            let [median, most, max] = spread(flown, heading)?.map(|value| {
                if value.is_finite() { serde_json::Value::from(value) } else { NEVER.into() }
            });
            let spread_of_column = json!({"median": median, "percent_95": most, "max": max});
            Some(((*heading).to_owned(), spread_of_column))
        })
        .collect();
    let case_json = |place: usize| {
        let (case, outcome) = &flown[place];
        let set: Vec<String> = case.settings(axes).collect();
        let cells = outcome.to_json();
        let mut row = json!({
            "case": place,
            "seed": case.seed,
            "set": set,
            "outcome": outcome.verdict().word(),
            "reason": outcome.cell("reason").to_cell(),
            "hash": outcome.cell("hash").to_cell(),
            "command": command(case),
        });
        for key in RANKING {
            row[key] = cells[key].clone();
        }
        row
    };
    let worst: Vec<_> = worst(flown, count).into_iter().map(case_json).collect();
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

    fn place(heading: &str) -> usize {
        Outcome::headings().iter().position(|(name, _)| name == heading).unwrap()
    }

    fn flown() -> Vec<(Case, Outcome)> {
        let case = |seed, value: &str| Case { seed, values: vec![value.to_owned()] };
        let outcome = |word: &str, max: f64| {
            let mut cells = Outcome::refused(&"").to_text();
            cells[0] = word.to_owned();
            cells[place("position_max_m")] = max.to_string();
            Outcome::from_text(&cells).unwrap()
        };
        vec![
            (case(1, "1"), outcome("PASSED", 0.5)),
            (case(2, "1"), outcome("LOST", 0.1)),
            (case(1, "2.5"), outcome("PASSED", 0.6)),
            (case(2, "2.5"), outcome("REFUSED", 0.0)),
        ]
    }

    #[test]
    fn the_worst_come_by_verdict_and_then_by_how_far_they_were_off() {
        assert_eq!(worst(&flown(), 3), [3, 1, 2]);
        assert_eq!(worst(&flown(), 99).len(), 4);
        let axes = [Axis { key: "k".into(), values: vec!["1".into(), "2.5".into()] }];
        let text = worst_cases(&axes, &flown(), 1, &|case| format!("fly {}", case.seed));
        assert!(text.ends_with("  fly 2\n") && text.contains("REFUSED"), "{text}");
    }

    #[test]
    fn rigs_are_ranked_by_when_they_settle_and_then_by_where() {
        let rig = |seed, settling: &str, error: &str| {
            let mut cells = Outcome::refused(&"").to_text();
            cells[0] = "PASSED".to_owned();
            cells[place("settling_s")] = settling.to_owned();
            cells[place("final_error_rad")] = error.to_owned();
            (Case { seed, values: Vec::new() }, Outcome::from_text(&cells).unwrap())
        };
        let flown = [rig(1, "0.2", "0.001"), rig(2, "inf", "0.1"), rig(3, "inf", "0.2")];
        assert_eq!(worst(&flown, 3), [2, 1, 0]);
        let text = worst_cases(&[], &flown, 3, &|_| String::new());
        assert!(text.contains("settling [ms]") && !text.contains("position"), "{text}");
        let json = to_json(&[], &flown, 1, &|_| String::new());
        assert_eq!(json["worst"][0]["settling_s"], "never", "{json}");
    }

    #[test]
    fn counts_and_spreads_are_over_all_cases() {
        let [(_, passed), _, _, (_, lost), (_, refused), (_, crashed)] = counts(&flown());
        assert_eq!([passed, lost, refused, crashed], [2, 1, 1, 0]);
        let flown = flown();
        let codes = [&flown[..1], &flown[..], &flown[3..]].map(exit_code);
        assert_eq!(codes, [exit::PASS, exit::FAILED, exit::USAGE]);
        let mut cells = flown[0].1.to_text();
        cells[place("swaps_failed")] = "1".to_owned();
        let refused = Outcome::from_text(&cells).unwrap();
        let cases = [(flown[0].0.clone(), refused), flown[1].clone()];
        let codes = [&cases[..1], &cases[..]].map(exit_code);
        assert_eq!(codes, [exit::SWAP_FAILED, exit::FAILED]);
        let text = line("swaps", &cases[..1]);
        assert!(
            text.contains("1 of 1 cases passed, 1 of them with a scripted swap that failed"),
            "{text}"
        );
        assert_eq!(spread(&flown, "position_max_m"), Some([0.3, 0.6, 0.6]));
        assert_eq!(spread(&flown, "settling_s"), None);
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
