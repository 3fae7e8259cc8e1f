//! From a figure to the plotting crate; no other module knows it.

mod dashes;
mod heat;
mod pdf;

use kuva::prelude::{
    BarPlot, Figure as Grid, Layout, LegendEntry, LegendShape, LinePlot, LineStyle, MarkerShape,
    Plot, PngBackend, ReferenceLine, ScatterPlot, ShadedRegion, SvgBackend, TickFormat,
};
use kuva::render::layout::ComputedLayout;
use std::fmt::Write as _;
use std::sync::Arc;

use super::{Axis, Bars, Colour, Curve, Dash, Figure, Level, Mark, Panel};

const LINE_PX: f64 = 1.6;
const BOUND_PX: f64 = 1.2;
const FONT: &str = "DejaVu Sans, Helvetica, Arial, sans-serif";

pub(super) fn svg(figure: &Figure) -> String {
    let drawn = SvgBackend::new().render_scene(&grid(figure).render());
    renumbered(&scalable(&drawn), &figure.title)
}

/// With its size as the extent of its coordinates: without, a page that is narrower cuts it off.
fn scalable(drawn: &str) -> String {
    let Some((head, rest)) = drawn.split_once('>') else { return drawn.to_owned() };
    let attribute = |name: &str| head.split_once(&format!(" {name}=\""))?.1.split('"').next();
    match (attribute("width"), attribute("height")) {
        (Some(width), Some(height)) if !head.contains("viewBox") => {
            format!("{head} viewBox=\"0 0 {width} {height}\">{rest}")
        }
        _ => drawn.to_owned(),
    }
}

pub(super) fn png(figure: &Figure) -> Result<Vec<u8>, String> {
    let mut scene = grid(figure).render();
    scene.elements = dashes::cut(scene.elements);
    PngBackend::new().render_scene(&scene)
}

pub(super) fn pdf(figure: &Figure) -> Vec<u8> {
    pdf::page(&grid(figure).render())
}

fn grid(figure: &Figure) -> Grid {
    let columns = figure.columns.max(1);
    let rows = figure.panels.len().div_ceil(columns).max(1);
    let [width, height] = figure.panel_px;
    let mut grid = Grid::new(rows, columns)
        .with_title(figure.title.clone())
        .with_title_size(18)
        .with_cell_size(width, height)
        .with_spacing(12.0)
        .with_plots(figure.panels.iter().map(plots).collect())
        .with_layouts(aligned(figure.panels.iter().map(layout).collect(), columns));
    let entries = legend(figure);
    if !entries.is_empty() {
        grid = grid.with_shared_legend_right_top().with_shared_legend_entries(entries);
    }
    grid
}

/// With the same room for labels on the left in all panels of a column, so that what happens at one instant stands at
/// one place in each.
fn aligned(mut layouts: Vec<Layout>, columns: usize) -> Vec<Layout> {
    for column in 0..columns {
        let margin = |layout: &Layout| ComputedLayout::from_layout(layout).margin_left;
        let widest = layouts.iter().skip(column).step_by(columns).map(margin).fold(0.0, f64::max);
        for layout in layouts.iter_mut().skip(column).step_by(columns) {
            layout.force_margin_left = Some(widest);
        }
    }
    layouts
}

/// The crate counts its clip paths through the whole process: here from 0 for each figure, and
/// with its title, so that several pictures can stand in one document.
fn renumbered(svg: &str, title: &str) -> String {
    const PREFIX: &str = "kuva-clip-";
    let name: String = title.chars().filter(char::is_ascii_alphanumeric).collect();
    let mut parts = svg.split(PREFIX);
    let mut text = parts.next().unwrap_or_default().to_owned();
    let mut seen: Vec<&str> = Vec::new();
    for part in parts {
        let digits = part.find(|c: char| !c.is_ascii_digit()).unwrap_or(part.len());
        let (number, rest) = part.split_at(digits);
        let place = seen.iter().position(|known| *known == number).unwrap_or_else(|| {
            seen.push(number);
            seen.len() - 1
        });
        // A string takes everything.
        let _ = write!(text, "clip-{name}-{place}{rest}");
    }
    text
}

