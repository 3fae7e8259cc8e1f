//! The page on this machine's own address, for its browser alone.

use core::sync::atomic::{AtomicBool, Ordering};
use core::time::Duration;
use std::io;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;
use thiserror::Error;
use tiny_http::{Header, Method, Request, Response};

/// How long a request is waited for before the end is looked for.
const LOOK: Duration = Duration::from_millis(100);

/// Why the page cannot be served.
#[derive(Debug, Error)]
pub enum ServeError {
    /// Somebody else has the port.
    #[error(
        "port {port} of 127.0.0.1 cannot be used: {cause}; name another with --port, or none for a free one"
    )]
    Port {
        /// The port asked for.
        port: u16,
        /// What the system says.
        cause: String,
    },
    /// The socket failed later.
    #[error("the page is served no more: {cause}")]
    Lost {
        /// What the system says.
        cause: io::Error,
    },
}

/// One page on a port of the loopback interface.
pub struct Server {
    server: tiny_http::Server,
    port: u16,
    page: String,
}

impl core::fmt::Debug for Server {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Server").field("port", &self.port).finish_non_exhaustive()
    }
}

impl Server {
    /// Takes a port of 127.0.0.1; 0 stands for any free one.
    ///
    /// # Errors
    /// The port is taken, or not for this user.
    pub fn open(port: u16, page: String) -> Result<Self, ServeError> {
        let failed = |cause: String| ServeError::Port { port, cause };
        let server = tiny_http::Server::http(SocketAddr::from((Ipv4Addr::LOCALHOST, port)))
            .map_err(|error| failed(error.to_string()))?;
        let address = server.server_addr().to_ip();
        let port = address.map(|address| address.port()).ok_or_else(|| failed(String::new()))?;
        Ok(Self { server, port, page })
    }

    /// Where a browser finds it.
    #[must_use]
    pub fn url(&self) -> String {
        format!("http://127.0.0.1:{}/", self.port)
    }

    /// Answers until `end` is set.
    ///
    /// # Errors
    /// The socket fails.
    pub fn serve(&self, end: &Arc<AtomicBool>) -> Result<(), ServeError> {
        while !end.load(Ordering::Relaxed) {
            let request =
                self.server.recv_timeout(LOOK).map_err(|cause| ServeError::Lost { cause })?;
            if let Some(request) = request {
                self.answer(request);
            }
        }
        Ok(())
    }

    fn answer(&self, request: Request) {
        let (code, kind, body) = if !self.is_for_us(&request) {
            (403, "text/plain", "this page is for 127.0.0.1 alone\n")
        } else if !matches!(request.method(), Method::Get | Method::Head) {
            (405, "text/plain", "this page can only be read\n")
        } else if request.url() == "/" {
            (200, "text/html; charset=utf-8", self.page.as_str())
        } else {
            (404, "text/plain", "there is one page only: /\n")
        };
        let mut response = Response::from_string(body).with_status_code(code);
        for (name, value) in [("Content-Type", kind), ("Cache-Control", "no-store")] {
            if let Ok(header) = Header::from_bytes(name, value) {
                response.add_header(header);
            }
        }
        // A browser that has gone away is no failure.
        let _ = request.respond(response);
    }

    /// False for a page from elsewhere that has given its name our address.
    fn is_for_us(&self, request: &Request) -> bool {
        let host = request.headers().iter().find(|header| header.field.equiv("Host"));
        let ours = [format!("127.0.0.1:{}", self.port), format!("localhost:{}", self.port)];
        host.is_some_and(|host| ours.iter().any(|name| host.value.as_str() == name))
    }
}
