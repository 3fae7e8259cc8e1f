//! Page and flight in one file.

use super::Scene;

const FRAME: &str = include_str!("../../assets/view/page.html");
const STYLE: &str = include_str!("../../assets/view/style.css");
/// Small first: each uses what those before it declare.
const SCRIPTS: [&str; 6] = [
    include_str!("../../assets/view/data.js"),
    include_str!("../../assets/view/vehicle.js"),
    include_str!("../../assets/view/space.js"),
    include_str!("../../assets/view/plan.js"),
    include_str!("../../assets/view/chart.js"),
    include_str!("../../assets/view/main.js"),
];

/// An HTML document that shows a flight in any browser, with nothing else to load.
#[must_use]
pub fn page(scene: &Scene) -> String {
    // Within a script element only `<` could end it; in JSON it stands in strings alone.
    let flight = scene.to_json().to_string().replace('<', "\\u003c");
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
