//! The section `[rehearsal]`: how a swap candidate is flown ahead before it flies the vehicle.

use garde::Validate;
use rehearsal::Tube;
use schemars::JsonSchema;
use serde::Deserialize;

/// Whether, for how long and how strictly a swap is rehearsed.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields, default)]
pub struct RehearsalSettings {
    /// A candidate of another kind or build is rehearsed before the flip.
    #[garde(skip)]
    pub enabled: bool,
    /// Logical time of a rehearsed flight \[s\].
    #[garde(range(min = 1.0, max = 30.0))]
    pub duration_s: f64,
    /// Error that the candidate may have, over the owner's in the same flight, where the owner stays
    /// inside the envelope.
    #[garde(range(min = 1.0, max = 100.0))]
    pub owner_scale: f64,
    /// Share of the envelope below which no error counts.
    #[garde(range(min = 0.0, max = 1.0))]
    pub floor_share: f64,
    /// Distance from the reference that the envelope allows at most \[m\].
    #[garde(range(min = 0.01, max = 100.0))]
    pub excursion_max_m: f64,
    /// Tilt at which the vehicle counts as lost \[°\].
    #[garde(range(min = 10.0, max = 90.0))]
    pub tilt_max_deg: f64,
    /// Wall time after which the answer is "not rehearsed" \[s\].
    #[garde(range(min = 0.1, max = 600.0))]
    pub wall_max_s: f64,
}

impl Default for RehearsalSettings {
    fn default() -> Self {
        let Tube { owner_scale, excursion_max_m, tilt_max_rad, floor_share } = Tube::default();
        Self {
            enabled: true,
            duration_s: 3.0,
            owner_scale,
            floor_share,
            excursion_max_m,
            tilt_max_deg: tilt_max_rad.to_degrees(),
            wall_max_s: 15.0,
        }
    }
}

impl RehearsalSettings {
    /// How wide the tube is.
    #[must_use]
    pub fn tube(&self) -> Tube {
        Tube {
            owner_scale: self.owner_scale,
            excursion_max_m: self.excursion_max_m,
            tilt_max_rad: self.tilt_max_deg.to_radians(),
            floor_share: self.floor_share,
        }
    }
}
