//! `morphquad live`: a run in the air, for viewers.

use super::browser;
use super::options::LiveArguments;
use super::ps::Trouble;
use super::refusal::{Done, Failure};
use core::sync::atomic::AtomicBool;
use host::exit;
use protocol::control::runs;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use std::io::Write;
use std::sync::Arc;
use viewers::live::{LiveError, LiveServer};

/// How far it stands back for the flight.
const NICE: i32 = 10;

/// Serves until the run is over.
pub(super) fn run(arguments: &LiveArguments, out: &mut dyn Write) -> Done {
    stand_back(arguments.away_from);
    let run = runs::find(arguments.run.run.as_deref()).map_err(|error| {
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
    let server = LiveServer::open(run, arguments.listen, rate_hz, arguments.demo.as_deref())
        .map_err(refused)?;
    if !arguments.listen.ip().is_loopback() {
        let warning =
            "everybody who reaches this address can watch; only its token lets them order";
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
    server.serve(&end).map_err(refused)?;
    Ok(exit::PASS)
}

/// Makes room for whoever flies.
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
