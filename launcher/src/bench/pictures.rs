//! Histogram and time line of each loop, and where the time goes between sensor and motor.

use super::loops::Measured;
use super::measure::{Chains, FIGURES, Moment, Steps};
use super::series::{Rank, Series};
use crate::figure::{Axis, Colour, Curve, Dash, Figure, Level, Mark, Panel};

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

/// Links below one another: a box as long as the median from where the one above ends, and a line on to
/// the 99 %.
fn waterfall(name: &str, chains: &Chains) -> Figure {
    let names = chains.names();
    let rows = names.len() as f64;
    let y = Axis::new("").range(0.0, rows).ticks(rows.max(1.0));
    let whole = chains.from_release().quantiles();
    // Room beyond the 99 %; what is slower still would leave nothing to see of the rest.
    let far_us = whole.map_or(1.0, |whole| 1.1 * whole.p99_us.max(1.0));
    let x = Axis::new("from the release [us]").range(0.0, far_us);
    let mut panel = Panel::new("medians end to end; on to the 99 %", x, y);
    let mut from_us = 0.0;
    for (index, name) in names.iter().enumerate() {
        let Some(told) = chains.link(index).quantiles() else { continue };
        let colour = Colour::SERIES[index % Colour::SERIES.len()];
        let middle = rows - index as f64 - 0.5;
        let (to_us, late_us) = (from_us + told.p50_us, (from_us + told.p99_us).min(far_us));
        // Filled, as far as lines can.
        for step in -8_i32..=8 {
            let y = middle + f64::from(step) * 0.04;
            let label = if step == 0 {
                format!("{name}: {} us", super::us(told.p50_us))
            } else {
                String::new()
            };
            panel = panel.curve(Curve::new(label, colour, vec![[from_us, y], [to_us, y]]));
        }
        let tail = vec![[to_us, middle], [late_us, middle]];
        panel = panel.curve(Curve::new("", colour, tail).mark(Mark::Line(Dash::Dotted)));
        from_us = to_us;
    }
    if let Some(told) = whole {
        for (rank, dash) in [(Rank::P50, Dash::Solid), (Rank::P99, Dash::Dashed)] {
            let label = format!("whole way {}: {} us", rank.label(), super::us(told.at(rank)));
            panel = panel.instant(Level::new(label, Colour::Black, dash, told.at(rank)));
        }
    }
    Figure::new(name, 1).panel_px(640.0, 60.0 + 34.0 * rows).panel(panel)
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
