//! A flight drawn: tracking, constraint use, disturbances, loops, and where time went.

use super::Report;
use crate::trace::{SEGMENTS, Traced};
use crate::view::{Gathered, Panel};
use figures::figure::{
    self, Axis, Colour, Curve, Dash, Figure, Level, Mark, Panel as Drawn, Stretch,
};

/// Intervals of a curve: more do not show on paper.
const INTERVALS: usize = 700;
/// Points of a tail.
const POINTS: usize = 400;

/// Every picture, by name.
#[must_use]
pub fn pictures(report: &Report) -> Vec<(&'static str, Figure)> {
    let gathered = &report.gathered;
    let panels = &gathered.panels;
    let [roll, pitch, yaw] = &panels.torque;
    let groups: [(&str, &str, usize, Vec<&Panel>); 4] = [
        ("tracking", "Tracking", 1, vec![&panels.error, &panels.attitude, &panels.morph]),
        (
            "constraints",
            "Constraints and their bounds",
            2,
            vec![roll, pitch, yaw, &panels.increment, &panels.thrust, &panels.tilt, &panels.rotors],
        ),
        ("disturbance", "What disturbed it", 1, vec![&panels.wind, &panels.force, &panels.moment]),
        ("loops", "Loops", 1, vec![&panels.lateness, &panels.compute, &panels.misses]),
    ];
    let drawn = groups.into_iter().filter_map(|(name, title, columns, panels)| {
        let shown: Vec<_> = panels.into_iter().filter(|panel| panel.is_worth_showing()).collect();
        let [width, height] = if columns == 1 { [800.0, 210.0] } else { [440.0, 200.0] };
        let empty = Figure::new(title, columns).panel_px(width, height);
        let figure = shown.iter().fold(empty, |figure, panel| figure.panel(draw(panel, gathered)));
        (!shown.is_empty()).then_some((name, figure))
    });
    let mut pictures: Vec<_> = drawn.collect();
    pictures.push(("waterfall", waterfall(report)));
    pictures.push(("tails", tails(report)));
    pictures
}

/// A chart of the page on paper, with a line where something happened.
fn draw(panel: &Panel, gathered: &Gathered) -> Drawn {
    let unit = if panel.unit == "1" { String::new() } else { format!("[{}]", panel.unit) };
    let y = if panel.log { Axis::log(unit) } else { Axis::new(unit) };
    let mut drawn = Drawn::new(panel.title, Axis::new("t [s]"), y);
    for series in &panel.series {
        let mut points = series.envelope.points(INTERVALS);
        points.retain(|[_, value]| !panel.log || *value > 0.0);
        if !points.is_empty() {
            let curve = Curve::new(series.name, series.colour, points);
            drawn = drawn.curve(curve.mark(Mark::Line(series.dash)));
        }
    }
    for (name, at) in &panel.levels {
        drawn = drawn.level(Level::new(*name, Colour::Red, Dash::Dashed, *at));
    }
    for happening in gathered.happenings.iter().filter(|happening| happening.is_mark) {
        drawn = drawn.instant(Level::new("", Colour::Grey, Dash::Dotted, happening.at_s));
    }
    drawn
}

/// From sensor to rotors, stretch after stretch.
fn waterfall(report: &Report) -> Figure {
    let stretch = |place: usize| {
        let figures = report.latency.segments.get(place)?;
        let [p50_us, p99_us] = [figures.p50_ns, figures.p99_ns].map(|ns| ns as f64 * 1e-3);
        let name = SEGMENTS[place].text.to_owned();
        (figures.n > 0).then_some(Stretch { name, p50_us, p99_us })
    };
    // Sums come after their parts.
    let whole = SEGMENTS.iter().position(|segment| segment.key == "sensor_to_gate");
    let parts = SEGMENTS.iter().position(|segment| segment.key == "gate_hold").unwrap_or(0);
    let stretches: Vec<_> = (0..parts).map(stretch).collect();
    let whole = whole.and_then(stretch);
    let title = titled("From sensor to motor", report);
    figure::waterfall(&title, &stretches, whole.as_ref())
}

/// A title that does not let times of lockstep pass for latencies.
fn titled(what: &str, report: &Report) -> String {
    if report.is_lockstep() { format!("{what}, in lockstep") } else { what.to_owned() }
}

/// Ways whose tails are drawn.
const TAILS: [&str; 4] =
    ["sensor_to_command", "sensor_to_gate", "attitude_compute", "estimator_compute"];

/// Their lengths, command by command \[us\].
#[derive(Debug, Default)]
pub(super) struct Tails([Vec<f64>; TAILS.len()]);

impl Tails {
    pub(super) fn add(&mut self, traced: &Traced) {
        let Ok(chain) = &traced.chain else { return };
        for (key, lengths) in TAILS.iter().zip(&mut self.0) {
            let segment = SEGMENTS.iter().find(|segment| segment.key == *key);
            let length_ns = segment.and_then(|segment| segment.of(chain));
            lengths.extend(length_ns.map(|ns| (ns as f64 * 1e-3).max(0.1)));
        }
    }

    pub(super) fn sorted(mut self) -> Self {
        for lengths in &mut self.0 {
            lengths.sort_by(f64::total_cmp);
        }
        self
    }
}

/// How many commands took longer than what.
fn tails(report: &Report) -> Figure {
    let x = Axis::log("longer than [us]");
    let mut panel = Drawn::new("", x, Axis::log("share of commands"));
    for ((key, lengths), colour) in TAILS.iter().zip(&report.tails.0).zip(Colour::SERIES) {
        let segment = SEGMENTS.iter().find(|segment| segment.key == *key);
        if let Some(segment) = segment.filter(|_| !lengths.is_empty()) {
            let curve = Curve::new(segment.text, colour, tail(lengths));
            panel = panel.curve(curve.mark(Mark::Hold(Dash::Solid)));
        }
    }
    Figure::new(titled("Tails", report), 1).panel_px(640.0, 300.0).panel(panel)
}

/// Of sorted lengths, the share that is at least as long: closer together towards the slowest.
fn tail(lengths: &[f64]) -> Vec<[f64; 2]> {
    let n = lengths.len();
    let mut places: Vec<usize> = (0..POINTS)
        .map(|i| {
            let share = libm::pow(n as f64, -(i as f64) / (POINTS - 1) as f64);
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "at most n"
            )]
            let longer = (share * n as f64).round() as usize;
            n - longer.clamp(1, n)
        })
        .collect();
    places.dedup();
    places.into_iter().map(|i| [lengths[i], (n - i) as f64 / n as f64]).collect()
}

#[cfg(test)]
mod tests {
    use super::tail;

    #[test]
    fn a_tail_begins_with_all_and_ends_with_the_slowest_alone() {
        let lengths: Vec<f64> = (1..=1000).map(f64::from).collect();
        let points = tail(&lengths);
        assert_eq!(points.first(), Some(&[1.0, 1.0]));
        assert_eq!(points.last(), Some(&[1000.0, 0.001]));
        assert!(points.windows(2).all(|pair| pair[0][0] < pair[1][0] && pair[0][1] > pair[1][1]));
        assert_eq!(tail(&[5.0]), [[5.0, 1.0]]);
    }
}
