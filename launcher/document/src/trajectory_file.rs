//! Trajectories as files of comma-separated values: what planners write, and tables of samples.

use super::problem::{Place, Problem};
use ::pilot::settings::{MAX_ROWS, first_not_increasing};
use core::ops::Range;
use miette::NamedSource;

/// Names of the columns of samples, and of what else they are called. Each begins with its short name.
const SAMPLE_COLUMNS: [&[&str]; 11] = [
    &["t", "t_s", "time", "time_s"],
    &["x", "x_m"],
    &["y", "y_m"],
    &["z", "z_m"],
    &["yaw", "yaw_rad", "heading", "heading_rad", "yaw_deg", "heading_deg"],
    &["vx", "vx_m_s"],
    &["vy", "vy_m_s"],
    &["vz", "vz_m_s"],
    &["ax", "ax_m_s2"],
    &["ay", "ay_m_s2"],
    &["az", "az_m_s2"],
];

/// Place of the heading among them.
const YAW: usize = 4;

/// Units that may stand behind the name of each: a number in another one would be taken for these.
const SAMPLE_UNITS: [&[&str]; 11] = [
    &["s"],
    &["m"],
    &["m"],
    &["m"],
    &["rad", "deg", "°"],
    &["m/s"],
    &["m/s"],
    &["m/s"],
    &["m/s2", "m/s^2", "m/s²"],
    &["m/s2", "m/s^2", "m/s²"],
    &["m/s2", "m/s^2", "m/s²"],
];

/// How many columns samples may have, in the order of the names.
const SAMPLE_WIDTHS: [usize; 4] = [4, 5, 8, 11];

/// How many of them may stand without names. With more of them the heading may stand before or behind velocities.
const UNNAMED_WIDTHS: [usize; 2] = [4, 5];

/// How many columns pieces may have: duration and eight coefficients of x, y and z, and of the heading.
const PIECE_WIDTHS: [usize; 2] = [25, 33];

/// What a file has, row by row.
#[derive(Debug)]
pub struct Table {
    /// Pieces of polynomials, or samples.
    pub is_pieces: bool,
    /// Numbers in the order of `pilot.pieces` or `pilot.samples`.
    pub rows: Vec<Vec<f64>>,
    name: String,
    text: String,
    /// Where each row stands.
    spans: Vec<Range<usize>>,
}

/// Where a number of a row comes from: a column of the file, if there is one, and what it is multiplied by.
#[derive(Debug, Clone, Copy)]
struct Column {
    from: Option<usize>,
    factor: f64,
}

impl Column {
    /// As it stands in a column.
    fn of(column: usize) -> Self {
        Self { from: Some(column), factor: 1.0 }
    }
}

/// A record of a file and where it stands.
type Record = (Range<usize>, Vec<String>);

impl Table {
    /// Reads a text that complaints call `name`.
    ///
    /// # Errors
    /// The first line that is neither a header nor as many numbers as there are columns.
    pub fn parse(name: &str, text: &str) -> Result<Self, Problem> {
        let text = text.trim_start_matches('\u{feff}').to_owned();
        let source = || NamedSource::new(name, text.clone());
        let refuse = |span: Range<usize>, what: String, remedy: &str| {
            Problem::new("pilot.file", what, remedy, Some(Place { source: source(), span }))
        };
        let mut records = records(&text)
            .map_err(|(span, what)| refuse(span, what, "write numbers between commas"))?;
        let is_header = |(_, fields): &Record| {
            fields.first().is_some_and(|field| field.parse::<f64>().is_err())
        };
        let header = if records.first().is_some_and(is_header) {
            Some(records.remove(0))
        } else {
            commented_header(&text, records.first())
        };
        let Some((first, fields)) = records.first().or(header.as_ref()) else {
            let remedy = "write rows of t,x,y,z,yaw, or pieces as planners write them: duration,x^0,...,yaw^7";
            return Err(refuse(0..0, "has no rows".to_owned(), remedy));
        };
        let (first, width) = (first.clone(), fields.len());
        let order = match &header {
            Some((span, names)) => {
                columns(names).map_err(|(what, remedy)| refuse(span.clone(), what, &remedy))?
            }
            None if PIECE_WIDTHS.contains(&width) || UNNAMED_WIDTHS.contains(&width) => {
                (0..width).map(Column::of).collect()
            }
            None => {
                let what = format!("{width} columns without names could be anything");
                let remedy = "name the columns in the first line, such as t,x,y,z,yaw,vx,vy,vz, or duration,x^0,...,yaw^7";
                return Err(refuse(first, what, remedy));
            }
        };
        if records.is_empty() {
            let (first, what) = (first.clone(), "has names of columns, and no rows".to_owned());
            return Err(refuse(first, what, "write a row of numbers for each piece or sample"));
        }
        if records.len() > MAX_ROWS {
            let what = format!("has {} rows, and at most {MAX_ROWS} fit", records.len());
            return Err(refuse(0..0, what, "keep every second row, or fewer"));
        }
        let mut table = Self {
            is_pieces: PIECE_WIDTHS.contains(&order.len()),
            rows: Vec::with_capacity(records.len()),
            name: name.to_owned(),
            text: text.clone(),
            spans: Vec::with_capacity(records.len()),
        };
        for (span, fields) in records {
            let row = numbers(&fields, width, &order);
            let row = row.map_err(|(what, remedy)| refuse(span.clone(), what, remedy))?;
            table.rows.push(row);
            table.spans.push(span);
        }
        if let Some(row) = first_not_increasing(&table.rows).filter(|_| !table.is_pieces) {
            let at = |row: usize| table.rows[row].first().copied().unwrap_or(0.0);
            let what = format!("{:?} s comes after {:?} s", at(row), at(row - 1));
            return Err(table.problem(Some(row), &what, "let the times increase from row to row"));
        }
        Ok(table)
    }

