//! A page for people that needs nothing else: text, tables, pictures and the figures themselves.

use super::Table;
use crate::figure::Figure;
use core::fmt::Write as _;
use serde::Serialize;

/// Pictures are drawn for white paper. In the dark light and dark change places and hues stay.
const STYLE: &str = ":root{color-scheme:light dark}body{font:15px/1.5 system-ui,sans-serif;\
    max-width:1080px;margin:2em auto;padding:0 1em}pre{font:12px/1.35 ui-monospace,monospace;\
    background:color-mix(in srgb,currentColor 6%,transparent);padding:1em;overflow-x:auto}\
    figure{margin:1.5em 0;background:#fff;border-radius:6px;overflow-x:auto}\
    svg{max-width:100%;height:auto;display:block}table{border-collapse:collapse;font-size:13px}\
    div{overflow-x:auto}td,th{padding:2px 14px 2px 0;text-align:left;vertical-align:top;\
    font-variant-numeric:tabular-nums}th{font-weight:600;border-bottom:1px solid}\
    .good{color:#00845a}.bad{color:#c24f00}@media(prefers-color-scheme:dark){\
    body{background:#14171c;color:#e9ecf0}figure svg{filter:invert(.91) hue-rotate(180deg)}\
    figure{background:#171717}.good{color:#35cf9f}.bad{color:#f28046}}";

/// Grows from top to bottom.
#[derive(Debug, Clone)]
pub struct Document {
    title: String,
    body: String,
}

impl Document {
    /// With its title as the first heading.
    #[must_use]
    pub fn new(title: &str) -> Self {
        Self { title: escaped(title), body: String::new() }
    }

    fn with(mut self, text: core::fmt::Arguments<'_>) -> Self {
        // A string takes everything.
        let _ = self.body.write_fmt(text);
        self
    }

    /// Adds a heading.
    #[must_use]
    pub fn heading(self, text: &str) -> Self {
        self.with(format_args!("<h2>{}</h2>\n", escaped(text)))
    }

    /// Adds a heading below the last one.
    #[must_use]
    pub fn subheading(self, text: &str) -> Self {
        self.with(format_args!("<h3>{}</h3>\n", escaped(text)))
    }

    /// Adds a paragraph.
    #[must_use]
    pub fn paragraph(self, text: &str) -> Self {
        self.with(format_args!("<p>{}</p>\n", escaped(text)))
    }

    /// Adds the sentence that counts.
    #[must_use]
    pub fn verdict(self, is_good: bool, text: &str) -> Self {
        let class = if is_good { "good" } else { "bad" };
        self.with(format_args!("<p class=\"{class}\"><strong>{}</strong></p>\n", escaped(text)))
    }

    /// Adds text as it stands.
    #[must_use]
    pub fn text(self, text: &str) -> Self {
        self.with(format_args!("<pre>{}</pre>\n", escaped(text.trim_end())))
    }

    /// Adds a table.
    #[must_use]
    pub fn table(self, table: &Table) -> Self {
        let row = |cells: &[String], tag: &str| {
            let cells = cells.iter().map(|cell| format!("<{tag}>{}</{tag}>", escaped(cell)));
            format!("<tr>{}</tr>\n", cells.collect::<String>())
        };
        let head = row(&table.headings, "th");
        let rows: String = table.rows.iter().map(|cells| row(cells, "td")).collect();
        self.with(format_args!("<div><table>\n{head}{rows}</table></div>\n"))
    }

    /// Adds a picture.
    #[must_use]
    pub fn figure(self, figure: &Figure) -> Self {
        self.with(format_args!("<figure>{}</figure>\n", figure.to_svg()))
    }

    /// Adds figures for machines, which are not shown.
    #[must_use]
    pub fn json(self, id: &str, value: &impl Serialize) -> Self {
        let json = serde_json::to_string(value).unwrap_or_default();
        // Nothing in it may end the element.
        let json = json.replace('<', "\\u003c");
        self.with(format_args!("<script type=\"application/json\" id=\"{id}\">{json}</script>\n"))
    }

    /// The whole page.
    #[must_use]
    pub fn to_html(&self) -> String {
        let Self { title, body } = self;
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
             <meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\
             <title>{title}</title><style>{STYLE}</style></head><body>\n<h1>{title}</h1>\n\
             {body}</body></html>\n"
        )
    }
}

/// With its first letter large.
#[must_use]
pub fn capital(text: &str) -> String {
    let mut letters = text.chars();
    let first = letters.next().into_iter().flat_map(char::to_uppercase);
    first.chain(letters).collect()
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_text_on_the_page_and_figures_do_not_end_their_element() {
        let mut table = Table::new(["a > b"]);
        table.push(["1 < 2 && 3"]);
        let page = Document::new("x & y").table(&table).json("data", &"</script>").to_html();
        assert!(page.contains("<th>a &gt; b</th>"), "{page}");
        assert!(page.contains("<td>1 &lt; 2 &amp;&amp; 3</td>"), "{page}");
        assert!(page.contains("<h1>x &amp; y</h1>") && page.contains("\\u003c/script>"), "{page}");
        assert_eq!(page.matches("</script>").count(), 1);
    }
}
