//! A service of the launcher's own executable as a process of its own.
//!
//! It is a crate beside `scenario` because here each service is compiled into its loop, which has to be fast, and
//! there texts are read, which need not be.

use host::{HostError, Joined, PlaceArguments, conclude, exit};
use runtime::{Ending, Service};
use scenario::Scenario;
use scenario::components::{self, Component, ComponentVisitor};
use shared_types::Role;
use std::io::{self, Write as _};

/// Has the loops of this process count their allocations.
pub fn count_allocations() {
    runtime::upkeep::count_allocations_with(|run| allocation_counter::measure(run).count_total);
}

/// Runs one process of a flight to its end and returns its exit code.
#[must_use]
pub fn run(service: &str, place: PlaceArguments) -> u8 {
    let Some(role) = components::role_of(service) else {
        let known = components::names().join(", ");
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
    components::build_service(Some(service), &scenario, Fly(joined)).map_err(HostError::Build)?
}

/// Flies whatever component it is given.
struct Fly(Joined);

impl ComponentVisitor for Fly {
    type Output = Result<Ending, HostError>;
    fn visit<S: Service>(self, component: Component<S>) -> Self::Output {
        self.0.fly(component.service, component.state_every)
    }
}
