//! What a measured flight came to, as it is shown, saved and compared.

use super::facts::BenchFacts;
use super::place::Place;
use super::series::{Quantiles, Rank, Ratios};
use figures::results::Table;
use observe::stopwatch::LAUNCHER;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt::Write as _;

/// What kind of file this is.
pub const FORMAT: &str = "morphquad bench loops";
pub const FORMAT_VERSION: u32 = 2;
/// Share of a loop's releases that it may miss and still hold its rate.
pub const MAX_MISS_SHARE: f64 = 1e-3;

/// A figure with its floor.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Figure {
    /// As flown.
    pub flown: Quantiles,
    /// The same of the machine alone; none where there is no such thing.
    pub floor: Option<Quantiles>,
    /// Flown over floor.
    pub ratio: Option<Ratios>,
    /// As flown in the warm-up.
    pub warm_up: Option<Quantiles>,
}

impl Figure {
    /// With its floor, if there is one.
    #[must_use]
    pub fn new(flown: Quantiles, floor: Option<Quantiles>, warm_up: Option<Quantiles>) -> Self {
        let ratio = floor.as_ref().map(|floor| flown.over(floor));
        Self { flown, floor, ratio, warm_up }
    }
}

/// Events of a loop after the warm-up.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Counts {
    /// Steps that ran.
    pub steps: u64,
    /// Steps that began at their input deadline, without final inputs.
    pub deadline_misses: u64,
    /// Steps that were published after the next release.
    pub overruns: u64,
    /// Releases left out.
    pub skipped: u64,
    /// Late releases that were run after all.
    pub caught_up: u64,
    /// Samples that arrived after the step that they were for.
    pub late_samples: u64,
    /// Waits that only their limit ended.
    pub rescued_waits: u64,
}

impl Counts {
    /// Releases that were missed, as a share of all.
    #[must_use]
    pub fn miss_share(&self) -> f64 {
        let missed = self.skipped + self.deadline_misses.max(self.overruns);
        missed as f64 / self.releases().max(1) as f64
    }

    /// Releases, those that were left out among them.
    #[must_use]
    pub fn releases(&self) -> u64 {
        self.steps + self.skipped
    }
}

/// What a loop's process took after the warm-up.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Cost {
    /// Of one processor \[%\].
    pub cpu_percent: f64,
    /// Resident memory \[MB\].
    pub rss_mb: f64,
    /// Page faults answered from memory.
    pub minor_faults: u64,
    /// Page faults answered from the disk.
    pub major_faults: u64,
    /// Allocations of the loop.
    pub allocations: u64,
    /// Allocations of the transport, one for each sample sent.
    pub transport_allocations: u64,
    /// Page faults of both kinds while some process joined or left.
    pub faults_while_joining: u64,
    /// Allocations of the loop while some process joined or left.
    pub allocations_while_joining: u64,
    /// Times in a second that the loop gave its processor back.
    pub voluntary_switches_per_s: f64,
    /// Times in a second that it was taken away.
    pub involuntary_switches_per_s: f64,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LoopReport {
    /// Service that runs it.
    pub name: String,
    pub role: String,
    /// Seat in the role.
    pub seat: u32,
    /// True if its own clock starts its steps; otherwise its inputs do.
    pub timed: bool,
    /// As asked for \[Hz\].
    pub rate_hz: f64,
    /// As flown: of the releases that were due, those that ran; none if none was due \[Hz\].
    pub achieved_hz: Option<f64>,
    /// True if it missed few enough.
    pub holds: bool,
    /// Steps in the warm-up.
    pub warm_up_steps: u64,
    /// Durations by name.
    pub figures: BTreeMap<String, Figure>,
    /// Events.
    pub counts: Counts,
    /// Its process; none if it was never seen twice.
    pub cost: Option<Cost>,
}

/// A stretch of a path.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LinkReport {
    /// What takes the time.
    pub name: String,
    /// How long.
    pub took: Quantiles,
}

/// A way from sensor to motor.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PathReport {
    /// Through what.
    pub name: String,
    /// From publication of the IMU sample to the command's arrival at the plant's gate; the floor is the
    /// sum of hops over the bare transport and of the steps as flown.
    pub total: Figure,
    /// From publication of the IMU sample until the command is in effect, over the same floor; with asap
    /// edges nothing holds a command, without them the gate does.
    pub until_effect: Figure,
    /// From the intended release of the IMU sample.
    pub from_release: Quantiles,
    /// Stretches in order.
    pub links: Vec<LinkReport>,
    /// Parts of the floor.
    pub floor_parts: Vec<LinkReport>,
    /// Logical time from the step of the command to its effect, which the gate keeps to; 0 if commands
    /// take effect when they are published \[us\].
    pub hold_us: f64,
    /// Commands after the warm-up that cannot be followed back.
    pub untraced: u64,
    /// Commands that were replaced before they took effect.
    pub unseen: u64,
    /// Commands in the warm-up.
    pub warm_up: u64,
}

