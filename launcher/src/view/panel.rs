//! The charts of the page, before they have data.

use super::envelope::Envelope;
use crate::figure::{Colour, Dash};

/// One pair of axes over time.
#[derive(Debug)]
pub(super) struct Panel {
    pub(super) title: &'static str,
    /// Of the vertical axis.
    pub(super) unit: &'static str,
    /// Logarithmic vertical axis.
    pub(super) log: bool,
    /// Lines right across.
    pub(super) levels: Vec<(&'static str, f64)>,
    pub(super) series: Vec<Series>,
}

/// One line of a chart.
#[derive(Debug)]
pub(super) struct Series {
    pub(super) name: &'static str,
    pub(super) colour: Colour,
    pub(super) dash: Dash,
    /// Of a constraint: may be left out when the axis is scaled.
    pub(super) is_bound: bool,
    pub(super) envelope: Envelope,
}

/// First three colours of an axis triple.
const XYZ: [Colour; 3] = [Colour::Blue, Colour::Orange, Colour::Green];

impl Panel {
    fn new(title: &'static str, unit: &'static str) -> Self {
        Self { title, unit, log: false, levels: Vec::new(), series: Vec::new() }
    }

    fn level(mut self, name: &'static str, at: f64) -> Self {
        if at.is_finite() {
            self.levels.push((name, at));
        }
        self
    }

    fn log(mut self) -> Self {
        self.log = true;
        self
    }

    fn line(self, name: &'static str, colour: Colour) -> Self {
        self.dashed(name, colour, Dash::Solid)
    }

    fn dashed(mut self, name: &'static str, colour: Colour, dash: Dash) -> Self {
        let envelope = Envelope::default();
        self.series.push(Series { name, colour, dash, is_bound: false, envelope });
        self
    }

    fn bound(mut self, name: &'static str) -> Self {
        let (colour, dash, envelope) = (Colour::Red, Dash::Dashed, Envelope::default());
        self.series.push(Series { name, colour, dash, is_bound: true, envelope });
        self
    }

