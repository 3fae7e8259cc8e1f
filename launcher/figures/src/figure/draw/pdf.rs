//! A drawing as one page of PDF, with lines as lines and text as text.
//!
//! The plotting crate has a way to PDF of its own, which needs 48 crates more. Text is in Helvetica, which every reader
//! of PDF has.

#![expect(clippy::cast_possible_truncation, reason = "coordinates of a page have single precision")]

use kuva::render::color::Color;
use kuva::render::render::{PathData, Primitive, Scene, TextAnchor};
use pdf_writer::{Content, Finish as _, Name, Pdf, Rect, Ref, Str};

/// Widths of the characters from blank to tilde, in thousandths of the size (Adobe Font Metrics of Helvetica).
const WIDTHS: [u16; 95] = [
    278, 278, 355, 556, 556, 889, 667, 191, 333, 333, 389, 584, 278, 333, 278, 278, 556, 556, 556,
    556, 556, 556, 556, 556, 556, 556, 278, 278, 584, 584, 584, 556, 1015, 667, 667, 722, 722, 667,
    611, 778, 722, 278, 500, 667, 556, 833, 722, 778, 667, 778, 722, 667, 611, 722, 667, 944, 667,
    667, 611, 278, 278, 278, 469, 556, 333, 556, 556, 500, 556, 556, 278, 556, 556, 222, 222, 500,
    222, 833, 556, 556, 556, 556, 333, 500, 278, 556, 500, 722, 500, 500, 500, 334, 260, 334, 584,
];

const FONT: Name<'static> = Name(b"F");

/// Half the length of a control line by which a cubic curve is a quarter of a circle.
const QUARTER: f64 = 0.552_284_749_8;

/// The page; a unit of the drawing is a point.
pub(super) fn page(scene: &Scene) -> Vec<u8> {
    let [catalog, pages, page, font, content] = [1, 2, 3, 4, 5].map(Ref::new);
    let mut pdf = Pdf::new();
    pdf.catalog(catalog).pages(pages);
    pdf.pages(pages).kids([page]).count(1);
    let mut leaf = pdf.page(page);
    leaf.media_box(Rect::new(0.0, 0.0, scene.width as f32, scene.height as f32));
    leaf.parent(pages).contents(content);
    leaf.resources().fonts().pair(FONT, font);
    leaf.finish();
    let mut helvetica = pdf.type1_font(font);
    helvetica.base_font(Name(b"Helvetica")).encoding_predefined(Name(b"WinAnsiEncoding"));
    helvetica.finish();
    let mut sheet = Sheet(Content::new());
    // A drawing counts downwards.
    sheet.0.transform([1.0, 0.0, 0.0, -1.0, 0.0, scene.height as f32]);
    if let Some(background) = &scene.background_color {
        let (width, height) = (scene.width, scene.height);
        let fill = Paint::of(&Color::from(background.as_str()), None);
        sheet.shape(fill, None, |content| rectangle(content, [0.0, 0.0, width, height]));
    }
    for element in &scene.elements {
        sheet.draw(element);
    }
    pdf.stream(content, &sheet.0.finish());
    pdf.finish()
}

/// Red, green and blue, from 0 to 1.
#[derive(Clone, Copy)]
struct Paint([f32; 3]);

impl Paint {
    /// None for what is not painted. What shines through is mixed with white, the colour of the page.
    fn of(color: &Color, opacity: Option<f64>) -> Option<Self> {
        let Color::Rgb(red, green, blue) = *color else { return None };
        let opacity = opacity.unwrap_or(1.0).clamp(0.0, 1.0) as f32;
        Some(Self([red, green, blue].map(|value| 1.0 - opacity * (1.0 - f32::from(value) / 255.0))))
    }
}

/// A line: its colour, width and pattern.
struct Pen<'a> {
    paint: Paint,
    width: f64,
    dashes: Option<&'a str>,
}

impl<'a> Pen<'a> {
    fn new(
        color: &Color,
        width: f64,
        dashes: Option<&'a str>,
        opacity: Option<f64>,
    ) -> Option<Self> {
        Some(Self { paint: Paint::of(color, opacity)?, width, dashes })
    }
}

struct Sheet(Content);

