//! The built-in services by name, and who fills which slot.

use crate::Settings;
use runtime::graph::ROLES;
use shared_types::Role;

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
}
