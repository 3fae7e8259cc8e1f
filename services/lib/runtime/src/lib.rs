//! Loops, ports, clocks, timing and ownership shared by every morphquad process.
