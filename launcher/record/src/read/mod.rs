//! Recordings read back: typed samples, states and events, only if file and build agree.
//!
//! [`RecordedFlight::open`] looks at the head and refuses what cannot be understood;
//! [`RecordedFlight::visit`] streams the file once, a chunk at a time. A file whose writer was
//! killed reads up to the cut; a damaged one is refused when the damage is met.

mod closing_summary;
mod error;
mod layout;
mod pass;
mod records;
mod recover;

pub use error::{LayoutChange, ReadError};
pub use pass::{Closing, RecordVisitor, RecordedEvent, RecordedState, Rescue, seat_config};
pub use recover::{Damage, RecoverError, Recovered, recover};

use super::{Branched, Clock, Continued, Facts, Machine};
use components::StateLayout;
use core::ops::ControlFlow;
use layout::{Channel, Origin};
use mcap::records::Record;
use records::{Ending, Records};
use scenario::Scenario;
use scenario::needs::Available;
use shared_types::{Role, Sample, Topic};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A recording of this build's types.
#[derive(Debug)]
pub struct RecordedFlight {
    path: PathBuf,
    facts: BTreeMap<String, String>,
    branched: Option<Branched>,
    scenario: Scenario,
    /// By name, slash included.
    channels: BTreeMap<String, Channel>,
    /// What the states of the scenario's components look like in this build.
    layouts: Vec<StateLayout>,
}

/// What comes before the first sample.
#[derive(Default)]
struct Head {
    facts: Option<BTreeMap<String, String>>,
    branched: Option<Branched>,
    scenario: Option<String>,
    schemas: BTreeMap<u16, (String, Vec<u8>)>,
    channels: BTreeMap<String, Channel>,
}

/// Name of the last channel of a head.
const LAST_CHANNEL: &str = "/events";

/// Run, build and machine of a recording, as in [`RecordedFlight::facts`], whichever build has written it; none of a
/// file that is no recording, or is cut in its head, as a launcher leaves it that is killed before its flight begins.
#[must_use]
pub fn facts_of(path: &Path) -> Option<BTreeMap<String, String>> {
    let (head, _) = Head::read(Records::open(path).ok()?).ok()?;
    head.facts.filter(|_| head.channels.contains_key(LAST_CHANNEL))
}

impl RecordedFlight {
    /// Reads the head of a recording.
    ///
    /// # Errors
    /// [`ReadError`] for a file that is empty, foreign, damaged or cut in its head, and for one
    /// whose types, topics or scenario are not those of this build.
    pub fn open(path: &Path) -> Result<Self, ReadError> {
        let records = Records::open(path)?;
        let length = records.length();
        let (head, ending) = Head::read(records)?;
        let Head { facts, branched, scenario, channels, .. } = head;
        let missing = if facts.is_none() {
            Some("the metadata `run`")
        } else if scenario.is_none() {
            Some("the attachment scenario.toml")
        } else {
            (!channels.contains_key(LAST_CHANNEL)).then_some("the list of topics")
        };
        let (facts, scenario) = match (facts, scenario, missing) {
            (Some(facts), Some(scenario), None) => (facts, scenario),
            (_, _, missing) => {
                let what = missing.unwrap_or_default().to_owned();
                let path = path.to_owned();
                return Err(match ending {
                    Ending::Cut => ReadError::CutHead { path, length, what },
                    Ending::Whole => {
                        ReadError::Foreign { path, what: format!("{what} is missing") }
                    }
                });
            }
        };
        let recorder = recorder(&facts);
        layout::check(Origin { path, recorder: &recorder }, &channels)?;
        let refuse = |reason: String| ReadError::Scenario {
            path: path.to_owned(),
            reason,
            recorder: recorder.clone(),
        };
        let name = format!("{}: scenario.toml", path.display());
        let scenario = Scenario::from_text(&name, &scenario, &[])
            .map_err(|error| refuse(error.problems().map(ToString::to_string).collect()))?;
        let layouts =
            components::state_layouts(&scenario).map_err(|error| refuse(error.to_string()))?;
        Ok(Self { path: path.to_owned(), facts, branched, scenario, channels, layouts })
    }

    /// The file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What was flown, every override in it.
    #[must_use]
    pub fn scenario(&self) -> &Scenario {
        &self.scenario
    }

    /// Run, build and machine, as in [`Facts::to_metadata`](super::Facts::to_metadata).
    #[must_use]
    pub fn facts(&self) -> &BTreeMap<String, String> {
        &self.facts
    }

    /// Unix time that stands for logical time 0 \[ns\].
    #[must_use]
    pub fn epoch_unix_ns(&self) -> u64 {
        self.facts.get("epoch_unix_ns").and_then(|text| text.parse().ok()).unwrap_or(0)
    }

    /// The change in flight, if it was flown with one.
    #[must_use]
    pub fn branched(&self) -> Option<&Branched> {
        self.branched.as_ref()
    }

    /// What this file goes on from, unless it begins with the flight.
    #[must_use]
    pub fn continued(&self) -> Option<Continued> {
        Continued::from_metadata(&self.facts)
    }

