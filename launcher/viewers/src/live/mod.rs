//! A running flight, for viewers: `morphquad live`, which `run --live` starts as a process of its own.
//!
//! It listens to the run as `topic` does, and forwards what it receives: `viewers` over the Foxglove
//! WebSocket protocol, where no client can write, and `http` to our own page, with buttons for a user
//! who holds the token. `picture` is what the page shows, kept up to date. A viewer that reads too
//! slowly loses samples here, and the flight knows nothing of it.

mod http;
mod past;
mod picture;
mod restart;
mod token;
mod viewers;

use core::sync::atomic::{AtomicBool, Ordering};
use core::time::Duration;
use document::ScenarioError;
use http::HttpApi;
use picture::Picture;
use protocol::control::client::Conversation;
use protocol::control::runs::Run;
use protocol::control::status::RunStatus;
use protocol::control::{Reply, Request};
use protocol::topic::feed::Ending;
use protocol::topic::live::{ListenError, Listening, Message};
pub use restart::Place;
use runtime::clock::{mono_now_ns, sleep_until};
use runtime::namespace::living_runs;
use scenario::Scenario;
use shared_types::{Sample, Topic, TopicInfo, TopicVisitor, topics};
use std::io;
use std::net::{IpAddr, SocketAddr, UdpSocket};
use std::path::Path;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{Builder, JoinHandle};
use thiserror::Error;
use token::Token;
use viewers::Viewers;

/// How long to wait for the next sample before looking at anything else.
const MOMENT: Duration = Duration::from_millis(50);
/// How often to ask the launcher for the status of the run.
const STATUS_EVERY: Duration = Duration::from_millis(500);
/// How long to look for another launcher once one has gone \[ns\].
const SUCCESSOR_LIMIT_NS: u64 = 120_000_000_000;
/// How often to look for it \[ns\].
const LOOK_EVERY_NS: u64 = 200_000_000;
/// How often to look at the memory that viewers make this process hold \[ns\].
const WEIGH_EVERY_NS: u64 = 50_000_000;
/// How long a page that goes on asking may take to fetch the end \[ns\]: one that is drawn without a graphics card on a
/// busy machine takes its time. One that has fallen silent is not waited for.
const LAST_LOOK_NS: u64 = 60_000_000_000;

/// Why a run cannot be shown.
#[derive(Debug, Error)]
pub enum LiveError {
    /// It cannot be listened to.
    #[error(transparent)]
    Listen(#[from] ListenError),
    /// What it flies cannot be read.
    #[error("the scenario of run {run} cannot be read: {cause}")]
    Scenario {
        run: String,
        /// The parser's error.
        cause: ScenarioError,
    },
    /// Another program has the port, or the address is not this machine's.
    #[error(
        "cannot listen on {address}: {cause}; name another with --listen ADDRESS:PORT (run: --live=ADDRESS:PORT), or port 0 for a free one"
    )]
    Address {
        /// As asked for.
        address: SocketAddr,
        /// The system's error.
        cause: String,
    },
    /// Threads, sockets, chance.
    #[error("cannot {action}: {cause}")]
    System {
        /// What was tried.
        action: &'static str,
        /// The system's error.
        cause: std::io::Error,
    },
}

/// What a server and its threads share.
#[derive(Debug)]
struct Shared {
    picture: Mutex<Picture>,
}

impl Shared {
    /// A picture is whole between two samples, whatever happened to the thread that held it.
    fn picture(&self) -> std::sync::MutexGuard<'_, Picture> {
        self.picture.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Where a server listens.
#[derive(Debug, Clone)]
pub enum Listen {
    /// For viewers at this address, for browsers on the port after it or, if that is taken, on any.
    At(SocketAddr),
    /// Where the server listened that this one replaces.
    Again(Place),
}

/// Serves one run until it is over.
pub struct LiveServer {
    run: Run,
    listening: Listening,
    viewers: Viewers,
    shared: Arc<Shared>,
    http: HttpApi,
    token: Token,
    watcher: Option<JoinHandle<()>>,
    /// Wakes the watcher for the last time.
    dismiss: Option<Sender<()>>,
}

impl core::fmt::Debug for LiveServer {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("LiveServer").field("run", &self.run).finish_non_exhaustive()
    }
}

