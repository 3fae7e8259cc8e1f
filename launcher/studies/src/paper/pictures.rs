//! Figures 3 to 6 of the paper with our curves.

use super::horizons::{self, Bars, DRAWN_WEIGHT, PAIRS, PRINTED_US};
use super::rig::Sample;
use super::step_rates::{PRINTED, ROTOR_CASES};
use super::{Run, SIZES, TARGET_RAD, label, sizes, step_rates};
use figures::figure::{self, Axis, Colour, Curve, Dash, Figure, Level, Mark, Panel};

const AXES: [&str; 3] = ["roll", "pitch", "yaw"];
const TORQUES: [&str; 3] = ["τx [N m]", "τy [N m]", "τz [N m]"];
const INCREMENTS: [&str; 3] = ["Δτx [N m]", "Δτy [N m]", "Δτz [N m]"];
const ANGLES: [&str; 3] = ["φ [rad]", "θ [rad]", "ψ [rad]"];
const TIME: &str = "t [s]";

/// A run with how it is drawn.
struct Drawn<'a> {
    name: String,
    colour: Colour,
    dash: Dash,
    run: &'a Run,
    /// The name of its bounds; none are drawn if absent.
    bounds: Option<String>,
}

fn find<'a>(runs: &'a [Run], name: &str) -> Option<&'a Run> {
    runs.iter().find(|run| run.name == name)
}

/// Rows of inputs, increments and angles over time, a column per axis.
fn grid(title: &str, drawn: &[Drawn], window: [f64; 2]) -> Figure {
    let mut figure = Figure::new(title, 3).panel_px(390.0, 235.0);
    let inside = |t_s: f64| t_s >= window[0] - 0.03 && t_s <= window[1] + 1e-9;
    let held = |item: &Drawn, value: &dyn Fn(&Sample) -> f64| {
        let samples = item.run.trajectory.samples.iter().filter(|sample| inside(sample.t_s));
        let points = samples.map(|sample| [sample.t_s, value(sample)]).collect();
        Curve::new(item.name.clone(), item.colour, points).mark(Mark::Hold(item.dash))
    };
    let time = || time_axis(window);
    for (label, increment) in [(TORQUES, false), (INCREMENTS, true)] {
        for axis in 0..3 {
            let title = if increment { "" } else { AXES[axis] };
            let mut panel = Panel::new(title, time(), Axis::new(label[axis]));
            for item in drawn {
                panel = panel.curve(held(item, &|sample| {
                    if increment {
                        sample.increment_nm()[axis]
                    } else {
                        sample.output.torque_nm[axis]
                    }
                }));
                if let Some(name) = &item.bounds {
                    let output = &item.run.trajectory.samples[0].output;
                    let bound =
                        if increment { output.increment_bound_nm } else { output.torque_bound_nm };
                    let colour = if drawn.iter().filter(|d| d.bounds.is_some()).count() > 1 {
                        item.colour
                    } else {
                        Colour::Black
                    };
                    panel = panel.bounds(name, colour, bound[axis]);
                }
            }
            figure = figure.panel(panel);
        }
    }
    for axis in 0..3 {
        figure = figure.panel(angle_panel("", drawn, axis, window));
    }
    figure
}

fn time_axis([from, to]: [f64; 2]) -> Axis {
    let tick = if to - from > 0.3 { 0.1 } else { 0.05 };
    // So that rounding does not cost the last tick.
    Axis::new(TIME).range(from, to + 1e-9).ticks(tick)
}

fn angle_panel(title: &str, drawn: &[Drawn], axis: usize, window: [f64; 2]) -> Panel {
    let time = time_axis(window);
    let target = Level::new("set point", Colour::Black, Dash::Solid, TARGET_RAD);
    let mut panel = Panel::new(title, time, Axis::new(ANGLES[axis])).level(target);
    for item in drawn {
        let path = item.run.trajectory.gamma_rad.iter();
        let inside = |t_s: f64| t_s >= window[0] - 0.03 && t_s <= window[1] + 0.03;
        let points = path.filter(|(t, _)| inside(*t)).map(|(t, gamma)| [*t, gamma[axis]]).collect();
        panel = panel
            .curve(Curve::new(item.name.clone(), item.colour, points).mark(Mark::Line(item.dash)));
    }
    panel
}

