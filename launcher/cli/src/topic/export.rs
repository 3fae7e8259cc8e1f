//! `morphquad topic export`.

use super::{Trouble, What, open, refuse};
use crate::bar::busy;
use crate::options::{Format, TopicExportArguments};
use crate::refusal::Done;
use host::exit;
use serde_json::{Value, json};
use std::io::Write;
use viewers::export::{Exported, Form, export};

/// Writes tables and names them.
pub(super) fn run(
    arguments: &TopicExportArguments,
    out: &mut dyn Write,
    diagnostics: &mut dyn Write,
) -> Done {
    let what = What::of_samples(&arguments.what)?;
    let Some(path) = &what.file else { return Err(refuse(Trouble::NoFile)) };
    let flight = open(path)?;
    let form = if arguments.csv { Form::Csv } else { Form::Parquet };
    let folder = arguments.out.clone().unwrap_or_else(|| path.with_extension(""));
    let busy = busy("writing tables");
    let written = export(&flight, &what.topics, form, &folder).map_err(refuse)?;
    drop(busy);
    for topic in
        what.topics.iter().filter(|topic| written.iter().all(|table| table.topic != topic.name))
    {
        writeln!(diagnostics, "morphquad: {}: nothing came", topic.name)?;
    }
    match arguments.format {
        Format::Text => {
            for table in &written {
                writeln!(out, "{}: {} rows", table.path.display(), table.rows)?;
            }
        }
        Format::Json => {
            let object = |table: &Exported| json!({"path": table.path.display().to_string(), "rows": table.rows});
            let list = written.iter().map(object);
            writeln!(out, "{}", list.collect::<Value>())?;
        }
    }
    out.flush()?;
    Ok(exit::PASS)
}
