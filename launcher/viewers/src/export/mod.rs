//! Tables of a recording: a file for each topic, as CSV or as Parquet, a column for each number.

pub(crate) mod cells;

use cells::cells;
pub use cells::{field_remedy, headings, is_of};
use figures::results::{Columns, Kind, ParquetFile, Value};
use record::read::{ReadError, RecordVisitor, RecordedFlight};
use shared_types::{Sample, Topic, TopicInfo};
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write as _};
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Rows that are kept before they are written.
const ROWS: usize = 8_192;

/// Form of the tables.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    /// Comma-separated, numbers so that they read back to the same bits.
    Csv,
    /// Apache Parquet.
    Parquet,
}

/// Why there is no table.
#[derive(Debug, Error)]
pub enum ExportError {
    /// The recording.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// The disk.
    #[error("cannot write {}: {reason}; name a folder on a disk with room: --out DIR", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The system's error.
        reason: String,
    },
}

/// A table that was written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Exported {
    /// Whose samples are in it.
    pub topic: &'static str,
    /// The file.
    pub path: PathBuf,
    /// One for each sample.
    pub rows: u64,
}

/// Writes a table of each of `wanted`, all topics if it is empty, into `folder`.
///
/// # Errors
/// [`ExportError`].
pub fn export(
    flight: &RecordedFlight,
    wanted: &[&'static TopicInfo],
    form: Form,
    folder: &Path,
) -> Result<Vec<Exported>, ExportError> {
    let unwritable = |error: io::Error| ExportError::Write {
        path: folder.to_owned(),
        reason: error.to_string(),
    };
    fs::create_dir_all(folder).map_err(unwritable)?;
    let tables = BTreeMap::new();
    let mut export = Export { wanted, form, folder, tables, trouble: None };
    flight.visit(&mut export)?;
    let mut written = Vec::new();
    for (name, mut table) in core::mem::take(&mut export.tables) {
        match table.flush().and_then(|()| table.close(name)) {
            Ok(exported) => written.push(exported),
            Err(reason) => {
                export.fail(name, &reason);
            }
        }
    }
    match export.trouble {
        Some(trouble) => Err(trouble),
        None => Ok(written),
    }
}

struct Export<'a> {
    wanted: &'a [&'static TopicInfo],
    form: Form,
    folder: &'a Path,
    tables: BTreeMap<&'static str, Table>,
    trouble: Option<ExportError>,
}

impl Export<'_> {
    fn path(&self, name: &str) -> PathBuf {
        let extension = if self.form == Form::Csv { "csv" } else { "parquet" };
        self.folder.join(format!("{name}.{extension}"))
    }

    fn fail(&mut self, name: &str, reason: &str) {
        let (path, reason) = (self.path(name), reason.to_owned());
        self.trouble.get_or_insert(ExportError::Write { path, reason });
    }

    fn take<T: Sample>(&mut self, name: &'static str, sample: &T) -> Result<(), String> {
        let path = self.path(name);
        let table = match self.tables.entry(name) {
            std::collections::btree_map::Entry::Occupied(there) => there.into_mut(),
            std::collections::btree_map::Entry::Vacant(none) => {
                let mut columns = vec![("t_s".to_owned(), Kind::Number)];
                columns.extend(headings(&T::SCHEMA));
                none.insert(Table::create(path, columns, self.form)?)
            }
        };
        let t_s = sample.header().valid_ns as f64 / 1e9;
        table.push(core::iter::once(Value::Number(t_s)).chain(cells(sample)))
    }
}

impl RecordVisitor for Export<'_> {
    fn wants(&self, topic: &TopicInfo) -> bool {
        self.wanted.is_empty() || self.wanted.iter().any(|wanted| wanted.name == topic.name)
    }

    fn sample<T: Sample>(&mut self, topic: &'static Topic<T>, sample: &T) {
        if self.trouble.is_none()
            && let Err(reason) = self.take(topic.info.name, sample)
        {
            self.fail(topic.info.name, &reason);
        }
    }
}

/// A table on its way.
struct Table {
    path: PathBuf,
    rows: u64,
    columns: Columns,
    sink: Sink,
}

enum Sink {
    Csv(BufWriter<File>),
    Parquet(Box<ParquetFile<File>>),
}

impl Table {
    fn create(path: PathBuf, columns: Vec<(String, Kind)>, form: Form) -> Result<Self, String> {
        let file = File::create(&path).map_err(|error| error.to_string())?;
        let columns = Columns::new(columns);
        let sink = match form {
            Form::Csv => {
                let mut file = BufWriter::new(file);
                // Without a row that is the line of headings.
                file.write_all(&columns.to_csv()).map_err(|error| error.to_string())?;
                Sink::Csv(file)
            }
            Form::Parquet => {
                let file = ParquetFile::begin(file, &columns, "sample");
                Sink::Parquet(Box::new(file.map_err(|error| error.to_string())?))
            }
        };
        Ok(Self { path, rows: 0, columns, sink })
    }

    fn push(&mut self, cells: impl Iterator<Item = Value>) -> Result<(), String> {
        self.columns.push(cells);
        self.rows += 1;
        if self.columns.rows().len() < ROWS { Ok(()) } else { self.flush() }
    }

    fn flush(&mut self) -> Result<(), String> {
        match &mut self.sink {
            Sink::Csv(file) => {
                file.write_all(&self.columns.rows_to_csv()).map_err(|error| error.to_string())?;
            }
            Sink::Parquet(file) => {
                file.write(&self.columns).map_err(|error| error.to_string())?;
            }
        }
        self.columns.clear();
        Ok(())
    }

    fn close(self, topic: &'static str) -> Result<Exported, String> {
        let Self { path, rows, sink, .. } = self;
        match sink {
            Sink::Csv(mut file) => file.flush().map_err(|error| error.to_string())?,
            Sink::Parquet(file) => file.close().map_err(|error| error.to_string())?,
        }
        Ok(Exported { topic, path, rows })
    }
}
