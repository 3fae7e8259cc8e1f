//! `morphquad live`: a running flight, for viewers.

use super::browser;
use super::options::LiveArguments;
use super::ps::Trouble;
use super::refusal::{Done, Failure};
use core::sync::atomic::{AtomicBool, Ordering};
use host::{exit, name_thread};
use protocol::control::runs;
use scenario::process::OWN_EXECUTABLE;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use std::io::{self, Write};
use std::os::unix::process::CommandExt as _;
use std::process::Command;
use std::sync::Arc;
use viewers::live::{Listen, LiveError, LiveServer, Place};

/// How far it stands back for the flight.
const NICE: i32 = 10;

/// Names the place of a server to the process that replaces it, after the process's id, which stays: what another
/// process has left is ignored. Only this user and root can read it.
const PLACE: &str = "MORPHQUAD_LIVE_PLACE";

/// Serves until the run is over.
pub(super) fn run(arguments: &LiveArguments, out: &mut dyn Write) -> Done {
    // As `run --live` calls it, however the process was started.
    name_thread("morphquad-live");
    let place = place_before();
    if place.is_none() {
        stand_back(arguments.away_from);
    }
    let wanted = place.as_ref().map(Place::run).or(arguments.run.run.as_deref());
    let run = runs::find(wanted).map_err(|error| {
        let trouble = Trouble::from(error);
        let code = trouble.exit_code();
        Failure::report(trouble, code)
    })?;
    let end = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM, SIGHUP] {
        signal_hook::flag::register(signal, Arc::clone(&end))?;
    }
    let refused = |error: LiveError| {
        let code = match error {
            LiveError::Address { .. } => exit::USAGE,
            _ => exit::UNFIT,
        };
        Failure::plain(&error, code)
    };
    let rate_hz = (!arguments.every_sample).then_some(arguments.rate);
    let is_first = place.is_none();
    let at = place.map_or(Listen::At(arguments.listen), Listen::Again);
    let server = LiveServer::open(run, &at, rate_hz, arguments.demo.as_deref()).map_err(refused)?;
    if is_first {
        announce(&server, arguments, out)?;
    }
    match server.serve(&end).map_err(refused)? {
        None => Ok(exit::PASS),
        Some(server) => restart(&server.place(), &end),
    }
}

/// Prints where it listens, and opens the page.
fn announce(server: &LiveServer, arguments: &LiveArguments, out: &mut dyn Write) -> io::Result<()> {
    if !arguments.listen.ip().is_loopback() {
        let warning = "all who reach this address can watch; only its token allows orders";
        eprintln!("morphquad: {warning}");
        for url in server.urls_elsewhere() {
            eprintln!("morphquad: on other machines  {url}");
        }
    }
    writeln!(out, "live  {}", server.page_url())?;
    writeln!(out, "live  {} (Foxglove WebSocket)", server.socket_url())?;
    out.flush()?;
    if !arguments.no_open {
        browser::open(&server.open_url(), &server.page_url());
    }
    Ok(())
}

/// The place of the server that this process had before it was replaced.
fn place_before() -> Option<Place> {
    let value = std::env::var(PLACE).ok()?;
    let (pid, place) = value.split_once(' ')?;
    Place::parse(place).filter(|_| pid == std::process::id().to_string())
}

/// Replaces this process by one that serves in the same place, unless it has been asked to end.
fn restart(place: &Place, end: &AtomicBool) -> Done {
    let reason =
        "a viewer that sends without reading has filled the memory of `live`, which restarts";
    eprintln!("morphquad: {reason}: viewers have to connect again");
    let mut arguments = std::env::args_os();
    let mut command = Command::new(OWN_EXECUTABLE);
    command.arg0(arguments.next().unwrap_or_default()).args(arguments);
    command.env(PLACE, format!("{} {place}", std::process::id()));
    if end.load(Ordering::Relaxed) {
        return Ok(exit::PASS);
    }
    let error = LiveError::System { action: "restart", cause: command.exec() };
    Err(Failure::plain(&error, exit::UNFIT))
}

/// Makes room for the processes that fly.
fn stand_back(away_from: Option<usize>) {
    use rustix::thread::{sched_getaffinity, sched_setaffinity};
    // Where it may not, it is served as well as it can be.
    let _ = rustix::process::nice(NICE);
    let Some(cpu) = away_from else { return };
    if let Ok(mut allowed) = sched_getaffinity(None) {
        allowed.unset(cpu);
        let _ = sched_setaffinity(None, &allowed);
    }
}
