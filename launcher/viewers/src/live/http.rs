//! Page and orders over HTTP. Any client that reaches the address may look; one that holds the token may order.

use super::token::Token;
use super::{LiveError, Shared};
use crate::view::live_page;
use crate::web::{Answer, Asked, WebServer};
use hyper::{Method, StatusCode};
use protocol::control::client::{AskError, Conversation};
use protocol::control::protocol::{Done, Reason, Refusal};
use protocol::control::runs::Run;
use protocol::control::status::{ProcessState, ProcessStatus};
use protocol::control::{Reply, Request};
use runtime::clock::{mono_now_ns, sleep_until};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::json;
use shared_types::Slot;
use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// How often to look whether every page has shown the end \[ns\].
const LOOK_EVERY_NS: u64 = 20_000_000;
/// A page that asked within this time is still looking: a hidden one asks every two seconds, and one on a
/// busy machine when it can \[ns\].
const LOOKING_NS: u64 = 20_000_000_000;
/// More pages than that are not waited for.
const PAGES_MAX: usize = 64;
/// Nor is one that gives itself a longer name.
const NAME_MAX: usize = 32;
/// Path with which a browser is started, before the secret.
const OPEN_PATH: &str = "/open/";

/// The page's server.
#[derive(Debug)]
pub(super) struct HttpApi {
    server: WebServer,
    counter: Arc<Counter>,
}

/// What every answer needs.
#[derive(Debug)]
struct Counter {
    run: Run,
    token: Token,
    /// Stands in the address with which a browser is started: all users can read its command line.
    open_secret: Token,
    shared: Arc<Shared>,
    /// Of a demo: what configures its bad controller.
    demo: Option<PathBuf>,
    pages: Mutex<Pages>,
}

/// Open pages by name, and when each asked last on `CLOCK_MONOTONIC` \[ns\].
#[derive(Debug, Default)]
struct Pages(BTreeMap<String, u64>);

impl Pages {
    fn asked(&mut self, name: &str, now_ns: u64) {
        self.0.retain(|_, asked_ns| now_ns.saturating_sub(*asked_ns) < LOOKING_NS);
        let has_room = self.0.len() < PAGES_MAX || self.0.contains_key(name);
        if has_room && name.len() <= NAME_MAX {
            self.0.insert(name.to_owned(), now_ns);
        }
    }

    fn closed(&mut self, name: &str) {
        self.0.remove(name);
    }

    /// True while a page is open. One that has shown the end closes: only the page itself knows that an
    /// answer has arrived and could be used.
    fn are_open(&self, now_ns: u64) -> bool {
        self.0.values().any(|asked_ns| now_ns.saturating_sub(*asked_ns) < LOOKING_NS)
    }
}

impl HttpApi {
    pub(super) fn open(
        address: SocketAddr,
        run: Run,
        token: Token,
        (shared, demo): (Arc<Shared>, Option<PathBuf>),
    ) -> Result<Self, LiveError> {
        let open_secret =
            Token::random().map_err(|cause| LiveError::System { action: "make a token", cause })?;
        let pages = Mutex::default();
        let counter = Arc::new(Counter { run, token, open_secret, shared, demo, pages });
        let theirs = Arc::clone(&counter);
        let answer = move |address: SocketAddr, asked: &Asked| theirs.answer(address, asked);
        let server = WebServer::open(address, answer);
        let server =
            server.map_err(|cause| LiveError::Address { address, cause: cause.to_string() });
        Ok(Self { server: server?, counter })
    }

    pub(super) fn address(&self) -> SocketAddr {
        self.server.address()
    }

    /// Path from which a browser of this user, or of root, is redirected to the page with its token.
    pub(super) fn open_path(&self) -> String {
        format!("{OPEN_PATH}{}", self.counter.open_secret.as_str())
    }

    /// Waits until every page that is open has shown the end, at most so long.
    pub(super) fn await_last_look(&self, limit_ns: u64) {
        let give_up_ns = mono_now_ns() + limit_ns;
        while mono_now_ns() < give_up_ns && self.counter.pages().are_open(mono_now_ns()) {
            sleep_until(mono_now_ns() + LOOK_EVERY_NS);
        }
    }
}

