//! Numbers of a recording over time, as a figure.

use crate::export::cells::cells;
use crate::export::{field_remedy, headings, is_of};
use crate::unit::axis_label;
use document::suggestion;
use figures::figure::{Axis, Colour, Curve, Dash, Figure, Mark, Panel};
use figures::results::{Kind, Value};
use protocol::topic::{known, schema};
use record::read::{ReadError, RecordVisitor, RecordedFlight};
use shared_types::{Sample, Topic, TopicInfo, topics};
use std::collections::{BTreeMap, BTreeSet};
use thiserror::Error;

/// Points of a curve that are drawn one by one; of more, only the extremes of each stretch are.
const DRAWN: usize = 4_000;

/// Patterns of lines, once the colours are used up.
const DASHES: [Dash; 4] = [Dash::Solid, Dash::Dashed, Dash::Dotted, Dash::DashDot];

/// Why there is no plot.
#[derive(Debug, Error)]
pub enum PlotError {
    /// The recording.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// Neither topic nor field.
    #[error("a signal without a name: give TOPIC.FIELD, such as truth.position_w_m")]
    Nothing,
    /// Before its beginning.
    #[error("--from {from_s} s is not before --to {to_s} s: give a later --to, or leave it out")]
    Backwards {
        /// Given as the beginning \[s\].
        from_s: f64,
        /// Given as the end \[s\].
        to_s: f64,
    },
    /// No such topic.
    #[error("{signal}: no topic is called `{topic}`: {remedy}")]
    Topic {
        /// What was asked for.
        signal: String,
        /// The part that names a topic.
        topic: String,
        /// What may have been meant.
        remedy: String,
    },
    /// A topic without a field.
    #[error(
        "{topic}: name a number of it, such as {topic}.{example}; `morphquad topic info {topic}` names all"
    )]
    NoField {
        topic: &'static str,
        /// One of its numbers.
        example: String,
    },
    /// No such number in the topic.
    #[error("{signal}: {topic} has no number `{field}`: {remedy}")]
    Field {
        /// What was asked for.
        signal: String,
        topic: &'static str,
        /// The part that names a field.
        field: String,
        /// What may have been meant.
        remedy: String,
    },
    /// Nothing was recorded of it.
    #[error(
        "{0}: the recording has no sample of it in this time: `morphquad topic info FILE` counts those that it has"
    )]
    Empty(String),
}

/// Numbers of one topic.
#[derive(Debug, Clone)]
pub struct Signal {
    asked: String,
    topic: &'static TopicInfo,
    /// Place among the columns of the topic's table, and name.
    columns: Vec<(usize, String)>,
}

impl Signal {
    /// `TOPIC.FIELD`, where the field may be a list or a group, of which all numbers are meant.
    ///
    /// # Errors
    /// There is no such topic, or no such number in it.
    pub fn parse(asked: &str) -> Result<Self, PlotError> {
        let asked = asked.trim().trim_start_matches('/');
        let (topic, field) = asked.split_once('.').unwrap_or((asked, ""));
        let signal = asked.to_owned();
        if topic.is_empty() {
            return Err(PlotError::Nothing);
        }
        let Some(info) = known(topic) else {
            let names = topics::all().into_iter().map(|topic| topic.name);
            let remedy = suggestion(topic, names);
            return Err(PlotError::Topic { signal, topic: topic.to_owned(), remedy });
        };
        let all = schema(info).map(|schema| headings(&schema)).unwrap_or_default();
        let is_number = |kind: Kind| matches!(kind, Kind::Number | Kind::Whole);
        let columns: Vec<(usize, String)> = all
            .iter()
            .enumerate()
            .filter(|(_, (name, kind))| is_number(*kind) && !field.is_empty() && is_of(name, field))
            .map(|(place, (name, _))| (place, name.clone()))
            .collect();
        if columns.is_empty() {
            let number =
                |(name, kind): &&(String, Kind)| is_number(*kind) && !name.starts_with("header.");
            if field.is_empty() {
                let first = all.iter().find(number).and_then(|(name, _)| name.split('[').next());
                let example = first.unwrap_or_default().to_owned();
                return Err(PlotError::NoField { topic: info.name, example });
            }
            let remedy = if all.iter().any(|(name, _)| is_of(name, field)) {
                format!(
                    "it is a word: `morphquad topic echo {} --field {field}` shows it",
                    info.name
                )
            } else {
                let numbers: Vec<_> = all.iter().filter(number).cloned().collect();
                field_remedy(&numbers, field)
            };
            let (topic, field) = (info.name, field.to_owned());
            return Err(PlotError::Field { signal, topic, field, remedy });
        }
        Ok(Self { asked: signal, topic: info, columns })
    }
}

