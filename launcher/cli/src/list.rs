//! `morphquad list`.

use crate::options::Format;
use scenario::{Scenario, shipped};
use serde_json::{Value, json};
use std::io::{self, Write};

/// One line per shipped scenario: name and description; or one list of objects.
///
/// # Errors
/// Those of `out`.
pub fn list(format: Format, out: &mut dyn Write) -> io::Result<()> {
    if format == Format::Json {
        let all: Vec<Value> = shipped::names().map(described).collect();
        return writeln!(out, "{}", Value::from(all));
    }
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

/// A shipped scenario for machines.
fn described(name: &str) -> Value {
    let Ok(scenario) = Scenario::load(name, &[]) else { return json!({ "name": name }) };
    let settings = &scenario.settings().scenario;
    json!({
        "name": name,
        "description": settings.description,
        "duration_s": settings.duration_s,
        "toml": shipped::text(name),
    })
}