    /// A complaint about a row, or about the whole.
    #[must_use]
    pub fn problem(&self, row: Option<usize>, what: &str, remedy: &str) -> Problem {
        let span = row.and_then(|row| self.spans.get(row).cloned()).unwrap_or(0..0);
        let source = NamedSource::new(&self.name, self.text.clone());
        Problem::new("pilot.file", what, remedy, Some(Place { source, span }))
    }
}

/// The names of the columns, where they stand in the comment before the first record, as some programs write them.
fn commented_header(text: &str, first: Option<&Record>) -> Option<Record> {
    let (row, fields) = first?;
    let before = text.get(..row.start)?;
    let comment = before.lines().rev().map(str::trim).find(|line| !line.is_empty())?;
    let names = comment.strip_prefix('#')?.trim_start_matches('#').trim();
    let begin = before.rfind(names)?;
    let span = begin..begin + names.len();
    let names: Vec<String> = names.split([',', ';']).map(|name| name.trim().to_owned()).collect();
    let begins = |first: &String| {
        let first = first.split(['[', '(']).next().unwrap_or_default().trim().to_lowercase();
        SAMPLE_COLUMNS[0].contains(&first.as_str()) || first.starts_with("duration")
    };
    // Any other comment is a sentence.
    let is_header = names.len() == fields.len() && names.first().is_some_and(begins);
    is_header.then_some((span, names))
}

/// The numbers of a record in the order of the columns, or what is wrong with it and what to do.
fn numbers(
    fields: &[String],
    width: usize,
    order: &[Column],
) -> Result<Vec<f64>, (String, &'static str)> {
    if fields.len() != width {
        let what = format!("{} values in {width} columns", fields.len());
        return Err((what, "write one value for each column"));
    }
    let number = |column: &Column| {
        let Column { from: Some(column), factor } = *column else { return Ok(0.0) };
        let field = &fields[column];
        let number = field.parse::<f64>().ok().filter(|number| number.is_finite());
        let remedy = "write a finite number, with a point before its decimals";
        number
            .map(|number| factor * number)
            .ok_or_else(|| (format!("`{field}` is not a number"), remedy))
    };
    order.iter().map(number).collect()
}

/// The records of a text, without empty lines and comments, and what a comma at the end of a line leaves behind.
fn records(text: &str) -> Result<Vec<Record>, (Range<usize>, String)> {
    let is_comment = |line: &str| line.trim().is_empty() || line.trim_start().starts_with('#');
    let first = text.lines().find(|line| !is_comment(line)).unwrap_or_default();
    // A quotation mark in a comment begins no field; what is blank instead leaves every other place as it is.
    let blank = |line: &str| {
        if is_comment(line) { " ".repeat(line.len() - 1) + "\n" } else { line.to_owned() }
    };
    let bare: String = text.split_inclusive('\n').map(blank).collect();
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .trim(csv::Trim::All)
        .delimiter(if first.contains(';') { b';' } else { b',' })
        .from_reader(bare.as_bytes());
    let mut records = Vec::new();
    for record in reader.records() {
        let record = record.map_err(|error| (0..0, error.to_string()))?;
        let begin = record.position().map_or(0, |place| usize::try_from(place.byte()).unwrap_or(0));
        let rest = text.get(begin..).unwrap_or_default();
        let begin = begin + rest.len() - rest.trim_start().len();
        let line = text.get(begin..).unwrap_or_default();
        let end = begin + line.find(['\n', '\r']).unwrap_or(line.len());
        let mut fields: Vec<String> = record.iter().map(str::to_owned).collect();
        if fields.iter().all(String::is_empty) {
            continue;
        }
        if fields.len() > 1 && fields.last().is_some_and(String::is_empty) {
            fields.pop();
        }
        records.push((begin..end, fields));
    }
    Ok(records)
}

