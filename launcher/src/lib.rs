//! A flight: [`run`] starts, conducts, supervises, records and sums it up, [`control`] lets others ask it, and
//! [`topic`] lets others look at topics, live and recorded. [`in_process`] flies in a single thread, [`rehearse`]
//! flies a swap ahead, [`replay`] flies a recording again and [`trace`] follows its commands to their sensor.

pub mod control;
pub mod fan_out;
pub mod in_process;
pub mod rehearse;
pub mod replay;
pub mod run;
pub mod topic;
pub mod trace;
