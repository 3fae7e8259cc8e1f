//! `morphquad completions`: what shells know, from the grammar itself.

use super::options::{Cli, CompletionsArguments};
use super::refusal::Done;
use clap::builder::{PossibleValue, PossibleValuesParser};
use clap::{Arg, Command, CommandFactory as _, ValueHint};
use clap_complete::Shell;
use host::exit;
use scenario::{services, shipped};
use shared_types::{Slot, topics};
use std::io::{self, Write};

/// Writes a shell's completions.
pub(super) fn completions(arguments: &CompletionsArguments, out: &mut dyn Write) -> Done {
    let mut text = Vec::new();
    let mut root = with_values(Cli::command());
    clap_complete::generate(arguments.shell, &mut root, "morphquad", &mut text);
    match arguments.shell {
        Shell::Zsh => out.write_all(and_files(&String::from_utf8_lossy(&text)).as_bytes())?,
        // For fish, clap completes options alone.
        Shell::Fish => {
            out.write_all(&text)?;
            fish_values(&root, "__fish_morphquad_using_subcommand", out)?;
        }
        _ => out.write_all(&text)?,
    }
    Ok(exit::PASS)
}

/// The grammar, with the values that arguments of text and numbers may have.
fn with_values(command: Command) -> Command {
    command.mut_args(with_values_of).mut_subcommands(with_values)
}

/// Without this a shell would offer the names of files there.
fn with_values_of(arg: Arg) -> Arg {
    let is_known =
        !arg.get_possible_values().is_empty() || arg.get_value_hint() != ValueHint::Unknown;
    if is_known || !arg.get_action().takes_values() {
        return arg;
    }
    let value = arg.get_value_names().and_then(|names| names.first()).map(ToString::to_string);
    let values = value.map(|value| values(&value)).unwrap_or_default();
    if values.is_empty() {
        arg.value_hint(ValueHint::Other)
    } else {
        arg.value_parser(PossibleValuesParser::new(values))
    }
}

/// What a value of this name may be; nothing if it is anything.
fn values(value: &str) -> Vec<String> {
    let is_plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '|';
    match value {
        "SLOT" => Slot::ALL.map(|slot| slot.label().to_owned()).to_vec(),
        "SLOT=NAME" => services::fillings(),
        "NAME|EXE" | "EXE|NAME" => controllers(),
        "TOPIC|FILE" | "FILE|TOPIC" => topic_names(),
        _ if value.contains('|') && value.chars().all(is_plain) => {
            value.split('|').map(ToOwned::to_owned).collect()
        }
        _ => Vec::new(),
    }
}

fn controllers() -> Vec<String> {
    let names = Slot::ALL.into_iter().flat_map(|slot| services::names_for(slot.role()));
    names.map(ToOwned::to_owned).collect()
}

fn topic_names() -> Vec<String> {
    topics::all().into_iter().map(|topic| topic.name.to_owned()).collect()
}

/// Names where the path of a file may stand as well.
fn beside_files() -> [(&'static str, String); 3] {
    let scenarios = shipped::names().collect::<Vec<_>>();
    [
        ("scenario", scenarios.join(" ")),
        ("controller", controllers().join(" ")),
        ("topic", topic_names().join(" ")),
    ]
}

/// Completions for zsh, where a list of values is all that there can be.
fn and_files(text: &str) -> String {
    beside_files().into_iter().fold(text.to_owned(), |text, (what, values)| {
        let both = format!(
            ":{{_alternative \"{what}s\\:{what}\\:({values})\" \"files\\:file\\:_files\"}}'"
        );
        text.replace(&format!(":({values})'"), &both)
    })
}

/// Offers the values that may follow every command below `command`.
fn fish_values(command: &Command, seen: &str, out: &mut dyn Write) -> io::Result<()> {
    for inner in command.get_subcommands() {
        let seen = format!("{seen} {}", inner.get_name());
        for place in inner.get_positionals() {
            let known = place.get_possible_values();
            let names = known.iter().map(PossibleValue::get_name).collect::<Vec<_>>().join(" ");
            if !names.is_empty() {
                writeln!(out, "complete -c morphquad -n \"{seen}\" -a \"{names}\"")?;
            }
        }
        fish_values(inner, &format!("{seen}; and __fish_seen_subcommand_from"), out)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use scenario::services;
    use shared_types::Slot;

    fn text(shell: &str) -> String {
        let (mut out, mut diagnostics) = (Vec::new(), Vec::new());
        let arguments = ["morphquad", "completions", shell].map(Into::into);
        assert_eq!(super::super::execute(arguments.into_iter(), &mut out, &mut diagnostics), 0);
        String::from_utf8(out).unwrap()
    }

    #[test]
    fn every_shell_knows_every_command_and_what_may_be_named() {
        for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
            let text = text(shell);
            for command in ["disturb", "goto", "topic", "new-controller"] {
                assert!(text.contains(command), "{shell} has no {command}");
            }
        }
        for shell in ["bash", "zsh", "fish"] {
            let text = text(shell);
            let controllers =
                Slot::ALL.into_iter().flat_map(|slot| services::names_for(slot.role()));
            let controllers = controllers.collect::<Vec<_>>().join(" ");
            for values in ["hover figure8-morph", &controllers, "attitude position", "imu pose_fix"]
            {
                assert!(text.contains(values), "{shell} has no {values}");
            }
        }
    }

    #[test]
    fn files_are_offered_where_a_file_may_stand_and_nowhere_else() {
        let text = text("zsh");
        assert_eq!(text.matches(":_default").count(), 0, "{text}");
        assert!(text.contains("lockstep|realtime:(lockstep realtime)'"), "{text}");
        assert!(text.contains("controllers\\:controller\\:(attitude-mpc"), "{text}");
        assert!(text.contains("topics\\:topic\\:(imu"), "{text}");
    }
}
