//! Whether the loops of a repeated stretch of flight went through what those of the recording did.

use observe::Observer;
use shared_types::{Deviation, DeviationKind, Role, Sample, Topic, topics};
use simulate::in_process::{Difference, Tape};
use std::any::Any;

/// What the loops report about their steps.
#[derive(Debug, Default)]
pub(super) struct Deviations(Vec<Deviation>);

impl Observer for Deviations {
    fn observe<T: Sample>(&mut self, _topic: &'static Topic<T>, sample: &T) {
        let any: &dyn Any = sample;
        self.0.extend(any.downcast_ref::<Deviation>());
    }
}

impl Deviations {
    /// The first deviation that only one of the two flights has of the loop of `role`, from `from_ns` to
    /// `at_ns`. Late samples are among them: no sample is late in a repetition.
    pub(super) fn difference(
        &self,
        tape: &Tape,
        role: Role,
        (from_ns, at_ns): (u64, u64),
    ) -> Option<Difference> {
        let generation = tape.generation_at(role, at_ns);
        let recorded = tape.reported_by(role, generation, at_ns);
        let recorded = recorded.filter(|deviation| deviation.header.release_ns >= from_ns);
        let (mut recorded, mut repeated) =
            (recorded, self.0.iter().filter(|deviation| deviation.role == role));
        loop {
            let pair = (recorded.next(), repeated.next());
            if pair.0.map(content) == pair.1.map(content) {
                pair.0?;
                continue;
            }
            let first = pair
                .0
                .into_iter()
                .chain(pair.1)
                .min_by_key(|deviation| deviation.header.release_ns)?;
            let what =
                |deviation: Option<&Deviation>| deviation.map_or("none".to_owned(), description);
            return Some(Difference {
                release_ns: first.header.release_ns,
                topic: topics::DEVIATION.info.name,
                field: role.label().to_owned(),
                old: what(pair.0),
                new: what(pair.1),
            });
        }
    }
}

/// Everything that is the same each time.
fn content(deviation: &Deviation) -> (u64, DeviationKind, &str, u64, u64, u64) {
    let Deviation { header, kind, first, last, due_ns, .. } = deviation;
    (header.release_ns, *kind, deviation.input_name(), *first, *last, *due_ns)
}

fn description(deviation: &Deviation) -> String {
    let Deviation { kind, first, last, .. } = deviation;
    format!("{kind:?} {} {first}..={last}", deviation.input_name())
}
