//! A client that has a flight's live page open, and a viewer that shows every topic, for a measurement.

use crate::flown;
use core::sync::atomic::{AtomicU64, Ordering};
use serde_json::{Value, json};
use std::io::{self, BufRead as _, BufReader, Read as _, Write as _};
use std::net::{SocketAddr, TcpStream};
use std::process::{Child, ChildStdout, Stdio};
use std::sync::Arc;
use std::thread;
use std::time::Duration;
use tungstenite::client::IntoClientRequest as _;
use tungstenite::http::HeaderValue;
use tungstenite::{HandshakeError, Message};

/// What does not come within this time does not come.
const PATIENCE: Duration = Duration::from_secs(2);
/// WebSocket subprotocol of the viewers.
const PROTOCOL: &str = "foxglove.sdk.v1";

/// `morphquad live` beside a run, its page and its viewer.
#[derive(Debug)]
pub(crate) struct Onlooker {
    child: Child,
    page: SocketAddr,
    received: Arc<AtomicU64>,
    /// Open, so that it may go on writing.
    _out: BufReader<ChildStdout>,
}

impl Onlooker {
    /// Of a run by its name; none if it cannot be shown.
    pub(crate) fn of(run: &str) -> Option<Self> {
        let mut child = flown::morphquad()
            .args(["live", "--run", run, "--listen", "127.0.0.1:0", "--no-open"])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .ok()?;
        let mut out = BufReader::new(child.stdout.take()?);
        let mut read_address = || {
            let mut line = String::new();
            out.read_line(&mut line).ok().and_then(|_| address(&line))
        };
        let (Some(page), Some(socket)) = (read_address(), read_address()) else {
            end(&mut child);
            return None;
        };
        let received = Arc::new(AtomicU64::new(0));
        let count = Arc::clone(&received);
        // It ends with the server; its only result is the count of messages received.
        thread::spawn(move || view(socket, &count));
        Some(Self { child, page, received, _out: out })
    }

    /// Requests what is new, as the page does five times a second; true if the server answered.
    pub(crate) fn look(&self) -> bool {
        let ask = format!(
            "GET /flight?since_s=1e9 HTTP/1.1\r\nHost: {}\r\nConnection: close\r\n\r\n",
            self.page
        );
        let request = || {
            let mut stream = TcpStream::connect_timeout(&self.page, PATIENCE)?;
            stream.set_read_timeout(Some(PATIENCE))?;
            stream.write_all(ask.as_bytes())?;
            let mut answer = Vec::new();
            stream.read_to_end(&mut answer)?;
            Ok::<_, io::Error>(answer)
        };
        request().is_ok_and(|answer| answer.starts_with(b"HTTP/1.1 200"))
    }

    /// Messages that the viewer was sent.
    pub(crate) fn received(&self) -> u64 {
        self.received.load(Ordering::Relaxed)
    }
}

impl Drop for Onlooker {
    fn drop(&mut self) {
        end(&mut self.child);
    }
}

fn end(child: &mut Child) {
    let _ = child.kill();
    let _ = child.wait();
}

/// Subscribes to every channel and reads until the server is gone.
fn view(server: SocketAddr, received: &AtomicU64) -> Result<(), tungstenite::Error> {
    let mut request = format!("ws://{server}").into_client_request()?;
    request.headers_mut().insert("Sec-WebSocket-Protocol", HeaderValue::from_static(PROTOCOL));
    let stream = TcpStream::connect_timeout(&server, PATIENCE)?;
    let (mut socket, _) = tungstenite::client(request, stream).map_err(|error| match error {
        HandshakeError::Failure(error) => error,
        HandshakeError::Interrupted(_) => io::Error::from(io::ErrorKind::WouldBlock).into(),
    })?;
    loop {
        match socket.read()? {
            Message::Text(text) => {
                if let Some(wish) = subscription(&text) {
                    socket.send(Message::text(wish))?;
                }
            }
            Message::Binary(_) => {
                received.fetch_add(1, Ordering::Relaxed);
            }
            _ => {}
        }
    }
}

/// A subscription to all that is advertised, if this is an advertisement.
fn subscription(text: &str) -> Option<String> {
    let message: Value = serde_json::from_str(text).ok()?;
    let channels = message["channels"].as_array().filter(|_| message["op"] == "advertise")?;
    let each =
        channels.iter().map(|channel| json!({ "id": channel["id"], "channelId": channel["id"] }));
    Some(json!({ "op": "subscribe", "subscriptions": each.collect::<Vec<_>>() }).to_string())
}

/// Address in a line that contains one.
fn address(line: &str) -> Option<SocketAddr> {
    line.split_once("://")?.1.split(['/', ' ', '\n']).next()?.parse().ok()
}
