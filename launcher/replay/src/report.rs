//! Text and tables for people, JSON for machines.

use super::{Departure, Difference, Hashes, Loss, Verification};
use core::fmt;
use serde_json::{Value, json};
use shared_types::Role;
use shared_types::time::s_from_ns;

impl Difference {
    fn json(&self) -> Value {
        json!({
            "t_s": s_from_ns(self.release_ns),
            "release": self.release_index,
            "topic": self.topic,
            "field": self.field,
            "recorded": self.recorded,
            "replayed": self.replayed,
        })
    }
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { release_index, topic, field, recorded, replayed, .. } = self;
        let t_s = s_from_ns(self.release_ns);
        write!(f, "release {release_index} at {t_s:.6} s, {topic}.{field}: ")?;
        write!(f, "recorded {recorded}, replayed {replayed}")
    }
}

impl Verification {
    /// As a JSON object.
    #[must_use]
    pub fn to_json(&self) -> Value {
        let first = |difference: &Option<Difference>| difference.as_ref().map(Difference::json);
        let services: Vec<Value> = self
            .services
            .iter()
            .map(|service| {
                json!({
                    "service": service.instance.role.label(),
                    "instance": service.instance.to_string(),
                    "left_out": service.left_out,
                    "loss": service.loss.map(|loss| json!({ "topic": loss.topic, "after_s": s_from_ns(loss.after_ns) })),
                    "steps": service.steps,
                    "samples": service.samples,
                    "states": service.states,
                    "unrecorded": service.unrecorded,
                    "differences": service.differences,
                    "first_difference": first(&service.first),
                })
            })
            .collect();
        json!({
            "identical": self.identical(),
            "complete": self.complete,
            "services": services,
            "first_difference": self.first().map(|(instance, difference)| {
                let mut object = difference.json();
                object["service"] = instance.role.label().into();
                object["instance"] = instance.to_string().into();
                object
            }),
        })
    }
}

impl fmt::Display for Verification {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some((instance, difference)) = self.first() {
            writeln!(f, "first difference: {instance}, {difference}")?;
        }
        let names: Vec<String> = self.services.iter().map(|s| s.instance.to_string()).collect();
        let width = names.iter().map(String::len).max().unwrap_or(0).max(12);
        let lost = self.services.iter().any(|service| service.unrecorded > 0);
        write!(
            f,
            "  {:<width$} {:>9} {:>9} {:>9} {:>12}",
            "service", "steps", "samples", "states", "differences"
        )?;
        writeln!(f, "{}", if lost { "  not recorded" } else { "" })?;
        for (name, service) in names.iter().zip(&self.services) {
            if let Some(why) = service.left_out {
                writeln!(f, "  {name:<width$} not flown again: {why}")?;
                continue;
            }
            write!(
                f,
                "  {name:<width$} {:>9} {:>9} {:>9} {:>12}",
                service.steps, service.samples, service.states, service.differences
            )?;
            if lost {
                write!(f, "{:>14}", service.unrecorded)?;
            }
            writeln!(f)?;
        }
        for (name, service) in names.iter().zip(&self.services) {
            if let Some(Loss { topic, after_ns }) = service.loss {
                let after_s = s_from_ns(after_ns);
                writeln!(
                    f,
                    "  {name} is compared up to {after_s:.6} s: the recorder then lost samples of {topic} that it had"
                )?;
            }
        }
        if !self.complete {
            writeln!(
                f,
                "  the file ends early: its recorder was killed or still writes, or the copy is a part; \
                 compared up to what it completely holds"
            )?;
        }
        let is_cut = self.services.iter().any(|service| service.loss.is_some());
        let word = match self.first() {
            Some(_) => "different",
            None if self.identical() && is_cut => "identical, as far as it could be compared",
            None if self.identical() => "identical",
            None if is_cut => {
                "nothing could be compared: the recorder lost samples at the beginning"
            }
            None => {
                "nothing could be compared: the file ends before it is known what the steps had"
            }
        };
        f.write_str(word)
    }
}

impl Departure {
    /// As a JSON object.
    #[must_use]
    pub fn to_json(&self, role: Role) -> Value {
        let fields: Vec<Value> = self
            .fields
            .iter()
            .map(|field| {
                json!({
                    "topic": field.topic,
                    "field": field.field,
                    "differing": field.differing,
                    "first_s": s_from_ns(field.first_ns),
                    "max": field.max,
                    "rms": field.rms,
                })
            })
            .collect();
        json!({
            "service": role.label(),
            "samples": self.samples,
            "unmatched": self.unmatched,
            "first_departure": self.first.as_ref().map(Difference::json),
            "fields": fields,
        })
    }
}

impl fmt::Display for Departure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Some(first) = &self.first else {
            write!(f, "{} samples, no departure", self.samples)?;
            return match self.unmatched {
                0 => Ok(()),
                count => write!(f, "; {count} samples on one side only"),
            };
        };
        writeln!(f, "departs first: {first}")?;
        let width = |field: &super::FieldDeparture| field.topic.len() + 1 + field.field.len();
        let width = self.fields.iter().map(width).max().unwrap_or(0);
        writeln!(
            f,
            "  {:<width$} {:>9} {:>10} {:>11} {:>11}",
            "field", "samples", "first s", "max", "rms"
        )?;
        for field in &self.fields {
            let name = format!("{}.{}", field.topic, field.field);
            let first_s = s_from_ns(field.first_ns);
            writeln!(
                f,
                "  {name:<width$} {:>9} {first_s:>10.3} {:>11.4e} {:>11.4e}",
                field.differing, field.max, field.rms
            )?;
        }
        write!(f, "{} samples compared, {} on one side only", self.samples, self.unmatched)
    }
}

impl Hashes {
    /// As a JSON object.
    #[must_use]
    pub fn to_json(&self) -> Value {
        json!({
            "hash": self.flight,
            "log_hash": self.log,
            "stored_hash": self.stored_flight,
            "stored_log_hash": self.stored_log,
            "agree": (self.stored_flight.is_some() || self.stored_log.is_some()).then(|| self.agree()),
        })
    }
}

impl fmt::Display for Hashes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let line = |name: &str, ours: &str, stored: &Option<String>| match stored {
            Some(stored) if stored == ours => format!("{name} {ours} as stored"),
            Some(stored) => format!("{name} {ours} DIFFERS, stored {stored}"),
            None => format!(
                "{name} {ours}, none stored of this form: the file ends early, or an earlier build made it"
            ),
        };
        writeln!(f, "{}", line("hash", &self.flight, &self.stored_flight))?;
        write!(f, "{}", line("log_hash", &self.log, &self.stored_log))
    }
}
