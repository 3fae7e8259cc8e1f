//! The morphquad command: conductor, pilot, supervisor and recorder.
//!
//! [`scenario`] says what is flown; [`components`] turns it into
//! flying components; [`process`] is one of them in its own process; [`run`] starts, conducts,
//! supervises, records and sums up a flight, and [`control`] lets others ask it; [`pilot`] flies along
//! in the launcher itself, and [`orders`] lead it elsewhere.
//! [`topic`] lets others look at topics, live and recorded.
//! [`replay`] flies a recording again, [`trace`] follows its commands to their sensor,
//! [`doctor`] looks at the machine; [`in_process`] flies in a single thread, [`campaign`] many
//! such flights, on all cores by [`mod@fan_out`]. [`figure`] and [`results`] are pictures and result files. [`mod@bench`] measures latencies. [`new_controller`] and [`types`] are for users'
//! own controllers, in Rust and in other languages.

pub mod bench;
pub mod branch;
pub mod build;
pub mod campaign;
pub mod candidate;
pub mod components;
pub mod control;
pub mod doctor;
pub mod fan_out;
pub use figures::{figure, results};
pub mod in_process;
pub mod new_controller;
pub mod orders;
mod own_executable;
pub use ::pilot;
pub mod process;
pub mod record;
pub mod rehearse;
pub mod replay;
pub mod run;
pub mod scenario;
pub mod scene;
pub mod topic;
pub mod trace;
pub mod types;

pub use host::{exit, name_thread};