impl Counter {
    /// Each page stands for itself, whatever happened to the thread that held them.
    fn pages(&self) -> MutexGuard<'_, Pages> {
        self.pages.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn answer(&self, address: SocketAddr, asked: &Asked) -> Answer {
        if !asked.is_for(address) {
            let reason = format!("this flight is shown at {address}, by its number");
            return Answer::refusal(StatusCode::FORBIDDEN, reason);
        }
        match (&asked.method, asked.path.as_str()) {
            (&Method::GET | &Method::HEAD, "/") => {
                let flight = self.shared.picture().whole();
                Answer::page(live_page(&flight))
            }
            (&Method::GET | &Method::HEAD, path) if path.starts_with(OPEN_PATH) => {
                self.redirect(asked)
            }
            (&Method::GET | &Method::HEAD, "/flight") => self.flight(&asked.query),
            (&Method::POST, "/control") => self.order(asked),
            (&Method::POST, "/demo") => self.demonstrate(asked),
            (&Method::POST, "/close") => {
                self.pages().closed(value(&asked.query, "page").unwrap_or_default());
                Answer::json("{}".to_owned())
            }
            (_, "/control" | "/close" | "/demo") => {
                Answer::refusal(StatusCode::METHOD_NOT_ALLOWED, "this is posted")
            }
            (_, "/" | "/flight") => {
                Answer::refusal(StatusCode::METHOD_NOT_ALLOWED, "this can only be read")
            }
            _ => {
                Answer::refusal(StatusCode::NOT_FOUND, "there are /, /flight, /control and /close")
            }
        }
    }

    /// Leads the browser that was started with the secret to the page with its token.
    fn redirect(&self, asked: &Asked) -> Answer {
        let shown = asked.path.strip_prefix(OPEN_PATH).unwrap_or_default();
        if self.open_secret.is(shown) && asked.is_by_own_user() {
            return Answer::see_other(format!("/#token={}", self.token.as_str()));
        }
        let reason = "the system does not show that this browser is yours: open the address that the terminal shows";
        Answer::refusal(StatusCode::FORBIDDEN, reason)
    }

    fn flight(&self, query: &str) -> Answer {
        let since = value(query, "since_s").map(|text| (text, text.parse::<f64>()));
        let events = value(query, "events").map_or(Ok(0), str::parse::<usize>);
        let flight = match (since, events) {
            (None, _) => self.shared.picture().whole(),
            (Some((_, Ok(since_s))), Ok(events)) if since_s.is_finite() => {
                self.shared.picture().since(since_s, events)
            }
            (Some((text, _)), _) => {
                let reason =
                    format!("since_s={text}: give seconds of flight, and events= a number");
                return Answer::refusal(StatusCode::BAD_REQUEST, reason);
            }
        };
        let page = value(query, "page").unwrap_or_default();
        self.pages().asked(page, mono_now_ns());
        Answer::json(flight.to_string())
    }

    /// Why the client may not order, if so.
    fn without_token(&self, asked: &Asked) -> Option<Answer> {
        let has_token = asked.bearer.as_ref().is_some_and(|shown| self.token.is(shown));
        let reason = "orders need the token that stands in the address as it was printed";
        (!has_token).then(|| Answer::refusal(StatusCode::FORBIDDEN, reason))
    }

    /// What a demo offers beyond the orders of every flight: a bad controller, and the death of a good one.
    fn demonstrate(&self, asked: &Asked) -> Answer {
        if let Some(refusal) = self.without_token(asked) {
            return refusal;
        }
        let Some(config) = &self.demo else {
            return Answer::refusal(StatusCode::NOT_FOUND, "this flight is not a demo");
        };
        let replies = match asked.body.as_deref() {
            Some(b"bad") => {
                let swap = json!({ "request": "swap", "slot": "attitude", "to": "attitude-pid", "config": config.to_string_lossy() });
                serde_json::from_value(swap).map(|swap| self.replies(&swap))
            }
            Some(b"kill") => Ok(self.kill_owner()),
            _ => {
                let reason = "a demo has `bad` and `kill`";
                return Answer::refusal(StatusCode::BAD_REQUEST, reason);
            }
        };
        match replies {
            Ok(Ok(replies)) => Answer::json(json!({ "replies": replies }).to_string()),
            Ok(Err(error)) => Answer::refusal(StatusCode::SERVICE_UNAVAILABLE, error),
            Err(error) => Answer::refusal(StatusCode::BAD_REQUEST, error),
        }
    }

