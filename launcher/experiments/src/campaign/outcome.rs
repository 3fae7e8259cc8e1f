//! What came of one flight of many, as a row.

use ::verdict::{End, Grade, Unit};
use core::fmt;
use figures::results::{Kind, Value};
use observe::{Closing, FACTS, Fact, FlightHash, Metrics};
use scenario::Scenario;
use simulate::in_process::{InProcess, InProcessError, StateSource};

/// Logical time flown between two looks at whether to stop \[ns\].
const LOOK_EVERY_NS: u64 = 500_000_000;

/// How a case came out, worst last.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Verdict {
    /// It was flown, and judged: passed, incomplete, failed or lost.
    Flown(Grade),
    /// The scenario or a component refuses this configuration.
    Refused,
    /// A component failed, which is a defect.
    Crashed,
}

impl Verdict {
    /// Every one, the best first.
    pub const ALL: [Self; 6] = [
        Self::Flown(Grade::Passed),
        Self::Flown(Grade::Incomplete),
        Self::Flown(Grade::Failed),
        Self::Flown(Grade::Lost),
        Self::Refused,
        Self::Crashed,
    ];

    /// In a word, which is that of every other output about a flight.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Flown(grade) => grade.word(),
            Self::Refused => "REFUSED",
            Self::Crashed => Grade::Crashed.word(),
        }
    }
}

impl From<Grade> for Verdict {
    fn from(grade: Grade) -> Self {
        if grade == Grade::Crashed { Self::Crashed } else { Self::Flown(grade) }
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.word())
    }
}

/// The column with the swaps of the script that were refused or taken back.
pub(super) const FAILED_SWAPS: &str = "swaps_failed";

/// What is known of every flight: what became of it, every fact, its swaps, and of a rig how it settled.
fn columns() -> impl Iterator<Item = (&'static str, Kind)> {
    let head = [("outcome", Kind::Text), ("reason", Kind::Text)];
    let kind = |fact: &Fact| if fact.unit == Unit::Count { Kind::Whole } else { Kind::Number };
    let facts = FACTS.iter().map(move |fact| (fact.key, kind(fact)));
    let rig = [("settling_s", Kind::Number), ("final_error_rad", Kind::Number)];
    let swaps = [(FAILED_SWAPS, Kind::Whole)];
    head.into_iter().chain(facts).chain(swaps).chain(rig).chain([("hash", Kind::Text)])
}

/// Columns by which cases are ranked; a flight has the first, a rig the others.
pub(super) const RANKING: [&str; 3] = ["position_max_m", "settling_s", "final_error_rad"];

/// When a rig settles that never does.
pub(super) const NEVER: &str = "never";

/// What came of one flight: a cell per column.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome(Vec<Value>);

impl Outcome {
    /// Heading and kind of each cell.
    #[must_use]
    pub fn headings() -> Vec<(String, Kind)> {
        columns().map(|(name, kind)| (name.to_owned(), kind)).collect()
    }

    /// Of a flight that never began.
    #[must_use]
    pub fn refused(reason: &impl fmt::Display) -> Self {
        Self::without_flight(Verdict::Refused, reason)
    }

    fn without_flight(verdict: Verdict, reason: &impl fmt::Display) -> Self {
        let mut cells = vec![Value::from(verdict.word()), Value::from(first_line(reason).as_str())];
        cells.resize(columns().count(), Value::Missing);
        Self(cells)
    }

    /// Of a flight that has ended after `flown_ns`, so many of whose scripted swaps were refused or taken back; finishes
    /// the metrics.
    #[must_use]
    pub fn of_flight(
        metrics: &mut Metrics,
        hash: &FlightHash,
        flown_ns: u64,
        failure: Option<&InProcessError>,
        failed_swaps: usize,
    ) -> Self {
        metrics.finish();
        let end = failure.map_or(End::Planned, |error| End::Crashed(first_line(error)));
        let closing = Closing { end, flown_ns, ..Closing::default() };
        let (judged, facts) = (metrics.judge(&closing), metrics.facts(&closing));
        let verdict = Verdict::from(judged.grade());
        let axes = metrics.step_response();
        let worst = |of: fn(&observe::AxisResponse) -> f64| {
            axes.map(|axes| axes.iter().map(of).fold(0.0, verdict::worst))
        };
        let cell = |name: &str, kind: Kind| match (name, kind) {
            ("outcome", _) => verdict.word().into(),
            ("reason", _) => judged.reason().as_str().into(),
            ("settling_s", _) => worst(|axis| axis.settling_s.unwrap_or(f64::INFINITY)).into(),
            ("final_error_rad", _) => worst(|axis| axis.final_error_rad.abs()).into(),
            ("hash", _) => hash.hex().as_str().into(),
            (FAILED_SWAPS, _) => Value::Whole(failed_swaps as u64),
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a count")]
            (key, Kind::Whole) => facts.number(key).map(|count| count as u64).into(),
            (key, _) => facts.number(key).into(),
        };
        Self(columns().map(|(name, kind)| cell(name, kind)).collect())
    }

    /// Cells in the order of the headings.
    #[must_use]
    pub fn cells(&self) -> &[Value] {
        &self.0
    }

    /// One cell.
    #[must_use]
    pub fn cell(&self, heading: &str) -> &Value {
        let place = columns().position(|(name, _)| name == heading);
        place.and_then(|place| self.0.get(place)).unwrap_or(&Value::Missing)
    }

