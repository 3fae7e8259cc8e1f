//! The one table that turns a scenario into components: a new built-in service is a line here.

use crate::{Plan, Scenario, Settings};
use ::pilot::{Pilot, RigPilot};
use attitude_lqr::{AttitudeLqr, LqrLaw};
use attitude_mpc::AttitudeMpc;
use attitude_pid::{AttitudePid, PidLaw};
use disturbance_injector::DisturbanceInjector;
use estimator::Estimator;
use monitor::Monitor;
use plant::Plant;
use position_mpc::{Landing, PositionMpc};
use position_pid::PositionPid;
use runtime::Service;
use runtime::graph::ROLES;
use runtime::service::state_layout;
use shared_types::Role;
use shared_types::wire::Wire;

/// A service with what the runtime needs to run it.
#[derive(Debug)]
pub struct Component<S> {
    /// The pure component.
    pub service: S,
    /// Steps from one published state to the next.
    pub state_every: u64,
}

/// Does something with a component of whatever type.
pub trait ComponentVisitor {
    /// What comes of it.
    type Output;
    /// Called with the component built.
    fn visit<S: Service + 'static>(self, component: Component<S>) -> Self::Output;
}

/// Why a component cannot be built although its scenario is valid.
pub type BuildError = Box<dyn std::error::Error>;

/// Services and the roles they fill, in data-flow order; the first of a role fills it unless another
/// one is asked for.
const PROCESSES: [(&str, Role); 9] = [
    ("plant", Role::Plant),
    ("estimator", Role::Estimator),
    ("position-mpc", Role::Position),
    ("position-pid", Role::Position),
    ("attitude-mpc", Role::Attitude),
    ("attitude-lqr", Role::Attitude),
    ("attitude-pid", Role::Attitude),
    ("disturbance-injector", Role::Disturbance),
    ("monitor", Role::Monitor),
];

/// Names of all built-in services.
#[must_use]
pub fn names() -> [&'static str; 9] {
    PROCESSES.map(|(name, _)| name)
}

/// Role that a service fills.
#[must_use]
pub fn role_of(name: &str) -> Option<Role> {
    PROCESSES.iter().find(|(n, _)| *n == name).map(|(_, role)| *role)
}

/// Roles whose owner can change.
pub const SLOTS: [Role; 2] = [Role::Attitude, Role::Position];

/// A slot and the service that is to fill it, by their names.
///
/// # Errors
/// What is wrong with them.
pub fn filling(slot: &str, name: &str) -> Result<(Role, &'static str), &'static str> {
    let role = SLOTS.into_iter().find(|role| role.label() == slot);
    let role = role.ok_or("there is no such slot")?;
    let service = names_for(role).find(|service| *service == name);
    Ok((role, service.ok_or("no service of this name fills the slot")?))
}

/// Every slot with every service that fills it.
#[must_use]
pub fn fillings() -> Vec<String> {
    let names = |role: Role| names_for(role).map(move |name| format!("{}={name}", role.label()));
    SLOTS.into_iter().flat_map(names).collect()
}

/// Name of the service that fills a role by default.
fn name_of(role: Role) -> Option<&'static str> {
    PROCESSES.iter().find(|(_, r)| *r == role).map(|(name, _)| *name)
}

/// Services that fill `role`.
pub fn names_for(role: Role) -> impl Iterator<Item = &'static str> + Clone {
    PROCESSES.into_iter().filter(move |(_, r)| *r == role).map(|(name, _)| name)
}

/// Who fills which role.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Crew([Option<&'static str>; ROLES]);

impl Default for Crew {
    fn default() -> Self {
        Self(Role::STEPPING.map(name_of))
    }
}

impl Crew {
    /// Who flies a scenario. A name that fills nothing, which no scenario that has been loaded has,
    /// changes nothing.
    #[must_use]
    pub fn of(settings: &Settings) -> Self {
        let mut crew = Self::default();
        for (role, name) in settings.crew.slots() {
            let _ = name.is_some_and(|name| crew.swap(role, name));
        }
        crew
    }

    /// Name of the service that fills a role; the pilot has none.
    #[must_use]
    pub fn name(&self, role: Role) -> Option<&'static str> {
        self.0.get(role.index()).copied().flatten()
    }

    /// Lets another service fill a role. False if the service is of another role.
    #[must_use]
    pub fn swap(&mut self, role: Role, service: &str) -> bool {
        let found = names_for(role).find(|name| *name == service);
        if let (Some(slot), Some(_)) = (self.0.get_mut(role.index()), found) {
            *slot = found;
        }
        found.is_some()
    }

    /// Builds the component that fills `role` and hands it to the visitor.
    ///
    /// # Errors
    /// The component refuses its configuration.
    pub fn build<V: ComponentVisitor>(
        &self,
        role: Role,
        scenario: &Scenario,
        visitor: V,
    ) -> Result<V::Output, BuildError> {
        build_service(self.name(role), scenario, visitor)
    }
}

