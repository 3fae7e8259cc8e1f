//! `morphquad paper`: the paper's tests, printed and written.

use super::bar::busy;
use super::refusal::{Done, Failure};
use super::{Format, PaperArguments};
use figures::results::{ResultsError, ResultsFolder};
use host::exit;
use std::io::{self, Write};
use studies::paper::{Findings, PaperError, Test, report};

/// Everything to look at.
const PAGE: &str = "paper.html";

/// Runs the tests asked for and gives the exit code.
///
/// # Errors
/// Those of `out`, and a folder that cannot be written.
pub(super) fn reproduce(arguments: &PaperArguments, out: &mut dyn Write) -> Done {
    let unwritable = |error: ResultsError| Failure::report(error, exit::UNFIT);
    // Before the work: a folder that cannot be is known at once.
    let mut folder = ResultsFolder::create(&arguments.out).map_err(unwritable)?;
    let findings = run(arguments).map_err(|error| Failure::plain(&error, exit::USAGE))?;
    write(&findings, &mut folder).map_err(unwritable)?;
    let code = if report::holds(&findings) { exit::PASS } else { exit::FAILED };
    crate::finished(print(&findings, &folder, arguments.format, out), code)
}

fn run(arguments: &PaperArguments) -> Result<Vec<Findings>, PaperError> {
    let asked = |test: &Test| arguments.test.is_none_or(|number| number == test.number());
    let run = |test: Test| {
        let _busy = busy(&format!("test {}", test.number()));
        test.run()
    };
    Test::ALL.into_iter().filter(asked).map(run).collect()
}

fn write(findings: &[Findings], folder: &mut ResultsFolder) -> Result<(), ResultsError> {
    for found in findings {
        report::write(found, folder)?;
    }
    folder.write(PAGE, report::page(findings).as_bytes())?;
    folder.json("summary", &report::summary(findings))
}

fn print(
    findings: &[Findings],
    folder: &ResultsFolder,
    format: Format,
    out: &mut dyn Write,
) -> io::Result<()> {
    match format {
        Format::Json => writeln!(out, "{:#}", report::summary(findings))?,
        Format::Text => {
            for found in findings {
                writeln!(out, "{found}")?;
            }
            let pictures = findings.iter().flat_map(|found| &found.figures);
            let pictures: Vec<String> = pictures.map(|(name, _)| format!("{name}.svg")).collect();
            let (count, path) = (folder.written().len(), folder.path().display());
            let names = pictures.join(", ");
            writeln!(out, "{count} files in {path}: {names}, tables, trajectories")?;
            writeln!(out, "{path}/{PAGE}: open it in a browser")?;
        }
    }
    out.flush()
}
