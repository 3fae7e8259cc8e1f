//! The charts of the page, before they have data.

use super::envelope::Envelope;
use figures::figure::{Colour, Dash};
use shared_types::Role;

/// One pair of axes over time.
#[derive(Debug)]
pub(crate) struct Panel {
    pub(crate) title: &'static str,
    /// Of the vertical axis.
    pub(crate) unit: &'static str,
    /// Logarithmic vertical axis.
    pub(crate) log: bool,
    /// Lines right across.
    pub(crate) levels: Vec<(&'static str, f64)>,
    pub(crate) series: Vec<Series>,
}

/// One line of a chart.
#[derive(Debug)]
pub(crate) struct Series {
    pub(crate) name: &'static str,
    pub(crate) colour: Colour,
    pub(crate) dash: Dash,
    /// Of a constraint: may be left out when the axis is scaled.
    pub(crate) is_bound: bool,
    pub(crate) envelope: Envelope,
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
    pub(crate) fn put(&mut self, place: usize, t_ns: u64, value: f64) {
        if let Some(series) = self.series.get_mut(place) {
            series.envelope.put(t_ns, value);
        }
    }

    /// Adds one value each to the series from `first` on.
    pub(crate) fn put_all<const N: usize>(&mut self, first: usize, t_ns: u64, values: [f64; N]) {
        for (i, value) in values.into_iter().enumerate() {
            self.put(first + i, t_ns, value);
        }
    }

    /// True if a series has a value that is not zero.
    pub(crate) fn is_worth_showing(&self) -> bool {
        let mut values = self.series.iter().flat_map(|series| series.envelope.bins().2).flatten();
        values.any(|value| !value.is_nan() && *value != 0.0)
    }

    /// True if no series has a value.
    pub(crate) fn is_empty(&self) -> bool {
        self.series.iter().all(|series| series.envelope.bins().2.is_empty())
    }
}

/// What is most of a bound that was used, 1 if all of it.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Uses {
    /// Of the torque about x, y, z.
    pub(crate) torque: [f64; 3],
    pub(crate) increment: [f64; 3],
    /// Of the collective thrust.
    pub(crate) thrust: f64,
    pub(crate) tilt: f64,
    /// Of a rotor's largest thrust.
    pub(crate) rotor: f64,
    /// The strongest wind \[m/s\].
    pub(crate) wind_max_m_s: f64,
}

/// Every chart, by what it shows.
#[derive(Debug)]
pub(crate) struct Panels {
    /// Error of the position along x, y, z.
    pub(crate) error: Panel,
    /// Roll, pitch, yaw, and then their set points.
    pub(crate) attitude: Panel,
    /// Deployable angle, and its command.
    pub(crate) morph: Panel,
    /// Of each axis: torque applied, lower and upper bound.
    pub(crate) torque: [Panel; 3],
    /// Share of its bound that each axis' increment takes.
    pub(crate) increment: Panel,
    /// Collective thrust applied, that of the set point, and its bounds.
    pub(crate) thrust: Panel,
    /// Pitch and roll set points of the position loop, and their bounds.
    pub(crate) tilt: Panel,
    /// Thrust of each rotor.
    pub(crate) rotors: Panel,
    /// Wind along x, y, z.
    pub(crate) wind: Panel,
    /// External force along x, y, z.
    pub(crate) force: Panel,
    /// External torque along x, y, z.
    pub(crate) moment: Panel,
    /// Error of the estimated position, and three sigma.
    pub(crate) estimate: Panel,
    /// Start of a step after its release, by loop.
    pub(crate) lateness: Panel,
    /// Length of a step, by loop.
    pub(crate) compute: Panel,
    /// Steps without final inputs and releases left out so far, by loop.
    pub(crate) misses: Panel,
}

/// Loops whose health is shown, in the order of the series.
pub(crate) const LOOPS: [Role; 4] = [Role::Plant, Role::Estimator, Role::Position, Role::Attitude];
const LOOP_COLOURS: [Colour; 4] = [Colour::Black, Colour::Green, Colour::Orange, Colour::Blue];

impl Panels {
    /// With what the vehicle can do.
    pub(crate) fn new(rotor_thrust_max_n: f64) -> Self {
        let torque = [("Torque, roll", "τx"), ("Torque, pitch", "τy"), ("Torque, yaw", "τz")];
        let by_loop =
            |title, unit| Panel::new(title, unit).lines(LOOPS.map(Role::label), LOOP_COLOURS);
        let along = |title, unit| Panel::new(title, unit).lines(["x", "y", "z"], XYZ);
        let attitude = Panel::new("Attitude", "°").lines(["roll φ", "pitch θ", "yaw ψ"], XYZ);
        let set_points = ["φ set", "θ set", "ψ set"].into_iter().zip(XYZ);
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
            lateness: by_loop("Start after release, slowest", "µs").log(),
            compute: by_loop("Length of a step, slowest", "µs").log(),
            misses: by_loop("Missed deadlines and skipped releases so far", "1"),
        }
    }

    /// In the order of the page, with the name of the group that each begins.
    pub(crate) fn in_order(&self) -> Vec<(&'static str, &Panel)> {
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
