//! A browser for what is served.

use std::env;

/// Opens an address where there is a screen; without one, "the browser" would be one in this terminal.
///
/// Where it does not open, that is said beside the results, which somebody else may be reading.
pub(super) fn open(url: &str) {
    let has_screen = ["DISPLAY", "WAYLAND_DISPLAY"].iter().any(|name| env::var_os(name).is_some());
    if has_screen && open::that_detached(url).is_err() {
        eprintln!("morphquad: no browser could be started; open the page yourself: {url}");
    }
}
