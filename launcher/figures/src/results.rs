//! What a study leaves behind: tables on the terminal, files in a folder.

mod columns;
mod document;

pub use columns::{Columns, Kind, ParquetFile, Value};
pub use document::{Document, capital};

use crate::figure::Figure;
use serde::Serialize;
use std::fmt;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// Columns with a heading each. Cells are text: the code that fills them knows how many digits count.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Table {
    headings: Vec<String>,
    rows: Vec<Vec<String>>,
}

/// The folder that takes the results.
#[derive(Debug)]
pub struct ResultsFolder {
    path: PathBuf,
    /// What the user names it with.
    flag: &'static str,
    written: Vec<PathBuf>,
}

/// A result that could not be written.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[error("cannot {action} `{}`", path.display())]
#[diagnostic(help("name a place on a disk with room that you may write to: {flag}"))]
pub struct ResultsError {
    action: &'static str,
    path: PathBuf,
    flag: &'static str,
    source: io::Error,
}

impl Table {
    /// With these headings and no row.
    #[must_use]
    pub fn new<H: Into<String>>(headings: impl IntoIterator<Item = H>) -> Self {
        let headings = headings.into_iter().map(Into::into).collect();
        Self { headings, rows: Vec::new() }
    }

    /// Adds a row; missing cells are empty, surplus ones are dropped.
    pub fn push<C: ToString>(&mut self, cells: impl IntoIterator<Item = C>) {
        let mut row: Vec<String> = cells.into_iter().map(|cell| cell.to_string()).collect();
        row.resize(self.headings.len(), String::new());
        self.rows.push(row);
    }

    /// A list with one object per row, by heading; what reads as a number becomes one.
    ///
    /// A heading that comes twice is distinguished by the heading before it.
    #[must_use]
    pub fn to_json(&self) -> serde_json::Value {
        let value = |cell: &String| match cell.parse::<f64>() {
            Ok(number) if number.is_finite() => number.into(),
            _ if cell == "-" || cell.is_empty() => serde_json::Value::Null,
            _ => cell.clone().into(),
        };
        let names = self.unique_headings();
        let object = |row: &Vec<String>| names.iter().cloned().zip(row.iter().map(value)).collect();
        self.rows.iter().map(|row| serde_json::Value::Object(object(row))).collect()
    }

    fn unique_headings(&self) -> Vec<String> {
        let mut names: Vec<String> = Vec::new();
        let mut group = "";
        for heading in &self.headings {
            if let Some((before, _)) = heading.split_once(": ") {
                group = before;
            }
            let repeated = self.headings.iter().filter(|other| *other == heading).count() > 1;
            let named = repeated && !group.is_empty() && !heading.starts_with(group);
            names.push(if named { format!("{group}: {heading}") } else { heading.clone() });
        }
        names
    }

    /// Comma-separated, one line per row after the headings, each ending with a line feed.
    #[must_use]
    pub fn to_csv(&self) -> Vec<u8> {
        let mut writer = csv::Writer::from_writer(Vec::new());
        for row in std::iter::once(&self.unique_headings()).chain(&self.rows) {
            // Memory takes everything, and all rows are as long as the headings.
            let _ = writer.write_record(row);
        }
        writer.into_inner().unwrap_or_default()
    }
}

/// Aligned for people: numbers to the right, text to the left.
impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let width = |column: usize| {
            let cells = std::iter::once(&self.headings).chain(&self.rows).map(|row| &row[column]);
            cells.map(|cell| cell.chars().count()).max().unwrap_or(0)
        };
        let numeric = |column: usize| {
            let mut cells =
                self.rows.iter().map(|row| row[column].trim()).filter(|c| !c.is_empty());
            cells.all(|cell| cell.starts_with(|c: char| c.is_ascii_digit() || "+-".contains(c)))
        };
        let columns: Vec<(usize, bool)> =
            (0..self.headings.len()).map(|column| (width(column), numeric(column))).collect();
        for row in std::iter::once(&self.headings).chain(&self.rows) {
            let mut line = String::new();
            for (cell, (width, right)) in row.iter().zip(&columns) {
                let cell =
                    if *right { format!("{cell:>width$}") } else { format!("{cell:<width$}") };
                line.push_str(&cell);
                line.push_str("  ");
            }
            writeln!(f, "{}", line.trim_end())?;
        }
        Ok(())
    }
}

impl ResultsFolder {
    /// Makes the folder that `--out` names, and those above it, if there is none.
    ///
    /// # Errors
    /// It cannot be made.
    pub fn create(path: &Path) -> Result<Self, ResultsError> {
        Self::named_by("--out DIR", path)
    }

    /// As [`create`](Self::create), where complaints are to name another flag, with its kind of value.
    ///
    /// # Errors
    /// It cannot be made.
    pub fn named_by(flag: &'static str, path: &Path) -> Result<Self, ResultsError> {
        fs::create_dir_all(path).map_err(|source| {
            let source = match source.kind() {
                io::ErrorKind::AlreadyExists => io::Error::other("it is there and is not a folder"),
                _ => source,
            };
            ResultsError { action: "make the folder", path: path.to_owned(), flag, source }
        })?;
        Ok(Self { path: path.to_owned(), flag, written: Vec::new() })
    }

