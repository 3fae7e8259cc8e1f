//! Pages and answers over HTTP, to browsers on this machine unless another address is asked for.
//!
//! A client that stalls, in the middle of a request or of an answer, holds up no other: where every
//! place is taken, the client that has been idle for longest makes room.

mod guests;
mod peers;

use core::convert::Infallible;
use core::time::Duration;
use guests::{CLIENTS, Guest, Guests};
use http_body_util::{BodyExt as _, Full, Limited};
use hyper::body::{Bytes, Incoming};
use hyper::header::{
    AUTHORIZATION, CACHE_CONTROL, CONTENT_TYPE, HOST, HeaderName, HeaderValue, LOCATION,
    X_FRAME_OPTIONS,
};
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper::{Method, Request, Response, StatusCode};
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::server::graceful::{GracefulShutdown, Watcher};
use std::io;
use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::thread::{Builder, JoinHandle};
use tokio::net::TcpStream;
use tokio::sync::{Notify, Semaphore};
use tokio_io_timeout::TimeoutStream;

/// How long one may take to read what it is sent, or to send what belongs to its request.
const PATIENCE: Duration = Duration::from_secs(30);
/// How long one may take to send the head of its request.
const HEAD_PATIENCE: Duration = Duration::from_secs(5);
/// How long a client that is being answered is waited for at the end: a flight that is ordered to stop answers the
/// client that ordered it, and on a busy machine that takes its time.
const GOODBYE: Duration = Duration::from_secs(5);
/// Port of an address that names none.
const HTTP_PORT: u16 = 80;
/// Longest head of a request \[bytes\].
const HEAD_BYTES: usize = 16 << 10;
/// Longest body of a request \[bytes\].
const BODY_BYTES: usize = 16 << 10;

/// What a browser asks for.
#[derive(Debug)]
pub(crate) struct Asked {
    pub(crate) method: Method,
    /// The connection's end here, and the client's.
    ends: Option<(SocketAddr, SocketAddr)>,
    /// Before the `?`.
    pub(crate) path: String,
    /// After it.
    pub(crate) query: String,
    /// The host that it believes to be talking to.
    host: Option<String>,
    /// Where the page is from that has the browser ask; `none` if its user has.
    site: Option<String>,
    /// The token that it shows.
    pub(crate) bearer: Option<String>,
    /// What it sends; none if that is longer than 16 KiB or cannot be read.
    pub(crate) body: Option<Bytes>,
}

/// What it is answered.
#[derive(Debug)]
pub(crate) struct Answer {
    code: StatusCode,
    kind: &'static str,
    body: String,
    /// Where else to look.
    location: Option<String>,
}

impl Answer {
    /// A document.
    pub(crate) fn page(body: impl Into<String>) -> Self {
        Self::new(StatusCode::OK, "text/html; charset=utf-8", body.into())
    }

    /// Data.
    pub(crate) fn json(body: impl Into<String>) -> Self {
        Self::new(StatusCode::OK, "application/json", body.into())
    }

    /// A sentence that states why not.
    pub(crate) fn refusal(code: StatusCode, sentence: impl core::fmt::Display) -> Self {
        Self::new(code, "text/plain; charset=utf-8", format!("{sentence}\n"))
    }

    /// Another address of the same server.
    pub(crate) fn see_other(location: String) -> Self {
        let answer = Self::new(StatusCode::SEE_OTHER, "text/plain", String::new());
        Self { location: Some(location), ..answer }
    }

    fn new(code: StatusCode, kind: &'static str, body: String) -> Self {
        Self { code, kind, body, location: None }
    }
}

impl Asked {
    /// False for a page from elsewhere that has given its own name our address: apart from `localhost`
    /// we are known by number alone.
    pub(crate) fn is_for(&self, address: SocketAddr) -> bool {
        let Some(host) = self.host.as_deref() else { return false };
        let has_port = host.rsplit_once(':').is_some_and(|(_, port)| port.parse::<u16>().is_ok());
        // The port of an address without one, as browsers write it.
        let host = if has_port { host.to_owned() } else { format!("{host}:{HTTP_PORT}") };
        if host == format!("localhost:{}", address.port()) {
            return true;
        }
        let named: Option<SocketAddr> = host.parse().ok();
        named.is_some_and(|named| {
            named == address || (address.ip().is_unspecified() && named.port() == address.port())
        })
    }

