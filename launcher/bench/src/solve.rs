//! `morphquad bench solve`: one step of each service, alone: the flight in one thread, without transport,
//! sleep or neighbours.

use super::BenchError;
use super::peer::Seat;
use super::place::Place;
use super::series::{Quantiles, Rank, Series};
use figures::results::Table;
use observe::stopwatch::Stopwatch;
use runtime::clock::mono_now_ns;
use scenario::components::{Crew, SLOTS, names_for};
use scenario::{Override, Scenario, ScenarioError};
use serde::Serialize;
use shared_types::Role;
use simulate::in_process::{InProcess, InProcessError, StateSource};
use std::collections::BTreeMap;
use std::thread;

/// Steps of a service.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SolveRow {
    /// The service.
    pub name: String,
    /// Its role.
    pub role: &'static str,
    /// Its rate \[Hz\].
    pub rate_hz: f64,
    /// From the start of a step, taking in its inputs included, to what it publishes.
    pub step: Quantiles,
}

/// Steps of every loop of a scenario in lockstep, as the crew flies it.
///
/// # Errors
/// The scenario does not fly without processes.
pub fn steps_alone(scenario: &Scenario, seat: Seat) -> Result<BTreeMap<Role, Series>, BenchError> {
    let flown = thread::scope(|scope| {
        scope
            .spawn(|| -> Result<Stopwatch, InProcessError> {
                seat.take("alone");
                let watch = Stopwatch::default();
                let mut flight = InProcess::new(scenario, StateSource::Estimator, watch)?;
                flight.stamp_by(mono_now_ns);
                flight.fly_until(scenario.duration_ns())?;
                Ok(flight.seen(core::mem::take))
            })
            .join()
    });
    let dead = || BenchError::Peer("died while it flew alone".to_owned());
    let watch = flown.map_err(|_| dead())?.map_err(BenchError::Alone)?;
    let compute = |role: Role| -> Series {
        let stamps = super::measure::stamps(&watch, role, 0);
        stamps.iter().map(|s| s.publish_mono_ns.saturating_sub(s.start_mono_ns)).collect()
    };
    let roles = Role::STEPPING.into_iter().map(|role| (role, compute(role)));
    Ok(roles.filter(|(_, series)| !series.is_empty()).collect())
}

/// Measures every service that can fill each role. `load` gives the scenario with further edits.
///
/// # Errors
/// [`BenchError`].
pub fn measure(
    load: &dyn Fn(&[Override]) -> Result<Scenario, ScenarioError>,
    place: &Place,
    done: &dyn Fn(),
) -> Result<Vec<SolveRow>, BenchError> {
    let seat = Seat { cpu: place.cpus.first().copied(), ..Seat::default() };
    let lockstep = Override::clock("lockstep");
    let mut rows: Vec<SolveRow> = Vec::new();
    for crew in crews() {
        let mut edits = vec![lockstep.clone()];
        for (slot, name) in &crew {
            edits.push(Override::crew(&format!("{}={name}", slot.label()))?);
        }
        let scenario = load(&edits)?;
        let crew = Crew::of(scenario.settings());
        let graph = scenario.graph().map_err(|error| BenchError::Wiring(error.to_string()))?;
        for (role, series) in steps_alone(&scenario, seat)? {
            let name = crew.name(role).unwrap_or(role.label());
            let (Some(step), Some(node)) = (series.quantiles(), graph.node(role)) else { continue };
            if rows.iter().all(|row| row.name != name) {
                let rate_hz = node.rate.hz();
                rows.push(SolveRow { name: name.to_owned(), role: role.label(), rate_hz, step });
            }
        }
        done();
    }
    Ok(rows)
}

/// Crews that have each service of a slot once.
#[must_use]
pub fn crews() -> Vec<Vec<(Role, &'static str)>> {
    let most = SLOTS.into_iter().map(|slot| names_for(slot).count()).max().unwrap_or(0);
    let crew = |index: usize| {
        let pick =
            |slot: Role| Some((slot, names_for(slot).nth(index).or(names_for(slot).next())?));
        SLOTS.into_iter().filter_map(pick).collect()
    };
    (0..most).map(crew).collect()
}

/// For people.
#[must_use]
pub fn table(rows: &[SolveRow]) -> Table {
    let heads = ["service", "Hz", "n"].into_iter();
    let mut table = Table::new(heads.chain(Rank::ALL.map(Rank::label)).chain(["of period"]));
    for row in rows {
        let ranks = Rank::ALL.map(|rank| super::us(row.step.at(rank)));
        let share = format!("{:.2} %", row.step.p99_us * 1e-6 * row.rate_hz * 100.0);
        let head = [row.name.clone(), row.rate_hz.to_string(), row.step.n.to_string()];
        table.push(head.into_iter().chain(ranks).chain([share]));
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_service_of_a_slot_is_in_some_crew() {
        let crews = crews();
        for slot in SLOTS {
            for name in names_for(slot) {
                assert!(crews.iter().any(|crew| crew.contains(&(slot, name))), "{name}");
            }
        }
    }

    #[test]
    fn steps_of_a_short_flight_are_all_counted() {
        let edits =
            [Override::clock("lockstep"), Override::set("scenario.duration_s=0.2").unwrap()];
        let scenario = Scenario::load("hover", &edits).unwrap();
        let steps = steps_alone(&scenario, Seat::default()).unwrap();
        let counts: Vec<_> = steps.iter().map(|(role, s)| (role.label(), s.len())).collect();
        for expected in [("plant", 200), ("estimator", 200), ("position", 10), ("attitude", 20)] {
            assert!(counts.contains(&expected), "{counts:?}");
        }
    }
}