    fn failed(&self, action: &'static str, path: &Path, source: io::Error) -> ResultsError {
        ResultsError { action, path: path.to_owned(), flag: self.flag, source }
    }

    /// Where it is.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Everything written so far.
    #[must_use]
    pub fn written(&self) -> &[PathBuf] {
        &self.written
    }

    /// Writes `name` as it is, in place of what was there.
    ///
    /// # Errors
    /// It cannot be written in full.
    pub fn write(&mut self, name: &str, content: &[u8]) -> Result<(), ResultsError> {
        let path = self.path.join(name);
        match fs::write(&path, content) {
            Ok(()) => {
                self.written.push(path);
                Ok(())
            }
            Err(source) => Err(self.failed("write", &path, source)),
        }
    }

    /// As [`write`](Self::write), so that a reader finds all of it or what was there before.
    ///
    /// # Errors
    /// Those of [`Self::write`].
    pub fn replace(&mut self, name: &str, content: &[u8]) -> Result<(), ResultsError> {
        let (path, partial) = (self.path.join(name), self.path.join(format!("{name}.partial")));
        let replaced = fs::write(&partial, content).and_then(|()| fs::rename(&partial, &path));
        replaced.map_err(|source| self.failed("write", &path, source))?;
        self.written.push(path);
        Ok(())
    }

    /// Writes a table as `name`.csv.
    ///
    /// # Errors
    /// Those of [`Self::write`].
    pub fn table(&mut self, name: &str, table: &Table) -> Result<(), ResultsError> {
        self.write(&format!("{name}.csv"), &table.to_csv())
    }

    /// Writes anything as `name`.json.
    ///
    /// # Errors
    /// Those of [`Self::write`], and a value that JSON cannot hold.
    pub fn json(&mut self, name: &str, value: &impl Serialize) -> Result<(), ResultsError> {
        let name = format!("{name}.json");
        let mut text = serde_json::to_vec_pretty(value)
            .map_err(|error| self.failed("write", &self.path.join(&name), error.into()))?;
        text.push(b'\n');
        self.write(&name, &text)
    }

    /// Writes a picture as `name`.svg.
    ///
    /// # Errors
    /// Those of [`Self::write`].
    pub fn figure(&mut self, name: &str, figure: &Figure) -> Result<(), ResultsError> {
        self.write(&format!("{name}.svg"), figure.to_svg().as_bytes())
    }

    /// Writes a picture as `name`.png.
    ///
    /// # Errors
    /// Those of [`Self::write`], and a picture that cannot be drawn.
    pub fn bitmap(&mut self, name: &str, figure: &Figure) -> Result<(), ResultsError> {
        let name = format!("{name}.png");
        let bytes = figure.to_png().map_err(|error| {
            self.failed("draw", &self.path.join(&name), io::Error::other(error))
        })?;
        self.write(&name, &bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_aligns_numbers_to_the_right_and_quotes_commas_in_csv() {
        let mut table = Table::new(["horizon", "time [s]"]);
        table.push(["{20, 3}", "0.07"]);
        table.push(["{30, 3}", "-10.25"]);
        assert_eq!(table.to_string(), "horizon  time [s]\n{20, 3}      0.07\n{30, 3}    -10.25\n");
        let csv = String::from_utf8(table.to_csv()).unwrap();
        assert_eq!(csv, "horizon,time [s]\n\"{20, 3}\",0.07\n\"{30, 3}\",-10.25\n");
    }

    #[test]
    fn a_folder_that_cannot_be_is_named_with_the_remedy() {
        let error = ResultsFolder::create(Path::new("/dev/null/results")).unwrap_err();
        assert!(error.to_string().contains("/dev/null/results"), "{error}");
        let report = format!("{:?}", miette::Report::new(error));
        assert!(report.contains("--out DIR"), "{report}");
        let file = tempfile::NamedTempFile::new().unwrap();
        let error = ResultsFolder::named_by("--png DIR", file.path()).unwrap_err();
        let report = format!("{:?}", miette::Report::new(error));
        assert!(report.contains("--png DIR") && report.contains("is not a folder"), "{report}");
    }

    #[test]
    fn what_is_written_is_there_and_a_full_disk_is_an_error() {
        let scratch = tempfile::tempdir().unwrap();
        let mut folder = ResultsFolder::create(&scratch.path().join("a/b")).unwrap();
        folder.json("summary", &[1, 2]).unwrap();
        let text = fs::read_to_string(scratch.path().join("a/b/summary.json")).unwrap();
        assert_eq!(text, "[\n  1,\n  2\n]\n");
        std::os::unix::fs::symlink("/dev/full", folder.path().join("full.csv")).unwrap();
        let error = folder.table("full", &Table::new(["a"])).unwrap_err();
        assert!(error.to_string().contains("full.csv"), "{error}");
        assert_eq!(folder.written().len(), 1);
    }
}
