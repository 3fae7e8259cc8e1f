//! Arguments that take the name of a shipped scenario, or something else.

use clap::builder::{PossibleValue, TypedValueParser};
use clap::error::Error;
use clap::{Arg, Command};
use scenario::shipped;
use std::ffi::OsStr;

/// Takes what the parser inside takes, and lets shells complete the names of the shipped scenarios.
#[derive(Debug, Clone)]
pub(super) struct ScenarioOr<P>(pub(super) P);

impl<P: TypedValueParser> TypedValueParser for ScenarioOr<P> {
    type Value = P::Value;

    fn parse_ref(
        &self,
        command: &Command,
        argument: Option<&Arg>,
        value: &OsStr,
    ) -> Result<Self::Value, Error> {
        self.0.parse_ref(command, argument, value)
    }

    fn possible_values(&self) -> Option<Box<dyn Iterator<Item = PossibleValue> + '_>> {
        Some(Box::new(shipped::names().map(PossibleValue::new)))
    }
}
