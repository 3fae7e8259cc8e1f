//! The runtime: its rules, a network of it in one process, and its transport.

mod authority;
mod contract;
mod ipc;
mod network;
