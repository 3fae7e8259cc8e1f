//! The pilot: a flying component like the others, on a thread of the launcher.

use host::realtime::Setup;
use host::{fly_component, name_thread, stay_on};
use runtime::ipc::Bus;
use runtime::watch::StopFlags;
use runtime::{Component, Ending, Executor, Graph, Place, Timing};
use scenario::Scenario;
use scenario::services::Assignment;
use shared_types::{ClockMode, Role};
use simulate::setup::clock_of;
use std::path::Path;
use std::thread::{self, JoinHandle};

/// Outcome of the pilot, as text if it failed.
pub(super) type PilotEnd = Result<Ending, String>;

/// How the pilot comes into a flight.
#[derive(Debug, Clone, Copy)]
pub(super) enum Entry {
    /// With all the others.
    AtTheStart,
    /// In the air, as this generation, when it is told to.
    InFlight { generation: u32 },
}

struct FlyPilot<'a> {
    bus: &'a Bus,
    graph: Graph,
    stop: StopFlags,
    entry: Entry,
    setup: Option<Setup>,
    timing: Option<Timing>,
}

impl FlyPilot<'_> {
    fn fly(self, component: Component) -> PilotEnd {
        let node = *self.graph.node(Role::Pilot).ok_or("this flight has no pilot")?;
        let (generation, await_handover) = match self.entry {
            Entry::AtTheStart => (0, false),
            Entry::InFlight { generation } => (generation, true),
        };
        let place = Place { generation, ..Place::default() };
        let executor = Executor::new(component, node, place);
        let prepare = || {
            // What is not granted here, was not to the other loops either.
            let Some(setup) = self.setup else { return Ok(()) };
            // Its process is the launcher: what that takes later belongs to no loop.
            if setup.lock_memory {
                let _ = host::realtime::lock_present_memory();
            }
            let _ = Setup { lock_memory: false, ..setup }.apply();
            Ok(())
        };
        let flown = (executor, self.timing);
        fly_component(self.bus, self.graph, self.stop, flown, (await_handover, prepare))
            .map_err(|error| error.to_string())
    }
}

/// Starts the pilot; it has its own connection, because ports stay on their thread.
pub(super) fn start(
    scenario: Scenario,
    graph: Graph,
    ipc_config: &Path,
    stop: StopFlags,
    cpu: Option<usize>,
    entry: Entry,
) -> std::io::Result<JoinHandle<PilotEnd>> {
    let ipc_config = ipc_config.to_path_buf();
    thread::Builder::new().name("pilot".to_owned()).spawn(move || {
        name_thread("pilot");
        if let Some(cpu) = cpu {
            stay_on(cpu);
        }
        let setup = scenario.flight().ok().and_then(|flight| flight.setup(Role::Pilot));
        let bus = Bus::join(&ipc_config, "pilot").map_err(|error| error.to_string())?;
        let component =
            components::build(&Assignment::of(scenario.settings()), Role::Pilot, &scenario)
                .map_err(|error| error.to_string())?;
        let by_the_wall = clock_of(&scenario) == ClockMode::Realtime;
        let timing = scenario.timing();
        let timing = timing.map(|s| Timing::new(s, Role::Pilot.label(), by_the_wall));
        FlyPilot { bus: &bus, graph, stop, entry, setup, timing }.fly(component)
    })
}
