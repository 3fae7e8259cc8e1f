//! `morphquad campaign`: one scenario times seeds times a grid of its keys, on all cores, in one
//! process, and again from where it was interrupted.
//!
//! [`Plan`] reads the file, [`Case`] is one flight, [`Outcome`] its row, [`Journal`] what survives a
//! kill; `report` makes the tables and names the worst. Branches of a recording use the same rows.

mod case;
mod file;
mod journal;
mod outcome;
pub mod report;
pub mod values;

pub use case::{Axis, Base, Case, quoted};
pub use file::{FileError, MAX_CASES, Plan};
pub use journal::{Identity, Journal, JournalError};
pub use outcome::{Outcome, Verdict, fly, fly_on};

use document::ScenarioError;
use figures::results::ResultsFolder;
use miette::Diagnostic;
use runtime::watch::StopFlags;
use scenario::Scenario;
use scenario::candidate::Candidate;
use simulate::fan_out::fan_out;
use std::path::PathBuf;
use std::sync::Mutex;
use thiserror::Error;

/// A campaign that has been flown.
#[derive(Debug)]
pub struct Campaign {
    /// What all cases share.
    pub base: Base,
    /// What varies.
    pub axes: Vec<Axis>,
    /// Each case with its outcome, in the order of [`Case::all`].
    pub flown: Vec<(Case, Outcome)>,
    /// How many of them an earlier run had flown.
    pub resumed: usize,
}

/// Why a campaign did not end.
#[derive(Debug, Error, Diagnostic)]
pub enum CampaignError {
    /// The scenario cannot be flown even without the grid.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Scenario(#[from] ScenarioError),
    #[error(transparent)]
    #[diagnostic(transparent)]
    Journal(#[from] JournalError),
    /// The executable cannot be read, so that it is not known whether it changes.
    #[error("cannot read the own executable: {0}")]
    Executable(std::io::Error),
    /// The user ended it.
    #[error("interrupted: {finished} of {cases} cases are finished and kept")]
    #[diagnostic(help("the same command goes on from here"))]
    Interrupted {
        /// Cases in the journal.
        finished: usize,
        /// Cases in all.
        cases: usize,
    },
}

/// What the user sees and asks for meanwhile.
#[derive(Debug)]
pub struct Watch<'w> {
    /// Signals.
    pub stop: &'w StopFlags,
    /// Is given the number of cases in all and already finished, and advances after each one.
    pub bar: &'w indicatif::ProgressBar,
}

/// Flies every case that the journal in `folder` does not have yet.
///
/// # Errors
/// [`CampaignError`]; what has been flown is in the journal then. A case that fails is an outcome.
pub fn run(
    plan: &Plan,
    folder: &ResultsFolder,
    restart: bool,
    watch: &Watch<'_>,
) -> Result<Campaign, CampaignError> {
    // A base that cannot fly is an error, not a table full of refusals.
    let own_seed = plan.base.own_seed()?;
    let seeds = plan.seeds.clone().unwrap_or_else(|| vec![own_seed]);
    let cases = Case::all(&plan.axes, &seeds);
    let build = build_hash().map_err(CampaignError::Executable)?;
    let keys = Keys::of(plan, &build);
    let keys: Vec<String> = cases.iter().map(|case| keys.of_case(case)).collect();
    let identity = Identity { campaign: hash(keys.iter().map(String::as_str)), build };
    let journal = Journal::open(folder.path(), &identity, restart)?;
    let known: Vec<Option<Outcome>> = keys.iter().map(|k| journal.finished(k).cloned()).collect();
    let open: Vec<usize> = (0..cases.len()).filter(|&i| known[i].is_none()).collect();
    let resumed = cases.len() - open.len();
    watch.bar.set_length(cases.len() as u64);
    watch.bar.set_position(resumed as u64);
    watch.bar.reset_eta();

    let journal = Mutex::new(journal);
    let stop = || watch.stop.signalled();
    let interrupted = || CampaignError::Interrupted {
        finished: usize::try_from(watch.bar.position()).unwrap_or(0),
        cases: cases.len(),
    };
    let fly_one = |&index: &usize| {
        let outcome = match plan.base.scenario(&plan.axes, &cases[index]) {
            Ok(scenario) => fly(&scenario, &stop).ok_or_else(interrupted)?,
            Err(error) => Outcome::refused(&error),
        };
        if let Ok(mut journal) = journal.lock() {
            journal.add(&keys[index], &outcome)?;
        }
        watch.bar.inc(1);
        Ok::<_, CampaignError>(outcome)
    };
    let mut fresh = fan_out(&open, &|| (), fly_one)?.into_iter();
    let outcomes = known.into_iter().filter_map(|known| known.or_else(|| fresh.next()));
    let flown = cases.into_iter().zip(outcomes).collect();
    Ok(Campaign { base: plan.base.clone(), axes: plan.axes.clone(), flown, resumed })
}

