//! What shows a flight: the page of a recording and of a running flight, the report, the terminal's dashboard, and
//! tables.
//!
//! [`view`] shows a recording as a page, [`report`] judges it, [`trace`] follows its commands back to their sensor,
//! [`export`] makes tables of it and [`plot`] pictures; [`live`] serves a running flight to a page and to viewers, and
//! [`top`] shows its loops in a terminal. All of them read recordings, topics and the control socket; nothing of a
//! flight knows them.

pub mod export;
pub mod live;
pub mod plot;
pub mod report;
pub mod top;
pub mod trace;
mod unit;
pub mod view;
mod web;
