//! What a rehearsal begins with, and how it judges.

mod judge;
mod snapshot;
