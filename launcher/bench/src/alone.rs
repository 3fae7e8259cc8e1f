//! Steps of each service alone: the flight in one thread, without transport, sleep or neighbours.

use super::BenchError;
use super::peer::Seat;
use super::series::Series;
use observe::stopwatch::Stopwatch;
use runtime::clock::mono_now_ns;
use scenario::Scenario;
use shared_types::Role;
use simulate::in_process::{InProcess, InProcessError, StateSource};
use std::collections::BTreeMap;
use std::thread;

/// Steps of every loop of a scenario in lockstep, by the controllers that are assigned.
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
