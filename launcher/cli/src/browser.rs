//! A browser for what is served.

use std::env;

/// Opens `address` where there is a screen; without one, "the browser" would be one in this terminal.
///
/// Where it does not open, `printed` is shown beside the results, which another program may be reading. It may hold a
/// token, `address` may not: all users can read the browser's command line.
pub(super) fn open(address: &str, printed: &str) {
    let has_screen = ["DISPLAY", "WAYLAND_DISPLAY"].iter().any(|name| env::var_os(name).is_some());
    if has_screen && open::that_detached(address).is_err() {
        eprintln!("morphquad: no browser could be started; open the page yourself: {printed}");
    }
}
