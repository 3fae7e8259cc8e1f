//! What the pilot refuses, in the words of a scenario.

use ::pilot::PilotError;

/// Key of what a pilot refuses, and what to do.
pub(super) fn pilot_error(error: &PilotError) -> (String, &'static str) {
    match error {
        PilotError::OutOfRange { parameter, .. } => {
            let own = parameter.trim_start_matches("trajectory.").trim_start_matches("step.");
            (format!("pilot.{}", own.replace("waypoints", "points")), "write a number in the range")
        }
        PilotError::Empty { parameter: "trajectory.samples" } => {
            ("pilot.file".to_owned(), "name a file, or write `pieces` or `samples`")
        }
        PilotError::Empty { .. } => ("pilot".to_owned(), "give at least one entry"),
        PilotError::TimesNotIncreasing { parameter, index, .. } => {
            let list = match *parameter {
                "morph" => "morph",
                "trajectory.samples" => "samples",
                _ => "points",
            };
            (format!("pilot.{list}[{index}]"), "let the times increase from entry to entry")
        }
        PilotError::Disjoint { index, .. } => {
            (format!("pilot.pieces[{index}]"), "let each piece begin where the one before it ends")
        }
        PilotError::FigureTooShort { .. } => {
            ("pilot.period_s".to_owned(), "fly longer or shorten the leads")
        }
        PilotError::MorphTooFast { index, .. } => (
            format!("pilot.morph[{index}]"),
            "give the sweep more time, or the servo a higher limit",
        ),
    }
}