    /// Clock of the flight.
    #[must_use]
    pub fn clock(&self) -> Clock {
        if self.facts.get("clock").is_some_and(|clock| clock == "realtime") {
            let speed = self.facts.get("speed").and_then(|speed| speed.parse().ok());
            Clock::Realtime { speed: speed.unwrap_or(1.0) }
        } else {
            Clock::Lockstep
        }
    }

    /// Facts for a recording made from this one.
    #[must_use]
    pub fn to_facts(&self) -> Facts {
        let fact = |key: &str| self.facts.get(key).cloned().unwrap_or_default();
        let settings = &self.scenario.settings().scenario;
        Facts {
            run_id: fact("run_id"),
            scenario_name: settings.name.clone(),
            scenario_toml: self.scenario.to_toml().to_owned(),
            seed: settings.seed,
            clock: self.clock(),
            epoch_unix_ns: self.epoch_unix_ns(),
            machine: Machine { kernel: fact("kernel"), cpu_model: fact("cpu_model") },
            vehicle: self.scenario.real_vehicle(),
            branch: self.branched.clone(),
            continues: self.continued(),
        }
    }

    /// What the launcher wrote about the flight at the end of the file, as in [`Closing::summary`], without a look at
    /// the samples; none of a file that is cut, or damaged at its end.
    #[must_use]
    pub fn closing_summary(&self) -> Option<BTreeMap<String, String>> {
        closing_summary::closing_summary(&self.path)
    }

    /// Streams the file once, in the order recorded, and returns how it ends.
    ///
    /// # Errors
    /// [`ReadError`] where the file is damaged, or a state is not of this build.
    pub fn visit<V: RecordVisitor>(&self, visitor: &mut V) -> Result<Closing, ReadError> {
        pass::visit(self, visitor)
    }

    /// Looks whether its samples fit into memory, for a caller that keeps them.
    ///
    /// # Errors
    /// [`ReadError::TooLong`].
    pub fn require_memory(&self) -> Result<(), ReadError> {
        let path = self.path.clone();
        let length = std::fs::metadata(&path).map_or(0, |metadata| metadata.len());
        let needed = length.saturating_mul(UNPACKED);
        match Available::here().map(|left| left.mb << 20) {
            Some(free) if needed > free => Err(ReadError::TooLong { path, length, needed, free }),
            _ => Ok(()),
        }
    }

    /// All samples of a topic, in the order recorded.
    ///
    /// # Errors
    /// As [`visit`](Self::visit).
    pub fn samples<T: Sample>(&self, topic: &'static Topic<T>) -> Result<Vec<T>, ReadError> {
        let mut collect = pass::Collect { topic: topic.info.name, samples: Vec::new() };
        self.visit(&mut collect)?;
        Ok(collect.samples)
    }

    /// All published states of a role, in the order recorded.
    ///
    /// # Errors
    /// As [`visit`](Self::visit).
    pub fn states(&self, role: Role) -> Result<Vec<RecordedState>, ReadError> {
        let mut collect = pass::CollectStates { role, states: Vec::new() };
        self.visit(&mut collect)?;
        Ok(collect.states)
    }

    fn recorder(&self) -> String {
        recorder(&self.facts)
    }
}

/// Bytes of samples in memory for one of a file, at most.
const UNPACKED: u64 = 3;

/// The build that recorded a file.
fn recorder(facts: &BTreeMap<String, String>) -> String {
    let fact = |key: &str| facts.get(key).map_or("unknown", String::as_str);
    format!("morphquad {} ({})", fact("version"), fact("git"))
}

impl Head {
    /// Reads up to the last channel, or to where the file ends before it.
    fn read(records: Records) -> Result<(Self, Ending), ReadError> {
        let mut head = Self::default();
        let ending = records.for_each(|record| {
            head.take(record);
            let complete = head.channels.contains_key(LAST_CHANNEL);
            Ok(if complete { ControlFlow::Break(()) } else { ControlFlow::Continue(()) })
        })?;
        Ok((head, ending))
    }

    fn take(&mut self, record: Record<'_>) {
        match record {
            Record::Metadata(metadata) if metadata.name == "run" => {
                self.facts = Some(metadata.metadata);
            }
            Record::Metadata(metadata) if metadata.name == "branch" => {
                self.branched = Some(Branched::from_metadata(&metadata.metadata));
            }
            Record::Attachment { header, data, .. } if header.name == "scenario.toml" => {
                self.scenario = Some(String::from_utf8_lossy(&data).into_owned());
            }
            Record::Schema { header, data } => {
                self.schemas.insert(header.id, (header.name, data.into_owned()));
            }
            Record::Channel(channel) => {
                let schema = self.schemas.get(&channel.schema_id).cloned();
                let (type_name, descriptors) = schema.unwrap_or_default();
                let metadata = channel.metadata;
                let channel_ = Channel { id: channel.id, type_name, descriptors, metadata };
                self.channels.insert(channel.topic, channel_);
            }
            _ => {}
        }
    }
}