impl Sheet {
    fn draw(&mut self, element: &Primitive) {
        match element {
            Primitive::GroupStart { transform, .. } => {
                let by = transform.as_deref().map_or([0.0; 2], translation);
                self.0.save_state().transform([1.0, 0.0, 0.0, 1.0, by[0], by[1]]);
            }
            Primitive::ClipStart { x, y, width, height, .. } => {
                self.0.save_state();
                rectangle(&mut self.0, [*x, *y, *width, *height]);
                self.0.clip_nonzero().end_path();
            }
            Primitive::GroupEnd | Primitive::ClipEnd => {
                self.0.restore_state();
            }
            Primitive::Text { x, y, content, size, anchor, rotate, color, .. } => {
                let text =
                    Text { at: [*x, *y], size: *size, anchor: *anchor, color: color.as_ref() };
                self.text(&text, content, rotate.unwrap_or(0.0));
            }
            Primitive::RichText { x, y, spans, size, anchor, color } => {
                let content: String = spans.iter().map(|span| span.text.as_str()).collect();
                let text =
                    Text { at: [*x, *y], size: *size, anchor: *anchor, color: color.as_ref() };
                self.text(&text, &content, 0.0);
            }
            Primitive::Line { x1, y1, x2, y2, stroke, stroke_width, stroke_dasharray } => {
                let pen = Pen::new(stroke, *stroke_width, stroke_dasharray.as_deref(), None);
                self.shape(None, pen, |content| along(content, [(*x1, *y1), (*x2, *y2)].iter()));
            }
            Primitive::PolyLine { points, stroke, stroke_width, stroke_dasharray } => {
                let pen = Pen::new(stroke, *stroke_width, stroke_dasharray.as_deref(), None);
                self.shape(None, pen, |content| along(content, points.iter()));
            }
            area => self.area(area),
        }
    }

    /// What may be filled.
    fn area(&mut self, element: &Primitive) {
        match element {
            Primitive::Path(path) => {
                let PathData { d, fill, stroke, stroke_width, opacity, stroke_dasharray } = &**path;
                let fill = fill.as_ref().and_then(|fill| Paint::of(fill, *opacity));
                let pen = Pen::new(stroke, *stroke_width, stroke_dasharray.as_deref(), *opacity);
                self.shape(fill, pen, |content| commands(content, d));
            }
            Primitive::Rect { x, y, width, height, fill, stroke, stroke_width, opacity } => {
                let stroke = stroke.as_ref();
                let pen = stroke.and_then(|s| Pen::new(s, stroke_width.unwrap_or(1.0), None, None));
                let area = [*x, *y, *width, *height];
                self.shape(Paint::of(fill, *opacity), pen, |content| rectangle(content, area));
            }
            Primitive::RectBatch { x, y, w, h, fills } => {
                for (i, fill) in fills.iter().enumerate() {
                    let area = [x[i], y[i], w[i], h[i]];
                    self.shape(Paint::of(fill, None), None, |content| rectangle(content, area));
                }
            }
            Primitive::Circle { cx, cy, r, fill, fill_opacity, stroke, stroke_width } => {
                let stroke = (stroke.as_ref(), *stroke_width);
                self.circle([*cx, *cy], *r, (fill, *fill_opacity), stroke);
            }
            Primitive::CircleBatch { cx, cy, r, fill, fill_opacity, stroke, stroke_width } => {
                for (x, y) in cx.iter().zip(cy) {
                    let stroke = (stroke.as_ref(), *stroke_width);
                    self.circle([*x, *y], *r, (fill, *fill_opacity), stroke);
                }
            }
            _ => {}
        }
    }

    /// Fills and strokes what `path` leads along.
    fn shape(
        &mut self,
        fill: Option<Paint>,
        pen: Option<Pen<'_>>,
        path: impl FnOnce(&mut Content),
    ) {
        let content = &mut self.0;
        if let Some(Paint([red, green, blue])) = fill {
            content.set_fill_rgb(red, green, blue);
        }
        if let Some(Pen { paint: Paint([red, green, blue]), width, dashes }) = &pen {
            content.set_stroke_rgb(*red, *green, *blue).set_line_width(*width as f32);
            let dashes = dashes.unwrap_or_default().split([',', ' ']);
            content.set_dash_pattern(dashes.filter_map(|length| length.parse().ok()), 0.0);
        }
        path(content);
        match (fill, pen) {
            (Some(_), Some(_)) => content.fill_nonzero_and_stroke(),
            (Some(_), None) => content.fill_nonzero(),
            (None, Some(_)) => content.stroke(),
            (None, None) => content.end_path(),
        };
    }

