//! `morphquad bench`: from arguments to tables on stdout and an exit code.

mod loops;

use super::STANDARD_INPUT;
use super::bar::bar;
use super::options::{
    BenchCommand, Format, HopArguments, MeasurePlace, RateArguments, ScenarioArguments,
    scenario_arguments,
};
use super::refusal::Done;
use bench::hop::{self, HopPlan};
use bench::place::Place;
use bench::rate::{self, Ladder};
use bench::{BenchError, peer};
use core::time::Duration;
use host::exit;
use scenario::services::{self, Assignment};
use scenario::{Override, Scenario};
use shared_types::{Role, Slot};
use std::io::Write;

/// Measures; 1 if a gate fails, 2 for an impossible request, 3 where the machine gives no measurement.
pub(super) fn run(command: &BenchCommand, out: &mut dyn Write) -> Done {
    let done = match command {
        BenchCommand::Loops(arguments) => loops::measure(arguments),
        BenchCommand::Hop(arguments) => hop(arguments),
        BenchCommand::Rate(arguments) => find_rates(arguments),
    };
    super::conclude(done, BenchError::exit_code, out)
}

/// Is another process of a measurement.
pub(super) fn be_peer() -> u8 {
    peer::be_peer()
}

fn place(arguments: &MeasurePlace) -> Result<Place, BenchError> {
    let place = Place::take(arguments.policy, arguments.priority, arguments.cpus())?;
    if let Some(fell_back) = &place.fell_back {
        eprintln!("morphquad: {fell_back}");
    }
    Ok(place)
}

fn nanoseconds(duration: Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}

fn hop(arguments: &HopArguments) -> Result<(String, u8), BenchError> {
    let place = place(&arguments.place)?;
    let bar = bar(2 * hop::pairs(&place.cpus).len(), "measurements");
    let plan = HopPlan { for_ns: nanoseconds(arguments.duration), place };
    let report = hop::measure(&plan, &|| bar.inc(1))?;
    bar.finish_and_clear();
    // What was not compared holds nothing.
    let worst = report.worst_ratio().unwrap_or(f64::INFINITY);
    let failed = arguments.max_ratio.is_some_and(|most| worst > most);
    let code = if failed { exit::FAILED } else { exit::PASS };
    let text = match arguments.format {
        Format::Json => report.to_json().to_string(),
        Format::Text => {
            let mut text = format!(
                "one {} of {} bytes, process to process, us; x is ours over bare iceoryx2\n\n{}",
                report.payload,
                report.payload_bytes,
                report.table()
            );
            for left_out in &report.left_out {
                text = format!("{text}not measured: {left_out}\n");
            }
            if let Some(most) = arguments.max_ratio {
                let verdict = if failed { "FAILS" } else { "holds" };
                text =
                    format!("{text}\n{verdict}: median at most {most} x bare, worst {worst:.2}\n");
            }
            text
        }
    };
    Ok((text, code))
}

/// Refuses what would be ignored.
fn require_realtime(scenario: &ScenarioArguments) -> Result<(), BenchError> {
    let clock = scenario.clock.as_deref().filter(|clock| *clock != "realtime").map(|_| "--clock");
    let flag = clock.or(scenario.speed.as_ref().map(|_| "--speed"));
    flag.map_or(Ok(()), |flag| Err(BenchError::Realtime { flag }))
}

/// Flights with the loop of each role at rising rates.
fn find_rates(arguments: &RateArguments) -> Result<(String, u8), BenchError> {
    // Asked once here, so that what is refused is refused before anything flies.
    let place = place(&arguments.place)?;
    if arguments.scenario.scenario == STANDARD_INPUT {
        return Err(BenchError::StandardInput);
    }
    require_realtime(&arguments.scenario)?;
    let scenario = Scenario::load(&arguments.scenario.scenario, &arguments.scenario.overrides()?)?;
    let settings = scenario.settings();
    let assignment = Assignment::of(settings);
    let slots = Slot::ALL.map(Slot::role);
    let usual = slots
        .into_iter()
        .chain([Role::Estimator, Role::Plant])
        .map(|role| assignment.name(role))
        .map(str::to_owned);
    let names: Vec<String> =
        if arguments.only.is_empty() { usual.collect() } else { arguments.only.clone() };
    let mut rates_hz = Vec::new();
    for name in &names {
        Override::rate(&format!("{name}=100"))?;
        let filled = services::role_of(name).map(|role| assignment.name(role));
        rates_hz.extend(services::rate_hz(filled.unwrap_or(name), settings));
    }
    let flight_arguments = scenario_arguments(&arguments.scenario, "5s");
    let flight_arguments: Vec<String> =
        flight_arguments.into_iter().chain(arguments.place.arguments()).collect();
    let bar = bar(names.len(), "loops");
    let ladders = names.iter().zip(rates_hz).map(|(name, rate_hz)| {
        let fly = &mut |hz: f64| rate::fly(&flight_arguments, name, hz);
        let ladder = rate::climb(name, rate_hz, fly);
        bar.inc(1);
        ladder
    });
    let ladders = ladders.collect::<Result<Vec<Ladder>, _>>()?;
    bar.finish_and_clear();
    let text = match arguments.format {
        Format::Json => serde_json::json!({ "place": place, "loops": ladders }).to_string(),
        Format::Text => {
            let mut text = format!(
                "held: at most 0.1 % of the releases missed; us; {}\n\n{}\n",
                place.to_line(),
                rate::table(&ladders)
            );
            for lost in rate::losses(&ladders) {
                text = format!("{text}{lost}\n");
            }
            for ladder in &ladders {
                let held = ladder
                    .highest_hz
                    .map_or_else(|| "none of these rates".to_owned(), |hz| format!("{hz} Hz"));
                text = format!("{text}{} holds {held}\n", ladder.name);
                if let Some(stopped) = &ladder.stopped {
                    text = format!("{text}  no higher one was tried: {stopped}\n");
                }
            }
            text
        }
    };
    Ok((text, exit::PASS))
}
