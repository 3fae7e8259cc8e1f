//! Where time goes, stretch after stretch.

use super::{Axis, Colour, Curve, Dash, Figure, Level, Mark, Panel};

/// One stretch of a way, over many of them.
#[derive(Debug, Clone, PartialEq)]
pub struct Stretch {
    /// Beside it, or in the legend.
    pub name: String,
    /// Half take at most this \[µs\].
    pub p50_us: f64,
    /// 99 in 100 do \[µs\].
    pub p99_us: f64,
}

/// Microseconds with three digits that count.
#[must_use]
pub fn us(us: f64) -> String {
    let decimals = match us {
        us if us < 10.0 => 2,
        us if us < 100.0 => 1,
        _ => 0,
    };
    format!("{us:.decimals$}")
}

/// Stretches below one another: a box as long as the median from where the one above ends, and a line on to
/// the 99 %; `whole` is the way from end to end. A stretch that was not measured is left empty.
#[must_use]
pub fn waterfall(title: &str, stretches: &[Option<Stretch>], whole: Option<&Stretch>) -> Figure {
    let name = |stretch: &Option<Stretch>| {
        let text = |s: &Stretch| format!("{}: {} us", s.name, us(s.p50_us));
        stretch.as_ref().map_or_else(String::new, text)
    };
    // From bottom to top.
    let y = Axis::new("").named(stretches.iter().rev().map(name).collect());
    let rows = stretches.len() as f64;
    // Room beyond the 99 %; what is slower still would leave nothing to see of the rest.
    let far_us = whole.map_or(1.0, |whole| 1.1 * whole.p99_us.max(1.0));
    let x = Axis::new("from the release [us]").range(0.0, far_us);
    let mut panel = Panel::new("medians end to end; on to the 99 %", x, y);
    let mut from_us = 0.0;
    for (index, stretch) in stretches.iter().enumerate() {
        let Some(stretch) = stretch else { continue };
        let colour = Colour::SERIES[index % Colour::SERIES.len()];
        let middle = rows - index as f64;
        let (to_us, late_us) = (from_us + stretch.p50_us, (from_us + stretch.p99_us).min(far_us));
        // Filled, as far as lines can.
        for step in -8_i32..=8 {
            let y = middle + f64::from(step) * 0.04;
            panel = panel.curve(Curve::new("", colour, vec![[from_us, y], [to_us, y]]));
        }
        let tail = vec![[to_us, middle], [late_us, middle]];
        panel = panel.curve(Curve::new("", colour, tail).mark(Mark::Line(Dash::Dotted)));
        from_us = to_us;
    }
    if let Some(whole) = whole {
        for (name, at_us, dash) in
            [("p50", whole.p50_us, Dash::Solid), ("p99", whole.p99_us, Dash::Dashed)]
        {
            let label = format!("whole way {name}: {} us", us(at_us));
            panel = panel.instant(Level::new(label, Colour::Black, dash, at_us));
        }
    }
    Figure::new(title, 1).panel_px(640.0, 60.0 + 34.0 * rows).panel(panel)
}
