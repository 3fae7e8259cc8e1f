//! One flying process of the launcher's own executable.

use crate::Scenario;
use crate::components::{self, Component, ComponentVisitor};
use host::{HostError, Joined, PlaceArguments, conclude, exit};
use runtime::{Ending, Service};
use shared_types::Role;
use std::io::{self, Write as _};

/// This executable, as a child is started from it: the file that runs, which the kernel holds even after a build
/// has replaced or removed it. Every process of a flight stays of one build, and a running flight can still
/// rehearse and restart. A process that is started by this path is called `exe` until it names itself, as `main`
/// does first.
pub const OWN_EXECUTABLE: &str = "/proc/self/exe";

/// Has the loops of this process count their allocations.
pub fn count_allocations() {
    runtime::upkeep::count_allocations_with(|run| allocation_counter::measure(run).count_total);
}

/// Runs one process of a flight to its end and returns its exit code.
#[must_use]
pub fn run_process(service: &str, place: PlaceArguments) -> u8 {
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

/// True if `role` is filled by a process of its own.
#[must_use]
pub fn has_process(role: Role) -> bool {
    role != Role::Pilot
}
