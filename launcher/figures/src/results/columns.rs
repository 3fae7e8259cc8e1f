//! A table for machines: columns of one kind each, as CSV and as Parquet, the same bytes each time.

use parquet::basic::{LogicalType, Repetition, Type as Physical};
use parquet::data_type::{ByteArray, ByteArrayType, DataType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::types::Type;
use std::io::Write;
use std::sync::Arc;

/// What a column holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Whole numbers, not negative.
    Whole,
    Number,
    Text,
}

/// One cell.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// There is no value.
    Missing,
    /// Of a column of [`Kind::Whole`].
    Whole(u64),
    /// Of a column of [`Kind::Number`].
    Number(f64),
    /// Of a column of [`Kind::Text`].
    Text(String),
}

impl Value {
    /// Shortest text that [`Kind::read`] reads back to the same bits; nothing if missing.
    #[must_use]
    pub fn to_cell(&self) -> String {
        match self {
            Self::Missing => String::new(),
            Self::Whole(whole) => whole.to_string(),
            Self::Number(number) => number.to_string(),
            Self::Text(text) => text.clone(),
        }
    }

    /// As a number, if it is one.
    #[must_use]
    pub fn number(&self) -> Option<f64> {
        match self {
            Self::Whole(whole) => Some(*whole as f64),
            Self::Number(number) => Some(*number),
            Self::Missing | Self::Text(_) => None,
        }
    }
}

impl From<u64> for Value {
    fn from(whole: u64) -> Self {
        Self::Whole(whole)
    }
}

impl From<f64> for Value {
    fn from(number: f64) -> Self {
        Self::Number(number)
    }
}

impl From<&str> for Value {
    fn from(text: &str) -> Self {
        Self::Text(text.to_owned())
    }
}

impl<T: Into<Self>> From<Option<T>> for Value {
    fn from(value: Option<T>) -> Self {
        value.map_or(Self::Missing, Into::into)
    }
}

impl Kind {
    /// Reads what [`Value::to_cell`] wrote; `None` if it was written by something else.
    #[must_use]
    pub fn read(self, cell: &str) -> Option<Value> {
        if cell.is_empty() {
            return Some(Value::Missing);
        }
        match self {
            Self::Whole => cell.parse().ok().map(Value::Whole),
            Self::Number => cell.parse().ok().map(Value::Number),
            Self::Text => Some(Value::Text(cell.to_owned())),
        }
    }

    fn physical(self) -> Physical {
        match self {
            Self::Whole => Physical::INT64,
            Self::Number => Physical::DOUBLE,
            Self::Text => Physical::BYTE_ARRAY,
        }
    }

    fn logical(self) -> Option<LogicalType> {
        match self {
            Self::Whole => Some(LogicalType::integer(64, false)),
            Self::Number => None,
            Self::Text => Some(LogicalType::String),
        }
    }
}

/// Rows under headings, each column of one kind.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Columns {
    headings: Vec<(String, Kind)>,
    rows: Vec<Vec<Value>>,
}

impl Columns {
    /// With these headings and no row.
    #[must_use]
    pub fn new(headings: Vec<(String, Kind)>) -> Self {
        Self { headings, rows: Vec::new() }
    }

    /// Adds a row; missing cells are [`Value::Missing`], surplus ones are dropped.
    pub fn push(&mut self, cells: impl IntoIterator<Item = Value>) {
        let mut row: Vec<Value> = cells.into_iter().collect();
        row.resize(self.headings.len(), Value::Missing);
        self.rows.push(row);
    }

    /// Rows in order.
    #[must_use]
    pub fn rows(&self) -> &[Vec<Value>] {
        &self.rows
    }

    /// Place of a column.
    #[must_use]
    pub fn place(&self, heading: &str) -> Option<usize> {
        self.headings.iter().position(|(name, _)| name == heading)
    }

    /// Forgets all rows.
    pub fn clear(&mut self) {
        self.rows.clear();
    }

    /// Comma-separated, a line per row after the headings; what is missing is empty.
    #[must_use]
    pub fn to_csv(&self) -> Vec<u8> {
        let mut writer = csv::Writer::from_writer(Vec::new());
        // Memory takes everything, and all rows are as long as the headings.
        let _ = writer.write_record(self.headings.iter().map(|(name, _)| name));
        let mut csv = writer.into_inner().unwrap_or_default();
        csv.extend(self.rows_to_csv());
        csv
    }

    /// The same without the headings.
    #[must_use]
    pub fn rows_to_csv(&self) -> Vec<u8> {
        let mut writer = csv::Writer::from_writer(Vec::new());
        for row in &self.rows {
            let _ = writer.write_record(row.iter().map(Value::to_cell));
        }
        writer.into_inner().unwrap_or_default()
    }

    /// Apache Parquet, one row group, uncompressed; what is missing is null.
    ///
    /// # Errors
    /// The format's writer refuses, which no table of these kinds makes it do.
    pub fn to_parquet(&self) -> Result<Vec<u8>, ParquetError> {
        let mut bytes = Vec::new();
        let mut file = ParquetFile::begin(&mut bytes, self, "case")?;
        file.write(self)?;
        file.close()?;
        Ok(bytes)
    }

