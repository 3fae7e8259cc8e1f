//! Rehearses every entry of the catalogue and prints how often each is refused and accepted per flight.
//!
//! `rehearsal_table [raw] [good] [FLIGHT] [attitude|position] [SEEDS]`: `raw` prints every figure, `good`
//! leaves out the bad entries.
#![expect(clippy::print_stdout, reason = "its table is for people")]

use catalogue::{Altering, Entry, Fault, Spoiler, entries};
use rustix::time::{ClockId, clock_gettime};
use scenario::services::names_for;
use scenario::{Override, Scenario};
use shared_types::{PerSlot, Slot};
use simulate::rehearse::{Rehearsal, Snapshot, Verdict, watch};
use std::collections::BTreeMap;
use swap::RehearsalSpec;
use vehicle::MorphAngle;

/// A flight in which swaps are rehearsed.
struct Flight {
    name: &'static str,
    scenario: &'static str,
    set: &'static [&'static str],
    /// Instants of the snapshots \[s\].
    at_s: &'static [f64],
}

const FLIGHTS: [Flight; 4] = [
    Flight {
        name: "hover",
        scenario: "hover",
        set: &["pilot.morph=[[0.0,45.0],[8.0,45.0],[8.5,160.0],[9.0,160.0],[9.4,45.0]]"],
        at_s: &[2.0],
    },
    Flight {
        name: "figure8",
        scenario: "figure8-morph",
        set: &[],
        at_s: &[2.0, 5.3, 9.1, 13.2, 15.4, 17.5],
    },
    Flight {
        name: "sweep",
        scenario: "hover",
        set: &[
            "pilot.morph=[[0.0,45.0],[2.0,45.0],[2.5,160.0],[3.0,160.0],[3.4,45.0],[5.0,45.0],[5.3,160.0]]",
        ],
        at_s: &[1.5, 2.2, 3.1],
    },
    Flight {
        name: "gusts",
        scenario: "hover",
        set: &[
            "disturbance_injector.script=[{kind=\"wind\",mean_w_m_s=[3.0,1.0,0.0],sigma_m_s=[1.5,1.5,0.5]}]",
            "pilot.morph=[[0.0,45.0],[7.0,45.0],[7.5,160.0],[8.0,160.0],[8.4,45.0]]",
        ],
        at_s: &[2.3, 5.1],
    },
];

/// Processor time of this process \[s\].
fn cpu_s() -> f64 {
    let t = clock_gettime(ClockId::ProcessCPUTime);
    t.tv_sec as f64 + t.tv_nsec as f64 * 1e-9
}

fn largest(slot: Slot, scenario: &Scenario, snapshot: &Snapshot) -> [f64; 4] {
    let vehicle = scenario.modelled_vehicle();
    let beta = MorphAngle::saturating_from_rad(snapshot.morph_angle_rad).unwrap_or(MorphAngle::MIN);
    match slot {
        Slot::Attitude => vehicle.largest_wrench(beta),
        Slot::Position => {
            let tilt = scenario.position_law().map_or(0.35, |law| law.tilt_max_rad);
            [vehicle.weight_n(), tilt, tilt, tilt]
        }
    }
}

#[derive(Default)]
struct Table {
    /// Numbers of refused and accepted rehearsals, by slot, entry and flight.
    cells: BTreeMap<(Slot, String), BTreeMap<&'static str, [u32; 2]>>,
    cpu_s: f64,
    count: u32,
    raw: bool,
}

/// Initial condition of rehearsals: a snapshot of a flight, and the owner that is to be replaced.
struct Moment<'a> {
    flight: &'static str,
    scenario: &'a Scenario,
    snapshot: Snapshot,
    slot: Slot,
    owner: &'static str,
    seed: u64,
}