    fn lines<const N: usize>(self, names: [&'static str; N], colours: [Colour; N]) -> Self {
        names.into_iter().zip(colours).fold(self, |panel, (name, colour)| panel.line(name, colour))
    }

    /// Adds a value to the series at `place`.
    pub(super) fn put(&mut self, place: usize, t_ns: u64, value: f64) {
        if let Some(series) = self.series.get_mut(place) {
            series.envelope.put(t_ns, value);
        }
    }

    /// Adds one value each to the series from `first` on.
    pub(super) fn put_all<const N: usize>(&mut self, first: usize, t_ns: u64, values: [f64; N]) {
        for (i, value) in values.into_iter().enumerate() {
            self.put(first + i, t_ns, value);
        }
    }

    /// True if no series has a value.
    pub(super) fn is_empty(&self) -> bool {
        self.series.iter().all(|series| series.envelope.bins().2.is_empty())
    }
}

/// Every chart, by what it shows.
#[derive(Debug)]
pub(super) struct Panels {
    /// Error of the position along x, y, z.
    pub(super) error: Panel,
    /// Roll, pitch, yaw, and then their set points.
    pub(super) attitude: Panel,
    /// Deployable angle, and its command.
    pub(super) morph: Panel,
    /// Of each axis: torque applied, lower and upper bound.
    pub(super) torque: [Panel; 3],
    /// Share of its bound that each axis' increment takes.
    pub(super) increment: Panel,
    /// Collective thrust applied, that of the set point, and its bounds.
    pub(super) thrust: Panel,
    /// Pitch and roll set points of the position loop, and their bounds.
    pub(super) tilt: Panel,
    /// Thrust of each rotor.
    pub(super) rotors: Panel,
    /// Wind along x, y, z.
    pub(super) wind: Panel,
    /// External force along x, y, z.
    pub(super) force: Panel,
    /// External torque along x, y, z.
    pub(super) moment: Panel,
    /// Error of the estimated position, and three sigma.
    pub(super) estimate: Panel,
    /// Start of a step after its release, by loop.
    pub(super) lateness: Panel,
    /// Length of a step, by loop.
    pub(super) compute: Panel,
    /// Steps without final inputs and releases left out so far, by loop.
    pub(super) misses: Panel,
}

/// Loops whose health is shown, in the order of the series.
pub(super) const LOOPS: [&str; 4] = ["plant", "estimator", "position", "attitude"];
const LOOP_COLOURS: [Colour; 4] = [Colour::Black, Colour::Green, Colour::Orange, Colour::Blue];

impl Panels {
    /// With what the vehicle can do.
    pub(super) fn new(rotor_thrust_max_n: f64) -> Self {
        let torque = [("Torque, roll", "τx"), ("Torque, pitch", "τy"), ("Torque, yaw", "τz")];
        let by_loop = |title, unit| Panel::new(title, unit).lines(LOOPS, LOOP_COLOURS);
        let along = |title, unit| Panel::new(title, unit).lines(["x", "y", "z"], XYZ);
        let attitude = Panel::new("Attitude", "°").lines(["roll φ", "pitch θ", "yaw ψ"], XYZ);
        let set_points = ["φ set point", "θ set point", "ψ set point"].into_iter().zip(XYZ);
        Self {
            error: along("Position error", "mm"),
            attitude: set_points.fold(attitude, |panel, (n, c)| panel.dashed(n, c, Dash::Dotted)),
            morph: Panel::new("Deployable angle β", "°")
                .line("β", Colour::Purple)
                .dashed("command", Colour::Black, Dash::Dotted)
                .level("smallest", 45.0)
                .level("largest", 160.0),
            torque: [0, 1, 2].map(|i| {
                let (title, name) = torque[i];
                Panel::new(title, "N m").line(name, XYZ[i]).bound("bounds").bound("")
            }),
            increment: Panel::new("Torque increment / its bound", "1")
                .lines(["Δτx", "Δτy", "Δτz"], XYZ)
                .level("bound", 1.0)
                .level("", -1.0),
            thrust: Panel::new("Collective thrust", "N")
                .line("T", Colour::Blue)
                .dashed("set point", Colour::Black, Dash::Dotted)
                .bound("bounds")
                .bound(""),
            tilt: Panel::new("Tilt asked for", "°")
                .lines(["θ", "φ"], [Colour::Orange, Colour::Blue])
                .bound("bounds")
                .bound(""),
            rotors: Panel::new("Rotor thrusts", "N")
                .lines(
                    ["1 front", "2 left", "3 rear", "4 right"],
                    [Colour::Blue, Colour::Orange, Colour::Green, Colour::Purple],
                )
                .level("bounds", rotor_thrust_max_n)
                .level("", 0.0),
            wind: along("Wind", "m/s"),
            force: along("External force", "N"),
            moment: along("External torque", "N m"),
            estimate: Panel::new("Error of the estimated position", "mm")
                .line("error", Colour::Blue)
                .dashed("3 σ", Colour::Red, Dash::Dashed),
            lateness: by_loop("Start after release", "µs").log(),
            compute: by_loop("Step, start to publication", "µs").log(),
            misses: by_loop("Missed deadlines and skipped releases so far", "1"),
        }
    }

    /// In the order of the page, with the name of the group that each begins.
    pub(super) fn in_order(&self) -> Vec<(&'static str, &Panel)> {
        let [roll, pitch, yaw] = &self.torque;
        vec![
            ("Flight", &self.error),
            ("", &self.attitude),
            ("", &self.morph),
            ("Constraints", roll),
            ("", pitch),
            ("", yaw),
            ("", &self.increment),
            ("", &self.thrust),
            ("", &self.tilt),
            ("", &self.rotors),
            ("Disturbance", &self.wind),
            ("", &self.force),
            ("", &self.moment),
            ("Estimator", &self.estimate),
            ("Loops", &self.lateness),
            ("", &self.compute),
            ("", &self.misses),
        ]
    }
}
