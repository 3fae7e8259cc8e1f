//! `morphquad bench loops`: scenario, place, gates, files.

use super::nanoseconds;
use crate::options::{LoopsArguments, TableFormat};
use bench::gate::{self, Comparison, Gate};
use bench::loops::{self, LoopsPlan, Measured};
use bench::place::Place;
use bench::{BenchError, page, pictures, timing};
use figures::results::ResultsFolder;
use host::exit;
use scenario::{Override, Scenario};
use serde_json::json;
use std::fmt::Write as _;
use std::io::{self, IsTerminal as _};
use std::path::Path;

/// Warm-up of a flight that is long enough \[ns\].
const WARM_UP_NS: u64 = 1_000_000_000;

/// Flies, measures, compares and judges.
pub(super) fn measure(arguments: &LoopsArguments) -> Result<(String, u8), BenchError> {
    // What can be refused is refused before anything flies.
    if arguments.compare.is_none() && arguments.gate.iter().any(Gate::needs_earlier) {
        return Err(BenchError::NothingToCompare);
    }
    if arguments.no_floor && arguments.gate.iter().any(Gate::needs_floor) {
        return Err(BenchError::NoFloor);
    }
    let before = arguments.compare.as_deref().map(gate::read).transpose()?;
    let place = super::place(&arguments.place)?;
    let plan = plan(arguments, place)?;
    if let (Some(before), Some(path)) = (&before, &arguments.compare) {
        plan.terms(&plan.graph()?).require_same(before, path)?;
    }
    let measured = loops::measure(&plan)?;
    let report = &measured.report;
    let comparison = before.as_ref().map(|before| gate::compare(report, before));
    write_files(&measured, arguments)?;
    let failures: Vec<String> =
        arguments.gate.iter().flat_map(|gate| gate.judge(report, before.as_ref())).collect();
    let code = match measured.summary.exit_code() {
        exit::PASS | exit::SWAP_FAILED if !failures.is_empty() => exit::FAILED,
        // A flight that did not pass has measured something else.
        code => code,
    };
    let text = match arguments.format {
        TableFormat::Json => json!({
            "line": measured.summary.line(),
            "verdict": measured.summary.verdict(),
            "report": report,
            "comparison": comparison,
            "failed": failures,
        })
        .to_string(),
        TableFormat::Table => to_text(&measured, comparison.as_ref(), arguments, &failures),
    };
    Ok((text, code))
}

fn plan(arguments: &LoopsArguments, place: Place) -> Result<LoopsPlan, BenchError> {
    super::require_realtime(&arguments.scenario)?;
    let given = crate::load_quietly(&arguments.scenario)?;
    // Standard input is read once, whatever is flown of it.
    let name = &arguments.scenario.scenario;
    let load = |edits: Vec<Override>| Scenario::from_text(name, given.to_toml(), &edits);
    let scenario = load(loops::edits(&place, arguments.asap)?)?;
    let alone = load(loops::edits_alone(scenario.settings().scenario.duration_s)?)?;
    let duration_ns = scenario.duration_ns();
    let warm_up_ns = arguments.warm_up.map_or(WARM_UP_NS.min(duration_ns / 4), nanoseconds);
    if warm_up_ns > duration_ns / 2 {
        let [warm_up_s, flown_s] = [warm_up_ns, duration_ns].map(|ns| ns as f64 * 1e-9);
        return Err(BenchError::WarmUp { warm_up_s, flown_s });
    }
    Ok(LoopsPlan {
        warm_up_ns,
        scenario,
        alone,
        place,
        load: arguments.load,
        record: arguments.record.clone(),
        with_floor: !arguments.no_floor,
        progress: io::stderr().is_terminal(),
    })
}

fn write_files(measured: &Measured, arguments: &LoopsArguments) -> Result<(), BenchError> {
    if let Some(path) = &arguments.save {
        let text = serde_json::to_string_pretty(&measured.report).unwrap_or_default();
        write("--save FILE", path, &format!("{text}\n"))?;
    }
    if let Some(path) = &arguments.out {
        write("--out FILE", path, &timing::entries(&measured.steps))?;
    }
    if let Some(path) = &arguments.html {
        write("--html FILE", path, &page::page(measured))?;
    }
    if arguments.svg.is_none() && arguments.png.is_none() {
        return Ok(());
    }
    let pictures = pictures::pictures(measured);
    if let Some(folder) = &arguments.svg {
        let mut folder = ResultsFolder::named_by("--svg DIR", folder)?;
        pictures.iter().try_for_each(|(name, figure)| folder.figure(name, figure))?;
    }
    if let Some(folder) = &arguments.png {
        let mut folder = ResultsFolder::named_by("--png DIR", folder)?;
        pictures.iter().try_for_each(|(name, figure)| folder.bitmap(name, figure))?;
    }
    Ok(())
}

fn write(flag: &'static str, path: &Path, text: &str) -> Result<(), BenchError> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    let mut folder = ResultsFolder::named_by(flag, folder.unwrap_or(Path::new(".")))?;
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned());
    folder.write(&name.unwrap_or_default(), text.as_bytes())?;
    Ok(())
}

fn to_text(
    measured: &Measured,
    comparison: Option<&Comparison>,
    arguments: &LoopsArguments,
    failures: &[String],
) -> String {
    let mut text = format!("{}\n{}", measured.summary.line(), measured.report.to_text());
    // A string takes everything.
    if let Some(lost) = &measured.summary.lost {
        let _ = writeln!(text, "\nthe flight ended before its time: {lost}");
    }
    if let (Some(comparison), Some(path)) = (comparison, &arguments.compare) {
        let _ = write!(text, "\nagainst {}\n\n{}", path.display(), comparison.table());
    }
    for failure in failures {
        let _ = writeln!(text, "FAILS {failure}");
    }
    if failures.is_empty() && !arguments.gate.is_empty() {
        let _ = writeln!(text, "every gate holds");
    }
    text
}
