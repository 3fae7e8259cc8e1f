//! `morphquad man` and `morphquad layout`: what `man` knows, from the grammar itself, and what viewers do.

use super::flown::recorded;
use super::options::{Cli, LayoutArguments, ManArguments};
use super::refusal::{Done, Failure};
use clap::{Command, CommandFactory as _};
use host::exit;
use record::scene;
use std::io::{self, Write};
use std::path::Path;

/// Writes a layout for a viewer.
pub(super) fn layout(arguments: &LayoutArguments, out: &mut dyn Write) -> Done {
    let Some(recording) = &arguments.plotjuggler else {
        out.write_all(scene::LAYOUT.as_bytes())?;
        return Ok(exit::PASS);
    };
    recorded(recording)?;
    // Wherever the layout ends up, it leads to the file.
    let path = std::path::absolute(recording)?;
    out.write_all(scene::plotjuggler_layout(&path.to_string_lossy()).as_bytes())?;
    Ok(exit::PASS)
}

/// Writes a page for each command, and prints which.
pub(super) fn man(arguments: &ManArguments, out: &mut dyn Write) -> Done {
    let folder = &arguments.dir;
    let written = std::fs::create_dir_all(folder).and_then(|()| {
        let mut written = 0;
        let mut root = Cli::command();
        root.build();
        pages(&root, "morphquad", folder, &mut written)?;
        Ok(written)
    });
    let written = written.map_err(|error| {
        let folder = folder.display();
        let what = format!("cannot write pages into {folder}: {error}; name another folder");
        Failure::plain(&what, exit::UNFIT)
    })?;
    writeln!(out, "{written} pages in {}", folder.display())?;
    Ok(exit::PASS)
}

fn pages(command: &Command, name: &str, folder: &Path, written: &mut u32) -> io::Result<()> {
    let mut page = Vec::new();
    let man = clap_mangen::Man::new(command.clone()).title(name);
    man.source(concat!("morphquad ", env!("CARGO_PKG_VERSION"))).render(&mut page)?;
    std::fs::write(folder.join(format!("{name}.1")), page)?;
    *written += 1;
    for inner in command.get_subcommands().filter(|c| !c.is_hide_set() && c.get_name() != "help") {
        pages(inner, &format!("{name}-{}", inner.get_name()), folder, written)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is shown under a command's help.
    fn examples(command: &Command) -> String {
        command.get_after_help().map(ToString::to_string).unwrap_or_default()
    }

    /// Every command that people can type, with its command line, and the examples of it and its parent.
    fn commands(command: &Command, line: &str, all: &mut Vec<(String, Command, String)>) {
        for inner in command.get_subcommands().filter(|c| !c.is_hide_set()) {
            let line = format!("{line} {}", inner.get_name());
            let shown = examples(command) + &examples(inner);
            all.push((line.clone(), inner.clone(), shown));
            commands(inner, &line, all);
        }
    }

    #[test]
    fn every_command_describes_what_it_does_and_shows_an_example() {
        let mut all = Vec::new();
        commands(&Cli::command(), "morphquad", &mut all);
        assert!(all.len() > 20);
        for (line, command, shown) in all {
            assert!(command.get_about().is_some(), "{line} has no description");
            if command.has_subcommands() || line.starts_with("morphquad disturb ") {
                continue;
            }
            assert!(shown.contains(&line), "{line} has no example: {shown}");
        }
    }

    #[test]
    fn pages_are_one_for_each_command() {
        let folder = tempfile::TempDir::new().unwrap();
        let arguments = ManArguments { dir: folder.path().join("man1") };
        let mut out = Vec::new();
        assert!(man(&arguments, &mut out).is_ok_and(|code| code == exit::PASS));
        let page = |name: &str| std::fs::read_to_string(arguments.dir.join(name)).unwrap();
        assert!(page("morphquad.1").contains("morphquad"));
        let echo = page("morphquad-topic-echo.1");
        assert!(echo.contains("topic echo") && echo.contains("Examples"), "{echo}");
        assert!(!arguments.dir.join("morphquad-proc.1").exists());
        let blocked = ManArguments { dir: folder.path().join("man1/morphquad.1/x") };
        assert!(man(&blocked, &mut out).is_err());
    }
}
