//! `morphquad study`: from arguments to tables on stdout, files in a folder and an exit code.

use super::bar::bar;
use super::options::{
    Format, MorphingArguments, RandomArguments, StabilityArguments, StudyCommand, StudyOutput,
    TimingArguments, TuningArguments,
};
use super::refusal::Done;
use attitude_mpc::AttitudeLawConfig;
use document::{ScenarioError, shell_word};
use figures::results::{ResultsError, ResultsFolder};
use host::exit;
use miette::Diagnostic;
use scenario::Override;
use std::io::Write;
use studies::controllers::{self, ControllersError};
use studies::morphing::{self, MorphingError};
use studies::random::{self, RandomError};
use studies::stability::{self, Bench, Grid, StabilityError};
use studies::timing::{self, TimingError};
use studies::tuning;
use studies::worst_case::{self, WorstCaseError};
use thiserror::Error;
use vehicle::{MorphAngle, VehicleParameters};

/// Seeds of a morphing study if none are given, and of a quick one.
const SEEDS: [u64; 2] = [20, 3];
/// Random flights of a quick study, at most.
const QUICK_SEEDS: usize = 15;
/// Candidates of a quick tuning, at most.
const QUICK_CANDIDATES: u64 = 3;
/// Times of a sweep, and halvings towards a limit.
const TIMES: [u16; 2] = [25, 8];
/// The same of a quick study.
const QUICK_TIMES: [u16; 2] = [7, 3];
/// Weight of the paper's reproduction; its limits are shown beside those of flight.
const PAPER_WEIGHT: f64 = 0.25;

