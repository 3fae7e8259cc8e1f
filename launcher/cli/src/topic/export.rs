//! `morphquad topic export`.

use super::{Trouble, What, open, refuse};
use crate::bar::busy;
use crate::options::{Format, TopicExportArguments};
use crate::refusal::Done;
use host::exit;
use serde_json::{Value, json};
use std::io::Write;
use viewers::export::{Form, export};

/// Writes tables and names them.
pub(super) fn run(arguments: &TopicExportArguments, out: &mut dyn Write) -> Done {
    let what = What::of_samples(&arguments.what)?;
    let Some(path) = &what.file else { return Err(refuse(Trouble::NoFile)) };
    let flight = open(path)?;
    let form = if arguments.csv { Form::Csv } else { Form::Parquet };
    let folder = arguments.out.clone().unwrap_or_else(|| path.with_extension(""));
    let busy = busy("writing tables");
    let written = export(&flight, &what.topics, form, &folder).map_err(refuse)?;
    drop(busy);
    match arguments.format {
        Format::Text => {
            for table in &written {
                writeln!(out, "{}: {} rows", table.path.display(), table.rows)?;
            }
        }
        Format::Json => {
            let list = written.iter().map(|table| json!({"path": table.path, "rows": table.rows}));
            writeln!(out, "{}", list.collect::<Value>())?;
        }
    }
    out.flush()?;
    Ok(exit::PASS)
}
