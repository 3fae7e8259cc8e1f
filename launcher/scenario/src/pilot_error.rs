//! What the pilot refuses, by the keys of a scenario.

use ::pilot::PilotError;
use document::Complaint;

/// A complaint about what the pilot refuses.
pub(super) fn pilot_error(error: &PilotError) -> Complaint {
    let what = match error {
        PilotError::Empty { parameter: "trajectory.samples" } => {
            "there is no trajectory".to_owned()
        }
        error => error.to_string(),
    };
    let (key, remedy) = key_and_remedy(error);
    (key, what, remedy.to_owned())
}

fn key_and_remedy(error: &PilotError) -> (String, &'static str) {
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