fn layout(panel: &Panel) -> Layout {
    let (x, y) = extent(panel);
    let mut layout = Layout::new((x[0], x[1]), (y[0], y[1]))
        .with_x_label(panel.x.label.clone())
        .with_y_label(panel.y.label.clone())
        .with_font_family(FONT)
        .with_title_size(14)
        .with_label_size(13)
        .with_tick_size(11)
        .with_body_size(12)
        .with_grid_line_width(0.5)
        .with_box_axes()
        .with_ticks(5);
    if !panel.title.is_empty() {
        layout = layout.with_title(panel.title.clone());
    }
    layout = match (&panel.bars, &panel.heat) {
        (Some(bars), _) => {
            layout.with_x_categories(bars.groups.iter().map(|(name, _)| name.clone()).collect())
        }
        (None, Some(heat)) => heat::mapped(layout, heat),
        (None, None) => layout.with_x_axis_min(x[0]).with_x_axis_max(x[1]),
    };
    if panel.heat.is_none() {
        layout = layout.with_y_axis_min(y[0]).with_y_axis_max(y[1]);
    }
    lined(ticked(layout, panel), panel)
}

fn ticked(mut layout: Layout, panel: &Panel) -> Layout {
    if !panel.y.names.is_empty() {
        layout = layout.with_y_categories(panel.y.names.clone());
    }
    if let Some(step) = panel.x.tick_step {
        layout = layout.with_x_tick_step(step);
    }
    if let Some(step) = panel.y.tick_step {
        layout = layout.with_y_tick_step(step);
    }
    if panel.x.log {
        layout = layout.with_log_x().with_x_tick_format(TickFormat::Custom(Arc::new(plain)));
    }
    if panel.y.log {
        layout = layout.with_log_y().with_y_tick_format(TickFormat::Custom(Arc::new(plain)));
    }
    layout
}

/// Three digits without trailing zeros, so that 0.5, 1 and 2 agree.
fn plain(value: f64) -> String {
    let digits = libm::floor(libm::log10(value.abs().max(1e-300)));
    let unit = libm::pow(10.0, digits - 2.0);
    let rounded = (value / unit).round();
    // Dividing by a whole power is exact where multiplying by a fraction is not.
    let value = if digits < 2.0 { rounded / libm::pow(10.0, 2.0 - digits) } else { rounded * unit };
    if (1e-4..1e6).contains(&value.abs()) { format!("{value}") } else { format!("{value:e}") }
}

fn lined(mut layout: Layout, panel: &Panel) -> Layout {
    for [from, to] in &panel.spans {
        layout = layout.with_shaded_region(
            ShadedRegion::vertical(*from, *to).with_color("#999999").with_opacity(0.15),
        );
    }
    for level in &panel.levels {
        layout = layout.with_reference_line(line(ReferenceLine::horizontal(level.at), level));
    }
    for instant in &panel.instants {
        layout = layout.with_reference_line(line(ReferenceLine::vertical(instant.at), instant));
    }
    layout
}

fn line(line: ReferenceLine, level: &Level) -> ReferenceLine {
    let pattern = dasharray(level.dash).unwrap_or("none");
    line.with_color(hex(level.colour)).with_stroke_width(BOUND_PX).with_dasharray(pattern)
}

fn plots(panel: &Panel) -> Vec<Plot> {
    let mut plots = Vec::new();
    if let Some(heat) = &panel.heat {
        plots.push(Plot::Heatmap(heat::cells(heat)));
        plots.extend(
            heat::divisions(heat).into_iter().map(|edge| stroke(&edge, "black", None, 2.0)),
        );
    }
    if let Some(bars) = &panel.bars {
        plots.push(Plot::Bar(columns(bars)));
    }
    plots.extend(panel.curves.iter().flat_map(curve));
    if plots.is_empty() {
        // A panel without plots is not drawn at all, axes included.
        plots.push(stroke(&[], "black", None, LINE_PX));
    }
    plots
}

fn curve(curve: &Curve) -> Vec<Plot> {
    let colour = hex(curve.colour);
    let marks = |shape, size| {
        let points = curve.points.iter().filter(|point| finite(point)).map(|[x, y]| (*x, *y));
        let marks = ScatterPlot::new().with_data(points).with_color(colour).with_marker(shape);
        vec![Plot::Scatter(marks.with_size(size).with_marker_stroke_width(LINE_PX))]
    };
    let strokes = |dash, hold: bool| {
        let unbroken = curve.points.split(|point| !finite(point)).filter(|part| !part.is_empty());
        unbroken
            .map(|part| if hold { held(part) } else { part.to_vec() })
            .map(|part| stroke(&part, colour, dasharray(dash), LINE_PX))
            .collect()
    };
    match curve.mark {
        Mark::Line(dash) => strokes(dash, false),
        Mark::Hold(dash) => strokes(dash, true),
        Mark::Dots(size) => marks(MarkerShape::Circle, size),
        Mark::Crosses(size) => marks(MarkerShape::Cross, size),
    }
}