impl LiveServer {
    /// Listens to `run`, and for viewers at `at`. At most `rate_hz` samples per second of flight of each writer of
    /// a topic are sent to viewers; all if it is `None`. With `demo`, a scenario that configures a bad controller, the
    /// page has buttons for it and for a kill.
    ///
    /// # Errors
    /// [`LiveError`].
    pub fn open(
        run: Run,
        at: &Listen,
        rate_hz: Option<f64>,
        demo: Option<&Path>,
    ) -> Result<Self, LiveError> {
        let file = run.folder().join("scenario.toml");
        let scenario = Scenario::load(&file.to_string_lossy(), &[])
            .map_err(|cause| LiveError::Scenario { run: run.id().to_owned(), cause })?;
        let listening = Listening::to_everything(&run)?;
        let (Listen::At(listen) | Listen::Again(Place { viewers: listen, .. })) = *at;
        let viewers = Viewers::open(listen, run.id(), &scenario, listening.flying(), rate_hz)?;
        let mut picture = Picture::new(run.id(), &scenario, listening.flying());
        if demo.is_some() {
            picture.is_demo();
        }
        let shared = Arc::new(Shared { picture: Mutex::new(picture) });
        let token = match at {
            Listen::At(_) => Token::random(),
            Listen::Again(place) => Ok(place.token.clone()),
        };
        let token = token.map_err(|cause| LiveError::System { action: "make a token", cause })?;
        let open = |address: SocketAddr| {
            HttpApi::open(
                address,
                run.clone(),
                token.clone(),
                (Arc::clone(&shared), demo.map(Path::to_owned)),
            )
        };
        let http = match at {
            Listen::Again(place) => open(place.page)?,
            Listen::At(listen) => {
                let [after, any] = [listen.port().wrapping_add(1), 0]
                    .map(|port| SocketAddr::new(listen.ip(), port));
                if listen.port() == 0 { open(any)? } else { open(after).or_else(|_| open(any))? }
            }
        };
        let (dismiss, dismissed) = channel();
        let watcher = watch(run.clone(), Arc::clone(&shared), dismissed)
            .map_err(|cause| LiveError::System { action: "start a thread", cause })?;
        let (watcher, dismiss) = (Some(watcher), Some(dismiss));
        Ok(Self { run, listening, viewers, shared, http, token, watcher, dismiss })
    }

    /// Where the page is, with the token in the part that a browser keeps to itself.
    #[must_use]
    pub fn page_url(&self) -> String {
        self.page_at(reachable(self.http.address()))
    }

    /// Address for the command line of a browser, from which only browsers of this user and root's get to the page with
    /// its token.
    #[must_use]
    pub fn open_url(&self) -> String {
        format!("http://{}{}", reachable(self.http.address()), self.http.open_path())
    }

    /// Where Foxglove and its kin connect.
    #[must_use]
    pub fn socket_url(&self) -> String {
        format!("ws://{}", reachable(self.viewers.address()))
    }

    /// Page and `WebSocket` as other machines find them, if every address of this one is listened at; none
    /// where it has no address but its own.
    #[must_use]
    pub fn urls_elsewhere(&self) -> Vec<String> {
        let (page, socket) = (self.http.address(), self.viewers.address());
        let own = Some(page.ip()).filter(IpAddr::is_unspecified).and_then(|_| outward(page.ip()));
        own.map_or_else(Vec::new, |ip| {
            let socket = SocketAddr::new(ip, socket.port());
            vec![self.page_at(SocketAddr::new(ip, page.port())), format!("ws://{socket}")]
        })
    }

    fn page_at(&self, address: SocketAddr) -> String {
        format!("http://{address}/#token={}", self.token.as_str())
    }

    /// Forwards what it receives until the flight is over or `end` is set. It comes back if viewers make it hold more
    /// memory than it may: then the process has to be replaced by one that listens in the same [`Self::place`].
    ///
    /// # Errors
    /// The launcher sends what this build does not understand.
    pub fn serve(mut self, end: &AtomicBool) -> Result<Option<Self>, LiveError> {
        let mut weighed_ns = mono_now_ns();
        while !end.load(Ordering::Relaxed) {
            if mono_now_ns() >= weighed_ns + WEIGH_EVERY_NS {
                weighed_ns = mono_now_ns();
                if restart::holds_too_much() {
                    return Ok(Some(self));
                }
            }
            match self.listening.next(MOMENT)? {
                Message::Sample(topic, packed) => self.sample(topic, &packed),
                Message::Log(log) => {
                    self.viewers.log(&log);
                    self.shared.picture().log(&log);
                }
                Message::Dropped(count) => self.shared.picture().dropped(count),
                Message::Nothing => {}
                Message::Ended(ending) => {
                    self.finish(ending);
                    return Ok(None);
                }
                Message::Over => {
                    let listening = match self.successor(end) {
                        Ok(listening) => listening,
                        Err(text) => {
                            self.finish(Ending { is_good: false, text: text.to_owned() });
                            return Ok(None);
                        }
                    };
                    self.shared.picture().orphaned(false);
                    self.listening = listening;
                    if self.viewers.is_closed() {
                        return Ok(Some(self));
                    }
                }
            }
        }
        let text = "still running, but shown no more";
        self.finish(Ending { is_good: false, text: text.to_owned() });
        Ok(None)
    }

    /// What another process needs to replace this one.
    #[must_use]
    pub fn place(&self) -> Place {
        let (viewers, page) = (self.viewers.address(), self.http.address());
        Place { run: self.run.id().to_owned(), viewers, page, token: self.token.clone() }
    }

