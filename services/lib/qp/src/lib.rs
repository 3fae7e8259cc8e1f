//! Small dense convex quadratic programs for model predictive control.
