//! Figures as data, and their pictures as SVG, PNG or PDF.
//!
//! A [`Figure`] is a grid of [`Panel`]s with one legend beside it. This file and `heat.rs` define
//! what a figure is made of; `draw.rs` alone knows the plotting crate.
//!
//! ```
//! use figures::figure::{Axis, Colour, Curve, Dash, Figure, Level, Panel};
//!
//! let panel = Panel::new("roll", Axis::new("t [s]"), Axis::new("angle [rad]"))
//!     .curve(Curve::new("100 Hz", Colour::Blue, vec![[0.0, 0.0], [0.04, 0.2]]))
//!     .level(Level::new("setpoint", Colour::Black, Dash::Solid, 0.2));
//! let svg = Figure::new("A step", 1).panel(panel).to_svg();
//! assert!(svg.starts_with("<svg"));
//! ```

mod draw;
mod heat;
mod waterfall;

pub use heat::{HeatMap, Shade};
pub use waterfall::{Stretch, us, waterfall};

/// A grid of panels.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    /// Above everything.
    pub title: String,
    /// Panels in a row.
    pub columns: usize,
    /// Width and height of one panel \[px\].
    pub panel_px: [f64; 2],
    /// Row by row.
    pub panels: Vec<Panel>,
}

/// One pair of axes and what is drawn between them.
#[derive(Debug, Clone, PartialEq)]
pub struct Panel {
    /// Above the panel; may be empty.
    pub title: String,
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// Series over x.
    pub curves: Vec<Curve>,
    /// Horizontal lines across the panel.
    pub levels: Vec<Level>,
    /// Vertical lines across the panel, at x.
    pub instants: Vec<Level>,
    /// Filled intervals of x behind everything, from and to.
    pub spans: Vec<[f64; 2]>,
    /// Groups of bars; the x axis then names the groups.
    pub bars: Option<Bars>,
    /// A map of values; both axes then name cells.
    pub heat: Option<HeatMap>,
}

/// An axis: its label with the unit, and what of it is shown.
#[derive(Debug, Clone, PartialEq)]
pub struct Axis {
    /// Quantity and unit.
    pub label: String,
    /// From and to; what the data needs if `None`.
    pub range: Option<[f64; 2]>,
    /// Logarithmic.
    pub log: bool,
    /// Distance of the ticks; what fits if `None`.
    pub tick_step: Option<f64>,
    /// Written at 1, 2, ... instead of numbers; numbers if empty.
    pub names: Vec<String>,
}

/// Points joined by a line or shown as marks. A point that is not finite breaks the line.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// In the legend; none if empty. Curves of one name share one entry.
    pub name: String,
    /// Of line or mark.
    pub colour: Colour,
    /// How it is drawn.
    pub mark: Mark,
    /// x and y.
    pub points: Vec<[f64; 2]>,
}

/// How a curve is drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Mark {
    /// Straight between points.
    Line(Dash),
    /// Each y holds until the next x, as a held input does.
    Hold(Dash),
    /// Unjoined circles of this radius \[px\].
    Dots(f64),
    /// Unjoined crosses of this half width \[px\].
    Crosses(f64),
}

/// A line right across a panel.
#[derive(Debug, Clone, PartialEq)]
pub struct Level {
    /// In the legend; none if empty.
    pub name: String,
    /// Of the line.
    pub colour: Colour,
    /// Of the line.
    pub dash: Dash,
    /// Where, in units of the axis.
    pub at: f64,
}

/// Pattern of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Dash {
    /// ────
    Solid,
    /// ── ──
    Dashed,
    /// · · ·
    Dotted,
    /// ── · ──
    DashDot,
}

/// Colours that remain apart for colour-blind readers and in grey.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[allow(missing_docs, reason = "colours are their names")]
pub enum Colour {
    Black,
    Grey,
    Red,
    Blue,
    Green,
    Orange,
    Purple,
    Sky,
}

impl Colour {
    /// In the order to use them for series without a meaning of their own.
    pub const SERIES: [Self; 6] =
        [Self::Blue, Self::Red, Self::Green, Self::Orange, Self::Purple, Self::Sky];
}

/// Bars side by side in named groups.
#[derive(Debug, Clone, PartialEq)]
pub struct Bars {
    /// Name and colour of each bar of a group.
    pub series: Vec<(String, Colour)>,
    /// Name of each group and the height of its bars, in the order of `series`.
    pub groups: Vec<(String, Vec<f64>)>,
}

