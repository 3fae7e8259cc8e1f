//! Page and orders over HTTP. Anybody who reaches the address may look; who holds the token may order.

use super::token::Token;
use super::{LiveError, Shared};
use crate::view::live_page;
use crate::web::{Answer, Asked, WebServer};
use hyper::{Method, StatusCode};
use protocol::control::client::{AskError, Conversation};
use protocol::control::runs::Run;
use protocol::control::{Reply, Request};
use runtime::clock::{mono_now_ns, sleep_until};
use serde_json::json;
use std::collections::BTreeMap;
use std::net::SocketAddr;
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

/// The page's server.
#[derive(Debug)]
pub(super) struct Desk {
    server: WebServer,
    counter: Arc<Counter>,
}

/// What every answer needs.
#[derive(Debug)]
struct Counter {
    run: Run,
    token: Token,
    shared: Arc<Shared>,
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

impl Desk {
    pub(super) fn open(
        address: SocketAddr,
        run: Run,
        token: Token,
        shared: Arc<Shared>,
    ) -> Result<Self, LiveError> {
        let counter = Arc::new(Counter { run, token, shared, pages: Mutex::default() });
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

    /// Waits until every page that is open has shown the end, at most so long.
    pub(super) fn await_last_look(&self, limit_ns: u64) {
        let give_up_ns = mono_now_ns() + limit_ns;
        while mono_now_ns() < give_up_ns && self.counter.pages().are_open(mono_now_ns()) {
            sleep_until(mono_now_ns() + LOOK_EVERY_NS);
        }
    }
}

impl Counter {
    /// Each page stands for itself, whatever happened to whoever held them.
    fn pages(&self) -> MutexGuard<'_, Pages> {
        self.pages.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn answer(&self, address: SocketAddr, asked: &Asked) -> Answer {
        if !asked.is_for(address) {
            let told = format!("this flight is shown at {address}, by its number");
            return Answer::refusal(StatusCode::FORBIDDEN, told);
        }
        match (&asked.method, asked.path.as_str()) {
            (&Method::GET | &Method::HEAD, "/") => {
                let flight = self.shared.picture().whole();
                Answer::page(live_page(&flight))
            }
            (&Method::GET | &Method::HEAD, "/flight") => self.flight(&asked.query),
            (&Method::POST, "/control") => self.order(asked),
            (&Method::POST, "/close") => {
                self.pages().closed(value(&asked.query, "page").unwrap_or_default());
                Answer::json("{}".to_owned())
            }
            (_, "/control" | "/close") => {
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

    fn flight(&self, query: &str) -> Answer {
        let since = value(query, "since_s").map(|text| (text, text.parse::<f64>()));
        let events = value(query, "events").map_or(Ok(0), str::parse::<usize>);
        let flight = match (since, events) {
            (None, _) => self.shared.picture().whole(),
            (Some((_, Ok(since_s))), Ok(events)) if since_s.is_finite() => {
                self.shared.picture().since(since_s, events)
            }
            (Some((text, _)), _) => {
                let told = format!("since_s={text}: give seconds of flight, and events= a number");
                return Answer::refusal(StatusCode::BAD_REQUEST, told);
            }
        };
        let page = value(query, "page").unwrap_or_default();
        self.pages().asked(page, mono_now_ns());
        Answer::json(flight.to_string())
    }

    /// Passes an order on to the launcher and waits for its last word.
    fn order(&self, asked: &Asked) -> Answer {
        if !asked.bearer.as_ref().is_some_and(|shown| self.token.is(shown)) {
            let told = "orders need the token that stands in the address as it was printed";
            return Answer::refusal(StatusCode::FORBIDDEN, told);
        }
        let bad = |told: &dyn core::fmt::Display| Answer::refusal(StatusCode::BAD_REQUEST, told);
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
            replies.push(conversation.hear()?);
            if replies.last().is_some_and(Reply::is_last) {
                return Ok(replies);
            }
            conversation.be_patient();
        }
    }
}

/// What a query says of `key`.
fn value<'a>(query: &'a str, key: &str) -> Option<&'a str> {
    query.split('&').find_map(|pair| pair.strip_prefix(key)?.strip_prefix('='))
}

/// A browser starts no executable and reads no file of this machine, whatever it shows.
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