    fn put<T: DataType, W: Write + Send>(
        &self,
        at: usize,
        group: &mut SerializedRowGroupWriter<'_, W>,
        cell: impl Fn(&Value) -> Option<T::T>,
    ) -> Result<(), ParquetError> {
        let cells: Vec<Option<T::T>> = self.rows.iter().map(|row| cell(&row[at])).collect();
        let present: Vec<i16> = cells.iter().map(|cell| i16::from(cell.is_some())).collect();
        let values: Vec<T::T> = cells.into_iter().flatten().collect();
        if let Some(mut column) = group.next_column()? {
            column.typed::<T>().write_batch(&values, Some(&present), None)?;
            column.close()?;
        }
        Ok(())
    }
}

/// A table that is written as it grows: a row group for each part.
pub struct ParquetFile<W: Write + Send>(SerializedFileWriter<W>);

impl<W: Write + Send> core::fmt::Debug for ParquetFile<W> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("ParquetFile").finish_non_exhaustive()
    }
}

impl<W: Write + Send> ParquetFile<W> {
    /// Begins a table with the headings of `columns`, whose rows are `row`s.
    ///
    /// # Errors
    /// The sink takes nothing.
    pub fn begin(sink: W, columns: &Columns, row: &str) -> Result<Self, ParquetError> {
        let field = |(name, kind): &(String, Kind)| {
            Type::primitive_type_builder(name, kind.physical())
                .with_repetition(Repetition::OPTIONAL)
                .with_logical_type(kind.logical())
                .build()
                .map(Arc::new)
        };
        let fields = columns.headings.iter().map(field).collect::<Result<_, _>>()?;
        let schema = Type::group_type_builder(row).with_fields(fields).build()?;
        let by = concat!("morphquad ", env!("CARGO_PKG_VERSION"));
        let properties = WriterProperties::builder().set_created_by(by.to_owned()).build();
        Ok(Self(SerializedFileWriter::new(sink, Arc::new(schema), Arc::new(properties))?))
    }

    /// Adds the rows of `columns`, which has the headings that the table began with.
    ///
    /// # Errors
    /// The sink takes no more.
    pub fn write(&mut self, columns: &Columns) -> Result<(), ParquetError> {
        if columns.rows.is_empty() {
            return Ok(());
        }
        let mut group = self.0.next_row_group()?;
        for (at, (_, kind)) in columns.headings.iter().enumerate() {
            match kind {
                Kind::Whole => {
                    columns.put::<Int64Type, W>(at, &mut group, |value| match value {
                        Value::Whole(whole) => Some(whole.cast_signed()),
                        _ => None,
                    })?;
                }
                Kind::Number => columns.put::<DoubleType, W>(at, &mut group, Value::number)?,
                Kind::Text => {
                    columns.put::<ByteArrayType, W>(at, &mut group, |value| match value {
                        Value::Text(text) => Some(ByteArray::from(text.as_str())),
                        _ => None,
                    })?;
                }
            }
        }
        group.close()?;
        Ok(())
    }

    /// Ends the table.
    ///
    /// # Errors
    /// The sink takes no more.
    pub fn close(self) -> Result<(), ParquetError> {
        self.0.close().map(|_| ())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use parquet::file::reader::{FileReader as _, SerializedFileReader};
    use parquet::record::RowAccessor as _;

    fn table() -> Columns {
        let mut columns = Columns::new(vec![
            ("seed".to_owned(), Kind::Whole),
            ("rms".to_owned(), Kind::Number),
            ("word".to_owned(), Kind::Text),
        ]);
        columns.push([Value::Whole(u64::MAX), Value::Number(0.1 + 0.2), Value::from("a, \"b\"")]);
        columns.push([Value::Whole(2), Value::Missing, Value::Missing]);
        columns
    }

    #[test]
    fn cells_read_back_to_the_same_bits() {
        for number in [0.1 + 0.2, -0.0, 5e-324, f64::MAX, f64::INFINITY, 1e22] {
            let Some(Value::Number(back)) = Kind::Number.read(&Value::Number(number).to_cell())
            else {
                panic!("{number} became something else");
            };
            assert_eq!(number.to_bits(), back.to_bits());
        }
        assert!(matches!(Kind::Number.read("NaN"), Some(Value::Number(x)) if x.is_nan()));
        assert_eq!(Kind::Whole.read(""), Some(Value::Missing));
        assert_eq!(Kind::Whole.read("-1"), None);
    }

    #[test]
    fn csv_has_a_line_per_row_and_nothing_where_nothing_is_known() {
        let csv = String::from_utf8(table().to_csv()).unwrap();
        let lines: Vec<&str> = csv.lines().collect();
        let first = "18446744073709551615,0.30000000000000004,\"a, \"\"b\"\"\"";
        assert_eq!(lines, ["seed,rms,word", first, "2,,"]);
    }

    #[test]
    fn parquet_reads_back_and_comes_out_the_same_each_time() {
        let bytes = table().to_parquet().unwrap();
        assert_eq!(bytes, table().to_parquet().unwrap());
        let mut file = tempfile::tempfile().unwrap();
        file.write_all(&bytes).unwrap();
        let reader = SerializedFileReader::new(file).unwrap();
        let rows: Vec<_> = reader.get_row_iter(None).unwrap().map(Result::unwrap).collect();
        assert_eq!(rows.len(), 2);
        assert_eq!(rows[0].get_ulong(0).unwrap(), u64::MAX);
        assert_eq!(rows[0].get_double(1).unwrap().to_bits(), (0.1_f64 + 0.2).to_bits());
        assert_eq!(rows[0].get_string(2).unwrap(), "a, \"b\"");
        assert!(rows[1].get_double(1).is_err() && rows[1].get_string(2).is_err());
    }
}
