//! `morphquad list`.

use scenario::{Scenario, shipped};
use std::io::{self, Write};

/// One line per shipped scenario: name and description.
///
/// # Errors
/// Those of `out`.
pub fn list(out: &mut dyn Write) -> io::Result<()> {
    let width = shipped::names().map(str::len).max().unwrap_or(0);
    for name in shipped::names() {
        let scenario = Scenario::load(name, &[]);
        let description = scenario.map_or_else(
            |error| error.to_string(),
            |scenario| scenario.settings().scenario.description.clone(),
        );
        writeln!(out, "{name:width$}  {description}")?;
    }
    Ok(())
}
