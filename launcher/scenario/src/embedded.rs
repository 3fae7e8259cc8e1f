//! What a scenario does not set itself because its trajectory does: the rows of a file, and where, how fast and for how
//! long a flight flies.

use super::pilot_error::pilot_error;
use super::text;
use ::pilot::settings::{COMMON_KEYS, MAX_SPEED_M_S, Trajectory};
use document::{Document, Edit, Problem, Table, Value};
use garde::Validate as _;
use serde::Deserialize as _;
use shared_types::time::ns_from_s;
use std::io;
use std::path::{Path, PathBuf};
use toml::Spanned;
use toml::de::{DeValue, ValueDeserializer};

/// Time at rest behind the end, if the scenario does not set how long it flies \[s\].
const HOLD_S: f64 = 2.0;

/// Longest flight that a scenario may have \[s\].
const MAX_FLIGHT_S: f64 = 1e6;

/// Speed below which a flight begins at rest \[m/s\].
const REST_M_S: f64 = 1e-3;

/// What a trajectory adds to its scenario: the rows of its file, where and how fast the flight begins and how long it
/// is, as far as the scenario does not set it itself.
///
/// # Errors
/// The file cannot be read, or what it has cannot be flown.
pub(super) fn embedded(document: &Document<'_>) -> Result<Vec<Edit>, Problem> {
    let Some(mut given) = typed(document) else { return Ok(Vec::new()) };
    let mut edits = Vec::new();
    // Which text what is implied comes from.
    let (mut table, mut name) = (None, "pilot".to_owned());
    if let Some(file) = given.file.take() {
        if !(given.pieces.is_empty() && given.samples.is_empty()) {
            let what = "there are rows in the scenario as well";
            let remedy = "leave out `file`, or `pieces` and `samples`";
            let place = document.place_of("pilot.file");
            return Err(Problem::new("pilot.file", what, remedy, place));
        }
        let read = read(document, &file)?;
        let key = if read.is_pieces { "pieces" } else { "samples" };
        if read.is_pieces {
            given.pieces.clone_from(&read.rows);
        } else {
            given.samples.clone_from(&read.rows);
        }
        edits.push(Edit::embedded(&file, format!("pilot.{key}"), format!("{:?}", read.rows)));
        (table, name) = (Some(read), file);
    }
    let path = match (::pilot::Trajectory::new(&given.config()), &table) {
        (Ok(path), _) => path,
        (Err(error), Some(table)) => {
            let (_, what, remedy) = pilot_error(&error);
            return Err(table.problem(error.index(), &what, &remedy));
        }
        // What is wrong with the scenario's own rows is reported when it is checked.
        (Err(_), None) => return Ok(Vec::new()),
    };
    edits.extend(implied(document, &path, &name)?);
    Ok(edits)
}

/// Where, how fast and for how long a flight along `path` flies, as far as the scenario does not set it; `name` is what
/// it comes from.
fn implied(
    document: &Document<'_>,
    path: &::pilot::Trajectory,
    name: &str,
) -> Result<Vec<Edit>, Problem> {
    let at_s = document.number("start.at_s").unwrap_or(0.0);
    let begin = path.at(ns_from_s(at_s));
    let left_s = (path.rest_s().unwrap_or(0.0) - at_s).max(0.0);
    // A sum of durations has more digits than they have.
    let length_s = libm::round(1e9 * (left_s + HOLD_S)) / 1e9;
    let turned_rad = libm::remainder(begin.yaw_rad, core::f64::consts::TAU);
    let speed_m_s = begin.velocity_w_m_s.iter().fold(0.0, |most: f64, v| most.max(v.abs()));
    let is_implied = |key: &str| !document.has(key);
    let refuse = |what: String, key: &str| {
        let remedy = format!("set {key} to another, or change the trajectory");
        Err(Problem::new("pilot", what, remedy, document.place_of("pilot.file")))
    };
    if speed_m_s > MAX_SPEED_M_S && is_implied("start.velocity_w_m_s") {
        let what = format!(
            "the trajectory begins with {speed_m_s:.1} m/s, and a flight with {MAX_SPEED_M_S} m/s at most"
        );
        return refuse(what, "start.velocity_w_m_s");
    }
    if length_s > MAX_FLIGHT_S && is_implied("scenario.duration_s") {
        let what =
            format!("the trajectory takes {length_s:.0} s, and a flight {MAX_FLIGHT_S} s at most");
        return refuse(what, "scenario.duration_s");
    }
    let [duration_s, position_w_m, yaw_deg, velocity_w_m_s] = [
        format!("{length_s:?}"),
        format!("{:?}", begin.position_w_m),
        format!("{:?}", turned_rad.to_degrees()),
        format!("{:?}", begin.velocity_w_m_s),
    ];
    let all = [
        ("scenario.duration_s", duration_s, true),
        ("start.position_w_m", position_w_m, true),
        ("start.yaw_deg", yaw_deg, turned_rad != 0.0),
        ("start.velocity_w_m_s", velocity_w_m_s, speed_m_s >= REST_M_S),
    ];
    let needed = all.into_iter().filter(|(key, _, is_needed)| *is_needed && is_implied(key));
    Ok(needed.map(|(key, value, _)| Edit::embedded(name, key.to_owned(), value)).collect())
}

/// The section, if it has a trajectory and is of the right types.
fn typed(document: &Document<'_>) -> Option<Trajectory> {
    let mut table = document.root().get("pilot")?.get_ref().as_table()?.clone();
    if table.remove("kind")?.get_ref().as_str() != Some("trajectory") {
        return None;
    }
    for key in COMMON_KEYS {
        table.remove(key);
    }
    let value: Value<'_> = Spanned::new(0..0, DeValue::Table(table));
    let given = Trajectory::deserialize(ValueDeserializer::from(value)).ok()?;
    let is_finite = given.time_scale.is_finite() && given.origin_w_m.iter().all(|x| x.is_finite());
    given.validate().ok().filter(|()| is_finite).map(|()| given)
}

/// Reads a file; one that the scenario names is looked for beside it.
fn read(document: &Document<'_>, file: &str) -> Result<Table, Problem> {
    let place = document.place_of("pilot.file");
    let scenario = place.as_ref().map(|place| PathBuf::from(place.source.name()));
    let folder = scenario.as_deref().and_then(Path::parent).unwrap_or("".as_ref());
    let path = folder.join(file).to_string_lossy().into_owned();
    let text = text::text_of(&path).map_err(|error| {
        let remedy = match error.kind() {
            io::ErrorKind::NotFound => {
                "a path in a scenario begins in its folder, and one by --set where the command runs"
            }
            io::ErrorKind::InvalidData => "save it as text in UTF-8",
            _ => "name a file of comma-separated values that may be read",
        };
        let path = if file.is_empty() { "a file without a name" } else { path.as_str() };
        Problem::new("pilot.file", format!("{path} cannot be read: {error}"), remedy, place)
    })?;
    Table::parse(&path, &text)
}

#[cfg(test)]
mod tests;