/// Why a study ended without a result.
#[derive(Debug, Error, Diagnostic)]
enum StudyError {
    #[error(transparent)]
    #[diagnostic(transparent)]
    Results(#[from] ResultsError),
    #[error(transparent)]
    #[diagnostic(help("the flights are fixed: this is a defect, please report it"))]
    Controllers(#[from] ControllersError),
    #[error(transparent)]
    #[diagnostic(help("the flights are fixed: this is a defect, please report it"))]
    Morphing(#[from] MorphingError),
    #[error(transparent)]
    #[diagnostic(transparent)]
    Scenario(#[from] ScenarioError),
    #[error(transparent)]
    #[diagnostic(help(
        "a flight of the family cannot be flown: this is a defect, please report it"
    ))]
    Random(RandomError),
    #[error(transparent)]
    #[diagnostic(help(
        "fly a scenario of controllers that are tested at their rates, without [[timing]]"
    ))]
    Timing(TimingError),
    #[error(transparent)]
    #[diagnostic(help("give a --rate from 50 to 1000 Hz and an --angle from 45 to 160 degrees"))]
    Stability(#[from] StabilityError),
    #[error(transparent)]
    #[diagnostic(help("give a --rate from 50 to 1000 Hz"))]
    WorstCase(#[from] WorstCaseError),
}

impl From<RandomError> for StudyError {
    fn from(error: RandomError) -> Self {
        match error {
            RandomError::Scenario(error) => Self::Scenario(error),
            error => Self::Random(error),
        }
    }
}

impl From<TimingError> for StudyError {
    fn from(error: TimingError) -> Self {
        match error {
            TimingError::Scenario(error) => Self::Scenario(error),
            error => Self::Timing(error),
        }
    }
}

impl StudyError {
    fn exit_code(&self) -> u8 {
        match self {
            Self::Results(_) => exit::UNFIT,
            Self::Controllers(_) | Self::Morphing(_) | Self::Random(_) => exit::CRASHED,
            Self::Scenario(_) | Self::Timing(_) | Self::Stability(_) | Self::WorstCase(_) => {
                exit::USAGE
            }
        }
    }
}

/// Runs a study; 1 if a mark fails, 2 for an impossible request, 3 for an unwritable folder.
pub(super) fn run(command: &StudyCommand, out: &mut dyn Write) -> Done {
    let done = match command {
        StudyCommand::Controllers(output) => compare_controllers(output),
        StudyCommand::Morphing(arguments) => fly_morphing(arguments),
        StudyCommand::Random(arguments) => fly_random(arguments),
        StudyCommand::Stability(arguments) => map_stability(arguments),
        StudyCommand::Timing(arguments) => make_late(arguments),
        StudyCommand::Tuning(arguments) => tune(arguments),
        StudyCommand::WorstCase(arguments) => certify(arguments),
    };
    super::conclude(done, StudyError::exit_code, out)
}

fn compare_controllers(output: &StudyOutput) -> Result<(String, u8), StudyError> {
    let mut folder = ResultsFolder::create(&output.out)?;
    let plan = if output.quick { controllers::Plan::quick() } else { controllers::Plan::full() };
    let bar = bar(plan.flights(), "flights");
    let study = controllers::fly(&plan, &|| bar.inc(1))?;
    bar.finish_and_clear();
    controllers::report::write(&study, &mut folder)?;
    let broken = study.rows.iter().any(|row| row.violations > 0 || row.lost > 0);
    let text = match output.format {
        Format::Json => controllers::report::to_json(&study).to_string(),
        Format::Text => format!(
            "figure8-morph (rms, max; {} seeds), hover pushed for a second with more than the tilt \
             bound holds (push, back\nwithin 0.1 m), attitude-step (roll or pitch, yaw, peak) and \
             disturbance (pulse, back within 0.02 rad) at {:?} deg,\nthe worst of each; commands \
             outside their bounds, clipped rotors, flights lost; times of a step over the first row's\
             \n\n{}\n{}",
            plan.seeds,
            plan.sizes_deg,
            controllers::report::table(&study),
            files(&folder),
        ),
    };
    Ok((text, if broken { exit::FAILED } else { exit::PASS }))
}

fn fly_morphing(arguments: &MorphingArguments) -> Result<(String, u8), StudyError> {
    // Before an hour of computing, not after it.
    let mut folder = ResultsFolder::create(&arguments.out.out)?;
    let seeds = arguments.seeds.unwrap_or(SEEDS[usize::from(arguments.out.quick)]);
    let plan = if arguments.out.quick {
        morphing::Plan::quick(seeds)
    } else {
        morphing::Plan::full(seeds)
    };
    let bar = bar(plan.flights(), "flights");
    let study = morphing::fly(&plan, &|| bar.inc(1))?;
    bar.finish_and_clear();
    morphing::report::write(&study, &mut folder)?;
    let marks = morphing::marks(&study);
    let code = if marks.iter().all(|mark| mark.holds) { exit::PASS } else { exit::FAILED };
    let text = match arguments.out.format {
        Format::Json => morphing::report::to_json(&study).to_string(),
        Format::Text => format!(
            "position RMS [mm] x ratio of its sweeps to the same stretches of the scheduled law's \
             flight at 45 deg; {} seeds where scheduled and lag real and modelled\n\n{}\n{}\n{}",
            seeds,
            morphing::report::table(&study),
            morphing::report::mark_table(&marks),
            files(&folder),
        ),
    };
    Ok((text, code))
}

fn fly_random(arguments: &RandomArguments) -> Result<(String, u8), StudyError> {
    let RandomArguments { out, seeds, controller, set } = arguments;
    let (overrides, flags) = shared(controller, set)?;
    let mut folder = ResultsFolder::create(&out.out)?;
    let flown = if out.quick { QUICK_SEEDS } else { usize::MAX };
    let seeds: Vec<u64> = seeds.iter().copied().take(flown).collect();
    let plan = random::Plan { seeds, overrides, flags };
    let bar = bar(plan.flights(), "flights");
    let study = random::fly(&plan, &|| bar.inc(1))?;
    bar.finish_and_clear();
    random::report::write(&study, &mut folder)?;
    let code = if study.lost() > 0 { exit::FAILED } else { exit::PASS };
    let text = match out.format {
        Format::Json => random::report::to_json(&study).to_string(),
        Format::Text => format!(
            "figure8-morph, {} seeds: largest position error of a flight\n\n{}\nthe worst\n{}\n{}{}",
            plan.seeds.len(),
            random::report::table(&study),
            random::report::worst(&study).join("\n"),
            listed("left out, for want of a trim", &random::report::left_out(&study)),
            files(&folder),
        ),
    };
    Ok((text, code))
}

/// What all flights of a study share, as changes of the scenario and as flags.
fn shared(controller: &[String], set: &[String]) -> Result<(Vec<Override>, String), ScenarioError> {
    let assigned = controller.iter().map(|value| Override::controller(value));
    let set_to = set.iter().map(|value| Override::set(value));
    let overrides = assigned.chain(set_to).collect::<Result<_, _>>()?;
    let flag = |name: &str, value: &String| format!("--{name} {}", shell_word(value));
    let assigned = controller.iter().map(|value| flag("controller", value));
    let flags: Vec<String> = assigned.chain(set.iter().map(|value| flag("set", value))).collect();
    Ok((overrides, flags.join(" ")))
}

fn make_late(arguments: &TimingArguments) -> Result<(String, u8), StudyError> {
    let TimingArguments { scenario, out, controller, set } = arguments;
    let (overrides, flags) = shared(controller, set)?;
    let mut folder = ResultsFolder::create(&out.out)?;
    let [points, halvings] = if out.quick { QUICK_TIMES } else { TIMES };
    let plan = timing::Plan { scenario: scenario.clone(), overrides, flags, points, halvings };
    let bar = bar(plan.flights(), "flights");
    let study = timing::fly(&plan, &|| bar.inc(1))?;
    bar.finish_and_clear();
    timing::report::write(&study, &mut folder)?;
    let text = match out.format {
        Format::Json => timing::report::to_json(&study).to_string(),
        Format::Text => format!(
            "{scenario}, one loop at a time: up to which time nothing is missed, the flight passes, the vehicle is not \
             lost\n\n{}\n{}{}",
            timing::report::table(&study),
            timing::report::prediction(&study),
            files(&folder),
        ),
    };
    Ok((text, exit::PASS))
}

fn tune(arguments: &TuningArguments) -> Result<(String, u8), StudyError> {
    let TuningArguments { out, candidates, seed, seeds, judged } = arguments;
    let mut folder = ResultsFolder::create(&out.out)?;
    let flown = if out.quick { QUICK_SEEDS } else { usize::MAX };
    let first = |seeds: &[u64]| seeds.iter().copied().take(flown).collect();
    let candidates = if out.quick { QUICK_CANDIDATES.min(*candidates) } else { *candidates };
    let (seeds, judged) = (first(seeds), first(judged));
    let plan = tuning::Plan { candidates, seed: *seed, seeds, judged };
    let bar = bar(usize::try_from(candidates).unwrap_or(usize::MAX), "candidates");
    let study = tuning::run(&plan, &|| bar.inc(1))?;
    bar.finish_and_clear();
    tuning::report::write(&study, &mut folder)?;
    let text = match out.format {
        Format::Json => tuning::report::to_json(&study).to_string(),
        Format::Text => format!(
            "position MPC, {candidates} candidates: the Pareto front, and the shipped set\n\n{}\n{}",
            tuning::report::table(&study),
            files(&folder),
        ),
    };
    Ok((text, exit::PASS))
}

/// Lines below what they are; nothing for none.
fn listed(what: &str, lines: &[String]) -> String {
    if lines.is_empty() { String::new() } else { format!("{what}\n{}\n", lines.join("\n")) }
}

fn map_stability(arguments: &StabilityArguments) -> Result<(String, u8), StudyError> {
    let mut folder = ResultsFolder::create(&arguments.out.out)?;
    let bench = Bench {
        rate_hz: arguments.rate,
        morph_angle: MorphAngle::from_degrees(arguments.angle).map_err(StabilityError::from)?,
        vehicle: VehicleParameters::default(),
    };
    let grid = if arguments.out.quick { Grid::quick() } else { Grid::full() };
    let flown_weight = AttitudeLawConfig::flight(arguments.rate).increment_weight;
    let bar = bar(grid.points(), "points");
    let study = stability::run(&bench, &grid, &[PAPER_WEIGHT, flown_weight], &|| bar.inc(1))?;
    bar.finish_and_clear();
    stability::report::write(&study, &mut folder)?;
    let text = match arguments.out.format {
        Format::Json => stability::report::to_json(&study).to_string(),
        Format::Text => format!(
            "attitude loop at {} Hz, {} degrees: where it is stable\n\n{}\n{}\npoints of the maps \
             where the two methods differ\n\n{}\n{}",
            arguments.rate,
            arguments.angle,
            stability::report::table(&study),
            stability::report::settling_table(&study),
            stability::report::differences(&study),
            files(&folder),
        ),
    };
    Ok((text, exit::PASS))
}

fn certify(arguments: &StabilityArguments) -> Result<(String, u8), StudyError> {
    let mut folder = ResultsFolder::create(&arguments.out.out)?;
    let angle = MorphAngle::from_degrees(arguments.angle).map_err(StabilityError::from)?;
    // The last one takes half a minute.
    let programs = [(1, false), (1, true), (2, false), (2, true), (3, false), (3, true)];
    let wanted = if arguments.out.quick { &programs[..5] } else { &programs[..] };
    let bar = bar(wanted.len(), "programs");
    let mut cases = Vec::new();
    for &(control, warm) in wanted {
        cases.push(worst_case::certify(arguments.rate, angle, control, warm)?);
        bar.inc(1);
    }
    bar.finish_and_clear();
    let table = worst_case::table(&cases);
    folder.write("worst-case.csv", &table.to_csv())?;
    let text = match arguments.out.format {
        Format::Json => table.to_json().to_string(),
        Format::Text => format!(
            "attitude law at {} Hz, {} degrees: most changes of the working set in a solve, for \
             every state\n\n{table}\n{}",
            arguments.rate,
            arguments.angle,
            files(&folder),
        ),
    };
    Ok((text, exit::PASS))
}

/// What was written, a line each.
fn files(folder: &ResultsFolder) -> String {
    let lines = folder.written().iter().map(|path| format!("wrote {}", path.display()));
    lines.collect::<Vec<_>>().join("\n")
}
