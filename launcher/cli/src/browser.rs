//! A browser for what is served.

use std::env;

/// Opens `address` where there is a screen; without one, "the browser" would be one in this terminal. All users can read
/// the browser's command line: an address with a secret is not for it, but may be `printed`.
///
/// Where it does not open, that is said beside the results, which somebody else may be reading.
pub(super) fn open(address: &str, printed: &str) {
    let has_screen = ["DISPLAY", "WAYLAND_DISPLAY"].iter().any(|name| env::var_os(name).is_some());
    if has_screen && open::that_detached(address).is_err() {
        eprintln!("morphquad: no browser could be started; open the page yourself: {printed}");
    }
}