    /// Kills the process that commands the attitude.
    fn kill_owner(&self) -> Result<Vec<Reply>, AskError> {
        let mut replies = self.replies(&Request::Ps)?;
        let Some(Reply::Status(status)) = replies.pop() else { return Ok(replies) };
        let slot = Slot::Attitude.label().to_owned();
        let is_owner =
            |process: &&ProcessStatus| process.role == slot && process.state == ProcessState::Owner;
        let owner = status.processes.iter().find(is_owner);
        let pid = owner.and_then(|owner| Pid::from_raw(i32::try_from(owner.pid?).ok()?));
        let killed = pid.and_then(|pid| kill_process(pid, Signal::KILL).ok());
        let reply = match (owner, killed) {
            (Some(owner), Some(())) => {
                let text = format!("process {} is killed, {}", owner.pid.unwrap_or(0), owner.name);
                Reply::Done(Done { slot, outcome: "killed".to_owned(), text })
            }
            _ => Reply::Refused(Refusal::new(Reason::Busy, "just now no process commands")),
        };
        Ok(vec![reply])
    }

    /// Passes an order on to the launcher and waits for its last reply.
    fn order(&self, asked: &Asked) -> Answer {
        if let Some(refusal) = self.without_token(asked) {
            return refusal;
        }
        let bad =
            |reason: &dyn core::fmt::Display| Answer::refusal(StatusCode::BAD_REQUEST, reason);
        let Some(body) = &asked.body else {
            return bad(&"an order has at most 16384 bytes");
        };
        let request = match serde_json::from_slice::<Request>(body) {
            Ok(request) => request,
            Err(error) => return bad(&format!("not an order: {error}")),
        };
        if !names_no_file(&request) {
            return bad(
                &"from here, controllers are known by name: for files use `morphquad swap`",
            );
        }
        match self.replies(&request) {
            Ok(replies) => Answer::json(json!({ "replies": replies }).to_string()),
            Err(error) => Answer::refusal(StatusCode::SERVICE_UNAVAILABLE, error),
        }
    }

    fn replies(&self, request: &Request) -> Result<Vec<Reply>, AskError> {
        let mut conversation = Conversation::ask(&self.run, request)?;
        let mut replies = Vec::new();
        loop {
            replies.push(conversation.receive()?);
            if replies.last().is_some_and(Reply::is_last) {
                return Ok(replies);
            }
            conversation.be_patient();
        }
    }
}

/// The value of `key` in a query.
fn value<'a>(query: &'a str, key: &str) -> Option<&'a str> {
    query.split('&').find_map(|pair| pair.strip_prefix(key)?.strip_prefix('='))
}

/// A browser names no file of this machine, whatever it shows. A name that is not a service's may be that of an executable
/// that was put beside this one or on the search path to be started by name.
fn names_no_file(request: &Request) -> bool {
    match request {
        Request::Swap(order) => order.config.is_none() && !order.to.contains('/'),
        Request::Standby { name, .. } => !name.contains('/'),
        _ => true,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND_NS: u64 = 1_000_000_000;

    #[test]
    fn an_open_page_is_waited_for_until_it_closes_or_asks_no_more() {
        let mut pages = Pages::default();
        assert!(!pages.are_open(SECOND_NS), "none has asked");
        pages.asked("quick", SECOND_NS);
        pages.asked("slow", SECOND_NS);
        pages.closed("quick");
        assert!(pages.are_open(7 * SECOND_NS), "one has not shown the end");
        assert!(!pages.are_open(SECOND_NS + LOOKING_NS), "it asks no more");
        pages.asked("slow", 7 * SECOND_NS);
        pages.closed("slow");
        assert!(!pages.are_open(7 * SECOND_NS), "both have shown it");
    }

    #[test]
    fn strangers_cannot_fill_the_memory_with_pages() {
        let mut pages = Pages::default();
        for i in 0..1000 {
            pages.asked(&i.to_string(), SECOND_NS);
        }
        pages.asked(&"x".repeat(1000), SECOND_NS);
        assert_eq!(pages.0.len(), PAGES_MAX);
        pages.asked("0", 2 * SECOND_NS);
        assert_eq!(pages.0["0"], 2 * SECOND_NS, "a page that is known stays known");
    }
}
