//! What was ordered in flight, and what the vehicle made of it.

use super::Response;
use super::pursuits::{Pursuits, SAME_S};
use crate::view::{Gathered, Kind};
use scenario::orders::OrderReport;
use serde::Serialize;

/// One order.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Ordered {
    /// When it was given, if the flight recorded it \[s\].
    pub asked_s: Option<f64>,
    /// From when on it shows \[s\].
    pub begins_s: f64,
    /// As text.
    pub order: String,
    /// When the vehicle was to be there, or the disturbance over \[s\].
    pub planned_s: Option<f64>,
    /// For people.
    pub came: String,
}

/// True if what happened is what was ordered: of orders that begin together each has its own end.
fn is_of(report: &OrderReport, happening: &str) -> bool {
    let kinds = [("go to", "goto"), ("heading", "goto"), ("deployable", "morph")];
    let kind = kinds.into_iter().find(|(happened, _)| happening.starts_with(happened));
    report.order.starts_with(kind.map_or("disturb", |(_, ordered)| ordered))
}

/// Everything that was ordered, in the order in which it began.
pub(super) fn ordered(
    gathered: &Gathered,
    pursuits: &Pursuits,
    responses: &[Response],
) -> Vec<Ordered> {
    let reports = gathered.closing.summary.get("orders");
    let reports: Vec<OrderReport> =
        reports.and_then(|text| serde_json::from_str(text).ok()).unwrap_or_default();
    let orders = gathered.happenings.iter().filter(|happening| happening.kind == Kind::Order);
    let orders = orders.map(|happening| {
        let begins_s = happening.at_s;
        let together = reports.iter().filter(|report| (report.begins_s - begins_s).abs() < SAME_S);
        let report = together.into_iter().find(|report| is_of(report, &happening.text));
        let response = || {
            responses
                .iter()
                .find(|r| r.what == happening.text && r.at_s.total_cmp(&begins_s).is_eq())
        };
        let came = pursuits.came(begins_s, &happening.text);
        let came = came.or_else(|| response().map(disturbed));
        Ordered {
            asked_s: report.map(|report| report.at_s),
            begins_s,
            order: happening.text.clone(),
            planned_s: report.and_then(|report| report.done_s),
            came: came.unwrap_or_else(|| "the file ends before it".to_owned()),
        }
    });
    orders.collect()
}

/// What a disturbance did.
fn disturbed(response: &Response) -> String {
    let Response { unit, before, peak, back_s, .. } = response;
    let back = match back_s {
        Some(s) => format!("back after {s:.3} s"),
        None => "not back in two seconds".to_owned(),
    };
    format!("error {before:.2} {unit} before, {peak:.2} {unit} at most, {back}")
}
