//! Scripted wind, forces, torques and faults.