/// The machine alone, in the same run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FloorReport {
    /// Rate \[Hz\] and lateness of each timer.
    pub timers: Vec<(f64, Quantiles)>,
    /// Name and hop of each ping.
    pub pings: Vec<(String, Quantiles)>,
    /// Processor time that other machines on the host took \[%\].
    pub steal_percent: f64,
}

/// What must be the same for two results to be compared.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Terms {
    /// Machine and build.
    pub facts: BenchFacts,
    /// Name of the scenario.
    pub scenario: String,
    /// Hash of all its settings but the duration.
    pub scenario_hash: String,
    /// Rate of each role's loop \[Hz\].
    pub rates_hz: BTreeMap<String, f64>,
    /// Where everything ran.
    pub place: Place,
    /// What else the machine did meanwhile.
    pub load: String,
}

/// All of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LoopsReport {
    /// [`FORMAT`].
    pub format: String,
    /// [`FORMAT_VERSION`].
    pub format_version: u32,
    /// Under which it was measured.
    pub terms: Terms,
    /// Logical time of the flight \[s\].
    pub duration_s: f64,
    /// Of that, at the beginning, apart from everything else \[s\].
    pub warm_up_s: f64,
    /// Every loop.
    pub loops: Vec<LoopReport>,
    /// The process that supervises the flight and records it.
    pub launcher: Option<Cost>,
    /// Ways from sensor to motor.
    pub paths: Vec<PathReport>,
    /// The machine alone.
    pub floor: FloorReport,
    /// What happened on the way.
    pub notices: Vec<String>,
}

impl LoopsReport {
    /// Loops that missed too much.
    pub fn overtaxed(&self) -> impl Iterator<Item = &LoopReport> {
        self.loops.iter().filter(|l| !l.holds)
    }

    /// For people, at most 80 columns wide.
    #[must_use]
    pub fn to_text(&self) -> String {
        let Terms { facts, scenario, place, load, .. } = &self.terms;
        let Self { duration_s, warm_up_s, .. } = self;
        let mut text = format!("{}\n", facts.to_line());
        // A string takes everything.
        let _ = writeln!(
            text,
            "{scenario}, {duration_s} s of which {warm_up_s} s warm-up, {}, load {load}",
            place.to_line()
        );
        if let Some(fell_back) = &place.fell_back {
            let _ = writeln!(text, "note: {fell_back}");
        }
        let _ = write!(
            text,
            "\n{}\nmissed: begun without final inputs; over: published after the next release; skipped: left out; caught:\n\
             run late after all; late: samples that came after the step that they were for\n\n\
             faults, allocations and blocks that the transport lent, in steady flight; and what fell to\n\
             ticks in which a process joined or left\n\n{}",
            self.rates(),
            self.costs()
        );
        let _ = write!(
            text,
            "\nus; x is over the floor: a bare timer loop (lateness, period), a bare iceoryx2 ping\n\
             (hop, age), the step alone in one process (compute)\n\n{}\n",
            self.figures()
        );
        for path in &self.paths {
            let _ = writeln!(text, "{}", path.to_text());
        }
        let _ =
            write!(text, "floor, us; steal {:.2} %\n\n{}", self.floor.steal_percent, self.floor());
        for taxed in self.overtaxed() {
            let _ = writeln!(
                text,
                "\n{} does not hold {} Hz: {:.2} % of its releases were missed, over or skipped, {} % may be; lower \
                 its rate, or see with `doctor` what else the machine does",
                taxed.name,
                taxed.rate_hz,
                100.0 * taxed.counts.miss_share(),
                100.0 * MAX_MISS_SHARE
            );
        }
        for notice in &self.notices {
            let _ = writeln!(text, "note: {notice}");
        }
        text
    }

    fn rates(&self) -> Table {
        let mut table = Table::new([
            "loop", "Hz", "flown", "steps", "missed", "over", "skipped", "caught", "late",
        ]);
        for l in &self.loops {
            let Counts { steps, deadline_misses, overruns, skipped, caught_up, .. } = l.counts;
            let achieved = l.achieved_hz.map_or_else(|| "-".to_owned(), |hz| format!("{hz:.2}"));
            let counts =
                [steps, deadline_misses, overruns, skipped, caught_up, l.counts.late_samples];
            let cells = [l.name.clone(), l.rate_hz.to_string(), achieved];
            table.push(cells.into_iter().chain(counts.map(|count| count.to_string())));
        }
        table
    }

