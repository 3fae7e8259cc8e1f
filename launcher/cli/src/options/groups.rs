//! The commands by what one wants to do, for `morphquad --help`; a manual lists them as they come.

use clap::Command;
use core::fmt::Write as _;

/// Headings, each with its commands, in the order in which they are needed.
const GROUPS: [(&str, &[&str]); 7] = [
    ("Fly", &["demo", "list", "run", "check", "scenario"]),
    (
        "A running flight",
        &["ps", "top", "live", "topic", "goto", "morph", "disturb", "stop", "adopt"],
    ),
    ("Change controllers", &["swap", "rehearse", "rollback", "standby", "retire"]),
    ("Write a controller", &["new-controller", "types"]),
    (
        "Recordings",
        &["recordings", "view", "plot", "layout", "report", "trace", "replay", "recover"],
    ),
    ("Measure and study", &["bench", "campaign", "study", "paper"]),
    ("Set up", &["doctor", "completions", "man"]),
];

/// The command with its own commands in groups in its help.
pub(super) fn grouped(command: Command) -> Command {
    let header = *command.get_styles().get_header();
    let literal = *command.get_styles().get_literal();
    let mut groups = String::new();
    for (heading, names) in GROUPS {
        // Writing to a string cannot fail.
        let _ = writeln!(groups, "\n{header}{heading}:{header:#}");
        for name in names {
            let about = command.find_subcommand(name).and_then(Command::get_about);
            let about = about.map(ToString::to_string).unwrap_or_default();
            let _ = writeln!(groups, "  {literal}{name:<15}{literal:#} {about}");
        }
    }
    let template = format!(
        "{{about-with-newline}}\n{{usage-heading}} {{usage}}\n{groups}\n{header}Options:{header:#}\n{{options}}\n\n\
         `morphquad COMMAND --help` shows more, with examples.\n"
    );
    command.help_template(template)
}

#[cfg(test)]
mod tests {
    use super::GROUPS;
    use crate::options::Cli;
    use clap::CommandFactory as _;

    #[test]
    fn every_command_stands_in_one_group_with_what_it_does_on_one_line() {
        let command = Cli::command();
        let mut named: Vec<&str> = GROUPS.iter().flat_map(|(_, names)| *names).copied().collect();
        named.sort_unstable();
        let shown = command.get_subcommands().filter(|command| !command.is_hide_set());
        let mut shown: Vec<&str> = shown.map(clap::Command::get_name).collect();
        shown.sort_unstable();
        assert_eq!(named, shown);
        let help = super::grouped(command).render_help().to_string();
        assert!(help.starts_with("Fly a morphing quadrotor"), "{help}");
        let longest = help.lines().map(|line| line.chars().count()).max();
        assert!(longest <= Some(100), "{help}");
    }
}
