//! `morphquad live`: a run in the air, for viewers.

use super::browser;
use super::options::LiveArguments;
use super::ps::Trouble;
use super::refusal::{Done, Failure};
use core::sync::atomic::AtomicBool;
use host::exit;
use protocol::control::runs;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use std::io::{self, Write};
use std::os::unix::process::CommandExt as _;
use std::process::Command;
use std::sync::Arc;
use viewers::live::{LiveError, LiveServer, Places};

/// How far it stands back for the flight.
const NICE: i32 = 10;

/// Where a server goes on that has begun anew. Only this user and root can read it.
const PLACES: &str = "MORPHQUAD_LIVE_PLACES";

/// Serves until the run is over.
pub(super) fn run(arguments: &LiveArguments, out: &mut dyn Write) -> Done {
    let places: Option<Places> = std::env::var(PLACES).ok().and_then(|text| text.parse().ok());
    if places.is_none() {
        stand_back(arguments.away_from);
    }
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
    let (listen, demo) = (arguments.listen, arguments.demo.as_deref());
    let server = LiveServer::open(run, listen, rate_hz, demo, places.as_ref()).map_err(refused)?;
    if places.is_none() {
        tell(&server, arguments, out)?;
    }
    match server.serve(&end).map_err(refused)? {
        None => Ok(exit::PASS),
        Some(server) => Err(begin_anew(&server.places())),
    }
}

/// Says where it listens, and shows it.
fn tell(server: &LiveServer, arguments: &LiveArguments, out: &mut dyn Write) -> io::Result<()> {
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
    Ok(())
}

/// Replaces this process by one that serves in the same places. What comes back is why it cannot.
fn begin_anew(places: &Places) -> Failure {
    let told =
        "a viewer that sends without reading has filled the memory of `live`, which begins anew";
    eprintln!("morphquad: {told}: viewers have to connect again");
    let mut again = Command::new("/proc/self/exe");
    again.args(std::env::args_os().skip(1)).env(PLACES, places.to_string());
    let error = LiveError::System { action: "begin anew", cause: again.exec() };
    Failure::plain(&error, exit::UNFIT)
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
