//! `morphquad bench scale`: the same flight one, two, four times at once, and what becomes of each.

use super::BenchError;
use super::fleet::{Flight, Flown};
use super::report::LoopsReport;
use super::series::Rank;
use figures::results::Table;
use serde::Serialize;

/// So many vehicles at once.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ScaleRow {
    /// How many.
    pub vehicles: usize,
    /// How many of them flew to the end.
    pub flown: usize,
    /// Of one processor, all processes of all together \[%\].
    pub cpu_percent: f64,
    /// Resident memory of all processes, what they share counted for each \[MB\].
    pub rss_mb: f64,
    /// Lateness of the attitude loop, median and 99 %, in the worst of them \[us\].
    pub lateness_us: [f64; 2],
    /// From the IMU sample to the gate, median and 99 %, in the worst of them \[us\].
    pub path_us: [f64; 2],
    /// The largest share of releases that a loop missed.
    pub miss_share: f64,
    /// Whose that was.
    pub worst_loop: String,
    /// True if every loop of every vehicle held its rate.
    pub holds: bool,
    /// Why one did not fly, or not to its end.
    pub lost: Option<String>,
}

/// Flies so many at once.
///
/// # Errors
/// [`BenchError`] if one cannot be started.
pub fn fly(words: &[String], vehicles: usize) -> Result<ScaleRow, BenchError> {
    let flights = (0..vehicles).map(|_| Flight::start(words)).collect::<Result<Vec<_>, _>>()?;
    let ended: Result<Vec<Flown>, _> = flights.into_iter().map(Flight::wait).collect();
    Ok(row(vehicles, &ended?))
}

fn row(vehicles: usize, ended: &[Flown]) -> ScaleRow {
    let mut row = ScaleRow {
        vehicles,
        flown: 0,
        cpu_percent: 0.0,
        rss_mb: 0.0,
        lateness_us: [0.0; 2],
        path_us: [0.0; 2],
        miss_share: 0.0,
        worst_loop: String::new(),
        holds: true,
        lost: None,
    };
    for flown in ended {
        match flown {
            Flown::Measured(report) => row.add(report),
            Flown::Refused(why) | Flown::Lost(why) => {
                row.holds = false;
                row.lost.get_or_insert_with(|| why.clone());
            }
        }
    }
    row
}

impl ScaleRow {
    fn add(&mut self, report: &LoopsReport) {
        self.flown += 1;
        for l in &report.loops {
            let cost = l.cost.unwrap_or_default();
            self.cpu_percent += cost.cpu_percent;
            self.rss_mb += cost.rss_mb;
            self.holds &= l.holds;
            let share = l.counts.miss_share();
            if share > self.miss_share || self.worst_loop.is_empty() {
                (self.miss_share, self.worst_loop) = (share, l.name.clone());
            }
            if l.role == "attitude"
                && let Some(told) = l.figures.get("lateness")
            {
                raise(&mut self.lateness_us, &told.flown);
            }
        }
        if let Some(path) = report.paths.first() {
            raise(&mut self.path_us, &path.total.flown);
        }
    }
}

fn raise(worst: &mut [f64; 2], told: &super::series::Quantiles) {
    for (worst, rank) in worst.iter_mut().zip([Rank::P50, Rank::P99]) {
        *worst = worst.max(told.at(rank));
    }
}

/// For people.
#[must_use]
pub fn table(rows: &[ScaleRow]) -> Table {
    let mut table = Table::new([
        "vehicles", "cpu %", "rss MB", "late p50", "late p99", "path p50", "path p99", "missed",
        "holds",
    ]);
    for row in rows {
        let [late, late99] = row.lateness_us.map(super::us);
        let [path, path99] = row.path_us.map(super::us);
        table.push([
            row.vehicles.to_string(),
            format!("{:.1}", row.cpu_percent),
            format!("{:.0}", row.rss_mb),
            late,
            late99,
            path,
            path99,
            format!("{:.2} %", 100.0 * row.miss_share),
            if row.holds { "yes" } else { "no" }.to_owned(),
        ]);
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_vehicle_that_was_lost_is_counted_and_named() {
        let row = row(2, &[Flown::Lost("killed".to_owned()), Flown::Refused("no".to_owned())]);
        assert_eq!((row.flown, row.holds), (0, false));
        assert_eq!(row.lost.as_deref(), Some("killed"));
    }
}