const THREE: [Colour; 3] = [Colour::Red, Colour::Blue, Colour::Green];

/// Figure 3.
pub(super) fn rates(runs: &[Run]) -> Figure {
    let mut drawn = Vec::new();
    for (colour, (rate, ..)) in THREE.into_iter().zip(PRINTED) {
        if let Some(run) = find(runs, &step_rates::name(rate)) {
            let bounds = drawn.is_empty().then(|| "bounds".to_owned());
            drawn.push(Drawn {
                name: format!("{rate} Hz"),
                colour,
                dash: Dash::Solid,
                run,
                bounds,
            });
        }
    }
    let mut figure =
        grid("Figure 3: three rates, smallest vehicle, {Np, Nc} = {20, 3}", &drawn, [0.0, 0.2]);
    for axis in 0..3 {
        figure = figure.panel(with_printed(angle_panel("closer", &drawn, axis, [0.0, 0.2])));
    }
    figure
}

/// A close view with the paper's numbers: when an angle reaches 0.2 rad, and how far it goes, but
/// not when. They are of roll; the paper states that they hold for pitch and yaw too.
fn with_printed(mut panel: Panel) -> Panel {
    panel.x = Axis::new(TIME).range(0.02, 0.12 + 1e-9).ticks(0.02);
    panel.y.range = Some([0.19, 0.212]);
    panel.y.tick_step = Some(0.005);
    for (colour, (rate, _, time_s, peak)) in THREE.into_iter().zip(PRINTED) {
        let reached =
            Curve::new("paper: 0.2 rad reached", Colour::Black, vec![[time_s, TARGET_RAD]]);
        panel = panel.curve(reached.mark(Mark::Crosses(5.0))).level(Level::new(
            format!("paper: peak at {rate} Hz"),
            colour,
            Dash::Dotted,
            peak,
        ));
    }
    panel
}

/// The same step among rotors.
pub(super) fn rotors(runs: &[Run]) -> Figure {
    let colours = [Colour::Sky, Colour::Red, Colour::Blue, Colour::Orange];
    let mut drawn = Vec::new();
    if let Some(run) = find(runs, &step_rates::name(100.0)) {
        let name = "paper's law, linear".to_owned();
        drawn.push(Drawn { name, colour: Colour::Grey, dash: Dash::Dashed, run, bounds: None });
    }
    for (colour, (label, ..)) in colours.into_iter().zip(ROTOR_CASES) {
        if let Some(run) = find(runs, &format!("{label}, 100 Hz min, all")) {
            let name = label.to_owned();
            drawn.push(Drawn { name, colour, dash: Dash::Solid, run, bounds: None });
        }
    }
    let title = "Test I among rotors: 100 Hz, smallest vehicle, all angles at once";
    let mut figure = Figure::new(title, 3).panel_px(390.0, 260.0);
    for (axis, name) in AXES.into_iter().enumerate() {
        figure = figure.panel(angle_panel(name, &drawn, axis, [0.0, 0.6]));
    }
    figure
}

