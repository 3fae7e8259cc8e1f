//! A sample as a row of a table.

use core::fmt::Write as _;
use document::suggestion;
use figures::results::{Kind as Column, Value as Cell};
use protocol::topic::fields::{enum_text, word};
use shared_types::wire::{Field, Kind, Schema, Visitor, Wire};

/// Headings of a table with a column for each number of a sample.
#[must_use]
pub fn headings(schema: &Schema) -> Vec<(String, Column)> {
    let mut all = Vec::new();
    head(schema, "", &mut all);
    all
}

/// Whether a column belongs to a field, which may be a list or a group of several.
#[must_use]
pub fn is_of(column: &str, field: &str) -> bool {
    let rest = column.strip_prefix(field);
    rest.is_some_and(|rest| rest.is_empty() || rest.starts_with(['[', '.']))
}

/// The hint for a field that no column belongs to: where it stands in a group, or the name that it resembles.
#[must_use]
pub fn field_remedy(columns: &[(String, Column)], field: &str) -> String {
    let inside = columns.iter().find_map(|(column, _)| {
        let (group, inner) = column.rsplit_once('.')?;
        is_of(inner, field).then(|| format!("did you mean `{group}.{field}`?"))
    });
    inside.unwrap_or_else(|| {
        let names = columns.iter().filter_map(|(column, _)| column.split(['[', '.']).next());
        let mut names: Vec<&str> = names.collect();
        names.dedup();
        suggestion(field, names.into_iter())
    })
}

fn head(schema: &Schema, prefix: &str, all: &mut Vec<(String, Column)>) {
    for field in schema.fields {
        let name = format!("{prefix}{}", field.name);
        let kind = match field.kind {
            Kind::Message(inner) => {
                for place in 0..field.count {
                    let at = if field.repeated { format!("[{place}]") } else { String::new() };
                    head(inner, &format!("{name}{at}."), all);
                }
                continue;
            }
            Kind::F64 => Column::Number,
            Kind::Enum(_) => Column::Text,
            Kind::U8 | Kind::I8 => {
                all.push((name, Column::Text));
                continue;
            }
            Kind::U64 | Kind::U32 => Column::Whole,
        };
        if field.repeated {
            all.extend((0..field.count).map(|place| (format!("{name}[{place}]"), kind)));
        } else {
            all.push((name, kind));
        }
    }
}

/// The cells under [`headings`].
pub(crate) fn cells<T: Wire>(value: &T) -> Vec<Cell> {
    let mut cells = ToCells(Vec::new());
    value.visit(&mut cells);
    cells.0
}

struct ToCells(Vec<Cell>);

impl Visitor for ToCells {
    fn f64s(&mut self, _field: &'static Field, values: &[f64]) {
        self.0.extend(values.iter().map(|value| Cell::Number(*value)));
    }
    fn u64s(&mut self, field: &'static Field, values: &[u64]) {
        match field.kind {
            Kind::Enum(kind) => {
                self.0.extend(values.iter().map(|value| Cell::Text(enum_text(kind, *value))));
            }
            _ => self.0.extend(values.iter().map(|value| Cell::Whole(*value))),
        }
    }
    fn bytes(&mut self, _field: &'static Field, values: &[u8]) {
        let hex = || {
            values.iter().fold(String::new(), |mut text, byte| {
                let _ = write!(text, "{byte:02x}");
                text
            })
        };
        self.0.push(Cell::Text(word(values).map_or_else(hex, str::to_owned)));
    }
    fn message<T: Wire>(&mut self, _field: &'static Field, value: &T) {
        value.visit(self);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::topics::visit_all;
    use shared_types::{Sample, Topic, TopicVisitor};

    #[test]
    fn every_topic_has_a_cell_for_each_heading_and_no_heading_comes_twice() {
        struct Check;
        impl TopicVisitor for Check {
            type Error = core::convert::Infallible;
            fn visit<T: Sample>(&mut self, topic: &'static Topic<T>) -> Result<(), Self::Error> {
                let headings = headings(&T::SCHEMA);
                let cells = cells(&T::default());
                assert_eq!(headings.len(), cells.len(), "{}", topic.info.name);
                for ((name, kind), cell) in headings.iter().zip(&cells) {
                    let fits = matches!(
                        (kind, cell),
                        (Column::Whole, Cell::Whole(_))
                            | (Column::Number, Cell::Number(_))
                            | (Column::Text, Cell::Text(_))
                    );
                    assert!(fits, "{name}: {cell:?}");
                }
                let mut names: Vec<_> = headings.iter().map(|(name, _)| name).collect();
                names.sort();
                names.dedup();
                assert_eq!(names.len(), headings.len(), "{}", topic.info.name);
                Ok(())
            }
        }
        let Ok(()) = visit_all(&mut Check);
    }
}