    /// How it went.
    #[must_use]
    pub fn verdict(&self) -> Verdict {
        let word = self.cell("outcome").to_cell();
        Verdict::ALL.into_iter().find(|v| v.word() == word).unwrap_or(Verdict::Crashed)
    }

    /// True if it passed, and a swap of its script was refused or taken back.
    #[must_use]
    pub fn passed_without_a_swap(&self) -> bool {
        let failed = self.cell(FAILED_SWAPS).number().is_some_and(|count| count > 0.0);
        failed && self.verdict() == Verdict::Flown(Grade::Passed)
    }

    /// What makes one case worse than another with the same verdict, the first that differs: how far
    /// it was off its path, or how long a rig took to settle and how far off it ended.
    #[must_use]
    pub fn badness(&self) -> [f64; 3] {
        RANKING.map(|name| self.cell(name).number().unwrap_or(0.0))
    }

    /// Every cell under its heading; infinity, of a rig that never settles, as a word.
    #[must_use]
    pub fn to_json(&self) -> serde_json::Value {
        let value = |cell: &Value| match cell {
            Value::Missing => serde_json::Value::Null,
            Value::Whole(whole) => (*whole).into(),
            Value::Number(number) if number.is_finite() => (*number).into(),
            Value::Number(_) => NEVER.into(),
            Value::Text(text) => text.as_str().into(),
        };
        columns().zip(&self.0).map(|((name, _), cell)| (name.to_owned(), value(cell))).collect()
    }

    /// As text, cell by cell.
    #[must_use]
    pub fn to_text(&self) -> Vec<String> {
        self.0.iter().map(Value::to_cell).collect()
    }

    /// Reads [`Outcome::to_text`] back, bit for bit; `None` for anything else.
    #[must_use]
    pub fn from_text(cells: &[String]) -> Option<Self> {
        let read = || columns().zip(cells).map(|((_, kind), cell)| kind.read(cell));
        (cells.len() == columns().count())
            .then(|| read().collect::<Option<_>>().map(Self))
            .flatten()
    }
}

fn first_line(text: &impl fmt::Display) -> String {
    text.to_string().lines().next().unwrap_or_default().to_owned()
}

/// Flies a scenario in this thread to its end; `None` once `stop` returns true.
pub fn fly(scenario: &Scenario, stop: &dyn Fn() -> bool) -> Option<Outcome> {
    let observer = (FlightHash::default(), Metrics::of(scenario));
    match InProcess::new(scenario, StateSource::Estimator, observer) {
        Ok(mut flight) => fly_on(&mut flight, 0, scenario.duration_ns(), stop),
        Err(error) => Some(Outcome::refused(&error)),
    }
}

/// Flies on from `from_ns` to `end_ns`; `None` once `stop` returns true.
pub fn fly_on(
    flight: &mut InProcess<(FlightHash, Metrics)>,
    from_ns: u64,
    end_ns: u64,
    stop: &dyn Fn() -> bool,
) -> Option<Outcome> {
    let mut end = Ok(());
    let mut t_ns = from_ns;
    while t_ns < end_ns && end.is_ok() {
        if stop() {
            return None;
        }
        t_ns = t_ns.saturating_add(LOOK_EVERY_NS).min(end_ns);
        end = flight.fly_until(t_ns);
    }
    let flown_ns = flight.flown_ns();
    let failed_swaps = flight.conclude().failed_swaps();
    let (hash, mut metrics) = flight.seen(core::mem::take);
    Some(Outcome::of_flight(&mut metrics, &hash, flown_ns, end.err().as_ref(), failed_swaps))
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::time::Duration;
    use scenario::Override;

    fn flown(name: &str, set: &[&str]) -> Outcome {
        let mut edits = vec![Override::duration(Duration::from_millis(400))];
        edits.extend(set.iter().map(|edit| Override::set(edit).unwrap()));
        fly(&Scenario::load(name, &edits).unwrap(), &|| false).unwrap()
    }

    #[test]
    fn a_flight_has_positions_and_a_rig_has_angles() {
        let hover = flown("hover", &[]);
        let passed = Verdict::Flown(Grade::Passed);
        assert_eq!((hover.verdict(), hover.cell("flown_s")), (passed, &Value::Number(0.4)));
        assert!(hover.badness()[0] > 0.0 && hover.badness()[0] < 0.1);
        assert_eq!(hover.cell("settling_s"), &Value::Missing);
        let rig = flown("attitude-step", &[]);
        assert_eq!(rig.cell("position_rms_m"), &Value::Missing);
        assert!(rig.cell("final_error_rad").number().is_some());
        assert!(rig.badness()[1] > 0.0, "a rig is ranked by how it settles");
    }

    #[test]
    fn an_outcome_reads_back_and_nothing_else_does() {
        let outcome = flown("hover", &["plant.mismatch.mass_scale=1.1"]);
        assert_eq!(Outcome::from_text(&outcome.to_text()), Some(outcome.clone()));
        let refused = Outcome::refused(&"no\nway");
        assert_eq!(refused.cell("reason"), &Value::from("no"));
        assert_eq!(Outcome::from_text(&refused.to_text()), Some(refused));
        let mut cells = outcome.to_text();
        cells[3] = "many".to_owned();
        assert_eq!(Outcome::from_text(&cells), None);
        assert_eq!(Outcome::from_text(&cells[1..]), None);
    }

    #[test]
    fn a_flight_that_is_stopped_has_no_outcome() {
        let scenario = Scenario::load("hover", &[]).unwrap();
        assert_eq!(fly(&scenario, &|| true), None);
    }
}
