//! A page's and a viewer's ends of `morphquad live`, by hand: the server's own libraries would share its mistakes.

use crate::common::morphquad;
use serde_json::{Value, json};
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::process::{Child, ChildStdout, Stdio};
use std::time::Duration;

/// `morphquad live` beside a run.
pub(super) struct Live {
    pub(super) child: Child,
    _out: BufReader<ChildStdout>,
    pub(super) page: String,
    pub(super) token: String,
    pub(super) socket: String,
}

impl Live {
    /// Of a flight that serves itself, from the addresses that it prints.
    pub(super) fn of(mut child: Child) -> (Self, std::thread::JoinHandle<String>) {
        let mut stderr = BufReader::new(child.stderr.take().expect("a pipe"));
        let out = BufReader::new(child.stdout.take().expect("a pipe"));
        let mut next = |begins: &str| {
            let mut line = String::new();
            while !line.contains(begins) {
                line.clear();
                assert!(stderr.read_line(&mut line).expect("a line") > 0, "it says no {begins}");
            }
            let (_, address) = line.split_once(begins).expect("just seen");
            address.split_whitespace().next().expect("an address").to_owned()
        };
        let (page, socket) = (next("live  http://"), next("live  ws://"));
        let (page, token) = page.split_once("/#token=").expect("a token");
        let (page, token) = (page.to_owned(), token.to_owned());
        // A process that writes to a pipe that is not read stands still at last.
        let rest = std::thread::spawn(move || {
            let mut rest = String::new();
            let _ = stderr.read_to_string(&mut rest);
            rest
        });
        (Self { child, _out: out, page, token, socket }, rest)
    }

    pub(super) fn beside(run: &str) -> Self {
        let arguments = ["live", "--run", run, "--listen", "127.0.0.1:0", "--no-open"];
        let mut child = morphquad(arguments).stderr(Stdio::null()).spawn().expect("it starts");
        let mut out = BufReader::new(child.stdout.take().expect("a pipe"));
        let mut lines = [String::new(), String::new()];
        for line in &mut lines {
            out.read_line(line).expect("a line");
        }
        let page = lines[0].trim().strip_prefix("live  http://").expect("a page").to_owned();
        let (page, token) = page.split_once("/#token=").expect("a token");
        let socket = lines[1].strip_prefix("live  ws://").expect("a socket");
        let socket = socket.split_whitespace().next().expect("an address").to_owned();
        Self { child, _out: out, page: page.to_owned(), token: token.to_owned(), socket }
    }

    pub(super) fn get(&self, path: &str) -> (u16, String) {
        self.ask(&format!(
            "GET {path} HTTP/1.1\r\nHost: {}\r\nConnection: close\r\n\r\n",
            self.page
        ))
    }

    pub(super) fn flight(&self, query: &str) -> Value {
        let (code, body) = self.get(&format!("/flight{query}"));
        assert_eq!(code, 200, "{body}");
        serde_json::from_str(&body).expect("JSON")
    }

    pub(super) fn order(&self, token: &str, body: &str) -> (u16, String) {
        self.post("/control", token, body)
    }

    pub(super) fn post(&self, path: &str, token: &str, body: &str) -> (u16, String) {
        let (host, length) = (&self.page, body.len());
        self.ask(&format!(
            "POST {path} HTTP/1.1\r\nHost: {host}\r\nAuthorization: Bearer {token}\r\n\
             Content-Length: {length}\r\nConnection: close\r\n\r\n{body}"
        ))
    }

    /// True once it answers at all.
    pub(super) fn answers(&self) -> bool {
        let Ok(mut stream) = TcpStream::connect(&self.page) else { return false };
        let ask = format!("HEAD / HTTP/1.1\r\nHost: {}\r\nConnection: close\r\n\r\n", self.page);
        let mut answer = String::new();
        stream.write_all(ask.as_bytes()).is_ok()
            && stream.read_to_string(&mut answer).is_ok()
            && answer.starts_with("HTTP/1.1 200")
    }

    /// Code and body of an answer, by hand: the server's own library would share its mistakes.
    pub(super) fn ask(&self, request: &str) -> (u16, String) {
        let mut stream = TcpStream::connect(&self.page).expect("the page listens");
        stream.set_read_timeout(Some(Duration::from_secs(30))).expect("a socket");
        stream.write_all(request.as_bytes()).expect("it reads");
        let mut answer = String::new();
        stream.read_to_string(&mut answer).expect("it answers");
        let code = answer.split(' ').nth(1).and_then(|code| code.parse().ok());
        let (head, body) = answer.split_once("\r\n\r\n").expect("head and body");
        let body = if head.to_lowercase().contains("transfer-encoding: chunked") {
            dechunked(body)
        } else {
            body.to_owned()
        };
        (code.unwrap_or_else(|| panic!("{answer}")), body)
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// RFC 9112, 7.1.
fn dechunked(mut text: &str) -> String {
    let mut out = String::new();
    while let Some((length, rest)) = text.split_once("\r\n") {
        let length = usize::from_str_radix(length.trim(), 16).expect("a length");
        out.push_str(&rest[..length]);
        text = rest[length..].trim_start_matches("\r\n");
    }
    out
}

/// A viewer of the WebSocket that wants everything and then never reads (RFC 6455).
pub(super) fn stalling_viewer(socket: &str) -> TcpStream {
    let mut stream = TcpStream::connect(socket).expect("the socket listens");
    stream.set_read_timeout(Some(Duration::from_secs(30))).expect("a socket");
    let hello = format!(
        "GET / HTTP/1.1\r\nHost: {socket}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\
         Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\
         Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n"
    );
    stream.write_all(hello.as_bytes()).expect("it reads");
    let mut head = Vec::new();
    let mut byte = [0];
    while !head.ends_with(b"\r\n\r\n") {
        stream.read_exact(&mut byte).expect("a handshake");
        head.extend(byte);
    }
    let head = String::from_utf8(head).expect("text");
    assert!(
        head.starts_with("HTTP/1.1 101") && head.contains("s3pPLMBiTxaQ9kYGzzhZRbK+xOo="),
        "{head}"
    );
    let wanted: Vec<Value> = (1..=30).map(|id| json!({ "id": id, "channelId": id })).collect();
    let text = json!({ "op": "subscribe", "subscriptions": wanted }).to_string();
    let length = u16::try_from(text.len()).expect("short").to_be_bytes();
    // Final text frame, masked with zeros.
    let frame = [&[0x81, 0xfe][..], &length, &[0; 4], text.as_bytes()].concat();
    stream.write_all(&frame).expect("it reads");
    stream
}

/// Longest body of a ping (RFC 6455, 5.5).
const PING_BYTES: u8 = 125;

/// Sends pings without end and reads none of the answers, until it is sent away.
pub(super) fn flood_with_pings(mut stream: TcpStream) {
    const FLOOD_BYTES_MAX: usize = 4 << 30;
    // The first bit of the second byte means that the body is masked, here with zeros.
    let ping = [&[0x89, 0x80 | PING_BYTES, 0, 0, 0, 0][..], &[b'x'; PING_BYTES as usize]].concat();
    let pings = ping.repeat(1000);
    let mut sent_bytes = 0;
    while stream.write_all(&pings).is_ok() {
        sent_bytes += pings.len();
        assert!(sent_bytes < FLOOD_BYTES_MAX, "it takes everything");
    }
}
