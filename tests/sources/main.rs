//! The sources themselves: what depends on what, and what documents and templates say of the code.

mod architecture;
mod circles;
mod docs;
mod new_controller;
mod scripts;
mod threads;
mod time;
mod words;
