//! The faults that a controller can have, and the list of those that are tested.

use serde::{Deserialize, Serialize};
use shared_types::Slot;

/// Kind of fault. Where thrust is affected, its deviation from the weight is.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Fault {
    /// No fault.
    #[default]
    Nothing,
    /// One axis has the wrong sign.
    WrongSign,
    /// Roll and pitch are exchanged.
    Exchanged,
    /// All axes are multiplied by this factor.
    Gain,
    /// The first command is repeated for ever.
    Frozen,
    /// Commands have an additional delay of this many seconds.
    Delay,
    /// Commands contain NaN.
    NotANumber,
    /// This share of the largest command is added to roll and pitch.
    Bias,
    /// Roll and pitch have the wrong sign beyond this tilt in degrees.
    Diverges,
    /// Roll and pitch have the wrong sign once the arms have moved.
    UntilMorph,
    /// A bias on roll and pitch grows by this share of the largest command per second.
    Leak,
    /// The thrust is this many weights.
    Thrust,
    /// Roll and pitch, or the axis alone, are this many of the largest command at once, with twice the weight's thrust.
    Slams,
    /// The same, while the set point that is reported as tracked is zero.
    SlamsAndReportsZero,
    /// Roll and pitch change between this many of the largest command and its opposite every 50 ms.
    Sways,
    /// The heading turns by this many radians per second.
    Spins,
    /// The set point that is reported as tracked is zero.
    ReportsZero,
    /// It is the one with which the fault began.
    ReportsFrozen,
    /// It has no thrust.
    ReportsNoThrust,
    /// It is said to be the fallback's, as if the position slot's owner had failed.
    ReportsFailOver,
    /// The position slot's owner is said to have tripped.
    ReportsTrip,
    /// It is said to be of an epoch that has not come.
    ReportsEpoch,
    /// Each record of the position slot that comes is said to be refused.
    ReportsRefusal,
    /// Roll and pitch are about the axes of the world, not of the body.
    WorldFrame,
    /// The reference is not received any more; of a position controller alone.
    NoReferences,
    /// The vehicle is believed to move to the west at this speed \[m/s\], and is flown to the east against it.
    WalksAway,
    /// The process ends.
    Exits,
    /// It publishes nothing any more.
    Silent,
    /// Trips of the other slot's owner are not received, from the first step on; of an attitude controller alone.
    IgnoresTrips,
    /// Each step sleeps for this many periods; for realtime flights only.
    Slow,
    /// The first command comes this many seconds after the first step; for realtime flights only.
    LateStart,
}

/// An entry of the catalogue, which is also the content of a configuration file of the executable.
#[derive(Debug, Clone, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct Entry {
    /// Name of the shipped controller that gets the fault; the first of the slot if left out.
    pub law: Option<String>,
    /// Kind of fault.
    pub fault: Fault,
    /// Axis of a wrong sign: 0 thrust, 1 roll, 2 pitch, 3 yaw.
    pub axis: usize,
    /// Size of the fault, in the unit that the kind of fault names.
    pub amount: f64,
    /// The fault begins this long after the first command \[s\].
    pub after_s: f64,
}

impl Entry {
    fn of(fault: Fault, axis: usize, amount: f64) -> Self {
        Self { law: None, fault, axis, amount, after_s: 0.0 }
    }

    /// The same fault, which begins `after_s` \[s\] after the first command.
    #[must_use]
    pub fn after(self, after_s: f64) -> Self {
        Self { after_s, ..self }
    }

    /// The same fault in another law.
    #[must_use]
    pub fn around(&self, law: &str) -> Self {
        Self { law: Some(law.to_owned()), ..self.clone() }
    }

    /// Name of the entry in tables and messages.
    #[must_use]
    pub fn name(&self) -> String {
        let axis = ["thrust", "roll", "pitch", "yaw"].get(self.axis).copied().unwrap_or("?");
        let amount = self.amount;
        let fault = match self.fault {
            Fault::Nothing => "good".to_owned(),
            Fault::WrongSign => format!("wrong sign in {axis}"),
            Fault::Exchanged => "roll and pitch exchanged".to_owned(),
            Fault::Gain => format!("gain x{amount}"),
            Fault::Frozen => "frozen output".to_owned(),
            Fault::Delay => format!("{:.0} ms more delay", 1e3 * amount),
            Fault::NotANumber => "no number".to_owned(),
            Fault::Bias => format!("bias {:.0} %", 1e2 * amount),
            Fault::Diverges => format!("diverges beyond {amount} deg"),
            Fault::UntilMorph => "works until the arms fold".to_owned(),
            Fault::Leak => format!("leak {:.0} %/s", 1e2 * amount),
            Fault::Thrust => format!("thrust of {amount} weights"),
            Fault::Slams if self.axis > 0 => format!("slams x{amount} in {axis}"),
            Fault::Slams => format!("slams x{amount}"),
            Fault::SlamsAndReportsZero => format!("slams x{amount} and reports zero"),
            Fault::Sways => format!("sways x{amount}"),
            Fault::Spins => format!("spins at {amount} rad/s"),
            Fault::ReportsZero => "reports zero".to_owned(),
            Fault::ReportsFrozen => "reports one set point".to_owned(),
            Fault::ReportsNoThrust => "reports no thrust".to_owned(),
            Fault::ReportsFailOver => "reports a fail-over".to_owned(),
            Fault::ReportsTrip => "reports a trip".to_owned(),
            Fault::ReportsEpoch => "reports another epoch".to_owned(),
            Fault::ReportsRefusal => "reports that records are refused".to_owned(),
            Fault::WorldFrame => "roll and pitch of the world".to_owned(),
            Fault::NoReferences => "no more references".to_owned(),
            Fault::WalksAway => format!("walks away at {amount} m/s"),
            Fault::Exits => "ends".to_owned(),
            Fault::Silent => "silent".to_owned(),
            Fault::IgnoresTrips => "ignores trips".to_owned(),
            Fault::Slow => format!("steps of {:.0} % of the period", 1e2 * amount),
            Fault::LateStart => format!("first command after {amount} s"),
        };
        if self.after_s > 0.0 { format!("{fault} after {} s", self.after_s) } else { fault }
    }
}