    /// Whether it is asked by a process of this user, or of root, on this machine, and not for a page from elsewhere.
    pub(crate) fn is_by_own_user(&self) -> bool {
        let own = rustix::process::geteuid().as_raw();
        let user = self.ends.and_then(|(here, there)| peers::user_of(here, there));
        let is_direct = self.site.as_deref().is_none_or(|site| site == "none");
        is_direct && user.is_some_and(|user| user == own || user == 0)
    }

    async fn read(request: Request<Incoming>, ends: Option<(SocketAddr, SocketAddr)>) -> Self {
        let text = |name: HeaderName| {
            let value = request.headers().get(name);
            value.and_then(|value| value.to_str().ok()).map(str::to_owned)
        };
        let (host, shown) = (text(HOST), text(AUTHORIZATION));
        let site = text(HeaderName::from_static("sec-fetch-site"));
        let bearer = shown.and_then(|s| Some(s.strip_prefix("Bearer ")?.trim().to_owned()));
        let method = request.method().clone();
        let path = request.uri().path().to_owned();
        let query = request.uri().query().unwrap_or_default().to_owned();
        let body = Limited::new(request.into_body(), BODY_BYTES).collect().await;
        let body = body.ok().map(http_body_util::Collected::to_bytes);
        Self { method, ends, path, query, host, site, bearer, body }
    }
}

/// Answers on one port, on threads of its own, until dropped.
#[derive(Debug)]
pub(crate) struct WebServer {
    address: SocketAddr,
    leave: Arc<Notify>,
    thread: Option<JoinHandle<()>>,
}

impl WebServer {
    /// Listens at an address; port 0 stands for any free one. `answer` may take its time.
    ///
    /// # Errors
    /// The address is taken, or not this machine's, or not for this user.
    pub(crate) fn open(
        address: SocketAddr,
        answer: impl Fn(SocketAddr, &Asked) -> Answer + Send + Sync + 'static,
    ) -> io::Result<Self> {
        let listener = TcpListener::bind(address)?;
        listener.set_nonblocking(true)?;
        let address = listener.local_addr()?;
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .max_blocking_threads(CLIENTS)
            .build()?;
        let listener = {
            let _inside = runtime.enter();
            tokio::net::TcpListener::from_std(listener)?
        };
        let leave = Arc::<Notify>::default();
        let answer: Arc<Answerer> = Arc::new(move |asked: &Asked| answer(address, asked));
        let left = Arc::clone(&leave);
        let serve = move || {
            runtime.block_on(async {
                let clients = GracefulShutdown::new();
                tokio::select! {
                    () = let_in(&listener, &answer, &clients) => {}
                    () = left.notified() => {}
                }
                // A client that is being answered gets the answer.
                let _ = tokio::time::timeout(GOODBYE, clients.shutdown()).await;
            });
            // A client that still waits for an answer is left without one.
            runtime.shutdown_background();
        };
        let thread = Some(Builder::new().name("web".to_owned()).spawn(serve)?);
        Ok(Self { address, leave, thread })
    }

    /// Where it listens.
    pub(crate) fn address(&self) -> SocketAddr {
        self.address
    }
}

