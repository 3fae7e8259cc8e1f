//! Samples that cross a process boundary, and the floor plan of topics.
