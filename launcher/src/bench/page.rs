//! A measured flight as one page that needs nothing else: tables, pictures and the figures themselves.

use super::loops::Measured;
use super::pictures;
use core::fmt::Write as _;

const STYLE: &str = "body{font:15px/1.5 system-ui,sans-serif;max-width:1000px;margin:2em auto;\
    padding:0 1em;color:#222}pre{font:12px/1.35 ui-monospace,monospace;background:#f6f6f6;\
    padding:1em;overflow-x:auto}figure{margin:2em 0}svg{max-width:100%;height:auto}";

/// The page.
#[must_use]
pub fn page(measured: &Measured) -> String {
    let report = &measured.report;
    let title = format!("morphquad bench loops: {}", report.terms.scenario);
    let mut page = format!(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>{0}</title>\
         <style>{STYLE}</style></head><body>\n<h1>{0}</h1>\n<pre>{1}</pre>\n",
        escaped(&title),
        escaped(report.to_text().trim_end())
    );
    for (_, figure) in pictures::pictures(measured) {
        // A string takes everything.
        let _ = writeln!(page, "<figure>{}</figure>", figure.to_svg());
    }
    let json = serde_json::to_string(report).unwrap_or_default();
    // Nothing in it may end the element.
    let json = json.replace('<', "\\u003c");
    let _ = write!(
        page,
        "<script type=\"application/json\" id=\"report\">{json}</script>\n</body></html>\n"
    );
    page
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use super::escaped;

    #[test]
    fn text_is_text_on_the_page() {
        assert_eq!(escaped("a < b && c > d"), "a &lt; b &amp;&amp; c &gt; d");
    }
}
