//! Incremental constrained MPC: prediction, constraints, condensing.
