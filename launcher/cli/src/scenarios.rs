//! `morphquad scenario`: scenarios as texts, and what can be set in them.

use super::options::{
    Format, ScenarioCommand, ScenarioKeysArguments, ScenarioNewArguments, ScenarioShowArguments,
};
use super::refusal::{Done, Failure};
use document::{shell_path, suggestion};
use host::exit;
use scenario::keys::{Key, Section, sections};
use scenario::{renamed, shipped};
use serde_json::Value;
use std::fs::File;
use std::io::{self, Write};

/// Does what is asked for.
pub(super) fn run(command: &ScenarioCommand, out: &mut dyn Write) -> Done {
    match command {
        ScenarioCommand::New(arguments) => new(arguments, out)?,
        ScenarioCommand::Show(ScenarioShowArguments { name }) => {
            out.write_all(text_of(name)?.as_bytes())?;
        }
        ScenarioCommand::Keys(arguments) => keys(arguments, out)?,
    }
    out.flush()?;
    Ok(exit::PASS)
}

fn text_of(name: &str) -> Result<&'static str, Failure> {
    shipped::text(name).ok_or_else(|| {
        let remedy = suggestion(name, shipped::names());
        Failure::plain(&format!("no scenario is called {name}: {remedy}"), exit::USAGE)
    })
}

/// Writes a shipped scenario without its name, so that it is called as its file.
fn new(arguments: &ScenarioNewArguments, out: &mut dyn Write) -> Result<(), Failure> {
    let ScenarioNewArguments { file, from } = arguments;
    let lines = text_of(from)?.lines().filter(|line| !line.starts_with("name = "));
    let text: String = lines.flat_map(|line| [line, "\n"]).collect();
    let shown = file.display();
    let written = File::create_new(file).and_then(|mut created| created.write_all(text.as_bytes()));
    written.map_err(|error| {
        let (reason, code) = match error.kind() {
            io::ErrorKind::AlreadyExists => {
                (format!("{shown} is there already: give another name"), exit::USAGE)
            }
            _ => (
                format!("cannot write {shown}: {error}; name a file that you may write"),
                exit::UNFIT,
            ),
        };
        Failure::plain(&reason, code)
    })?;
    let path = shell_path(file);
    writeln!(
        out,
        "{shown}: `morphquad run {path}` flies it, `morphquad scenario keys` lists what can be set"
    )?;
    Ok(())
}

fn keys(arguments: &ScenarioKeysArguments, out: &mut dyn Write) -> Result<(), Failure> {
    let wanted = arguments.key.as_deref().unwrap_or_default();
    let mut wanted = wanted.trim_matches(['[', ']']).to_lowercase().replace('-', "_");
    let today = renamed(&wanted);
    let before = today.map(|name| std::mem::replace(&mut wanted, name));
    let those = |fits: fn(&str, &str) -> bool| {
        let mut found = sections();
        for section in &mut found {
            section.keys.retain(|key| fits(&key.name, &wanted));
        }
        found.retain(|section| !section.keys.is_empty());
        found
    };
    let begun = those(|name, wanted| name.starts_with(wanted));
    let found = if begun.is_empty() { those(|name, wanted| name.contains(wanted)) } else { begun };
    if found.is_empty() {
        let all = sections();
        let keys = all.iter().flat_map(|section| &section.keys).map(|key| key.name.as_str());
        let names = all.iter().map(|section| section.name);
        // There are too many keys to name them all.
        let guess = suggestion(&wanted, keys.chain(names.clone()));
        let guess = guess.split_once(" Known are").map(|(guess, _)| guess.to_owned());
        let remedy = guess.unwrap_or_else(|| suggestion(&wanted, names));
        let reason = format!("no key has {wanted} in its name: {remedy}");
        return Err(Failure::plain(&reason, exit::USAGE));
    }
    if arguments.format == Format::Json {
        let all: Value = found.iter().flat_map(|section| &section.keys).map(Key::to_json).collect();
        writeln!(out, "{all}")?;
        return Ok(());
    }
    if let Some(before) = before {
        writeln!(out, "`{before}` is called `{wanted}` now\n")?;
    }
    for (place, section) in found.iter().enumerate() {
        if place > 0 {
            writeln!(out)?;
        }
        show(section, out)?;
    }
    Ok(())
}

fn show(section: &Section, out: &mut dyn Write) -> io::Result<()> {
    writeln!(out, "[{}]  {}", section.name, section.meaning)?;
    for key in &section.keys {
        let kind = key.kind.map_or(String::new(), |kind| format!("  (kind = \"{kind}\")"));
        let value = match key.default_in_toml() {
            Some(value) => format!(" = {value}"),
            None if key.is_required => "  required".to_owned(),
            None => String::new(),
        };
        writeln!(out, "  {}{value}{kind}", key.name)?;
        writeln!(out, "      {}{}. {}", key.takes, key.range_text(), key.meaning)?;
    }
    Ok(())
}
