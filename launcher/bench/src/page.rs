//! A measured flight as one page that needs nothing else: tables, pictures and the figures themselves.

use super::loops::Measured;
use super::pictures;
use figures::results::Document;

#[must_use]
pub fn page(measured: &Measured) -> String {
    let report = &measured.report;
    let title = format!("morphquad bench loops: {}", report.terms.scenario);
    let page = Document::new(&title).text(&report.to_text());
    let pictures = pictures::pictures(measured);
    let page = pictures.iter().fold(page, |page, (_, figure)| page.figure(figure));
    page.json("report", report).to_html()
}
