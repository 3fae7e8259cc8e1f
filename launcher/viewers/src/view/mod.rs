//! A recording as a page: the vehicle in space, every constraint with its bounds, and what happened.
//!
//! `collect.rs` goes through the file once and keeps what fits a screen: `envelope.rs` time series with
//! every peak, `track.rs` frames of the moving picture, `happening.rs` events. [`Scene`] is all of that
//! as one JSON object, which is all that the page (`launcher/viewers/assets`) knows of a flight; `page.rs`
//! puts both into one file that needs no server, and `serve.rs` hands that file to a browser.

mod collect;
mod envelope;
mod happening;
pub(crate) mod json;
mod page;
mod panel;
mod scene;
mod serve;
mod track;

pub(crate) use collect::Collect;
pub(crate) use envelope::Envelope;
pub(crate) use happening::{Happening, Kind, Owners};
pub(crate) use page::live_page;
pub use page::page;
pub(crate) use panel::Panel;
pub(crate) use scene::{Gathered, gather};
pub use scene::{Scene, ViewError};
pub use serve::{ServeError, Server};
