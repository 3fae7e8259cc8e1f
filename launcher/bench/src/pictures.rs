//! Histogram and time line of each loop, and where the time goes between sensor and motor.

use super::loops::Measured;
use super::measure::{Chains, FIGURES, Moment, Steps};
use super::series::Series;
use figures::figure::{self, Axis, Colour, Curve, Dash, Figure, Mark, Panel, Stretch};

/// Bars of a histogram in a factor of ten.
const BARS_PER_DECADE: f64 = 20.0;
/// Points of a time line; of more steps the slowest in each stretch is shown.
const POINTS: usize = 1500;
/// Width and height of a panel \[px\].
const PANEL_PX: [f64; 2] = [560.0, 300.0];

/// Every picture of a measured flight, by name.
#[must_use]
pub fn pictures(measured: &Measured) -> Vec<(String, Figure)> {
    let loops =
        measured.steps.iter().map(|(name, steps)| (format!("loop-{name}"), of(name, steps)));
    let paths = measured.chains.iter().enumerate();
    let paths = paths
        .map(|(index, (name, chains))| (format!("path-{}", index + 1), waterfall(name, chains)));
    loops.chain(paths).collect()
}

fn of(name: &str, steps: &Steps) -> Figure {
    let [width, height] = PANEL_PX;
    Figure::new(name, 1)
        .panel_px(width, height)
        .panel(histogram(steps))
        .panel(time_line(&steps.moments))
}

/// How often what took how long, on logarithmic axes, so that one slow step shows beside a thousand.
fn histogram(steps: &Steps) -> Panel {
    let x = Axis::log("duration [us]");
    let mut panel = Panel::new("how often", x, Axis::log("steps"));
    for (figure, colour) in FIGURES.into_iter().zip(Colour::SERIES) {
        let points = steps.figure(figure).map(columns).unwrap_or_default();
        if !points.is_empty() {
            panel = panel.curve(Curve::new(figure, colour, points).mark(Mark::Hold(Dash::Solid)));
        }
    }
    panel
}

/// Corners of a histogram's columns: edge \[us\] and height. An empty column is half a step high, which
/// a logarithmic axis can show.
fn columns(series: &Series) -> Vec<[f64; 2]> {
    let column = |ns: u64| libm::floor(libm::log10((ns as f64 / 1e3).max(1e-3)) * BARS_PER_DECADE);
    let mut heights: Vec<(f64, u64)> = Vec::new();
    for (ns, count) in series.bins() {
        match heights.last_mut() {
            Some((last, height)) if last.to_bits() == column(ns).to_bits() => *height += count,
            _ => heights.push((column(ns), count)),
        }
    }
    let edge = |column: f64| libm::pow(10.0, column / BARS_PER_DECADE);
    let mut points = Vec::new();
    let mut next = None;
    for (column, height) in heights {
        if next.is_none_or(|next: f64| column > next) {
            points.extend(next.map(|next| [edge(next), 0.5]));
            points.push([edge(column), 0.5]);
        }
        points.push([edge(column), height as f64]);
        next = Some(column + 1.0);
    }
    points.extend(next.map(|next| [edge(next), 0.5]));
    points
}

fn time_line(moments: &[Moment]) -> Panel {
    let lateness = slowest(moments, |moment| moment.lateness_us);
    let compute = slowest(moments, |moment| moment.compute_us);
    Panel::new("step by step", Axis::new("t [s]"), Axis::log("[us]"))
        .curve(Curve::new("lateness", Colour::SERIES[0], lateness).mark(Mark::Dots(1.2)))
        .curve(Curve::new("compute", Colour::SERIES[5], compute).mark(Mark::Dots(1.2)))
}

/// The slowest step of each stretch.
fn slowest(moments: &[Moment], of: impl Fn(&Moment) -> f64) -> Vec<[f64; 2]> {
    let stretch = moments.len().div_ceil(POINTS).max(1);
    let stretches = moments.chunks(stretch).filter_map(|chunk| {
        let slow = chunk.iter().max_by(|a, b| of(a).total_cmp(&of(b)))?;
        Some([slow.t_s, of(slow).max(0.1)])
    });
    stretches.collect()
}

/// Links below one another.
fn waterfall(name: &str, chains: &Chains) -> Figure {
    let stretch = |name: &str, series: &Series| {
        let quantiles = series.quantiles()?;
        Some(Stretch { name: name.to_owned(), p50_us: quantiles.p50_us, p99_us: quantiles.p99_us })
    };
    let names = chains.names();
    let links = names.iter().enumerate().map(|(index, name)| stretch(name, &chains.link(index)));
    let links: Vec<_> = links.collect();
    figure::waterfall(name, &links, stretch(name, &chains.from_release()).as_ref())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_of_a_histogram_hold_every_value_and_gaps_are_empty() {
        let series: Series = [10_000, 10_000, 10_100, 500_000].into_iter().collect();
        let points = columns(&series);
        let heights: Vec<f64> = points.iter().map(|point| point[1]).collect();
        assert_eq!(heights, [0.5, 3.0, 0.5, 0.5, 1.0, 0.5]);
        assert!(points.windows(2).all(|pair| pair[0][0] <= pair[1][0]), "{points:?}");
        assert!(columns(&Series::default()).is_empty());
    }

    #[test]
    fn a_time_line_shows_the_slowest_step_of_every_stretch() {
        let moment = |k: u32| Moment {
            t_s: f64::from(k),
            lateness_us: if k == 7777 { 900.0 } else { 1.0 },
            compute_us: 1.0,
        };
        let moments: Vec<Moment> = (0..10_000).map(moment).collect();
        let points = slowest(&moments, |m| m.lateness_us);
        assert!(points.len() <= POINTS && points.contains(&[7777.0, 900.0]));
    }
}
