//! What the page shows of a running flight, in bounded memory: everything so far, or what is new.

use crate::view::{Collect, Happening, Owners, json};
use protocol::control::status::RunStatus;
use protocol::topic::feed::{Ending, Flying};
use record::read::{RecordVisitor as _, RecordedEvent};
use runtime::clock::mono_now_ns;
use scenario::{Scenario, services};
use serde_json::{Value, json};
use shared_types::time::{ns_from_s, s_from_ns};
use shared_types::{Sample, Slot, Topic};

/// How much of what a page has already is sent again, for reports and set points come after the instant
/// that they are about \[ns\].
const OVERLAP_NS: u64 = 1_000_000_000;

/// A flight as far as it has come.
#[derive(Debug)]
pub(super) struct Picture {
    /// When this process began to draw it \[ns\]: a page asks another one for everything.
    begun_mono_ns: u64,
    collect: Collect,
    vehicle: Value,
    facts: Value,
    live: Value,
    title: String,
    status: Option<RunStatus>,
    /// Samples that came too fast for this process.
    dropped: u64,
    ending: Option<Ending>,
    /// Its launcher has died.
    is_orphan: bool,
    /// What it is then.
    orphan: &'static str,
}

impl Picture {
    pub(super) fn new(run: &str, scenario: &Scenario, flying: Flying) -> Self {
        let vehicle = scenario.modelled_vehicle();
        let settings = &scenario.settings().scenario;
        let clock = match flying.speed {
            None => "lockstep".to_owned(),
            Some(speed) => format!("realtime, speed {speed}"),
        };
        let facts = json!([
            ["run", run],
            ["scenario", settings.name],
            ["clock", clock],
            ["seed", settings.seed.to_string()],
            ["planned", format!("{} s", settings.duration_s)],
            ["build", format!("{} ({})", env!("CARGO_PKG_VERSION"), record::build::declared().git)],
        ]);
        let slots = Slot::ALL.map(|slot| {
            let controllers: Vec<&str> = services::names_for(slot.role()).collect();
            json!({ "slot": slot.label(), "controllers": controllers })
        });
        Self {
            begun_mono_ns: mono_now_ns(),
            collect: Collect::new(
                Owners::default(),
                flying.epoch_unix_ns,
                flying.clock(),
                vehicle.rotor_thrust_max_n,
            ),
            vehicle: json::vehicle(&vehicle),
            facts,
            live: json!({ "run": run, "may_order": true, "slots": slots }),
            title: format!("{} · run {run}", settings.name),
            status: None,
            dropped: 0,
            ending: None,
            is_orphan: false,
            orphan: match flying.speed {
                None => {
                    "its launcher has died, which ends a flight in lockstep; its recording can be read"
                }
                Some(_) => "running, but its launcher has died: `morphquad adopt` goes on with it",
            },
        }
    }

    /// The page has the buttons of a demo.
    pub(super) fn is_demo(&mut self) {
        self.live["demo"] = true.into();
    }

    pub(super) fn sample<T: Sample>(&mut self, topic: &'static Topic<T>, sample: &T) {
        let Self { collect, .. } = self;
        collect.owners.sample(topic, sample);
        let changes = core::mem::take(&mut collect.owners.happenings);
        collect.happenings.extend(changes);
        collect.sample(topic, sample);
    }

    /// Takes a logged event, as `foxglove.Log`.
    pub(super) fn log(&mut self, log: &[u8]) {
        if let Ok(event) = RecordedEvent::decode(log) {
            self.collect.event(event);
        }
    }

    pub(super) fn dropped(&mut self, count: u64) {
        self.dropped += count;
    }

    pub(super) fn status(&mut self, status: Option<RunStatus>) {
        self.status = status;
    }

    /// Takes note that there is no launcher, or that there is one again.
    pub(super) fn orphaned(&mut self, is_orphan: bool) {
        self.is_orphan = is_orphan;
    }

    pub(super) fn end(&mut self, ending: Ending) {
        self.collect.finish();
        self.ending = Some(ending);
    }

    /// Everything so far, for a page that begins.
    pub(super) fn whole(&self) -> Value {
        let mut json = self.now(0, 0);
        json["charts"] = json::all_charts(&self.collect.panels);
        json["title"] = self.title.as_str().into();
        json["facts"] = self.facts.clone();
        json["vehicle"] = self.vehicle.clone();
        json["live"] = self.live.clone();
        json
    }

    /// What is new to a page that knows all up to `since_s` and the first `events` events.
    pub(super) fn since(&self, since_s: f64, events: usize) -> Value {
        let since_ns = ns_from_s(since_s);
        self.now(since_ns.saturating_sub(OVERLAP_NS), events)
    }