    fn sample(&mut self, topic: &'static TopicInfo, packed: &[u8]) {
        let mut picture = self.shared.picture();
        let mut hand_on =
            HandOn { topic, packed, viewers: &mut self.viewers, picture: &mut picture };
        let Ok(()) = topics::visit_all(&mut hand_on);
    }

    /// The launcher that takes the run over from one that has died, or how the flight has ended.
    fn successor(&mut self, end: &AtomicBool) -> Result<Listening, &'static str> {
        const DEAD: &str = "its launcher has died, and no other has taken over";
        self.shared.picture().orphaned(true);
        let give_up_ns = mono_now_ns() + SUCCESSOR_LIMIT_NS;
        let mut is_closed = false;
        while mono_now_ns() < give_up_ns && !end.load(Ordering::Relaxed) {
            if !living_runs().iter().any(|(id, _)| id == self.run.id()) {
                return Err(DEAD);
            }
            let was_closed = is_closed;
            match Listening::to_everything(&self.run) {
                Ok(listening) => return Ok(listening),
                // A launcher that dies leaves its socket. One that removes it has ended the flight, and waits for this
                // process to leave; between one and the next it is gone for a moment only.
                Err(ListenError::Closed { source, .. }) => {
                    is_closed = source.kind() == io::ErrorKind::NotFound;
                }
                Err(_) => is_closed = false,
            }
            if is_closed && was_closed {
                return Err("it has ended; how was not received here");
            }
            // As long as no launcher leads the run, no other process could show it.
            if restart::holds_too_much() {
                self.viewers.close();
            }
            sleep_until(mono_now_ns() + LOOK_EVERY_NS);
        }
        Err(DEAD)
    }

    /// Reports the end to the viewers that are connected, and closes.
    fn finish(mut self, ending: Ending) {
        self.shared.picture().end(ending);
        self.viewers.close();
        self.http.await_last_look(LAST_LOOK_NS);
        self.dismiss.take();
        if let Some(watcher) = self.watcher.take() {
            let _ = watcher.join();
        }
    }
}

/// Gives a packed sample to viewers and picture as what it is.
struct HandOn<'a> {
    topic: &'static TopicInfo,
    packed: &'a [u8],
    viewers: &'a mut Viewers,
    picture: &'a mut Picture,
}

impl TopicVisitor for HandOn<'_> {
    type Error = core::convert::Infallible;

    fn visit<T: Sample>(&mut self, topic: &'static Topic<T>) -> Result<(), Self::Error> {
        if topic.info.name == self.topic.name && self.packed.len() == T::PACKED_SIZE {
            let sample = T::unpack(self.packed);
            self.viewers.sample(topic, &sample);
            self.picture.sample(topic, &sample);
        }
        Ok(())
    }
}

/// Asks the launcher for the status of the run now and then, for the page.
fn watch(
    run: Run,
    shared: Arc<Shared>,
    dismissed: Receiver<()>,
) -> std::io::Result<JoinHandle<()>> {
    Builder::new().name("status".to_owned()).spawn(move || {
        while dismissed.recv_timeout(STATUS_EVERY) == Err(RecvTimeoutError::Timeout) {
            let status = status(&run);
            shared.picture().status(status);
        }
    })
}

fn status(run: &Run) -> Option<RunStatus> {
    let reply = Conversation::ask(run, &Request::Ps).and_then(|mut asked| asked.receive());
    match reply {
        Ok(Reply::Status(status)) => Some(status),
        _ => None,
    }
}

/// An address that a browser on this machine can use.
fn reachable(address: SocketAddr) -> SocketAddr {
    let ip = match address.ip() {
        IpAddr::V4(ip) if ip.is_unspecified() => std::net::Ipv4Addr::LOCALHOST.into(),
        IpAddr::V6(ip) if ip.is_unspecified() => std::net::Ipv6Addr::LOCALHOST.into(),
        ip => ip,
    };
    SocketAddr::new(ip, address.port())
}

/// Address with which this machine would turn to others, of those it has in the family of `any`.
fn outward(any: IpAddr) -> Option<IpAddr> {
    // Kept for documentation (RFC 5737, RFC 3849); nothing is sent to it.
    let far = |ip: IpAddr| -> IpAddr {
        match ip {
            IpAddr::V4(_) => std::net::Ipv4Addr::new(192, 0, 2, 1).into(),
            IpAddr::V6(_) => std::net::Ipv6Addr::new(0x2001, 0xdb8, 0, 0, 0, 0, 0, 1).into(),
        }
    };
    // A socket that listens on all of IPv6 listens on all of IPv4, too.
    let families = [any, std::net::Ipv4Addr::UNSPECIFIED.into()];
    let mut own = families.into_iter().filter_map(|family| {
        let socket = UdpSocket::bind((family, 0)).ok()?;
        socket.connect((far(family), 9)).ok()?;
        Some(socket.local_addr().ok()?.ip())
    });
    own.find(|ip| !ip.is_loopback() && !ip.is_unspecified())
}
