//! Who fills the slots, and what the controllers beside the MPCs refuse.

use super::Checker;
use crate::services::{self, Assignment};
use crate::suggest;
use attitude_lqr::{LqrError, LqrLaw};
use attitude_pid::PidLaw;
use controller::OutOfRange;
use position_pid::PositionPidLaw;
use shared_types::Slot;

impl Checker<'_> {
    pub(super) fn assignment(&mut self) {
        let slots = self.settings().controller.clone();
        for (role, name) in slots.slots() {
            let Some(name) = name else { continue };
            if !services::names_for(role).any(|known| known == name) {
                let what = format!("no service called `{name}` fills this slot");
                let remedy = suggest::remedy(name, services::names_for(role));
                self.error(&format!("controller.{}", role.label()), what, remedy);
            }
        }
        self.alternates();
    }

    /// Builds the laws that fly, or that have a section, so that they say here what they refuse.
    fn alternates(&mut self) {
        let assignment = Assignment::of(self.settings());
        let flies = |name: &str| {
            Slot::ALL.into_iter().any(|slot| assignment.name(slot.role()) == Some(name))
        };
        let wanted =
            |name: &str, section: &str| flies(name) || self.document.root().contains_key(section);
        let (lqr, pid) =
            (wanted("attitude-lqr", "attitude_lqr"), wanted("attitude-pid", "attitude_pid"));
        let position = wanted("position-pid", "position_pid");
        let vehicle = self.scenario.modelled_vehicle();
        if vehicle.validate().is_err() {
            return;
        }
        if lqr {
            match LqrLaw::new(self.scenario.attitude_lqr(), &vehicle) {
                Ok(_) | Err(LqrError::Vehicle(_)) => {}
                Err(LqrError::Range(error)) => self.out_of_range("attitude_lqr", &error),
                Err(error @ LqrError::NotStabilisable) => {
                    self.error(
                        "attitude_lqr",
                        error.to_string(),
                        "choose weights nearer to the defaults",
                    );
                }
            }
        }
        if pid && let Err(error) = PidLaw::new(self.scenario.attitude_pid()) {
            self.out_of_range("attitude_pid", &error);
        }
        if position
            && let Ok(config) = self.scenario.position_pid()
            && let Err(error) = PositionPidLaw::new(config, &vehicle)
        {
            self.out_of_range("position_pid", &error);
        }
    }

    fn out_of_range(&mut self, section: &str, error: &OutOfRange) {
        let key = match error.name {
            "wrench_latency_s" => "latency.wrench_command_s".to_owned(),
            name => format!("{section}.{name}"),
        };
        let what = format!("{} does not go with the other settings", error.value);
        let remedy = format!("write a number from {} to {}", error.least, error.most);
        self.error(&key, what, remedy);
    }
}