    fn circle(
        &mut self,
        [x, y]: [f64; 2],
        r: f64,
        (fill, opacity): (&Color, Option<f64>),
        (stroke, width): (Option<&Color>, Option<f64>),
    ) {
        let pen = stroke.and_then(|stroke| Pen::new(stroke, width.unwrap_or(1.0), None, None));
        self.shape(Paint::of(fill, opacity), pen, |content| {
            content.move_to((x + r) as f32, y as f32);
            for [cos, sin] in [[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]] {
                // A quarter from (cos, sin) to (-sin, cos).
                let at = |a: f64, b: f64| {
                    ((x + r * (a * cos - b * sin)) as f32, (y + r * (a * sin + b * cos)) as f32)
                };
                let ((x1, y1), (x2, y2), (x3, y3)) =
                    (at(1.0, QUARTER), at(QUARTER, 1.0), at(0.0, 1.0));
                content.cubic_to(x1, y1, x2, y2, x3, y3);
            }
            content.close_path();
        });
    }

    fn text(&mut self, text: &Text<'_>, content: &str, turned_deg: f64) {
        let &Text { at: [x, y], size, anchor, color } = text;
        let bytes: Vec<u8> = content.chars().map(byte).collect();
        let width = |byte: &u8| {
            let place = usize::from(*byte).wrapping_sub(32);
            f64::from(WIDTHS.get(place).copied().unwrap_or(556))
        };
        let length = bytes.iter().map(width).sum::<f64>() * f64::from(size) / 1000.0;
        let before = match anchor {
            TextAnchor::Start => 0.0,
            TextAnchor::Middle => 0.5 * length,
            TextAnchor::End => length,
        };
        let (sin, cos) = libm::sincos(turned_deg.to_radians());
        let place = [cos, sin, sin, -cos, x - cos * before, y - sin * before].map(|v| v as f32);
        let Paint([red, green, blue]) =
            color.and_then(|color| Paint::of(color, None)).unwrap_or(Paint([0.0; 3]));
        self.0.set_fill_rgb(red, green, blue).begin_text();
        self.0.set_font(FONT, f64::from(size) as f32).set_text_matrix(place);
        self.0.show(Str(&bytes)).end_text();
    }
}

/// How a text stands.
struct Text<'a> {
    at: [f64; 2],
    size: u32,
    anchor: TextAnchor,
    color: Option<&'a Color>,
}

/// A character as the font has it.
fn byte(character: char) -> u8 {
    match character {
        '\u{2212}' => b'-',
        '\u{2013}' => 0x96,
        '\u{2014}' => 0x97,
        '\u{2026}' => 0x85,
        '\u{80}'..='\u{9f}' => b'?',
        _ => u8::try_from(u32::from(character)).unwrap_or(b'?'),
    }
}

fn rectangle(content: &mut Content, area: [f64; 4]) {
    let [x, y, width, height] = area.map(|value| value as f32);
    content.rect(x, y, width, height);
}

fn along<'a>(content: &mut Content, points: impl Iterator<Item = &'a (f64, f64)>) {
    for (place, (x, y)) in points.enumerate() {
        if place == 0 {
            content.move_to(*x as f32, *y as f32);
        } else {
            content.line_to(*x as f32, *y as f32);
        }
    }
}

/// A path in the commands of SVG, with absolute places: what the plotting crate draws lines and areas with.
fn commands(content: &mut Content, path: &str) {
    let is_command = |c: char| c.is_ascii_alphabetic() && c != 'e';
    let mut rest = path;
    while let Some(at) = rest.find(is_command) {
        let command = rest.as_bytes()[at];
        let end = rest[at + 1..].find(is_command).map_or(rest.len(), |next| at + 1 + next);
        let numbers = rest[at + 1..end].split([' ', ',']).filter_map(|number| number.parse().ok());
        let numbers: Vec<f32> = numbers.collect();
        match (command, &numbers[..]) {
            (b'Z' | b'z', _) => drop(content.close_path()),
            (b'C', numbers) => {
                for curve in numbers.chunks_exact(6) {
                    content.cubic_to(curve[0], curve[1], curve[2], curve[3], curve[4], curve[5]);
                }
            }
            (_, numbers) => {
                for (place, to) in numbers.chunks_exact(2).enumerate() {
                    let begins = command == b'M' && place == 0;
                    if begins {
                        content.move_to(to[0], to[1])
                    } else {
                        content.line_to(to[0], to[1])
                    };
                }
            }
        }
        rest = &rest[end..];
    }
}

/// Of `translate(x, y)`.
fn translation(transform: &str) -> [f32; 2] {
    let inside = transform.strip_prefix("translate(").and_then(|rest| rest.split_once(')'));
    let mut numbers = inside.map_or("", |(numbers, _)| numbers).split([',', ' ']);
    let mut next = || numbers.by_ref().find_map(|number| number.parse().ok()).unwrap_or(0.0);
    [next(), next()]
}