    fn costs(&self) -> Table {
        let mut table = Table::new([
            "process", "cpu %", "rss MB", "faults", "major", "allocs", "lent", "joining",
            "waits/s", "forced/s",
        ]);
        let loops = self.loops.iter().map(|l| (l.name.as_str(), l.cost.as_ref(), true));
        let launcher = (LAUNCHER, self.launcher.as_ref(), false);
        for (name, cost, is_loop) in loops.chain([launcher]) {
            let Some(cost) = cost else { continue };
            // What is not a loop allocates as it likes.
            let counted = |count: u64| if is_loop { count.to_string() } else { "-".to_owned() };
            let joining = cost.faults_while_joining + cost.allocations_while_joining;
            table.push([
                name.to_owned(),
                format!("{:.1}", cost.cpu_percent),
                format!("{:.1}", cost.rss_mb),
                cost.minor_faults.to_string(),
                cost.major_faults.to_string(),
                counted(cost.allocations),
                counted(cost.transport_allocations),
                joining.to_string(),
                format!("{:.1}", cost.voluntary_switches_per_s),
                format!("{:.1}", cost.involuntary_switches_per_s),
            ]);
        }
        table
    }

    fn figures(&self) -> Table {
        let heads = ["loop", "figure", "n"].into_iter();
        let heads = heads.chain(Rank::ALL.map(Rank::label)).chain(["p50 x", "p99 x"]);
        let mut table = Table::new(heads);
        for l in &self.loops {
            let mut name = l.name.as_str();
            for figure in super::measure::FIGURES {
                let Some(measured) = l.figures.get(figure) else { continue };
                let row = [name.to_owned(), figure.to_owned(), measured.flown.n.to_string()];
                let ranks = Rank::ALL.map(|rank| super::us(measured.flown.at(rank)));
                let ratios = [Rank::P50, Rank::P99]
                    .map(|rank| super::ratio(measured.ratio.as_ref().and_then(|r| r.at(rank))));
                table.push(row.into_iter().chain(ranks).chain(ratios));
                // Written once per loop, so that the eye finds it.
                name = "";
            }
        }
        table
    }

    fn floor(&self) -> Table {
        let mut table = Table::new(["what", "n"].into_iter().chain(Rank::ALL.map(Rank::label)));
        let timers =
            self.floor.timers.iter().map(|(hz, quantiles)| (format!("timer {hz} Hz"), quantiles));
        let pings =
            self.floor.pings.iter().map(|(name, quantiles)| (format!("ping {name}"), quantiles));
        for (name, quantiles) in timers.chain(pings) {
            let ranks = Rank::ALL.map(|rank| super::us(quantiles.at(rank)));
            table.push([name, quantiles.n.to_string()].into_iter().chain(ranks));
        }
        table
    }
}

impl PathReport {
    fn to_text(&self) -> String {
        let mut table = Table::new(["", "n"].into_iter().chain(Rank::ALL.map(Rank::label)));
        let mut row = |name: &str, quantiles: &Quantiles| {
            let ranks = Rank::ALL.map(|rank| super::us(quantiles.at(rank)));
            table.push([name.to_owned(), quantiles.n.to_string()].into_iter().chain(ranks));
        };
        for link in &self.links {
            row(&format!("  {}", link.name), &link.took);
        }
        row("from release", &self.from_release);
        row("from publication", &self.total.flown);
        row("until in effect", &self.until_effect.flown);
        for part in &self.floor_parts {
            row(&format!("  {}", part.name), &part.took);
        }
        if let Some(floor) = &self.total.floor {
            row("floor", floor);
        }
        let over = |figure: &Figure| {
            let at = |rank| super::ratio(figure.ratio.as_ref().and_then(|ratio| ratio.at(rank)));
            format!("p50 {} x, p99 {} x", at(Rank::P50), at(Rank::P99))
        };
        let held = if self.hold_us > 0.0 {
            format!("in effect {} us of logical time after the step", self.hold_us)
        } else {
            "in effect when published".to_owned()
        };
        format!(
            "{}, us\n\n{table}over floor, from publication to the gate: {}\n\
             over floor, until in effect:             {} ({held})\n\
             {} commands untraced, {} replaced before they took effect\n",
            self.name,
            over(&self.total),
            over(&self.until_effect),
            self.untraced,
            self.unseen
        )
    }
}
