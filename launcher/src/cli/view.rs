//! `morphquad view`: a recording as a page.

use super::options::ViewArguments;
use super::refusal::{Done, Failure};
use crate::exit;
use crate::view::{Scene, ServeError, Server, page};
use core::sync::atomic::AtomicBool;
use signal_hook::consts::{SIGINT, SIGTERM};
use std::env;
use std::io::Write;
use std::sync::Arc;

/// Writes the page, or serves it.
pub(super) fn run(arguments: &ViewArguments, out: &mut dyn Write) -> Done {
    let unfit = |error: &dyn std::fmt::Display| Failure::plain(&error, exit::UNFIT);
    let flight = super::flown::open(&arguments.file)?;
    let busy = super::bar::busy("reading");
    let scene = Scene::read(&flight);
    drop(busy);
    let page = page(&scene.map_err(|error| unfit(&error))?);
    let megabytes = page.len() as f64 * 1e-6;
    if let Some(path) = &arguments.out {
        std::fs::write(path, page).map_err(|error| {
            let path = path.display();
            unfit(&format!("cannot write {path}: {error}; give --out a file that you may write"))
        })?;
        writeln!(out, "{} ({megabytes:.1} MB): open it in a browser", path.display())?;
        return Ok(exit::PASS);
    }
    let refused = |error: ServeError| Failure::plain(&error, exit::USAGE);
    let end = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        signal_hook::flag::register(signal, Arc::clone(&end))?;
    }
    let server = Server::open(arguments.port, page).map_err(refused)?;
    writeln!(out, "{} ({megabytes:.1} MB), until Ctrl-C", server.url())?;
    out.flush()?;
    // Without a screen, "the browser" would be one in this terminal.
    let has_screen = ["DISPLAY", "WAYLAND_DISPLAY"].iter().any(|name| env::var_os(name).is_some());
    if !arguments.no_open && has_screen && open::that_detached(server.url()).is_err() {
        writeln!(out, "no browser could be started: open the address yourself")?;
        out.flush()?;
    }
    server.serve(&end).map_err(|error| unfit(&error))?;
    Ok(exit::PASS)
}
