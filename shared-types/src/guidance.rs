//! pilot -> controllers and plant: where to go, and how wide to spread the arms.

use crate::{Header, sample};

/// Capacity of [`Reference::points`].
pub const REFERENCE_POINTS: usize = 48;
/// Capacity of [`MorphCommand::path_rad`].
pub const MORPH_PATH_POINTS: usize = 48;

sample! {
    /// One point of a reference trajectory.
    pub struct ReferencePoint {
        /// Position \[m\].
        pub position_w_m: [f64; 3],
        /// Velocity \[m/s\].
        pub velocity_w_m_s: [f64; 3],
        /// Heading, counter-clockwise from east \[rad\].
        pub yaw_rad: f64,
    }
}

sample! {
    /// Reference trajectory from the sample's instant on.
    pub struct Reference {
        /// Identity and time.
        pub header: Header,
        /// Time between points \[ns\].
        pub spacing_ns: u64,
        /// Number of points in use, at least 1.
        pub count: u64,
        /// Point i is due at `valid_ns + i * spacing_ns`.
        pub points: [ReferencePoint; REFERENCE_POINTS],
    }
}

sample! {
    /// Commanded deployable angle, with its planned path.
    pub struct MorphCommand {
        /// Identity and time.
        pub header: Header,
        /// Commanded angle now \[rad\].
        pub angle_rad: f64,
        /// Time between points of the path \[ns\].
        pub spacing_ns: u64,
        /// Number of points in use.
        pub count: u64,
        /// Angle planned at `valid_ns + i * spacing_ns` \[rad\].
        pub path_rad: [f64; MORPH_PATH_POINTS],
    }
}
