//! Page and flight in one file.

use super::Scene;
use serde_json::Value;

const FRAME: &str = include_str!("../../assets/page.html");
const STYLE: &str = include_str!("../../assets/style.css");
/// Small first: each uses what those before it declare.
const SCRIPTS: [&str; 11] = [
    include_str!("../../assets/data.js"),
    include_str!("../../assets/vehicle.js"),
    include_str!("../../assets/space.js"),
    include_str!("../../assets/plan.js"),
    include_str!("../../assets/chart.js"),
    include_str!("../../assets/lists.js"),
    include_str!("../../assets/player.js"),
    include_str!("../../assets/live.js"),
    include_str!("../../assets/control.js"),
    include_str!("../../assets/demo.js"),
    include_str!("../../assets/main.js"),
];

/// An HTML document that shows a flight in any browser, with nothing else to load.
#[must_use]
pub fn page(scene: &Scene) -> String {
    document(scene.to_json())
}

/// The same document for a running flight, which asks its server for what comes.
pub(crate) fn live_page(flight: &Value) -> String {
    document(flight).replacen("connect-src 'none'", "connect-src 'self'", 1)
}

fn document(flight: &Value) -> String {
    // Within a script element only `<` could end it; in JSON it stands in strings alone.
    let flight = flight.to_string().replace('<', "\\u003c");
    let script = SCRIPTS.concat();
    let mut document =
        String::with_capacity(FRAME.len() + STYLE.len() + script.len() + flight.len());
    for part in FRAME.split_inclusive("-->") {
        match part.split_once("<!--") {
            Some((before, "style-->")) => document.extend([before, STYLE]),
            Some((before, "script-->")) => document.extend([before, &script]),
            Some((before, "flight-->")) => document.extend([before, &flight]),
            _ => document.push_str(part),
        }
    }
    document
}