impl Figure {
    /// An empty figure.
    #[must_use]
    pub fn new(title: impl Into<String>, columns: usize) -> Self {
        Self { title: title.into(), columns, panel_px: [420.0, 280.0], panels: Vec::new() }
    }

    /// With panels of this width and height \[px\].
    #[must_use]
    pub fn panel_px(mut self, width: f64, height: f64) -> Self {
        self.panel_px = [width, height];
        self
    }

    /// With one more panel.
    #[must_use]
    pub fn panel(mut self, panel: Panel) -> Self {
        self.panels.push(panel);
        self
    }

    /// The picture; the same figure gives the same bytes.
    #[must_use]
    pub fn to_svg(&self) -> String {
        draw::svg(self)
    }

    /// The picture as a page of PDF, lines as lines and text as text.
    #[must_use]
    pub fn to_pdf(&self) -> Vec<u8> {
        draw::pdf(self)
    }

    /// The picture as PNG, twice as many points to an inch.
    ///
    /// # Errors
    /// The drawing crate's error.
    pub fn to_png(&self) -> Result<Vec<u8>, String> {
        draw::png(self)
    }
}

impl Panel {
    /// Empty axes.
    #[must_use]
    pub fn new(title: impl Into<String>, x: Axis, y: Axis) -> Self {
        Self {
            title: title.into(),
            x,
            y,
            curves: Vec::new(),
            levels: Vec::new(),
            instants: Vec::new(),
            spans: Vec::new(),
            bars: None,
            heat: None,
        }
    }

    /// With one more curve.
    #[must_use]
    pub fn curve(mut self, curve: Curve) -> Self {
        self.curves.push(curve);
        self
    }

    /// With one more horizontal line.
    #[must_use]
    pub fn level(mut self, level: Level) -> Self {
        self.levels.push(level);
        self
    }

    /// With the pair of lines ±`bound`, dashed.
    #[must_use]
    pub fn bounds(self, name: &str, colour: Colour, bound: f64) -> Self {
        self.level(Level::new(name, colour, Dash::Dashed, bound)).level(Level::new(
            name,
            colour,
            Dash::Dashed,
            -bound,
        ))
    }

    /// With one more vertical line.
    #[must_use]
    pub fn instant(mut self, instant: Level) -> Self {
        self.instants.push(instant);
        self
    }

    /// With x in `from..to` shaded.
    #[must_use]
    pub fn span(mut self, from: f64, to: f64) -> Self {
        self.spans.push([from, to]);
        self
    }

    /// With bars; the x axis names their groups.
    #[must_use]
    pub fn bars(mut self, bars: Bars) -> Self {
        self.bars = Some(bars);
        self
    }

    /// With a map of values; both axes name its cells.
    #[must_use]
    pub fn heat(mut self, heat: HeatMap) -> Self {
        self.heat = Some(heat);
        self
    }
}

impl Axis {
    /// A linear axis over what the data needs.
    #[must_use]
    pub fn new(label: impl Into<String>) -> Self {
        let (label, names) = (label.into(), Vec::new());
        Self { label, range: None, log: false, tick_step: None, names }
    }

    /// A logarithmic one: values must be positive.
    #[must_use]
    pub fn log(label: impl Into<String>) -> Self {
        Self { log: true, ..Self::new(label) }
    }

    /// Showing `from..=to`.
    #[must_use]
    pub fn range(mut self, from: f64, to: f64) -> Self {
        self.range = Some([from, to]);
        self
    }

    /// With names at 1, 2, ... and nothing between.
    #[must_use]
    pub fn named(mut self, names: Vec<String>) -> Self {
        self.range = Some([0.5, names.len() as f64 + 0.5]);
        self.names = names;
        self
    }

    /// With a tick at each multiple of `step`.
    #[must_use]
    pub fn ticks(mut self, step: f64) -> Self {
        self.tick_step = Some(step);
        self
    }
}

impl Curve {
    /// A solid line.
    #[must_use]
    pub fn new(name: impl Into<String>, colour: Colour, points: Vec<[f64; 2]>) -> Self {
        Self { name: name.into(), colour, mark: Mark::Line(Dash::Solid), points }
    }

    /// Drawn otherwise.
    #[must_use]
    pub fn mark(mut self, mark: Mark) -> Self {
        self.mark = mark;
        self
    }
}

impl Level {
    /// A line at `at`.
    #[must_use]
    pub fn new(name: impl Into<String>, colour: Colour, dash: Dash, at: f64) -> Self {
        Self { name: name.into(), colour, dash, at }
    }
}
