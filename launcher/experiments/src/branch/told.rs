//! Whether the loops of a repeated stretch of flight went through what those of the recording did.

use observe::Observer;
use shared_types::{Deviation, DeviationKind, Role, Sample, Topic, topics};
use simulate::in_process::{Difference, Tape};
use std::any::Any;

/// What the loops tell of their steps.
#[derive(Debug, Default)]
pub(super) struct Told(Vec<Deviation>);

impl Observer for Told {
    fn observe<T: Sample>(&mut self, _topic: &'static Topic<T>, sample: &T) {
        let any: &dyn Any = sample;
        self.0.extend(any.downcast_ref::<Deviation>());
    }
}

impl Told {
    /// The first thing that only one of the two flights tells of the loop of `role`, from `from_ns` to
    /// `at_ns`. Late samples are among them: no sample is late in a repetition.
    pub(super) fn difference(
        &self,
        tape: &Tape,
        role: Role,
        (from_ns, at_ns): (u64, u64),
    ) -> Option<Difference> {
        let generation = tape.generation_at(role, at_ns);
        let recorded = tape.told_by(role, generation, at_ns);
        let recorded = recorded.filter(|told| told.header.release_ns >= from_ns);
        let (mut recorded, mut repeated) =
            (recorded, self.0.iter().filter(|told| told.role == role));
        loop {
            let pair = (recorded.next(), repeated.next());
            if pair.0.map(content) == pair.1.map(content) {
                pair.0?;
                continue;
            }
            let first =
                pair.0.into_iter().chain(pair.1).min_by_key(|told| told.header.release_ns)?;
            let what = |told: Option<&Deviation>| told.map_or("none".to_owned(), words);
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
fn content(told: &Deviation) -> (u64, DeviationKind, &str, u64, u64, u64) {
    let Deviation { header, kind, first, last, due_ns, .. } = told;
    (header.release_ns, *kind, told.input_name(), *first, *last, *due_ns)
}

fn words(told: &Deviation) -> String {
    let Deviation { kind, first, last, .. } = told;
    format!("{kind:?} {} {first}..={last}", told.input_name())
}
