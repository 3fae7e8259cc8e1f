//! From a map of values to the plotting crate.

use kuva::prelude::{ColorMap, Heatmap, Layout, TextAnnotation, TickFormat};
use std::sync::Arc;

use super::plain;
use crate::figure::{HeatMap, Shade};

/// Names of the cells, and their numbers or the scale of their colours.
pub(super) fn mapped(layout: Layout, heat: &HeatMap) -> Layout {
    let layout = layout
        .with_x_categories(heat.columns.clone())
        .with_y_categories(heat.rows.clone())
        .with_show_grid(false);
    let mut layout = numbers(heat).into_iter().fold(layout, Layout::with_annotation);
    // Where each cell bears its number, the scale of the colours adds nothing.
    layout.show_colorbar = heat.decimals.is_none();
    if matches!(heat.shade, Shade::RisingLog(..)) {
        let power = |exponent: f64| plain(libm::pow(10.0, exponent));
        layout.colorbar_tick_format = TickFormat::Custom(Arc::new(power));
    }
    layout
}

pub(super) fn cells(heat: &HeatMap) -> Heatmap {
    let log = matches!(heat.shade, Shade::RisingLog(..));
    // The crate knows a missing value only as NaN, and no logarithmic scale.
    let position = |value: f64| match value {
        missing if !missing.is_finite() || (log && missing <= 0.0) => f64::NAN,
        value if log => libm::log10(value),
        value => value,
    };
    let data: Vec<Vec<f64>> =
        heat.values.iter().map(|row| row.iter().map(|value| position(*value)).collect()).collect();
    let (least, most) = data
        .iter()
        .flatten()
        .filter(|value| value.is_finite())
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), value| (a.min(*value), b.max(*value)));
    let shade = heat.shade;
    // The crate hands over the place between least and most.
    let colour = move |part: f64| {
        let at = least + part * (most - least);
        let [r, g, b] = shade.rgb(if log { libm::pow(10.0, at) } else { at });
        format!("#{r:02x}{g:02x}{b:02x}")
    };
    Heatmap::new()
        .with_data(data)
        .with_color_map(ColorMap::Custom(Arc::new(colour)))
        .with_cell_size(1.0)
}

/// The number in each cell, a little below its middle because a note stands above its point.
fn numbers(heat: &HeatMap) -> Vec<TextAnnotation> {
    let Some(decimals) = heat.decimals else { return Vec::new() };
    let mut notes = Vec::new();
    for (i, row) in heat.values.iter().enumerate() {
        for (j, value) in row.iter().enumerate().filter(|(_, value)| value.is_finite()) {
            let (x, y) = (j as f64 + 1.0, i as f64 + 0.88);
            notes.push(TextAnnotation::new(format!("{value:.decimals$}"), x, y).with_font_size(11));
        }
    }
    notes
}

/// The edges between cells on either side of `heat.divide`.
pub(super) fn divisions(heat: &HeatMap) -> Vec<[[f64; 2]; 2]> {
    let Some(limit) = heat.divide else { return Vec::new() };
    let above = |i: usize, j: usize| {
        heat.values.get(i).and_then(|row| row.get(j)).map(|value| value.is_nan() || *value > limit)
    };
    let differ = |a: Option<bool>, b: Option<bool>| a.is_some() && b.is_some() && a != b;
    let mut edges = Vec::new();
    for i in 0..heat.values.len() {
        for j in 0..heat.values[i].len() {
            let (right, top) = (j as f64 + 1.5, i as f64 + 1.5);
            if differ(above(i, j), above(i, j + 1)) {
                edges.push([[right, top - 1.0], [right, top]]);
            }
            if differ(above(i, j), above(i + 1, j)) {
                edges.push([[right - 1.0, top], [right, top]]);
            }
        }
    }
    edges
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_divide_the_cells_beyond_the_limit_from_the_others() {
        let map = HeatMap {
            columns: vec!["a".into(), "b".into()],
            rows: vec!["c".into(), "d".into()],
            values: vec![vec![1.0, f64::INFINITY], vec![1.0, 2.0]],
            decimals: None,
            shade: Shade::Rising(0.0, 1.0),
            divide: Some(5.0),
        };
        assert_eq!(divisions(&map), [[[1.5, 0.5], [1.5, 1.5]], [[1.5, 1.5], [2.5, 1.5]]]);
    }
}