fn finite(point: &[f64; 2]) -> bool {
    point.iter().all(|value| value.is_finite())
}

/// The corners of a staircase through `points`.
fn held(points: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let risers = points.windows(2).flat_map(|pair| [[pair[1][0], pair[0][1]], pair[1]]);
    points.first().copied().into_iter().chain(risers).collect()
}

fn stroke(points: &[[f64; 2]], colour: &str, dash: Option<&str>, width: f64) -> Plot {
    let style = dash.map_or(LineStyle::Solid, |pattern| LineStyle::Custom(pattern.into()));
    let data = points.iter().map(|[x, y]| (*x, *y));
    let line = LinePlot::new().with_data(data).with_color(colour).with_stroke_width(width);
    Plot::Line(line.with_line_style(style))
}

fn columns(bars: &Bars) -> BarPlot {
    let colours = bars.series.iter().map(|(_, colour)| hex(*colour));
    bars.groups.iter().fold(BarPlot::new(), |plot, (name, heights)| {
        plot.with_group(
            name.clone(),
            heights.iter().copied().zip(colours.clone()).collect::<Vec<_>>(),
        )
    })
}

fn legend(figure: &Figure) -> Vec<LegendEntry> {
    let mut entries: Vec<LegendEntry> = Vec::new();
    let mut enter = |name: &str, colour, shape, dash: Option<Dash>| {
        if !name.is_empty() && entries.iter().all(|entry| entry.label != name) {
            let dasharray = dash.and_then(dasharray).map(Into::into);
            let color = hex(colour).to_owned();
            entries.push(LegendEntry { label: name.to_owned(), color, shape, dasharray });
        }
    };
    for panel in &figure.panels {
        for curve in &panel.curves {
            let (shape, dash) = match curve.mark {
                Mark::Line(dash) | Mark::Hold(dash) => (LegendShape::Line, Some(dash)),
                Mark::Dots(_) => (LegendShape::Circle, None),
                Mark::Crosses(_) => (LegendShape::Marker(MarkerShape::Cross), None),
            };
            enter(&curve.name, curve.colour, shape, dash);
        }
        for (name, colour) in panel.bars.iter().flat_map(|bars| &bars.series) {
            enter(name, *colour, LegendShape::Rect, None);
        }
        for level in panel.levels.iter().chain(&panel.instants) {
            enter(&level.name, level.colour, LegendShape::Line, Some(level.dash));
        }
    }
    entries
}

/// The palette of Okabe and Ito, which those who see no red or green can distinguish.
fn hex(colour: Colour) -> &'static str {
    match colour {
        Colour::Black => "#000000",
        Colour::Grey => "#7f7f7f",
        Colour::Red => "#d55e00",
        Colour::Blue => "#0072b2",
        Colour::Green => "#009e73",
        Colour::Orange => "#e69f00",
        Colour::Purple => "#cc79a7",
        Colour::Sky => "#56b4e9",
    }
}

fn dasharray(dash: Dash) -> Option<&'static str> {
    match dash {
        Dash::Solid => None,
        Dash::Dashed => Some("6 4"),
        Dash::Dotted => Some("1.5 3"),
        Dash::DashDot => Some("8 3 2 3"),
    }
}

