//! A map of values over named rows and columns.

/// Values in cells, coloured by their size.
#[derive(Debug, Clone, PartialEq)]
pub struct HeatMap {
    /// Names along x.
    pub columns: Vec<String>,
    /// Names along y, from the bottom.
    pub rows: Vec<String>,
    /// Row by row from the bottom; a value that is not finite is drawn grey, without a number.
    pub values: Vec<Vec<f64>>,
    /// Decimals of the number written into each cell; none is written if `None`.
    pub decimals: Option<usize>,
    /// Colours.
    pub shade: Shade,
    /// A value along which cells are divided by a thick line: `stable` from `unstable`.
    pub divide: Option<f64>,
}

/// Colours of the cells of a map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shade {
    /// From white at the first value to a deep blue at the second; beyond them the end's colour.
    Rising(f64, f64),
    /// The same over the logarithm; both values positive.
    RisingLog(f64, f64),
    /// Blue below the first value, white at it, red above; full colour at this distance.
    Around(f64, f64),
}

impl Shade {
    /// Red, green and blue of `value`.
    pub(super) fn rgb(self, value: f64) -> [u8; 3] {
        const WHITE: [f64; 3] = [250.0, 250.0, 250.0];
        const BLUE: [f64; 3] = [86.0, 140.0, 200.0];
        const RED: [f64; 3] = [226.0, 110.0, 92.0];
        if !value.is_finite() {
            return [190, 190, 190];
        }
        let (end, part) = match self {
            Self::Rising(from, to) => (BLUE, (value - from) / (to - from)),
            Self::RisingLog(from, to) => {
                let part = libm::log(value.max(f64::MIN_POSITIVE) / from) / libm::log(to / from);
                (BLUE, part)
            }
            Self::Around(middle, distance) if value < middle => (BLUE, (middle - value) / distance),
            Self::Around(middle, distance) => (RED, (value - middle) / distance),
        };
        let part = if part.is_finite() { part.clamp(0.0, 1.0) } else { 0.0 };
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 250")]
        let channel = |i: usize| (WHITE[i] + (end[i] - WHITE[i]) * part).round() as u8;
        [channel(0), channel(1), channel(2)]
    }
}
