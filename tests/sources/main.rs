//! Checks of the sources: what depends on what, and whether documents and templates agree with the code.

mod architecture;
mod circles;
mod docs;
mod new_controller;
mod scripts;
mod threads;
mod time;
mod words;