/// Figure 4.
pub(super) fn horizons(runs: &[Run], bars: &Bars) -> Figure {
    let mut drawn = Vec::new();
    for pair in PAIRS {
        let colour = match pair.0 {
            10 => Colour::Red,
            20 => Colour::Blue,
            _ => Colour::Green,
        };
        let dash = match pair.1 {
            3 => Dash::Solid,
            4 => Dash::Dashed,
            5 => Dash::DashDot,
            _ => Dash::Dotted,
        };
        if let Some(run) = find(runs, &horizons::name(100.0, DRAWN_WEIGHT, pair)) {
            drawn.push(Drawn { name: label(pair), colour, dash, run, bounds: None });
        }
    }
    let title = "Figure 4: horizons {Np,Nc} at 100 Hz, r_w 0.25, and compute time on this machine";
    let mut figure = Figure::new(title, 3).panel_px(390.0, 280.0);
    for (axis, name) in AXES.into_iter().enumerate() {
        figure = figure.panel(angle_panel(name, &drawn, axis, [0.0, 0.2]));
    }
    let mut close = angle_panel("roll, closer", &drawn, 0, [0.0, 0.1]);
    close.x = Axis::new(TIME).range(0.02, 0.07 + 1e-9).ticks(0.01);
    close.y = Axis::new(ANGLES[0]).range(0.18, 0.22 + 1e-9).ticks(0.01);
    let groups = horizons::drawn_overshoots(runs).into_iter().map(|(pair, os)| (pair, vec![os]));
    let overshoot =
        Panel::new("overshoot of roll", Axis::new("{Np,Nc}"), Axis::new("overshoot [%]")).bars(
            figure::Bars { series: vec![(String::new(), Colour::Grey)], groups: groups.collect() },
        );
    figure = figure.panel(close).panel(overshoot);
    figure.panel(step_times(bars))
}

/// Our step times with the paper's ranges.
fn step_times(bars: &Bars) -> Panel {
    let series = PRINTED.iter().zip([Colour::Orange, Colour::Purple, Colour::Sky]);
    let groups = PAIRS.iter().zip(bars).map(|(pair, bar)| (label(*pair), bar.to_vec()));
    let mut panel = Panel::new(
        "mean time of a step",
        Axis::new("{Np,Nc}"),
        Axis::log("time [µs]").range(0.1, 1000.0),
    )
    .bars(figure::Bars {
        series: series.map(|((rate, ..), colour)| (format!("{rate} Hz, here"), colour)).collect(),
        groups: groups.collect(),
    });
    for ((rate, ..), ((from, to), colour)) in PRINTED.into_iter().zip(PRINTED_US.into_iter().zip([
        Colour::Orange,
        Colour::Purple,
        Colour::Sky,
    ])) {
        let name = format!("{rate} Hz, paper's range");
        panel = panel.level(Level::new(name, colour, Dash::Dashed, from)).level(Level::new(
            "",
            colour,
            Dash::Dashed,
            to,
        ));
    }
    panel
}

fn three_sizes(runs: &[Run], struck: bool) -> Vec<Drawn<'_>> {
    let mut drawn = Vec::new();
    for (colour, (size, _)) in THREE.into_iter().zip(SIZES) {
        if let Some(run) = find(runs, &sizes::name(size, struck)) {
            let bounds = Some(format!("{size} bounds"));
            drawn.push(Drawn { name: size.to_owned(), colour, dash: Dash::Solid, run, bounds });
        }
    }
    drawn
}

/// Figure 5.
pub(super) fn sizes(runs: &[Run]) -> Figure {
    grid("Figure 5: three sizes, 100 Hz, {Np, Nc} = {20, 3}", &three_sizes(runs, false), [0.0, 0.2])
}

/// Figure 6.
pub(super) fn disturbed(runs: &[Run]) -> Figure {
    let title = "Figure 6: three sizes, torque of 0.1 rd N m over one sample at 0.3 s";
    let mut figure = grid(title, &three_sizes(runs, true), [0.25, 0.45]);
    for (index, panel) in figure.panels.iter_mut().enumerate() {
        let name = "paper: recovered, 0.05 to 0.07 s";
        let at = [sizes::STRUCK_S + 0.05, sizes::STRUCK_S + 0.07];
        if index >= 6 {
            panel.spans.push(at);
            for at in at {
                panel.instants.push(Level::new(name, Colour::Grey, Dash::Dotted, at));
            }
        }
    }
    figure
}
