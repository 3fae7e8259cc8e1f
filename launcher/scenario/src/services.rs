//! The built-in services by name, and which of them fills which slot.

use crate::Settings;
use ::controller::ControllerSection as _;
use runtime::graph::ROLES;
use shared_types::{Role, Slot};

/// A service that steps, and its rate.
#[derive(Debug)]
pub(crate) struct Loop {
    /// Its name in commands and messages.
    pub(crate) name: &'static str,
    /// The section of a scenario that configures it.
    pub(crate) section: &'static str,
    role: Role,
    /// Rate in a scenario \[Hz\].
    rate_hz: fn(&Settings) -> f64,
}

macro_rules! loops {
    ([] $($name:literal $section:ident $settings:ty,)*) => {
        /// The built-in services in data-flow order, the first of a role filling it unless another one is asked for.
        /// Controllers of a slot run at the rate of its MPC unless they have their own.
        pub(crate) const LOOPS: &[Loop] = &[
            Loop::new("plant", "plant", Role::Plant, |s| s.plant.rate_hz),
            Loop::new("estimator", "estimator", Role::Estimator, |s| s.estimator.rate_hz),
            $(Loop::new($name, stringify!($section), <$settings>::SLOT.role(), |s| {
                s.$section.rate_hz().unwrap_or_else(|| usual_rate_hz(<$settings>::SLOT, s))
            }),)*
            Loop::new("disturbance-injector", "disturbance_injector", Role::Disturbance, |s| {
                s.disturbance_injector.rate_hz
            }),
            Loop::new("monitor", "monitor", Role::Monitor, |s| s.monitor.rate_hz),
            Loop::new("pilot", "pilot", Role::Pilot, |s| s.pilot.common.rate_hz),
        ];
    };
}
with_controllers!(loops []);

/// Rate of a controller whose section has none \[Hz\]: that of the first one of its slot, which has one of its own.
pub(crate) fn usual_rate_hz(slot: Slot, settings: &Settings) -> f64 {
    Loop::of(slot.role()).map_or(0.0, |first| (first.rate_hz)(settings))
}

impl Loop {
    const fn new(
        name: &'static str,
        section: &'static str,
        role: Role,
        rate_hz: fn(&Settings) -> f64,
    ) -> Self {
        Self { name, section, role, rate_hz }
    }

    pub(crate) fn role(&self) -> Role {
        self.role
    }

    /// By its name or, the first, by that of its role; it may be written as its section is.
    pub(crate) fn named(name: &str) -> Option<&'static Self> {
        let name = name.trim().replace('_', "-");
        LOOPS.iter().find(|known| known.name == name || known.role.label() == name)
    }

    /// The first that fills a role.
    pub(crate) fn of(role: Role) -> Option<&'static Self> {
        LOOPS.iter().find(|known| known.role == role)
    }
}

/// Names of all built-in services.
pub fn names() -> impl Iterator<Item = &'static str> + Clone {
    LOOPS.iter().map(|service| service.name)
}

/// Role that a service fills.
#[must_use]
pub fn role_of(name: &str) -> Option<Role> {
    LOOPS.iter().find(|service| service.name == name).map(|service| service.role)
}

/// Rate at which a loop steps in a scenario \[Hz\], by its name or that of its role; none if there is no such loop.
#[must_use]
pub fn rate_hz(name: &str, settings: &Settings) -> Option<f64> {
    Loop::named(name).map(|found| (found.rate_hz)(settings))
}

/// A slot and the service that is to fill it, by their names.
///
/// # Errors
/// What is wrong with them.
pub fn filling(slot: &str, name: &str) -> Result<(Role, &'static str), &'static str> {
    let role = Slot::named(slot).ok_or("there is no such slot")?.role();
    let service = names_for(role).find(|service| *service == name);
    Ok((role, service.ok_or("no service of this name fills the slot")?))
}

/// Every slot with every service that fills it.
#[must_use]
pub fn fillings() -> Vec<String> {
    let names = |role: Role| names_for(role).map(move |name| format!("{}={name}", role.label()));
    Slot::ALL.into_iter().flat_map(|slot| names(slot.role())).collect()
}

/// Services that fill `role`.
pub fn names_for(role: Role) -> impl Iterator<Item = &'static str> + Clone {
    LOOPS.iter().filter(move |service| service.role == role).map(|service| service.name)
}

/// Which service fills which role.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Assignment([&'static str; ROLES]);

impl Default for Assignment {
    fn default() -> Self {
        Self(Role::STEPPING.map(|role| Loop::of(role).map_or(role.label(), |first| first.name)))
    }
}

impl Assignment {
    /// The services that fly a scenario. A name that fills nothing, which no scenario that has been loaded has,
    /// changes nothing.
    #[must_use]
    pub fn of(settings: &Settings) -> Self {
        let mut assignment = Self::default();
        for (role, name) in settings.controller.slots() {
            let _ = name.is_some_and(|name| assignment.swap(role, name));
        }
        assignment
    }

    /// Name of the service that fills a role.
    #[must_use]
    pub fn name(&self, role: Role) -> &'static str {
        self.0.get(role.index()).copied().unwrap_or(role.label())
    }

    /// Rate of the loop that fills a role \[Hz\].
    #[must_use]
    pub fn rate_hz(&self, role: Role, settings: &Settings) -> f64 {
        rate_hz(self.name(role), settings).unwrap_or_default()
    }

    /// Lets another service fill a role. False if the service is of another role.
    #[must_use]
    pub fn swap(&mut self, role: Role, service: &str) -> bool {
        let found = names_for(role).find(|name| *name == service);
        if let (Some(slot), Some(found)) = (self.0.get_mut(role.index()), found) {
            *slot = found;
        }
        found.is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_controller_of_each_slot_has_a_rate_of_its_own() {
        macro_rules! rates {
            ([] $($name:literal $section:ident $settings:ty,)*) => {
                [$((<$settings>::SLOT, <$settings>::default().rate_hz())),*]
            };
        }
        let rates = with_controllers!(rates []);
        for slot in Slot::ALL {
            let first = rates.iter().find(|(own, _)| *own == slot);
            assert!(first.is_some_and(|(_, rate_hz)| rate_hz.is_some()), "{}", slot.label());
        }
    }
}
