//! What a component reads and writes.

use super::ReplayError;
use core::convert::Infallible;
use runtime::Service;
use runtime::input::{Input, InputSet as _, InputVisitor};
use runtime::output::{Output, OutputSet as _, OutputVisitor};
use scenario::Scenario;
use scenario::components::{Component, ComponentVisitor, Crew, build_service, names_for};
use shared_types::{Role, Sample, Topic};

/// Topics that a component reads and writes.
pub(super) struct Topics {
    pub(super) read: Vec<&'static str>,
    pub(super) written: Vec<&'static str>,
}

impl Topics {
    /// Of a service that fills `role` in `scenario`.
    pub(super) fn of(
        service: Option<&str>,
        role: Role,
        scenario: &Scenario,
    ) -> Result<Self, ReplayError> {
        struct Names;
        struct Collect(Vec<&'static str>);
        impl InputVisitor for Collect {
            type Error = Infallible;
            fn visit<T: Sample>(
                &mut self,
                topic: &'static Topic<T>,
                _input: &mut Input<T>,
            ) -> Result<(), Infallible> {
                self.0.push(topic.info.name);
                Ok(())
            }
        }
        impl OutputVisitor for Collect {
            type Error = Infallible;
            fn visit<T: Sample>(
                &mut self,
                topic: &'static Topic<T>,
                _output: &mut Output<T>,
            ) -> Result<(), Infallible> {
                self.0.push(topic.info.name);
                Ok(())
            }
        }
        impl ComponentVisitor for Names {
            type Output = Topics;
            fn visit<S: Service + 'static>(self, _component: Component<S>) -> Topics {
                let (mut read, mut written) = (Collect(Vec::new()), Collect(Vec::new()));
                let Ok(()) = S::Inputs::default().visit(&mut read);
                let Ok(()) = S::Outputs::default().visit(&mut written);
                Topics { read: read.0, written: written.0 }
            }
        }
        build_service(service, scenario, Names).map_err(ReplayError::component(role))
    }

    /// Of all who may have filled `role` in `scenario`.
    pub(super) fn of_all(role: Role, scenario: &Scenario) -> Result<Self, ReplayError> {
        let begins = Crew::of(scenario.settings()).name(role);
        let mut all = Self::of(begins, role, scenario)?;
        for name in names_for(role).filter(|name| Some(*name) != begins) {
            // Whoever does not fit the scenario has not flown in it.
            if let Ok(other) = Self::of(Some(name), role, scenario) {
                all.read.extend(other.read);
                all.written.extend(other.written);
            }
        }
        Ok(all)
    }
}