/// Attitude controllers that are good or bad in ways that a position controller's fault finds out.
#[must_use]
pub fn entries_of_pairs() -> [Entry; 5] {
    let of = |fault| Entry::of(fault, 0, 0.0);
    [
        of(Fault::Nothing),
        of(Fault::IgnoresTrips),
        of(Fault::ReportsZero).after(9.0),
        of(Fault::ReportsFailOver).after(9.0),
        of(Fault::ReportsRefusal).after(2.0),
    ]
}

/// Entries with a fault that shows only in realtime.
#[must_use]
pub fn late_entries() -> [Entry; 2] {
    [Entry::of(Fault::Slow, 0, 1.2), Entry::of(Fault::LateStart, 0, 10.0)]
}

/// Entries that are faultless for longer than a rehearsal and a rollback window.
#[must_use]
pub fn patient_entries(slot: Slot) -> Vec<Entry> {
    /// Later than the flip, which depends on the rehearsal, and than the end of the rollback window.
    const AFTER_S: f64 = 4.0;
    let axis = |axis| Entry::of(Fault::WrongSign, axis, 0.0);
    let of = |fault, amount| Entry::of(fault, 0, amount);
    let mut all = vec![
        axis(1),
        axis(2),
        of(Fault::Exchanged, 0.0),
        of(Fault::Gain, 10.0),
        of(Fault::Frozen, 0.0),
        of(Fault::Delay, 0.06),
        of(Fault::NotANumber, 0.0),
        of(Fault::Bias, 0.2),
        of(Fault::Bias, -1.0),
        of(Fault::Leak, 0.2),
        of(Fault::Slams, 1.0),
        of(Fault::Slams, -2.0),
        Entry::of(Fault::Slams, 1, 1.0),
        of(Fault::Sways, 1.0),
        of(Fault::WorldFrame, 0.0),
        of(Fault::Exits, 0.0),
        of(Fault::Silent, 0.0),
        of(Fault::Thrust, 0.0),
        of(Fault::Thrust, 4.0),
    ];
    match slot {
        Slot::Attitude => all.extend([
            axis(3),
            of(Fault::SlamsAndReportsZero, 1.0),
            of(Fault::ReportsZero, 0.0),
            of(Fault::ReportsFrozen, 0.0),
            of(Fault::ReportsNoThrust, 0.0),
            of(Fault::ReportsFailOver, 0.0),
            of(Fault::ReportsTrip, 0.0),
            of(Fault::ReportsEpoch, 0.0),
        ]),
        Slot::Position => all.extend([
            axis(0),
            of(Fault::Spins, 1.0),
            of(Fault::Spins, 0.2),
            of(Fault::NoReferences, 0.0),
            of(Fault::WalksAway, 0.5),
        ]),
    }
    all.into_iter().map(|entry| entry.after(AFTER_S)).collect()
}

/// Every entry with a fault that shows in lockstep too.
#[must_use]
pub fn entries(slot: Slot) -> Vec<Entry> {
    // A position controller passes the heading of the reference through, so that its sign cannot be wrong.
    let signs = match slot {
        Slot::Attitude => [1, 2, 3],
        Slot::Position => [0, 1, 2],
    };
    let mut all: Vec<Entry> =
        signs.iter().map(|axis| Entry::of(Fault::WrongSign, *axis, 0.0)).collect();
    all.push(Entry::of(Fault::Exchanged, 0, 0.0));
    all.extend([0.2, 3.0, 10.0].map(|factor| Entry::of(Fault::Gain, 0, factor)));
    all.push(Entry::of(Fault::Frozen, 0, 0.0));
    all.extend([0.03, 0.06, 0.1].map(|delay_s| Entry::of(Fault::Delay, 0, delay_s)));
    all.push(Entry::of(Fault::NotANumber, 0, 0.0).after(0.7));
    all.extend([0.05, 0.2].map(|share| Entry::of(Fault::Bias, 0, share)));
    all.push(Entry::of(Fault::Diverges, 0, 10.0));
    all.push(Entry::of(Fault::UntilMorph, 0, 0.0));
    all.push(Entry::of(Fault::Leak, 0, 0.05));
    all
}
