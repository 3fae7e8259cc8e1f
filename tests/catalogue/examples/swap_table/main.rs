//! Swaps the entries of the catalogue into flights with all safeguards, with the monitor alone and without
//! any, and compares the ground truth with the same flight without a swap.
//!
//! `swap_table [attitude|position] [all|watch|none] [good] [patient] [pairs] [python] [SEEDS] [FILE.jsonl] [KEY=VALUE...]
//! [ENTRY...]`:
//! `good` flies every shipped controller in place of every other, `patient` those with a fault that begins after
//! rehearsal and rollback window, `pairs` each of those in the position slot after an attitude controller of
//! `entries_of_pairs`, `python` the controllers in Python, good or bad, and `KEY=VALUE` sets a key of the scenario, for
//! example `monitor.rate_hz=200.0`. Each flight becomes a line of the file, and what the file has of this build is not flown
//! again, but for scripts. Ends with 1 if one with all safeguards is lost, goes farther than 0.5 m, tilts by more than 60
//! degrees, is not reported or cannot be flown. Run it after `cargo build --release --workspace --examples --bins`; Python needs
//! the environment of `services/attitude-python/README.md`.
#![expect(clippy::print_stdout, reason = "its table is for people")]

mod journal;

use catalogue::limits::{lower_limit, upper_limit};
use catalogue::swapped::{
    Guard, Holder, Plain, SITUATIONS, Situation, Swapped, config_of, pair_settings, paired, plain,
    swapped,
};
use catalogue::{Entry, Fault, entries, entries_of_pairs, patient_entries};
use journal::{JOURNAL, Journal};
use scenario::Override;
use scenario::services::names_for;
use shared_types::Slot;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};