/// Which column of a file each number of a row comes from, or what is wrong with the names and what to do.
fn columns(names: &[String]) -> Result<Vec<Column>, (String, String)> {
    if let [only] = names
        && only.contains(char::is_whitespace)
    {
        let what = "the columns are not separated by commas".to_owned();
        return Err((what, "write a comma, or a semicolon, between two columns".to_owned()));
    }
    let split = |name: &String| {
        let (name, unit) = name.split_once(['[', '(']).unwrap_or((name, ""));
        let unit = unit.trim().trim_end_matches([']', ')']).to_owned();
        (name.trim().to_lowercase(), unit)
    };
    let (names, units): (Vec<String>, Vec<String>) = names.iter().map(split).unzip();
    if names.first().is_some_and(|name| name == "duration" || name == "duration_s") {
        return piece_columns(&names, &units);
    }
    let known: Vec<&str> = SAMPLE_COLUMNS.iter().map(|names| names[0]).collect();
    let unknown =
        names.iter().find(|name| !SAMPLE_COLUMNS.iter().any(|c| c.contains(&name.as_str())));
    if let Some(unknown) = unknown {
        if unknown.is_empty() {
            let what = "a column has no name".to_owned();
            return Err((what, "name it, or leave it out: `to_csv(index=False)` in pandas".into()));
        }
        let remedy = match meant(unknown) {
            Some(name) => format!("call it {name}"),
            None => format!("leave it out; what is known is {}", known.join(",")),
        };
        return Err((format!("there is no column `{unknown}`"), remedy));
    }
    let place = |known: &[&str]| names.iter().position(|name| known.contains(&name.as_str()));
    let mut order: Vec<Column> =
        SAMPLE_COLUMNS.iter().map(|known| Column { from: place(known), factor: 1.0 }).collect();
    for (column, allowed) in order.iter().zip(SAMPLE_UNITS) {
        let Some(place) = column.from else { continue };
        let unit = units[place].as_str();
        let is_twice = names[place].ends_with("_deg") && unit == "rad";
        if is_twice || !(unit.is_empty() || allowed.contains(&unit)) {
            return Err(other_unit(&names[place], unit, allowed[0]));
        }
    }
    if let Column { from: Some(column), factor } = &mut order[YAW]
        && (names[*column].ends_with("_deg") || ["deg", "°"].contains(&units[*column].as_str()))
    {
        *factor = 1_f64.to_radians();
    }
    let last = order.iter().rposition(|column| column.from.is_some()).map_or(0, |last| last + 1);
    order.truncate(last);
    // Only a heading that never changes may be left out before what follows it.
    let is_whole = order.iter().enumerate().all(|(i, column)| i == YAW || column.from.is_some());
    let is_once = order.iter().filter(|column| column.from.is_some()).count() == names.len();
    if is_whole && is_once && SAMPLE_WIDTHS.contains(&order.len()) {
        return Ok(order);
    }
    let what = format!("the columns {} are not what a trajectory consists of", names.join(","));
    let remedy = "give t,x,y,z, with a heading yaw, with velocities vx,vy,vz, and with these accelerations ax,ay,az";
    Err((what, remedy.to_owned()))
}

/// What another name for a column may stand for, such as `pos_x` and `timestamp`.
fn meant(unknown: &str) -> Option<&'static str> {
    if unknown.contains("time") || unknown.contains("stamp") {
        return Some("t");
    }
    let parts: Vec<&str> = unknown.split(['_', '.', ' ']).collect();
    let has = |names: &[&str]| parts.iter().any(|part| names.contains(part));
    let axis = ["x", "y", "z"].into_iter().position(|axis| parts.contains(&axis))?;
    let names = if has(&["v", "vel", "velocity"]) {
        ["vx", "vy", "vz"]
    } else if has(&["a", "acc", "accel", "acceleration"]) {
        ["ax", "ay", "az"]
    } else if has(&["p", "pos", "position"]) {
        ["x", "y", "z"]
    } else {
        return None;
    };
    Some(names[axis])
}

fn other_unit(name: &str, unit: &str, wanted: &str) -> (String, String) {
    (format!("the column `{name}` is in {unit}"), format!("give it in {wanted}"))
}

/// As [`columns`], of pieces.
fn piece_columns(names: &[String], units: &[String]) -> Result<Vec<Column>, (String, String)> {
    let axes = ["x", "y", "z", "yaw"].map(|axis| (0..8).map(move |k| format!("{axis}^{k}")));
    let known: Vec<String> = axes.into_iter().flatten().collect();
    let same = |(name, known): (&String, &String)| name.replace('^', "") == known.replace('^', "");
    let wrong = names.iter().skip(1).zip(&known).find(|pair| !same(*pair));
    match wrong {
        Some((name, known)) => {
            let what = format!("the column `{name}` stands where `{known}` belongs");
            Err((what, "write duration,x^0,...,x^7,y^0,...,z^0,...,yaw^0,...,yaw^7".to_owned()))
        }
        None if PIECE_WIDTHS.contains(&names.len()) => {
            for (place, unit) in units.iter().enumerate() {
                let wanted = if place == 0 {
                    "s"
                } else if place < 25 {
                    "m"
                } else {
                    "rad"
                };
                let first = unit.split('/').next().unwrap_or_default();
                if !first.is_empty() && first != wanted {
                    return Err(other_unit(&names[place], unit, wanted));
                }
            }
            Ok((0..names.len()).map(Column::of).collect())
        }
        None => {
            let what = format!("{} columns, where pieces have 25 or 33", names.len());
            Err((what, "give duration and eight coefficients of x, y, z and yaw".to_owned()))
        }
    }
}