/// Builds the component that fills `role` in a scenario and hands it to the visitor.
///
/// # Errors
/// The component refuses its configuration.
pub fn build<V: ComponentVisitor>(
    role: Role,
    scenario: &Scenario,
    visitor: V,
) -> Result<V::Output, BuildError> {
    Crew::of(scenario.settings()).build(role, scenario, visitor)
}

/// Builds a service by name; the pilot has none.
///
/// # Errors
/// The component refuses its configuration.
#[expect(clippy::too_many_lines, reason = "one arm per service")]
pub fn build_service<V: ComponentVisitor>(
    name: Option<&str>,
    scenario: &Scenario,
    visitor: V,
) -> Result<V::Output, BuildError> {
    let settings = scenario.settings();
    let vehicle = scenario.modelled_vehicle();
    let after_s = settings.launcher.launcher_grace_s;
    let landing = Landing { after_s, ..Landing::default() };
    let yaw_rad = scenario.start_yaw_rad();
    Ok(match name {
        Some("plant") => visitor.visit(Component {
            service: Plant::new(&scenario.plant_config()?)?,
            state_every: settings.plant.state_every.into(),
        }),
        Some("estimator") => {
            let (config, initial) = scenario.filter()?;
            visitor.visit(Component {
                service: Estimator::new(config, &initial)?,
                state_every: settings.estimator.state_every.into(),
            })
        }
        Some("position-mpc") => {
            let service = PositionMpc::new(scenario.position_law()?, &vehicle, landing)?;
            visitor.visit(Component { service, state_every: 1 })
        }
        Some("position-pid") => {
            let service = PositionPid::new(scenario.position_pid()?, &vehicle, landing)?;
            visitor.visit(Component { service, state_every: 1 })
        }
        Some("attitude-mpc") => {
            let service = AttitudeMpc::new(scenario.attitude_law()?, &vehicle, yaw_rad)?;
            visitor.visit(Component { service, state_every: 1 })
        }
        Some("attitude-lqr") => {
            let config = scenario.attitude_lqr();
            let law = LqrLaw::new(config, &vehicle)?;
            let service = AttitudeLqr::new(law, &vehicle, config.timing, yaw_rad);
            visitor.visit(Component { service, state_every: 1 })
        }
        Some("attitude-pid") => {
            let config = scenario.attitude_pid();
            let service = AttitudePid::new(PidLaw::new(config)?, &vehicle, config.timing, yaw_rad);
            visitor.visit(Component { service, state_every: 1 })
        }
        Some("disturbance-injector") => {
            let section = &settings.disturbance_injector;
            let config = section.injector_config();
            visitor.visit(Component {
                service: DisturbanceInjector::new(&config, settings.scenario.seed)?,
                state_every: section.state_every.into(),
            })
        }
        Some("monitor") => visitor.visit(Component {
            service: Monitor::new(&scenario.monitor_config(landing), &vehicle),
            state_every: 1,
        }),
        _ => match scenario.plan() {
            Plan::Flight(config) => {
                let service = Pilot::new(&config, &vehicle)?;
                visitor.visit(Component { service, state_every: PILOT_STATE_EVERY })
            }
            Plan::Rig(config) => {
                let service = RigPilot::new(&config, &vehicle)?;
                visitor.visit(Component { service, state_every: PILOT_STATE_EVERY })
            }
        },
    })
}

/// Layout of the published state of the component that fills a role.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StateLayout {
    /// The role.
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
    struct Layout(Role);
    impl ComponentVisitor for Layout {
        type Output = StateLayout;
        fn visit<S: Service + 'static>(self, _component: Component<S>) -> StateLayout {
            StateLayout {
                role: self.0,
                type_name: <S::Memory as Wire>::SCHEMA.name,
                hash: state_layout::<S>(),
            }
        }
    }
    let graph = scenario.graph()?;
    let crew = Crew::of(scenario.settings());
    let mut layouts = Vec::new();
    for role in graph.nodes().iter().map(|node| node.role) {
        layouts.push(crew.build(role, scenario, Layout(role))?);
        let others = names_for(role).filter(|name| Some(*name) != crew.name(role));
        // Whoever does not fit the scenario has not flown in it.
        layouts.extend(
            others.filter_map(|name| build_service(Some(name), scenario, Layout(role)).ok()),
        );
    }
    Ok(layouts)
}

/// The pilot is a function of time; its state is a counter.
const PILOT_STATE_EVERY: u64 = 50;
