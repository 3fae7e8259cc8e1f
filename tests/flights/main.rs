//! The real executable: what it flies, records, refuses and reports. One executable for all of these tests, because
//! each one more is compiled and linked with everything that they share; what changes the state of its own
//! process has one for itself beside this folder.

#[path = "../common/mod.rs"]
mod common;

mod adopt;
mod attitude_step;
mod bad_input;
mod bad_recordings;
mod bench;
mod branch;
mod campaign;
mod control;
mod doctor;
mod empty_objects;
mod faults;
mod gate;
mod in_process;
mod late_owners;
mod live;
mod lives;
mod lockstep;
mod memory;
mod orders;
mod paper;
mod processes;
mod realtime;
mod recordings;
mod refusals;
mod replay;
mod report;
mod storms;
mod study;
mod swap;
mod timing;
mod topic;
mod trace;
mod tracking;
mod verdict;
mod view;
