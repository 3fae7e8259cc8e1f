//! The morphing quadrotor: geometry, inertia, dynamics, control allocation.
