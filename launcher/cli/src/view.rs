//! `morphquad view`: a recording as a page.

use super::keep_safe::write_page;
use super::options::ViewArguments;
use super::refusal::{Done, Failure};
use super::{browser, flown};
use core::sync::atomic::AtomicBool;
use host::exit;
use signal_hook::consts::{SIGINT, SIGTERM};
use std::io::Write;
use std::sync::Arc;
use viewers::view::{Scene, ServeError, Server, page};

/// Writes the page, or serves it.
pub(super) fn run(
    arguments: &ViewArguments,
    out: &mut dyn Write,
    diagnostics: &mut dyn Write,
) -> Done {
    let flight = flown::open(&flown::named_or_latest(arguments.file.as_deref(), diagnostics)?)?;
    let busy = super::bar::busy("reading");
    let scene = Scene::read(&flight);
    drop(busy);
    let page = page(&scene.map_err(|error| flown::unreadable(&error))?);
    let megabytes = page.len() as f64 * 1e-6;
    if let Some(path) = &arguments.out {
        write_page(path, page, "--out")?;
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
    if !arguments.no_open {
        browser::open(&server.url(), &server.url());
    }
    server.serve(&end);
    Ok(exit::PASS)
}
