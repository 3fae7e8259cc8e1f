//! A browser for what is served.

use std::env;
use std::io::{self, Write as _};
use std::path::PathBuf;
use tempfile::NamedTempFile;

/// Opens an address where there is a screen; without one, "the browser" would be one in this terminal.
///
/// Where it does not open, that is said beside the results, which somebody else may be reading.
pub(super) fn open(address: &str) {
    if has_screen() && open::that_detached(address).is_err() {
        eprintln!("morphquad: no browser could be started; open the page yourself: {address}");
    }
}

/// As [`open`], for an address that no other user may see: a command line is read by all. The browser is given a file that
/// leads there and is its owner's alone. Keep it for as long as the address is served.
pub(super) fn open_privately(address: &str) -> Option<NamedTempFile> {
    if !has_screen() {
        return None;
    }
    let opened = leading_to(address).and_then(|file| {
        open::that_detached(file.path())?;
        Ok(file)
    });
    opened
        .inspect_err(|error| {
            eprintln!("morphquad: no browser could be started ({error}); open the page yourself");
        })
        .ok()
}

fn has_screen() -> bool {
    ["DISPLAY", "WAYLAND_DISPLAY"].iter().any(|name| env::var_os(name).is_some())
}

/// A page that leads to `address`, readable by this user alone.
fn leading_to(address: &str) -> io::Result<NamedTempFile> {
    let folder = env::var_os("XDG_RUNTIME_DIR").map_or_else(env::temp_dir, PathBuf::from);
    let mut file =
        tempfile::Builder::new().prefix("morphquad-").suffix(".html").tempfile_in(folder)?;
    let page = format!(
        "<!doctype html><meta charset=utf-8><meta name=referrer content=no-referrer>\
         <meta http-equiv=refresh content=\"0; url={address}\"><a href=\"{address}\">morphquad</a>\n"
    );
    file.write_all(page.as_bytes())?;
    Ok(file)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt as _;

    #[test]
    fn the_file_that_leads_to_a_page_is_its_owners_alone() {
        let address = "http://127.0.0.1:8000/#token=secret";
        let file = leading_to(address).unwrap();
        let path = file.path().to_owned();
        assert_eq!(file.as_file().metadata().unwrap().permissions().mode() & 0o777, 0o600);
        assert!(std::fs::read_to_string(&path).unwrap().contains(&format!("url={address}\"")));
        drop(file);
        assert!(!path.exists());
    }
}
