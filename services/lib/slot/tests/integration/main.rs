//! The protocol of slots: every interleaving of it, and its gate.

mod model;
mod shadow;
