//! The same flight one, two, four times at once, and what becomes of each.
//!
//! `cargo bench --bench scale -- SCENARIO --max N --policy other` takes the scenario and the place of
//! `morphquad bench loops`.

mod flown;

use bench::BenchError;
use bench::fleet::{Flight, Flown};
use bench::place::Place;
use bench::report::LoopsReport;
use bench::series::{Quantiles, Rank};
use clap::Parser;
use cli::options::{Format, MeasurePlace, ScenarioArguments, scenario_arguments};
use figures::figure::us;
use figures::results::Table;
use scenario::Scenario;
use serde::Serialize;
use std::io::Write as _;
use std::process::ExitCode;

/// The same flight with 1, 2, 4, ... vehicles at once.
#[derive(Debug, Parser)]
struct Options {
    /// The scenario; each flight of it takes 5s unless --for is given.
    #[command(flatten)]
    scenario: ScenarioArguments,
    /// Where.
    #[command(flatten)]
    place: MeasurePlace,
    /// Most vehicles at once
    #[arg(long, value_name = "N", default_value = "4", value_parser = clap::value_parser!(u16).range(1..=64))]
    max: u16,
    /// Form of the result
    #[arg(long, value_enum, default_value = "text")]
    format: Format,
    /// What cargo passes to every bench.
    #[arg(long, hide = true)]
    bench: bool,
}

/// So many vehicles at once.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct ScaleRow {
    /// How many.
    vehicles: usize,
    /// How many of them flew to the end.
    flown: usize,
    /// Of one processor, all processes of all together \[%\].
    cpu_percent: f64,
    /// Resident memory of all processes, what they share counted for each \[MB\].
    rss_mb: f64,
    /// Lateness of the attitude loop, median and 99 %, in the worst of them \[us\].
    lateness_us: [f64; 2],
    /// From the IMU sample to the gate, median and 99 %, in the worst of them \[us\].
    path_us: [f64; 2],
    /// The largest share of releases that a loop missed.
    miss_share: f64,
    /// The loop with that share.
    worst_loop: String,
    /// True if every loop of every vehicle held its rate.
    holds: bool,
    /// Why one did not fly, or not to its end.
    lost: Option<String>,
}

/// Flies so many at once.
fn fly(arguments: &[String], vehicles: usize) -> Result<ScaleRow, BenchError> {
    let flights = (0..vehicles)
        .map(|_| Flight::start(flown::morphquad(), arguments))
        .collect::<Result<Vec<_>, _>>()?;
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
                && let Some(figure) = l.figures.get("lateness")
            {
                raise(&mut self.lateness_us, &figure.flown);
            }
        }
        if let Some(path) = report.paths.first() {
            raise(&mut self.path_us, &path.total.flown);
        }
    }
}

fn raise(worst: &mut [f64; 2], quantiles: &Quantiles) {
    for (worst, rank) in worst.iter_mut().zip([Rank::P50, Rank::P99]) {
        *worst = worst.max(quantiles.at(rank));
    }
}

/// For people.
fn table(rows: &[ScaleRow]) -> Table {
    let mut table = Table::new([
        "vehicles", "cpu %", "rss MB", "late p50", "late p99", "path p50", "path p99", "missed",
        "holds",
    ]);
    for row in rows {
        let [late, late99] = row.lateness_us.map(us);
        let [path, path99] = row.path_us.map(us);
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

fn report(options: &Options) -> Result<String, BenchError> {
    let place = Place::take(options.place.policy, options.place.priority, options.place.cpus())?;
    Scenario::load(&options.scenario.scenario, &options.scenario.overrides()?)?;
    let arguments = scenario_arguments(&options.scenario, "5s");
    let arguments: Vec<String> = arguments.into_iter().chain(options.place.arguments()).collect();
    let most = usize::from(options.max);
    let doubled = core::iter::successors(Some(1), |n| Some(2 * n)).take_while(|n| *n < most);
    let rows = doubled.chain([most]).map(|vehicles| fly(&arguments, vehicles));
    let rows = rows.collect::<Result<Vec<_>, _>>()?;
    if options.format == Format::Json {
        return Ok(serde_json::json!({ "place": place, "sizes": rows }).to_string());
    }
    let mut text = format!(
        "late: release of the attitude loop to its start; path: IMU sample to the plant's gate; us, the worst\n\
         of the vehicles; missed: the loop that missed most; {}\n\n{}",
        place.to_line(),
        table(&rows)
    );
    for row in &rows {
        if let Some(lost) = &row.lost {
            text = format!("{text}with {} vehicles one was lost: {lost}\n", row.vehicles);
        }
    }
    Ok(text)
}

fn main() -> ExitCode {
    if let Some(code) = flown::run_if_flown() {
        return code;
    }
    match report(&Options::parse()) {
        Ok(text) => {
            // A closed pipe changes nothing.
            let _ = writeln!(std::io::stdout(), "{text}");
            ExitCode::SUCCESS
        }
        Err(error) => {
            let _ = writeln!(std::io::stderr(), "{error}");
            ExitCode::from(error.exit_code())
        }
    }
}
