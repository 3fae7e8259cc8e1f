//! How others talk with a running flight: its control socket and its feed of samples.
//!
//! [`control`] answers questions and takes orders, [`topic`] lets others look at the samples. Each holds both
//! ends. [`samples`] declares the samples for other languages.

pub mod control;
pub mod samples;
pub mod topic;