/// What distinguishes a case from every other one, in this campaign or another, of this build or another: also what
/// stands in the files that its scenario names.
struct Keys<'p> {
    plan: &'p Plan,
    build: &'p str,
    /// Of the scenario that all cases share, unless an axis may name files.
    shared: Option<Vec<String>>,
}

impl<'p> Keys<'p> {
    fn of(plan: &'p Plan, build: &'p str) -> Self {
        let names_files = |axis: &Axis| FILES.iter().any(|section| axis.key.starts_with(section));
        let shared = plan.base.shared().ok().filter(|_| !plan.axes.iter().any(names_files));
        Self { plan, build, shared: shared.map(|scenario| read(&scenario)) }
    }

    fn of_case(&self, case: &Case) -> String {
        let Self { plan, build, shared } = self;
        let own = || {
            let scenario = plan.base.scenario(&plan.axes, case);
            scenario.map_or_else(|_| vec![plan.base.text.clone()], |scenario| read(&scenario))
        };
        let read = shared.clone().unwrap_or_else(own);
        let settings = plan.base.set.iter().cloned().chain(case.settings(&plan.axes));
        let parts = [(*build).to_owned(), plan.base.name.clone(), case.seed.to_string()];
        let parts: Vec<String> = parts.into_iter().chain(read).chain(settings).collect();
        hash(parts.iter().map(String::as_str))
    }
}

/// Sections whose keys name files.
const FILES: [&str; 3] = ["pilot", "swap", "standby"];

/// The text of a scenario, which has the rows of its path's file, and hashes of the other files that its flight needs.
fn read(scenario: &Scenario) -> Vec<String> {
    core::iter::once(scenario.to_toml().to_owned()).chain(files_of(scenario)).collect()
}

/// Hashes of the configurations and executables that join a flight.
fn files_of(scenario: &Scenario) -> Vec<String> {
    let settings = scenario.settings();
    let swaps = settings.swap.iter().map(|swap| (swap.slot, &swap.to));
    let all = swaps.chain(settings.standby.iter().map(|standby| (standby.slot, &standby.name)));
    let executables = all.filter_map(|(slot, name)| match Candidate::find(slot, name) {
        Ok(Candidate::Executable(path)) => Some(path),
        _ => None,
    });
    let configs = settings.swap.iter().filter_map(|swap| swap.config.clone());
    let hash = |path: PathBuf| {
        let content = std::fs::read(path);
        content.map_or_else(|_| String::new(), |bytes| blake3::hash(&bytes).to_hex().to_string())
    };
    executables.chain(configs).map(hash).collect()
}

/// 128 bits over texts, each with its length, as hexadecimal.
fn hash<'t>(texts: impl IntoIterator<Item = &'t str>) -> String {
    let mut hasher = blake3::Hasher::new();
    for text in texts {
        hasher.update(&(text.len() as u64).to_le_bytes());
        hasher.update(text.as_bytes());
    }
    hasher.finalize().to_hex().as_str()[..32].to_owned()
}

/// Hash of the running executable, also if its file has been replaced meanwhile.
fn build_hash() -> std::io::Result<String> {
    let bytes = std::fs::read(scenario::process::OWN_EXECUTABLE)?;
    Ok(blake3::hash(&bytes).to_hex().as_str()[..32].to_owned())
}
