//! The plant as a component, and what it follows.

mod authority;
mod component;
