//! Which services fill the slots, and what the controllers beside the MPCs refuse.

use super::Checker;
use crate::services::{self, Assignment};
use controller::{ControllerSection as _, OutOfRange, SectionRefusal};
use document::suggestion;
use shared_types::Slot;

impl Checker<'_> {
    pub(super) fn assignment(&mut self) {
        let slots = self.settings().controller.clone();
        for (role, name) in slots.slots() {
            let Some(name) = name else { continue };
            if !services::names_for(role).any(|known| known == name) {
                let what = format!("no service called `{name}` fills this slot");
                let remedy = suggestion(name, services::names_for(role));
                self.error(&format!("controller.{}", role.label()), what, remedy);
            }
        }
        self.alternates();
    }

    /// Asks the controllers that fly, or that have a section, what they refuse.
    fn alternates(&mut self) {
        let assignment = Assignment::of(self.settings());
        let flies =
            |name: &str| Slot::ALL.into_iter().any(|slot| assignment.name(slot.role()) == name);
        let wanted =
            |name: &str, section: &str| flies(name) || self.document.root().contains_key(section);
        let vehicle = self.scenario.modelled_vehicle();
        if vehicle.validate().is_err() {
            return;
        }
        let flight = self.scenario.flight_facts();
        let settings = self.settings();
        macro_rules! refusals {
            ([] $($name:literal $section:ident $settings:ty,)*) => {
                [$((stringify!($section), wanted($name, stringify!($section))
                    .then(|| settings.$section.check(&flight).err()).flatten()),)*]
            };
        }
        for (section, refusal) in with_controllers!(refusals []) {
            match refusal {
                Some(SectionRefusal::Range(error)) => self.out_of_range(section, &error),
                Some(SectionRefusal::Refused { what, remedy }) => self.error(section, what, remedy),
                None => {}
            }
        }
    }

    fn out_of_range(&mut self, section: &str, error: &OutOfRange) {
        let key = match error.name {
            "wrench_latency_s" => "latency.wrench_command_s".to_owned(),
            "setpoint_latency_s" => "latency.attitude_setpoint_s".to_owned(),
            name => format!("{section}.{name}"),
        };
        let what = format!("{} does not go with the other settings", error.value);
        let remedy = format!("write a number from {} to {}", error.least, error.most);
        self.error(&key, what, remedy);
    }
}