/// A panel for each of `panels` over the instants `from_s` to `to_s`, with the curves of all `flights` in it; the x axis is
/// the instant from which a sample is in effect \[s\].
///
/// # Errors
/// [`PlotError`] for a recording that cannot be read, or one that has nothing of a signal.
pub fn plot(
    flights: &[RecordedFlight],
    panels: &[Vec<Signal>],
    (from_s, to_s): (f64, f64),
) -> Result<Figure, PlotError> {
    if from_s >= to_s {
        return Err(PlotError::Backwards { from_s, to_s });
    }
    let names = names(flights);
    let mut read = Vec::new();
    for flight in flights {
        let signals: Vec<&Signal> = panels.iter().flatten().collect();
        let curves = signals.iter().map(|_| Curves::new()).collect();
        let mut of_flight = Read { signals, from_s, to_s, curves };
        flight.visit(&mut of_flight)?;
        read.push(of_flight.curves);
    }
    let points = || read.iter().flatten().flat_map(BTreeMap::values).flatten();
    let instants = || points().map(|[t_s, _]| *t_s);
    let (first_s, last_s) =
        (instants().fold(f64::INFINITY, f64::min), instants().fold(0.0, f64::max));
    let time = || {
        let axis = Axis::new("t [s]");
        if first_s < last_s { axis.range(first_s, last_s) } else { axis }
    };
    let mut figure = Figure::new(names.join(", "), 1).panel_px(900.0, 260.0);
    // One legend is of all panels, so that no two curves look alike, and one that comes twice looks the same.
    let mut seen: BTreeMap<String, Option<(Colour, Dash)>> = BTreeMap::new();
    let mut looks =
        DASHES.into_iter().flat_map(|dash| Colour::SERIES.map(|colour| (colour, dash))).cycle();
    let mut place = 0;
    for signals in panels {
        let mut labels: Vec<String> =
            signals.iter().map(|signal| axis_label(&signal.asked)).collect();
        let mut known = BTreeSet::new();
        labels.retain(|label| known.insert(label.clone()));
        let mut panel = Panel::new("", time(), Axis::new(labels.join(", ")));
        for signal in signals {
            for (flight, curves) in names.iter().zip(&read) {
                let of_flight =
                    if flights.len() > 1 { format!("{flight}: ") } else { String::new() };
                let Some(found) = curves.get(place).filter(|found| !found.is_empty()) else {
                    return Err(PlotError::Empty(format!("{of_flight}{}", signal.asked)));
                };
                for (name, points) in named_curves(signal, found) {
                    let name = format!("{of_flight}{name}");
                    let look = seen.entry(name.clone()).or_insert_with(|| looks.next());
                    let (colour, dash) = look.unwrap_or((Colour::Black, Dash::Solid));
                    let curve = Curve::new(name, colour, thinned(points.clone()));
                    panel = panel.curve(curve.mark(Mark::Line(dash)));
                }
            }
            place += 1;
        }
        figure = figure.panel(panel);
    }
    Ok(figure)
}

/// What each flight is called: the name of its file, and the whole path where names are the same.
fn names(flights: &[RecordedFlight]) -> Vec<String> {
    let name = |flight: &RecordedFlight| {
        flight.path().file_stem().unwrap_or_default().to_string_lossy().into_owned()
    };
    let all: Vec<String> = flights.iter().map(name).collect();
    let alone = |name: &String| all.iter().filter(|other| *other == name).count() < 2;
    let named = all.iter().zip(flights).map(|(name, flight)| {
        if alone(name) { name.clone() } else { flight.path().display().to_string() }
    });
    named.collect()
}

