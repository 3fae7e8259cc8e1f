//! The recording as its readers and the disk see it.

#![allow(clippy::unwrap_used, reason = "a set-up that fails is a failed test")]

mod fields;
mod file;
mod read;
mod recorder;
mod scene;
mod trouble;
