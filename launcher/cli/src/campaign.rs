//! `morphquad campaign`: from a file to a table, the worst cases and an exit code.

use super::bar::bar;
use super::options::{CampaignArguments, Format};
use super::refusal::Done;
use experiments::campaign::report::{self, ReportError};
use experiments::campaign::{self, Campaign, CampaignError, FileError, JournalError, Plan, Watch};
use figures::results::{ResultsError, ResultsFolder};
use host::exit;
use miette::Diagnostic;
use runtime::watch::StopFlags;
use std::io::{self, Write};
use std::path::PathBuf;
use thiserror::Error;

/// Why a campaign ended without a table.
#[derive(Debug, Error, Diagnostic)]
enum Trouble {
    #[error(transparent)]
    #[diagnostic(transparent)]
    File(#[from] FileError),
    #[error(transparent)]
    #[diagnostic(transparent)]
    Campaign(#[from] CampaignError),
    #[error(transparent)]
    #[diagnostic(transparent)]
    Results(#[from] ResultsError),
    #[error(transparent)]
    #[diagnostic(transparent)]
    Report(#[from] ReportError),
    #[error("cannot watch signals: {0}")]
    Signals(io::Error),
}

impl Trouble {
    fn exit_code(&self) -> u8 {
        match self {
            Self::File(_)
            | Self::Campaign(
                CampaignError::Scenario(_)
                | CampaignError::Journal(JournalError::Changed { .. } | JournalError::Damaged { .. }),
            ) => exit::USAGE,
            Self::Campaign(CampaignError::Interrupted { .. }) => exit::INTERRUPTED,
            _ => exit::UNFIT,
        }
    }
}

/// Flies a campaign; 0 if every case passed, 1 if one did not, 2 if no case can be flown, 4 if a component failed in one, 5
/// if all passed and a scripted swap was refused or taken back in one, 130 if interrupted.
pub(super) fn run(arguments: &CampaignArguments, out: &mut dyn Write) -> Done {
    super::conclude(fly(arguments), Trouble::exit_code, out)
}

fn fly(arguments: &CampaignArguments) -> Result<(String, u8), Trouble> {
    let plan = Plan::load(&arguments.file)?;
    let stem = arguments.file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let beside = || PathBuf::from("campaigns").join(&stem);
    let path = arguments.out.clone().or_else(|| plan.out.clone()).unwrap_or_else(beside);
    let mut folder = ResultsFolder::create(&path)?;
    let stop = StopFlags::watch_signals().map_err(Trouble::Signals)?;
    let bar = bar(0, "cases");
    let watch = Watch { stop: &stop, bar: &bar };
    let flown = campaign::run(&plan, &folder, arguments.restart, &watch);
    bar.finish_and_clear();
    let campaign = flown?;
    report::write("cases", &campaign.table(), &mut folder)?;
    let code = report::exit_code(&campaign.flown);
    let line = report::line(&format!("campaign {stem}"), &campaign.flown);
    let text = match arguments.format {
        Format::Json => in_json(line, &campaign, plan.worst, &folder),
        Format::Text => in_text(&line, &campaign, plan.worst, &folder),
    };
    Ok((text, code))
}

fn in_text(line: &str, campaign: &Campaign, worst: usize, folder: &ResultsFolder) -> String {
    let Campaign { base, axes, flown, resumed } = campaign;
    let command = |case: &campaign::Case| campaign.command(case);
    let files = folder.written().iter().map(|path| format!("wrote {}\n", path.display()));
    format!(
        "{line}\n  scenario      {}, {} cases, {resumed} of them flown before\n{}\n{}\n{}",
        base.name,
        flown.len(),
        report::figures(flown),
        report::worst_cases(axes, flown, worst, &command),
        files.collect::<String>(),
    )
}

fn in_json(line: String, campaign: &Campaign, worst: usize, folder: &ResultsFolder) -> String {
    let command = |case: &campaign::Case| campaign.command(case);
    let mut json = report::to_json(&campaign.axes, &campaign.flown, worst, &command);
    let files: Vec<_> = folder.written().iter().map(|path| path.display().to_string()).collect();
    json["line"] = line.into();
    json["resumed"] = campaign.resumed.into();
    json["files"] = files.into();
    json.to_string()
}