/// The controller that is swapped in.
#[derive(Clone)]
enum Candidate {
    /// A shipped law with a fault.
    Bad(Entry),
    /// The first in the attitude slot, then the second in the position slot.
    Pair(Box<[Entry; 2]>),
    /// The law in Python with a fault.
    BadPython(Entry),
    /// A shipped controller.
    Shipped(&'static str),
    /// The controller in Python.
    Python,
}

/// One flight of the table.
struct Case {
    situation: &'static Situation,
    seed: u64,
    slot: Slot,
    /// The first owner of the slot; `None` for that of the scenario.
    holder: Option<Holder>,
    candidate: Candidate,
    guard: Guard,
}

/// Which faults are flown.
#[derive(Clone, Copy, PartialEq)]
enum Bad {
    /// Those that a rehearsal can see.
    Early,
    /// Those that begin after rehearsal and rollback window.
    Patient,
    /// Those of the position slot, after an attitude controller that is swapped in first.
    Pairs,
}

/// The flights that the command line selects.
struct Selection {
    slots: Vec<Slot>,
    guards: Vec<Guard>,
    seeds: u64,
    good: bool,
    bad: Bad,
    python: bool,
    settings: Vec<Override>,
    /// The settings as they were given.
    given: Vec<String>,
    named: Vec<String>,
    /// Results of this run and of those that it goes on with.
    journal: Option<PathBuf>,
}

impl Case {
    /// The candidate, and whom it replaces if that is not the scenario's own controller.
    fn name(&self) -> String {
        let holder = self.holder.map_or(String::new(), |(_, name)| format!(" for {name}"));
        self.candidate.name() + &holder
    }
}

#[derive(Default)]
struct Row {
    flights: u32,
    lost: u32,
    flipped: u32,
    tripped: u32,
    /// Trips that predicted a distance, and those of them after which the vehicle went no farther.
    predicted: u32,
    kept: u32,
    /// Longest time from the first command with the fault to the effect of the trip \[s\].
    trip_delay_s: f64,
    excursion_m: f64,
    tilt_deg: f64,
}

/// Rows of the table, by slot and controller, then by guard.
type Rows = BTreeMap<(&'static str, String), BTreeMap<&'static str, Row>>;

/// Flights without a swap, by situation, seed and the controller that owns the slot.
type Plains<'a> = BTreeMap<(&'a str, u64, Option<&'a str>), Arc<Plain>>;

impl Candidate {
    fn is_good(&self) -> bool {
        matches!(self, Self::Shipped(_) | Self::Python)
    }

    fn name(&self) -> String {
        match self {
            Self::Bad(entry) => entry.name(),
            Self::Pair(entries) => format!("{}, then {}", entries[0].name(), entries[1].name()),
            Self::BadPython(entry) => format!("Python, {}", entry.name()),
            Self::Shipped(name) => format!("good {name}"),
            Self::Python => "good in Python".to_owned(),
        }
    }
}

impl Selection {
    fn read(arguments: &[String]) -> Self {
        let has = |name: &str| arguments.iter().any(|argument| argument == name);
        let known = ["all", "watch", "none", "good", "patient", "pairs", "python"];
        let only = arguments.iter().find_map(|argument| Slot::named(argument));
        let guards = [(Guard::All, "all"), (Guard::Watch, "watch"), (Guard::None, "none")];
        let chosen = guards.iter().any(|(_, name)| has(name));
        let guards = guards.into_iter().filter(|(_, name)| !chosen || has(name));
        let named = arguments.iter().filter(|argument| {
            argument.parse::<u64>().is_err()
                && !argument.contains('=')
                && !argument.ends_with(JOURNAL)
                && Slot::named(argument).is_none()
                && !known.contains(&argument.as_str())
        });
        let given = arguments.iter().filter(|argument| argument.contains('='));
        let given: Vec<String> = given.cloned().collect();
        let set = given.iter().map(|argument| Override::set(argument).expect("a setting"));
        Self {
            slots: Slot::ALL.into_iter().filter(|slot| only.is_none_or(|o| o == *slot)).collect(),
            guards: guards.map(|(guard, _)| guard).collect(),
            seeds: arguments.iter().find_map(|argument| argument.parse().ok()).unwrap_or(1),
            good: has("good"),
            bad: match (has("pairs"), has("patient")) {
                (true, _) => Bad::Pairs,
                (false, true) => Bad::Patient,
                (false, false) => Bad::Early,
            },
            python: has("python"),
            settings: (if has("pairs") { pair_settings() } else { Vec::new() })
                .into_iter()
                .chain(set)
                .collect(),
            journal: arguments.iter().find(|a| a.ends_with(JOURNAL)).map(PathBuf::from),
            given,
            named: named.cloned().collect(),
        }
    }

    fn candidates(&self, slot: Slot) -> Vec<Candidate> {
        let in_python = |entry: &Entry| {
            let first_sign = entry.fault == Fault::WrongSign && entry.axis == 1;
            let kinds = matches!(entry.fault, Fault::Frozen | Fault::NotANumber);
            first_sign || kinds || entry.fault == Fault::Gain && entry.amount > 5.0
        };
        match (self.good, self.python) {
            (true, true) => vec![Candidate::Python],
            (true, false) => names_for(slot.role()).map(Candidate::Shipped).collect(),
            (false, true) => {
                let chosen = entries(slot).into_iter().filter(in_python);
                chosen.map(Candidate::BadPython).collect()
            }
            (false, false) => match self.bad {
                Bad::Early => entries(slot).into_iter().map(Candidate::Bad).collect(),
                Bad::Patient => patient_entries(slot).into_iter().map(Candidate::Bad).collect(),
                Bad::Pairs if slot == Slot::Attitude => Vec::new(),
                Bad::Pairs => {
                    let pairs = entries_of_pairs().into_iter().flat_map(|attitude| {
                        let with = move |position| Box::new([attitude.clone(), position]);
                        patient_entries(slot).into_iter().map(with)
                    });
                    pairs.map(Candidate::Pair).collect()
                }
            },
        }
    }

    fn holders(&self, slot: Slot) -> Vec<Option<Holder>> {
        if self.good {
            names_for(slot.role()).map(|name| Some((slot, name))).collect()
        } else {
            vec![None]
        }
    }

    fn cases(&self) -> Vec<Case> {
        let mut cases = Vec::new();
        for &slot in &self.slots {
            for candidate in self.candidates(slot) {
                let name = candidate.name();
                if !self.named.is_empty() && !self.named.iter().any(|part| name.contains(part)) {
                    continue;
                }
                for holder in self.holders(slot) {
                    for situation in &SITUATIONS {
                        for seed in 1..=self.seeds {
                            for &guard in &self.guards {
                                let all_alone = candidate.is_good() || self.bad == Bad::Pairs;
                                if !all_alone || guard == Guard::All {
                                    let candidate = candidate.clone();
                                    cases.push(Case {
                                        situation,
                                        seed,
                                        slot,
                                        holder,
                                        candidate,
                                        guard,
                                    });
                                }
                            }
                        }
                    }
                }
            }
        }
        cases
    }
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if arguments.first().is_some_and(|argument| argument == "types") {
        // A controller in Python gets the layout of samples from the executable that started it.
        print!("{}", protocol::samples::python());
        return ExitCode::SUCCESS;
    }
    let selection = Selection::read(&arguments);
    let cases = selection.cases();
    let journal = Journal::open(&selection);
    let next = AtomicUsize::new(0);
    let faults = AtomicUsize::new(0);
    let rows: Mutex<Rows> = Mutex::default();
    let plains: Mutex<Plains> = Mutex::default();
    std::thread::scope(|scope| {
        for _ in 0..std::thread::available_parallelism().map_or(1, usize::from) {
            scope.spawn(|| {
                while let Some(case) = cases.get(next.fetch_add(1, Ordering::Relaxed)) {
                    if let Some(flown) = journal.known.get(&journal.name(case)) {
                        let is_fault = note(case, flown, &mut rows.lock().expect("no panic"));
                        faults.fetch_add(usize::from(is_fault), Ordering::Relaxed);
                        continue;
                    }
                    let holder = case.holder.map(|(_, name)| name);
                    let key = (case.situation.name, case.seed, holder);
                    let known = plains.lock().expect("no panic").get(&key).cloned();
                    let unswapped = known.unwrap_or_else(|| {
                        let made =
                            plain(case.situation, case.seed, case.holder, &selection.settings);
                        let made = Arc::new(made.expect("a flight"));
                        plains.lock().expect("no panic").insert(key, made.clone());
                        made
                    });
                    let flown = fly(case, &unswapped);
                    if flown.excursion_m.is_finite() {
                        journal.keep(case, &flown);
                    }
                    let is_fault = note(case, &flown, &mut rows.lock().expect("no panic"));
                    faults.fetch_add(usize::from(is_fault), Ordering::Relaxed);
                }
            });
        }
    });
    print_table(&rows.into_inner().expect("no panic"));
    if faults.into_inner() > 0 { ExitCode::FAILURE } else { ExitCode::SUCCESS }
}

/// The executable `catalogue` of this build.
fn executable() -> PathBuf {
    let own = std::env::current_exe().expect("the own executable");
    own.parent().and_then(|examples| examples.parent()).expect("a target folder").join("catalogue")
}

fn fly(case: &Case, unswapped: &Plain) -> Swapped {
    let Case { situation, seed, slot, candidate, guard, .. } = case;
    let folder = tempfile::TempDir::new().expect("a folder");
    let write = |name: &str, entry: &Entry| {
        let path = folder.path().join(name);
        std::fs::write(&path, config_of(entry)).expect("a file");
        path
    };
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let faulty = executable().display().to_string();
    let (to, entry) = match candidate {
        Candidate::Bad(entry) => (faulty, Some(entry)),
        Candidate::Pair(entries) => {
            let configs = ["first.toml", "second.toml"];
            let [first, second] = core::array::from_fn(|i| write(configs[i], &entries[i]));
            let pair = [first.as_path(), second.as_path()].map(|config| (&*faulty, Some(config)));
            return paired((situation, *seed), pair, unswapped).unwrap_or_else(not_flown);
        }
        Candidate::BadPython(entry) => {
            let file = format!("python/bad_{}.py", slot.label());
            (here.join(file).display().to_string(), Some(entry))
        }
        Candidate::Shipped(name) => ((*name).to_owned(), None),
        Candidate::Python => {
            let file = format!("../../services/attitude-python/{}_pd.py", slot.label());
            (here.join(file).display().to_string(), None)
        }
    };
    let config = entry.map(|entry| write("entry.toml", entry));
    let flown = swapped((situation, *seed), *slot, (&to, config.as_deref()), *guard, unswapped);
    flown.unwrap_or_else(not_flown)
}

#[expect(clippy::needless_pass_by_value, reason = "as an error is given")]
fn not_flown(error: Box<dyn std::error::Error>) -> Swapped {
    Swapped {
        recovered: false,
        lost: Some(format!("not flown: {error}")),
        excursion_m: f64::INFINITY,
        tilt_deg: f64::INFINITY,
        flipped: false,
        trips: [0; Slot::COUNT],
        epochs: [0; Slot::COUNT],
        tripped_s: None,
        tripped_after_s: None,
        predicted_m: None,
        outcome: String::new(),
        unreported: Vec::new(),
    }
}

/// Counts a flight. True if the safeguards have not done what they are for.
fn note(case: &Case, flown: &Swapped, rows: &mut Rows) -> bool {
    let name = case.name();
    let row = rows.entry((case.slot.label(), name.clone())).or_default();
    let row = row.entry(case.guard.name()).or_default();
    row.flights += 1;
    row.lost += u32::from(flown.lost.is_some());
    row.flipped += u32::from(flown.flipped);
    row.tripped += u32::from(flown.tripped_s.is_some());
    if let Some(predicted_m) = flown.predicted_m {
        row.predicted += 1;
        row.kept += u32::from(flown.excursion_m <= predicted_m);
    }
    if let (Candidate::Bad(entry), Some(after_s)) = (&case.candidate, flown.tripped_after_s) {
        row.trip_delay_s = row.trip_delay_s.max(after_s - entry.after_s);
    }
    row.excursion_m = row.excursion_m.max(flown.excursion_m);
    row.tilt_deg = row.tilt_deg.max(flown.tilt_deg);
    let is_refused = case.candidate.is_good() && !flown.flipped;
    let hurts = flown.lost.is_some()
        || case.guard == Guard::All && (flown.excursion_m > 0.5 || flown.tilt_deg > 60.0);
    let is_unreported = !flown.unreported.is_empty();
    if is_refused || is_unreported || case.guard != Guard::None && hurts {
        println!(
            "{} {name} {} seed {} {}: {}, {:.2} m, {:.0} deg, trip {:?}; unreported {:?}; {}",
            case.slot.label(),
            case.situation.name,
            case.seed,
            case.guard.name(),
            flown.lost.as_deref().unwrap_or("kept"),
            flown.excursion_m,
            flown.tilt_deg,
            flown.tripped_s,
            flown.unreported,
            flown.outcome
        );
    }
    case.guard == Guard::All && (hurts || is_unreported)
}

fn print_table(rows: &Rows) {
    println!(
        "{:<9} {:<40} {:<12} {:>7} {:>5} {:>7} {:>7} {:>8} {:>8} {:>6}",
        "slot",
        "controller",
        "guard",
        "flights",
        "lost",
        "flipped",
        "tripped",
        "within",
        "at most",
        "tilt"
    );
    // All losses; losses by controllers that also lose the vehicle without any guard; and flips.
    let mut sums: BTreeMap<&str, [Sum; 3]> = BTreeMap::new();
    let (mut predicted, mut kept) = (0, 0);
    for ((slot, name), guards) in rows {
        let hurts = guards.get(Guard::None.name()).is_none_or(|row| row.lost > 0);
        for (guard, row) in guards {
            println!(
                "{slot:<9} {name:<40} {guard:<12} {:>7} {:>5} {:>7} {:>7} {:>5.0} ms {:>6.2} m {:>4.0} d",
                row.flights,
                row.lost,
                row.flipped,
                row.tripped,
                1e3 * row.trip_delay_s,
                row.excursion_m,
                row.tilt_deg
            );
            (predicted, kept) = (predicted + row.predicted, kept + row.kept);
            let [all, hurting, flipped] = sums.entry(guard).or_default();
            all.add(row.lost, row);
            flipped.add(row.flipped, row);
            if hurts {
                hurting.add(row.lost, row);
            }
        }
    }
    for (guard, [all, hurting, flipped]) in sums {
        println!("{guard}: {} lost; of entries that hurt {}", all.at_most(), hurting.at_most());
        println!("{guard}: {} flipped", flipped.at_least());
    }
    println!("{kept} of {predicted} trips that predicted a distance: the vehicle went no farther");
}

/// A number of flights out of a total, with its confidence limits.
#[derive(Default)]
struct Sum {
    of: u32,
    flights: u32,
}

impl Sum {
    fn add(&mut self, of: u32, row: &Row) {
        self.of += of;
        self.flights += row.flights;
    }

    fn at_most(&self) -> String {
        let limit = 100.0 * upper_limit(self.of, self.flights);
        format!("{} of {} ({limit:.2} % at most at 95 %)", self.of, self.flights)
    }

    fn at_least(&self) -> String {
        let limit = 100.0 * lower_limit(self.of, self.flights);
        format!("{} of {} ({limit:.2} % at least at 95 %)", self.of, self.flights)
    }
}