/// What the axes show: x, then y.
fn extent(panel: &Panel) -> ([f64; 2], [f64; 2]) {
    if let Some(heat) = &panel.heat {
        return ([0.5, heat.columns.len() as f64 + 0.5], [0.5, heat.rows.len() as f64 + 0.5]);
    }
    let points = || panel.curves.iter().flat_map(|curve| &curve.points).filter(|p| finite(p));
    let xs = points().map(|point| point[0]).chain(panel.instants.iter().map(|i| i.at));
    let heights = panel.bars.iter().flat_map(|bars| &bars.groups).flat_map(|(_, heights)| heights);
    let floor = panel.bars.is_some().then_some(0.0);
    let ys = points()
        .map(|point| point[1])
        .chain(panel.levels.iter().map(|level| level.at))
        .chain(heights.copied())
        .chain(floor);
    // A line may end on the frame, half a mark may not.
    let joined = |curve: &Curve| matches!(curve.mark, Mark::Line(_) | Mark::Hold(_));
    let marked = !panel.curves.iter().all(joined);
    let x = panel.bars.as_ref().map_or_else(
        || shown(&panel.x, xs, if marked { 0.04 } else { 0.0 }),
        |bars| [0.5, bars.groups.len() as f64 + 0.5],
    );
    let mut y = shown(&panel.y, ys, 0.06);
    if let (Some(_), None) = (floor, panel.y.range) {
        y[0] = 0.0;
    }
    (x, y)
}

/// The range asked for, or that of the values and `margin` of it on both sides.
fn shown(axis: &Axis, values: impl Iterator<Item = f64>, margin: f64) -> [f64; 2] {
    if let Some(range) = axis.range {
        return range;
    }
    let usable = values.filter(|value| value.is_finite() && (!axis.log || *value > 0.0));
    let (least, most) = usable
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), value| (a.min(value), b.max(value)));
    if least > most {
        return if axis.log { [0.1, 10.0] } else { [0.0, 1.0] };
    }
    if axis.log {
        let factor = libm::pow(most / least, margin).max(1.0 + margin);
        return [least / factor, most * factor];
    }
    let pad = if most > least { (most - least) * margin } else { least.abs().max(1.0) * 0.5 };
    [least - pad, most + pad]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_of_a_logarithmic_axis_have_three_digits_at_most() {
        for (value, label) in
            [(0.5, "0.5"), (1.0, "1"), (2000.0, "2000"), (0.03, "0.03"), (0.1 + 0.2, "0.3")]
        {
            assert_eq!(plain(value), label);
        }
    }

    #[test]
    fn a_held_curve_is_a_staircase_and_a_gap_breaks_a_line() {
        let corners = held(&[[0.0, 1.0], [1.0, 2.0]]);
        assert_eq!(corners, [[0.0, 1.0], [1.0, 1.0], [1.0, 2.0]]);
        let points = vec![[0.0, 1.0], [1.0, 2.0], [2.0, f64::NAN], [3.0, 1.0]];
        assert_eq!(curve(&Curve::new("", Colour::Red, points)).len(), 2);
    }

    #[test]
    fn a_legend_names_each_thing_once() {
        let panel = || {
            Panel::new("", Axis::new("t [s]"), Axis::new("u"))
                .curve(Curve::new("ours", Colour::Blue, vec![[0.0, 1.0]]))
                .bounds("bound", Colour::Black, 2.0)
        };
        let entries = legend(&Figure::new("", 2).panel(panel()).panel(panel()));
        let names: Vec<&str> = entries.iter().map(|entry| entry.label.as_str()).collect();
        assert_eq!(names, ["ours", "bound"]);
    }

    #[test]
    fn the_same_figure_gives_the_same_svg_with_its_labels_in_it() {
        let panel = Panel::new("", Axis::log("rate [Hz]"), Axis::new("a < b")).curve(Curve::new(
            "ours",
            Colour::Blue,
            vec![[1.0, 1.0], [10.0, 2.0]],
        ));
        let figure = Figure::new("steps & peaks", 1).panel(panel);
        let text = svg(&figure);
        assert!(
            png(&figure).is_ok_and(|bytes| bytes.starts_with(b"\x89PNG") && bytes.len() > 1000)
        );
        assert!(text == svg(&figure) && text.contains("url(#clip-stepspeaks-0)"));
        for label in ["steps &amp; peaks", "a &lt; b", "ours", "rate [Hz]"] {
            assert!(text.contains(label), "{label}");
        }
    }

    #[test]
    fn a_figure_of_nothing_and_one_without_finite_values_are_drawn() {
        let empty = Panel::new("", Axis::new("x"), Axis::new("y"));
        let lost = empty.clone().curve(Curve::new("", Colour::Red, vec![[f64::NAN, f64::NAN]]));
        for figure in [Figure::new("", 0), Figure::new("", 1).panel(empty).panel(lost)] {
            let text = svg(&figure);
            assert!(text.ends_with("</svg>") && !text.contains("NaN"));
        }
    }
}