impl Table {
    fn rehearse(&mut self, moment: &Moment<'_>, entry: &Entry) {
        let &Moment { flight, scenario, snapshot, slot, owner, seed } = moment;
        let law = entry.law.clone().unwrap_or_default();
        let is_good = entry.fault == Fault::Nothing;
        let spec = RehearsalSpec {
            scenario: scenario.to_toml().to_owned(),
            snapshot,
            slot,
            owners: PerSlot::default(),
            owner: None,
            candidate: law.clone(),
            config: None,
            seed,
            swap: 1,
        };
        let spoiler = Spoiler::new(entry.clone(), largest(slot, scenario, &snapshot));
        let before_s = cpu_s();
        let done = Rehearsal::prepare(spec).and_then(|rehearsal| {
            rehearsal.fly_with(&mut || true, || Altering::new(slot, spoiler.clone()))
        });
        self.cpu_s += cpu_s() - before_s;
        self.count += 1;
        let verdict = Verdict::of(&law, owner, done);
        let label = if is_good { format!("good {law} for {owner}") } else { entry.name() };
        let cells = self.cells.entry((slot, label.clone())).or_default();
        cells.entry(flight).or_default()[usize::from(verdict.accepted)] += 1;
        let (slot, at_s) = (slot.label(), snapshot.at_ns as f64 / 1e9);
        if verdict.accepted != is_good || self.raw {
            let message = &verdict.message;
            println!(
                "{slot} {flight} seed {seed} at {at_s} {label} ({law} for {owner}): {message}"
            );
        }
        let figures = verdict.measured().filter(|_| self.raw);
        for figure in figures.into_iter().flat_map(|figures| &figures.figures) {
            println!(
                "RAW {slot} {flight} {at_s} {seed} {owner} {law} {:?} {} {:?} {:.2} {} {:?} {:.5} {:.5} {:.5} {:.5}",
                entry.fault,
                entry.amount,
                entry.axis,
                figure.at_s,
                figure.challenge.description().replace(' ', "-"),
                figure.measure,
                figure.candidate,
                figure.owner,
                figure.envelope,
                figure.limit
            );
        }
    }

    fn print(&self) {
        println!("refused/accepted in {}", FLIGHTS.map(|flight| flight.name).join(", "));
        for ((slot, what), cells) in &self.cells {
            let cell = |flight: &Flight| {
                let cell = cells.get(flight.name);
                cell.map_or("-".to_owned(), |[no, yes]| format!("{no}/{yes}"))
            };
            let cells: Vec<String> = FLIGHTS.iter().map(cell).collect();
            println!("{:<9} {what:<40} {}", slot.label(), cells.join("   "));
        }
        let each_s = self.cpu_s / f64::from(self.count.max(1));
        println!("{} rehearsals, {each_s:.3} s of processor time each", self.count);
    }
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let has = |name: &str| arguments.iter().any(|argument| argument == name);
    let only = arguments.iter().find_map(|argument| Slot::named(argument));
    let seeds: u64 = arguments.iter().find_map(|argument| argument.parse().ok()).unwrap_or(1);
    let mut table = Table { raw: has("raw"), ..Table::default() };
    for slot in Slot::ALL.into_iter().filter(|slot| only.is_none_or(|only| only == *slot)) {
        let laws: Vec<&'static str> = names_for(slot.role()).collect();
        let named = FLIGHTS.iter().any(|flight| has(flight.name));
        for flight in FLIGHTS.iter().filter(|flight| !named || has(flight.name)) {
            for seed in 1..=seeds {
                for (nth, owner) in laws.iter().copied().enumerate() {
                    let set = flight.set.iter().map(|set| Override::set(set));
                    let mut edits: Vec<Override> = set.map(|set| set.expect("a setting")).collect();
                    edits.push(Override::seed(seed));
                    let assignment = format!("{}={owner}", slot.label());
                    edits
                        .push(Override::controller(&assignment).expect("a controller of the slot"));
                    let scenario = Scenario::load(flight.scenario, &edits).expect("a scenario");
                    for at_s in flight.at_s {
                        let at_ms = at_s * 1e3 + 13.0 * seed as f64;
                        #[expect(
                            clippy::cast_possible_truncation,
                            clippy::cast_sign_loss,
                            reason = "a few seconds"
                        )]
                        let at_ns = at_ms as u64 * 1_000_000;
                        let snapshot = watch::snapshot_of(&scenario, at_ns).expect("a flight");
                        let snapshot = snapshot.expect("an estimate");
                        let name = flight.name;
                        let scenario = &scenario;
                        let moment = Moment { flight: name, scenario, snapshot, slot, owner, seed };
                        for law in &laws {
                            table.rehearse(&moment, &Entry::default().around(law));
                        }
                        // Any law would do for the faults; the one after the owner's varies with the owner.
                        let spoiled = laws[(nth + 1) % laws.len()];
                        let bad = entries(slot).into_iter().filter(|_| !has("good"));
                        bad.for_each(|entry| table.rehearse(&moment, &entry.around(spoiled)));
                    }
                }
            }
        }
    }
    table.print();
}