    fn now(&self, from_ns: u64, events: usize) -> Value {
        let Self { collect, status, dropped, ending, is_orphan, .. } = self;
        let (begin_ns, end_ns) = collect.span_ns.unwrap_or((0, 0));
        let outcome = match ending {
            Some(ending) => json!(ending),
            None if *is_orphan => json!({
                "is_good": false,
                "text": self.orphan,
            }),
            None => {
                let trouble = collect.trouble();
                let text =
                    trouble.as_ref().map_or("running".to_owned(), |why| format!("running, {why}"));
                json!({ "is_good": trouble.is_none(), "text": text })
            }
        };
        let first = events.min(collect.happenings.len());
        let news: &[Happening] = &collect.happenings[first..];
        json!({
            "format": 1,
            "server": self.begun_mono_ns,
            "from_s": s_from_ns(begin_ns),
            "to_s": s_from_ns(end_ns),
            "is_over": ending.is_some(),
            "outcome": outcome,
            "frames": json::frames(&collect.frames, from_ns.saturating_sub(begin_ns), ending.is_none()),
            "charts": json::charts_since(&collect.panels, from_ns),
            "events_first": first,
            "events": news,
            "loops": json::loops(&collect.loops.seats()),
            "dropped": dropped,
            "status": status,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::{Truth, topics};

    fn picture() -> Picture {
        let scenario = Scenario::load("hover", &[]).unwrap();
        Picture::new("x", &scenario, Flying::default())
    }

    fn fly(picture: &mut Picture, ticks: core::ops::Range<u64>) {
        for tick in ticks {
            let mut truth = Truth::default();
            truth.q_wb.w = 1.0;
            truth.header.release_ns = tick * 1_000_000;
            truth.header.valid_ns = tick * 1_000_000;
            truth.position_w_m = [0.0, 0.0, tick as f64];
            picture.sample(&topics::TRUTH, &truth);
        }
    }

    #[test]
    fn what_is_new_continues_what_was_sent_and_its_shape_never_changes() {
        let mut picture = picture();
        let empty = picture.whole();
        fly(&mut picture, 0..3000);
        let whole = picture.whole();
        fly(&mut picture, 3000..4000);
        let news = picture.since(2.999, 0);
        let shape = |json: &Value| -> Vec<usize> {
            let charts = json["charts"].as_array().unwrap().iter();
            charts.map(|chart| chart["series"].as_array().unwrap().len()).collect()
        };
        assert!(shape(&empty).iter().all(|series| *series > 0));
        assert_eq!((shape(&empty), shape(&whole)), (shape(&whole), shape(&news)));
        assert_eq!(
            (&whole["frames"]["first"], &whole["frames"]["count"]),
            (&0.into(), &300.into())
        );
        assert_eq!(
            (&news["frames"]["first"], &news["frames"]["count"]),
            (&199.into(), &400.into())
        );
        let angle = &news["charts"][1]["series"][0];
        assert!(angle["first"].as_u64() > Some(0) && angle["least"].as_str().is_some(), "{angle}");
        assert!(news["vehicle"].is_null() && whole["vehicle"].is_object());
    }

    #[test]
    fn events_are_sent_once_and_the_end_to_each_client_that_asks_after_it() {
        let mut picture = picture();
        let mut log = Vec::new();
        let event = record::Event {
            logical_ns: 5,
            severity: record::Severity::Error,
            source: "s",
            text: "broken",
        };
        record::encode_log(&event, 5, &mut log);
        picture.log(&log);
        picture.log(b"garbage");
        assert_eq!(picture.whole()["events"].as_array().map(Vec::len), Some(1));
        let news = picture.since(0.0, 1);
        assert_eq!((&news["events_first"], &news["events"]), (&1.into(), &json!([])));
        assert_eq!(picture.since(0.0, 99)["events_first"], 1);
        assert_eq!(
            (&news["is_over"], &news["outcome"]["text"]),
            (&false.into(), &"running".into())
        );
        picture.orphaned(true);
        let outcome = picture.since(0.0, 1)["outcome"]["text"].to_string();
        assert!(outcome.contains("lockstep") && !outcome.contains("adopt"), "{outcome}");
        let flying = Flying { speed: Some(1.0), ..Flying::default() };
        picture = Picture::new("x", &Scenario::load("hover", &[]).unwrap(), flying);
        picture.orphaned(true);
        assert!(picture.whole()["outcome"]["text"].to_string().contains("morphquad adopt"));
        picture.end(Ending { is_good: false, text: "lost".to_owned() });
        let last = picture.since(0.0, 1);
        assert_eq!(last["outcome"], json!({ "is_good": false, "text": "lost" }));
        assert_eq!(last["is_over"], true);
    }
}
