//! The page on this machine's own address, for its browser alone.

use crate::web::{Answer, Asked, WebServer};
use core::sync::atomic::{AtomicBool, Ordering};
use hyper::{Method, StatusCode};
use runtime::clock::{mono_now_ns, sleep_until};
use std::net::{Ipv4Addr, SocketAddr};
use thiserror::Error;

/// How often to look whether it is over \[ns\].
const LOOK_EVERY_NS: u64 = 50_000_000;

/// Why the page cannot be served.
#[derive(Debug, Error)]
#[error(
    "port {port} of 127.0.0.1 cannot be used: {cause}; name another with --port, or none for a free one"
)]
pub struct ServeError {
    /// The port asked for.
    pub port: u16,
    /// The system's error.
    pub cause: std::io::Error,
}

/// One page on a port of the loopback interface.
#[derive(Debug)]
pub struct Server(WebServer);

impl Server {
    /// Takes a port of 127.0.0.1; 0 stands for any free one.
    ///
    /// # Errors
    /// The port is taken, or not for this user.
    pub fn open(port: u16, page: String) -> Result<Self, ServeError> {
        let answer = move |address: SocketAddr, asked: &Asked| {
            if !asked.is_for(address) {
                Answer::refusal(StatusCode::FORBIDDEN, "this page is for 127.0.0.1 alone")
            } else if !matches!(asked.method, Method::GET | Method::HEAD) {
                Answer::refusal(StatusCode::METHOD_NOT_ALLOWED, "this page can only be read")
            } else if asked.path == "/" {
                Answer::page(page.as_str())
            } else {
                Answer::refusal(StatusCode::NOT_FOUND, "there is one page only: /")
            }
        };
        let server = WebServer::open(SocketAddr::from((Ipv4Addr::LOCALHOST, port)), answer);
        server.map(Self).map_err(|cause| ServeError { port, cause })
    }

    /// Where a browser finds it.
    #[must_use]
    pub fn url(&self) -> String {
        format!("http://{}/", self.0.address())
    }

    /// Answers until `end` is set.
    pub fn serve(self, end: &AtomicBool) {
        while !end.load(Ordering::Relaxed) {
            sleep_until(mono_now_ns() + LOOK_EVERY_NS);
        }
    }
}