/// Curves of a signal by what they are called in the legend; with the seat of the writer if there are several.
fn named_curves<'a>(
    signal: &'a Signal,
    found: &'a Curves,
) -> impl Iterator<Item = (String, &'a Vec<[f64; 2]>)> {
    let seats: BTreeSet<u32> = found.keys().map(|(_, seat)| *seat).collect();
    found.iter().map(move |((column, seat), points)| {
        let (_, name) = &signal.columns[*column];
        let writer = if seats.len() > 1 { format!(", seat {seat}") } else { String::new() };
        (format!("{}.{name}{writer}", signal.topic.name), points)
    })
}

/// Instants and values by column and seat of the writer.
type Curves = BTreeMap<(usize, u32), Vec<[f64; 2]>>;

struct Read<'a> {
    signals: Vec<&'a Signal>,
    from_s: f64,
    to_s: f64,
    /// Of each signal.
    curves: Vec<Curves>,
}

impl RecordVisitor for Read<'_> {
    fn wants(&self, topic: &TopicInfo) -> bool {
        self.signals.iter().any(|signal| signal.topic.name == topic.name)
    }

    fn sample<T: Sample>(&mut self, topic: &'static Topic<T>, sample: &T) {
        let (header, t_s) = (sample.header(), sample.header().valid_ns as f64 * 1e-9);
        if !(self.from_s..=self.to_s).contains(&t_s) {
            return;
        }
        let cells = cells(sample);
        for (signal, curves) in self.signals.iter().zip(&mut self.curves) {
            if signal.topic.name != topic.info.name {
                continue;
            }
            for (column, (place, _)) in signal.columns.iter().enumerate() {
                let value = match cells.get(*place) {
                    Some(Value::Number(value)) => *value,
                    Some(Value::Whole(value)) => *value as f64,
                    _ => continue,
                };
                curves.entry((column, header.seat)).or_default().push([t_s, value]);
            }
        }
    }
}

/// As many points as a drawing can show: of each stretch the lowest and the highest, in their order.
fn thinned(points: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    if points.len() <= DRAWN {
        return points;
    }
    let stretch = points.len().div_ceil(DRAWN / 2);
    let extremes = points.chunks(stretch).flat_map(|points| {
        let by_value =
            |place: &usize, other: &usize| points[*place][1].total_cmp(&points[*other][1]);
        let low = (0..points.len()).min_by(by_value).unwrap_or(0);
        let high = (0..points.len()).max_by(by_value).unwrap_or(0);
        let places = if low == high { vec![low] } else { vec![low.min(high), low.max(high)] };
        places.into_iter().map(|place| points[place]).collect::<Vec<_>>()
    });
    extremes.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_signal_is_a_number_a_list_or_a_group_of_a_topic() {
        let names = |asked: &str| -> Vec<String> {
            Signal::parse(asked).unwrap().columns.into_iter().map(|(_, name)| name).collect()
        };
        assert_eq!(names("truth.position_w_m[2]"), ["position_w_m[2]"]);
        assert_eq!(names("/truth.position_w_m").len(), 3);
        assert_eq!(names("reference.points[0]").len(), 7);
        assert_eq!(names("imu.header.sequence"), ["header.sequence"]);
    }

    #[test]
    fn what_is_no_signal_is_refused_with_what_may_have_been_meant() {
        for (asked, hint) in [
            ("trut.position_w_m", "`truth`"),
            ("truth.positon_w_m", "`position_w_m`"),
            ("truth", "position_w_m"),
            ("truth.position", "`position_w_m`"),
            ("truth.position_w_m[7]", "`position_w_m`"),
        ] {
            let error = Signal::parse(asked).unwrap_err().to_string();
            assert!(error.contains(hint), "{asked}: {error}");
        }
    }

    #[test]
    fn thinning_keeps_every_extreme_and_the_order() {
        let points: Vec<[f64; 2]> = (0..50_000)
            .map(|i| [f64::from(i), if i == 31_234 { 9.0 } else { f64::from(i % 7) }])
            .collect();
        let kept = thinned(points.clone());
        assert!(kept.len() <= DRAWN);
        assert!(kept.contains(&[31_234.0, 9.0]));
        assert!(kept.windows(2).all(|pair| pair[0][0] < pair[1][0]));
        assert_eq!(thinned(points[..3_000].to_vec()).len(), 3_000);
    }
}
