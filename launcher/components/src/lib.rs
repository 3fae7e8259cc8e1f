//! Turns a scenario into components. Controllers are those of `with_controllers`, and what a new one needs stands in
//! `launcher/docs/controllers.md`.
//!
//! It is a crate beside `scenario` because here each service is compiled into what its loop runs, which has to
//! be fast, and there texts are read, which need not be.

use ::pilot::{Pilot, RigPilot};
use controller::ControllerSection as _;
use disturbance_injector::DisturbanceInjector;
use estimator::Estimator;
use monitor::Monitor;
use plant::Plant;
use runtime::{Component, Service};
use scenario::services::{Assignment, names_for};
use scenario::{Plan, Scenario};
use shared_types::Role;

/// The pilot is a function of time; its state is a counter.
const PILOT_STATE_EVERY: u64 = 50;

/// Does something with a service of whatever type.
pub trait ServiceVisitor {
    /// What comes of it.
    type Output;
    /// Called with the service and the number of steps from one published state to the next.
    fn visit<S: Service + 'static>(self, service: S, state_every: u64) -> Self::Output;
}

/// Why a component cannot be built although its scenario is valid.
pub type BuildError = Box<dyn std::error::Error>;

/// Builds the component that fills `role` by an assignment of controllers.
///
/// # Errors
/// The component refuses its configuration.
pub fn build(
    assignment: &Assignment,
    role: Role,
    scenario: &Scenario,
) -> Result<Component, BuildError> {
    build_service(assignment.name(role), scenario)
}

/// Builds a service by name.
///
/// # Errors
/// The component refuses its configuration.
pub fn build_service(name: &str, scenario: &Scenario) -> Result<Component, BuildError> {
    struct Forget;
    impl ServiceVisitor for Forget {
        type Output = Component;
        fn visit<S: Service + 'static>(self, service: S, state_every: u64) -> Component {
            Component::new(service, state_every)
        }
    }
    visit_service(name, scenario, Forget)
}

/// Builds a service by name and hands it to the visitor.
///
/// # Errors
/// There is no such service, or the component refuses its configuration.
pub fn visit_service<V: ServiceVisitor>(
    name: &str,
    scenario: &Scenario,
    visitor: V,
) -> Result<V::Output, BuildError> {
    let settings = scenario.settings();
    let vehicle = scenario.modelled_vehicle();
    macro_rules! visit_controller {
        ([] $($name:literal $section:ident $settings:ty,)*) => {
            match name {
                $($name => {
                    let service = settings.$section.build(&scenario.flight_facts())?;
                    return Ok(visitor.visit(service, 1));
                })*
                _ => {}
            }
        };
    }
    scenario::with_controllers!(visit_controller []);
    Ok(match name {
        "plant" => {
            visitor.visit(Plant::new(&scenario.plant_config()?)?, settings.plant.state_every.into())
        }
        "estimator" => {
            let (config, initial) = scenario.filter()?;
            visitor.visit(Estimator::new(config, &initial)?, settings.estimator.state_every.into())
        }
        "disturbance-injector" => {
            let section = &settings.disturbance_injector;
            let config = section.injector_config();
            visitor.visit(
                DisturbanceInjector::new(&config, settings.scenario.seed)?,
                section.state_every.into(),
            )
        }
        "monitor" => visitor.visit(Monitor::new(&scenario.monitor_config(), &vehicle), 1),
        "pilot" => match scenario.plan() {
            Plan::Flight(config) => {
                let service = Pilot::new(&config, &vehicle)?;
                visitor.visit(service, PILOT_STATE_EVERY)
            }
            Plan::Rig(config) => {
                let service = RigPilot::new(&config, &vehicle)?;
                visitor.visit(service, PILOT_STATE_EVERY)
            }
        },
        other => return Err(format!("no service is called `{other}`").into()),
    })
}

/// Layout of the published state of the component that fills a role.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StateLayout {
    pub role: Role,
    /// Type of the component's memory.
    pub type_name: &'static str,
    /// Hash of header, outputs, latches and memory.
    pub hash: u64,
}

/// Layouts of the states that a scenario's components publish, and of those that others in their
/// slots would.
///
/// # Errors
/// A component refuses its configuration, or the loops cannot be wired.
pub fn state_layouts(scenario: &Scenario) -> Result<Vec<StateLayout>, BuildError> {
    let layout = |role: Role, component: &Component| {
        let layout = component.layout();
        StateLayout { role, type_name: layout.memory.name, hash: layout.hash() }
    };
    let graph = scenario.graph()?;
    let assignment = Assignment::of(scenario.settings());
    let mut layouts = Vec::new();
    for role in graph.nodes().iter().map(|node| node.role) {
        layouts.push(layout(role, &build(&assignment, role, scenario)?));
        // A service that does not fit the scenario has not flown in it.
        let others = names_for(role).filter(|name| *name != assignment.name(role));
        let others = others.filter_map(|name| build_service(name, scenario).ok());
        layouts.extend(others.map(|component| layout(role, &component)));
    }
    Ok(layouts)
}

#[cfg(test)]
mod tests {
    use super::build_service;
    use runtime::StateHeader;
    use scenario::Scenario;
    use scenario::services::names;

    #[test]
    fn every_service_begins_with_a_state_that_a_process_can_go_on_from() {
        let scenario = Scenario::load("figure8-morph", &[]).expect("a shipped scenario");
        let mut built = 0;
        for name in names() {
            let component = build_service(name, &scenario).expect("it fits this scenario");
            let layout = *component.layout();
            let mut state = vec![0; layout.state_size()];
            component.pack(&StateHeader::default(), &mut state);
            assert!(layout.is_finite(&state), "{name:?}: {}", layout.memory.name);
            built += 1;
        }
        assert!(built > 9, "{built}");
    }
}