impl Drop for WebServer {
    fn drop(&mut self) {
        self.leave.notify_one();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

type Answerer = dyn Fn(&Asked) -> Answer + Send + Sync;

async fn let_in(
    listener: &tokio::net::TcpListener,
    answer: &Arc<Answerer>,
    clients: &GracefulShutdown,
) {
    let mut guests = Guests::default();
    let at_work = Arc::new(Semaphore::new(CLIENTS));
    loop {
        match listener.accept().await {
            Ok((stream, _)) => {
                let (answer, until) = (Arc::clone(answer), clients.watcher());
                let at_work = Arc::clone(&at_work);
                guests.admit(|guest| converse(stream, (answer, at_work), guest, until)).await;
            }
            // No descriptor is free: a client that knocks waits until one is.
            Err(_) => tokio::time::sleep(Duration::from_millis(100)).await,
        }
    }
}

async fn converse(
    stream: TcpStream,
    (answer, at_work): (Arc<Answerer>, Arc<Semaphore>),
    guest: Guest,
    until: Watcher,
) {
    let ends = stream.local_addr().and_then(|here| Ok((here, stream.peer_addr()?))).ok();
    let mut stream = TimeoutStream::new(stream);
    stream.set_write_timeout(Some(PATIENCE));
    stream.set_read_timeout(Some(PATIENCE));
    let guest = Arc::new(guest);
    let service = service_fn(move |request| {
        let (answer, at_work) = (Arc::clone(&answer), Arc::clone(&at_work));
        let guest = Arc::clone(&guest);
        async move { Ok::<_, Infallible>(respond(request, ends, (answer, at_work), &guest).await) }
    });
    let conversation = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(HEAD_PATIENCE)
        .max_buf_size(HEAD_BYTES)
        .serve_connection(TokioIo::new(Box::pin(stream)), service);
    // A browser that has gone away, or sends what is no request, is no failure.
    let _ = until.watch(conversation).await;
}

async fn respond(
    request: Request<Incoming>,
    ends: Option<(SocketAddr, SocketAddr)>,
    (answer, at_work): (Arc<Answerer>, Arc<Semaphore>),
    guest: &Guest,
) -> Response<Full<Bytes>> {
    let asked = Asked::read(request, ends).await;
    guest.works();
    // Held until the answer is there, also by a client that has gone away: nothing queues for a thread.
    let turn = at_work.acquire_owned().await;
    let answered = tokio::task::spawn_blocking(move || {
        let _turn = turn;
        answer(&asked)
    })
    .await;
    guest.idles();
    let Answer { code, kind, body, location } = answered.unwrap_or_else(|_| {
        Answer::refusal(StatusCode::INTERNAL_SERVER_ERROR, "this cannot be answered")
    });
    let mut response = Response::new(Full::new(Bytes::from(body)));
    *response.status_mut() = code;
    let headers = response.headers_mut();
    headers.insert(CONTENT_TYPE, HeaderValue::from_static(kind));
    headers.insert(CACHE_CONTROL, HeaderValue::from_static("no-store"));
    // Within another page, its buttons could be pressed without being seen.
    headers.insert(X_FRAME_OPTIONS, HeaderValue::from_static("DENY"));
    if let Some(location) = location.and_then(|location| location.try_into().ok()) {
        headers.insert(LOCATION, location);
    }
    response
}

#[cfg(test)]
mod tests {
    use super::{Answer, Asked, CLIENTS, StatusCode, WebServer};
    use core::sync::atomic::{AtomicUsize, Ordering};
    use std::io::{Read as _, Write as _};
    use std::net::{SocketAddr, TcpStream};

    fn server() -> WebServer {
        let answer = |address: SocketAddr, asked: &Asked| {
            if !asked.is_for(address) {
                return Answer::refusal(StatusCode::FORBIDDEN, "not you");
            }
            let body = asked.body.as_ref().map(hyper::body::Bytes::len);
            Answer::json(format!("{} {} {body:?} {:?}", asked.path, asked.query, asked.bearer))
        };
        WebServer::open(SocketAddr::from(([127, 0, 0, 1], 0)), answer).unwrap()
    }

    fn ask(server: &WebServer, host: &str, rest: &str) -> String {
        let mut stream = TcpStream::connect(server.address()).unwrap();
        write!(stream, "POST /a?b=c HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n{rest}")
            .unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        answer
    }

    #[test]
    fn a_request_comes_apart_and_only_the_number_or_localhost_is_us() {
        let server = server();
        let port = server.address().port();
        let asked = "Authorization: Bearer 77 \r\nContent-Length: 3\r\n\r\nabc";
        for host in [format!("127.0.0.1:{port}"), format!("localhost:{port}")] {
            let answer = ask(&server, &host, asked);
            assert!(answer.ends_with("/a b=c Some(3) Some(\"77\")"), "{answer}");
        }
        for host in ["evil.example", "127.0.0.1", "localhost", "", "127.0.0.2:80"] {
            let answer = ask(&server, host, asked);
            assert!(answer.starts_with("HTTP/1.1 403"), "{host}: {answer}");
        }
        let long = format!("Content-Length: 20000\r\n\r\n{}", "x".repeat(20_000));
        let answer = ask(&server, &format!("127.0.0.1:{port}"), &long);
        assert!(answer.contains("/a b=c None"), "{answer}");
    }

    #[test]
    fn an_address_without_a_port_is_that_of_port_80() {
        let asked = |host: &str| Asked {
            method: hyper::Method::GET,
            ends: None,
            path: "/".to_owned(),
            query: String::new(),
            host: Some(host.to_owned()),
            site: None,
            bearer: None,
            body: None,
        };
        let usual = SocketAddr::from(([127, 0, 0, 1], 80));
        for host in ["127.0.0.1", "localhost", "127.0.0.1:80", "localhost:80"] {
            assert!(asked(host).is_for(usual), "{host}");
            let other = SocketAddr::from(([127, 0, 0, 1], 8080));
            assert!(!asked(host).is_for(other), "{host}");
        }
        assert!(asked("[::1]").is_for("[::1]:80".parse().unwrap()));
        assert!(!asked("evil.example").is_for(usual));
    }

    #[test]
    fn clients_that_stall_hold_up_no_other_even_where_every_place_is_taken() {
        let server = server();
        let stalled: Vec<TcpStream> = (0..2 * CLIENTS)
            .map(|i| {
                let mut stream = TcpStream::connect(server.address()).unwrap();
                let host = server.address();
                let whole = format!("GET /{i} HTTP/1.1\r\nHost: {host}\r\n\r\n").repeat(50);
                // Half of them never finish asking, the others never listen.
                let request = if i % 2 == 0 { &whole[..20] } else { &whole };
                // A client that comes later may already have taken this one's place.
                let _ = stream.write_all(request.as_bytes());
                stream
            })
            .collect();
        let host = server.address().to_string();
        assert!(ask(&server, &host, "\r\n").starts_with("HTTP/1.1 200"));
        drop(stalled);
        drop(server);
    }

    #[test]
    fn a_client_that_is_being_answered_is_sent_away_for_no_other() {
        let (go_on, waiting) = std::sync::mpsc::channel::<()>();
        let (begin, begun) = std::sync::mpsc::channel::<()>();
        let waiting = std::sync::Mutex::new(waiting);
        let answer = move |_: SocketAddr, asked: &Asked| {
            if asked.path == "/slow" {
                begin.send(()).unwrap();
                let _ = waiting.lock().unwrap().recv();
            }
            Answer::json("done")
        };
        let server = WebServer::open(SocketAddr::from(([127, 0, 0, 1], 0)), answer).unwrap();
        let host = server.address();
        let mut slow = TcpStream::connect(host).unwrap();
        write!(slow, "GET /slow HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n").unwrap();
        begun.recv().unwrap();
        let idle: Vec<_> = (0..2 * CLIENTS).map(|_| TcpStream::connect(host).unwrap()).collect();
        // The client that comes last is only answered once all those before have been let in.
        assert!(ask(&server, &host.to_string(), "\r\n").ends_with("done"));
        go_on.send(()).unwrap();
        let mut answer = String::new();
        slow.read_to_string(&mut answer).unwrap();
        assert!(answer.ends_with("done"), "{answer}");
        drop(idle);
    }

    #[test]
    fn what_clients_asked_that_have_gone_is_not_worked_out_where_all_is_at_work() {
        let (go_on, waiting) = std::sync::mpsc::channel::<()>();
        let (begin, begun) = std::sync::mpsc::channel::<()>();
        let waiting = std::sync::Mutex::new(waiting);
        let in_vain = std::sync::Arc::new(AtomicUsize::new(0));
        let counted = std::sync::Arc::clone(&in_vain);
        let answer = move |_: SocketAddr, asked: &Asked| {
            if asked.path == "/slow" {
                begin.send(()).unwrap();
                let _ = waiting.lock().unwrap().recv();
            } else if asked.path == "/gone" {
                counted.fetch_add(1, Ordering::Relaxed);
            }
            Answer::json("done")
        };
        let server = WebServer::open(SocketAddr::from(([127, 0, 0, 1], 0)), answer).unwrap();
        let host = server.address();
        // Asks, goes away, and sees that the server has noticed.
        let leave = |path: &str, is_at_work: &dyn Fn()| {
            let mut stream = TcpStream::connect(host).unwrap();
            write!(stream, "GET {path} HTTP/1.1\r\nHost: {host}\r\n\r\n").unwrap();
            is_at_work();
            stream.shutdown(std::net::Shutdown::Write).unwrap();
            let mut answer = Vec::new();
            let _ = stream.read_to_end(&mut answer);
            assert!(answer.is_empty(), "{answer:?}");
        };
        for _ in 0..CLIENTS {
            leave("/slow", &|| begun.recv().unwrap());
        }
        for _ in 0..3 * CLIENTS {
            leave("/gone", &|| ());
        }
        drop(go_on);
        assert!(ask(&server, &host.to_string(), "\r\n").ends_with("done"));
        assert_eq!(in_vain.load(Ordering::Relaxed), 0);
    }

    #[test]
    fn what_is_no_request_ends_its_own_conversation() {
        let server = server();
        let mut stream = TcpStream::connect(server.address()).unwrap();
        stream.write_all(&[0x16, 3, 1, 0, 255, 0, 0, 13, 10, 13, 10]).unwrap();
        let mut answer = Vec::new();
        let _ = stream.read_to_end(&mut answer);
        assert!(answer.is_empty() || answer.starts_with(b"HTTP/1.1 400"), "{answer:?}");
        let host = server.address().to_string();
        assert!(ask(&server, &host, "\r\n").starts_with("HTTP/1.1 200"));
    }
}
