//! A service of this executable as a process of its own.

use host::{HostError, Joined, PlaceArguments, conclude, exit};
use runtime::Ending;
use scenario::{Scenario, services};
use shared_types::Role;
use std::io::{self, Write as _};

/// Has the loops of this process count their allocations.
pub(super) fn count_allocations() {
    runtime::upkeep::count_allocations_with(|run| allocation_counter::measure(run).count_total);
}

/// Runs one process of a flight to its end and returns its exit code.
pub(super) fn run(service: &str, place: PlaceArguments) -> u8 {
    let Some(role) = services::role_of(service) else {
        let known = services::names().collect::<Vec<_>>().join(", ");
        let _ = writeln!(io::stderr(), "{service}: no such service; there are {known}");
        return exit::USAGE;
    };
    conclude(service, fly(service, role, place))
}

fn fly(service: &str, role: Role, place: PlaceArguments) -> Result<Ending, HostError> {
    let file = place.config.clone().unwrap_or_else(|| place.run.join("scenario.toml"));
    let joined = Joined::join(service, role, place)?;
    let scenario = Scenario::load(&file.to_string_lossy(), &[])
        .map_err(|error| HostError::Build(error.into()))?;
    let component = components::build_service(service, &scenario).map_err(HostError::Build)?;
    joined.fly(component)
}
