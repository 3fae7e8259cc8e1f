//! The plant as a component, and what it obeys.

mod component;
mod obey;
