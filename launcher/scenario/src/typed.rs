//! From the merged document to types, section by section, with every complaint at its place.

use super::settings::{SECTIONS, Settings};
use ::pilot::settings::{self as pilot, Manoeuvre};
use core::ops::Range;
use disturbance_injector::Event;
use document::{Document, Problem, Value, suggestion};
use garde::Validate;
use serde::de::DeserializeOwned;
use toml::Spanned;
use toml::de::{DeTable, DeValue, ValueDeserializer};

macro_rules! kinds {
    ($($kind:ident $variant:ident,)*) => {
        /// Words for `kind` of an event of the disturbance injector.
        pub(super) const EVENT_KINDS: &[&str] = &[$(stringify!($kind)),*];
    };
}
with_events!(kinds);

/// Types the whole document.
pub(super) fn settings(document: &Document<'_>) -> Result<Settings, Vec<Problem>> {
    let mut reader = Reader { document, problems: Vec::new() };
    reader.refuse_unknown_sections();
    reader.refuse_what_is_no_number();
    if !reader.problems.is_empty() {
        return Err(reader.problems);
    }
    macro_rules! read {
        ($($name:ident $how:ident $type:ty,)*) => {
            Settings { $($name: reader.$how(stringify!($name)),)* }
        };
    }
    let settings = with_sections!(read);
    if reader.problems.is_empty() { Ok(settings) } else { Err(reader.problems) }
}

struct Reader<'d, 't> {
    document: &'d Document<'t>,
    problems: Vec<Problem>,
}

impl<'t> Reader<'_, 't> {
    fn refuse_unknown_sections(&mut self) {
        for (key, _) in self.document.root() {
            let name = key.get_ref().as_ref();
            if !SECTIONS.contains(&name) {
                let remedy = suggestion(name, SECTIONS.iter().copied());
                self.complain(name, "there is no such section", remedy, &key.span());
            }
        }
    }

    /// No key takes NaN or an infinity, so that no range check has to think of them.
    fn refuse_what_is_no_number(&mut self) {
        let mut found = Vec::new();
        self.document.walk(&mut |path, _, value| {
            let number = value.get_ref().as_float().and_then(|f| f.as_str().parse::<f64>().ok());
            if let Some(number) = number.filter(|number| !number.is_finite()) {
                found.push((path.to_owned(), number, value.span()));
            }
        });
        for (path, number, span) in found {
            let what = format!("{number} is not a number that anything can be set to");
            self.complain(&path, what, "give a finite number".to_owned(), &span);
        }
    }

    fn section<T: DeserializeOwned + Validate<Context = ()> + Default>(&mut self, name: &str) -> T {
        let value = self.document.root().get(name).cloned();
        self.validated(name, value)
    }

    /// Each `[[name]]`.
    fn list<T: DeserializeOwned + Validate<Context = ()>>(&mut self, name: &str) -> Vec<T> {
        let Some(section) = self.document.root().get(name).cloned() else { return Vec::new() };
        let Some(entries) = section.get_ref().as_array() else {
            let remedy = format!("write [[{name}]] above each entry");
            self.complain(name, "is not a list", remedy, &section.span());
            return Vec::new();
        };
        let mut list = Vec::new();
        for (index, entry) in entries.iter().enumerate() {
            let Some(settings) = self.typed::<T>(entry.clone()) else { continue };
            self.validate(&format!("{name}[{index}]"), &settings);
            list.push(settings);
        }
        list
    }

    fn validated<T>(&mut self, name: &str, value: Option<Value<'t>>) -> T
    where
        T: DeserializeOwned + Validate<Context = ()> + Default,
    {
        let settings = value.and_then(|value| self.typed::<T>(value)).unwrap_or_default();
        self.validate(name, &settings);
        settings
    }

    fn validate<T: Validate<Context = ()>>(&mut self, name: &str, settings: &T) {
        let Err(report) = settings.validate() else { return };
        for (path, error) in report.iter() {
            // The validator numbers an enum's only field, which the text does not.
            let key = format!("{name}.{path}").replace("][0].", "].");
            let place = self.document.place_of(&key);
            let (what, remedy) = range_message(error.message());
            self.problems.push(Problem::new(key, what, remedy, place));
        }
    }

    fn typed<T: DeserializeOwned>(&mut self, value: Value<'t>) -> Option<T> {
        match T::deserialize(ValueDeserializer::from(value)) {
            Ok(settings) => Some(settings),
            Err(error) => {
                let span = error.span().unwrap_or(0..0);
                let key = self.document.key_at(&span);
                let (what, remedy) = type_message(error.message());
                self.complain(&key, what, remedy, &span);
                None
            }
        }
    }

    /// `kind` decides which keys the section has; serde's tagged enums would lose the places.
    fn pilot(&mut self, name: &str) -> pilot::Settings {
        let Some(section) = self.document.root().get(name) else {
            return pilot::Settings::default();
        };
        let span = section.span();
        let Some(table) = section.get_ref().as_table() else {
            self.complain(name, "is not a section", format!("write [{name}]"), &span);
            return pilot::Settings::default();
        };
        let (mut common, mut own) = (DeTable::new(), table.clone());
        for key in pilot::COMMON_KEYS {
            if let Some((key, value)) = own.remove_entry(key) {
                common.insert(key, value);
            }
        }
        let Some(kind) = self.kind(&mut own, &span, name, &pilot::KINDS) else {
            return pilot::Settings::default();
        };
        let section = |table| Some(Spanned::new(span.clone(), DeValue::Table(table)));
        let common = self.validated(name, section(common));
        let own = section(own);
        let manoeuvre = match kind {
            "hover" => Manoeuvre::Hover(self.validated(name, own)),
            "figure8" => Manoeuvre::Figure8(self.validated(name, own)),
            "waypoints" => Manoeuvre::Waypoints(self.validated(name, own)),
            "trajectory" => Manoeuvre::Trajectory(self.validated(name, own)),
            _ => Manoeuvre::AttitudeStep(self.validated(name, own)),
        };
        pilot::Settings { common, manoeuvre }
    }

    fn injector(&mut self, name: &str) -> disturbance_injector::settings::Settings {
        let Some(mut section) = self.document.root().get(name).cloned() else {
            return disturbance_injector::settings::Settings::default();
        };
        let script = match section.get_mut() {
            DeValue::Table(table) => table.remove("script"),
            _ => None,
        };
        let mut settings =
            self.typed::<disturbance_injector::settings::Settings>(section).unwrap_or_default();
        let events = script.as_ref().and_then(|script| script.get_ref().as_array());
        if let (Some(script), None) = (&script, events) {
            let key = format!("{name}.script");
            let remedy = format!("write [[{key}]] above each event");
            self.complain(&key, "is not a list", remedy, &script.span());
        }
        let complaints = self.problems.len();
        for (index, event) in events.into_iter().flat_map(|array| array.iter()).enumerate() {
            settings.script.extend(self.event(&format!("{name}.script[{index}]"), event.clone()));
        }
        // With an event missing the places of the others would be wrong.
        if self.problems.len() == complaints {
            self.validate(name, &settings);
        }
        settings
    }

    fn event(&mut self, path: &str, event: Value<'t>) -> Option<Event> {
        let span = event.span();
        let DeValue::Table(mut table) = event.into_inner() else {
            let remedy = "write { kind = \"...\", ... }".to_owned();
            self.complain(path, "is not an event", remedy, &span);
            return None;
        };
        let kind = self.kind(&mut table, &span, path, EVENT_KINDS)?;
        let own = Spanned::new(span, DeValue::Table(table));
        macro_rules! read {
            ($($word:ident $variant:ident,)*) => {
                $(if kind == stringify!($word) {
                    return self.typed(own).map(Event::$variant);
                })*
            };
        }
        with_events!(read);
        None
    }

    /// Takes `kind` out of a table.
    fn kind(
        &mut self,
        table: &mut DeTable<'t>,
        span: &Range<usize>,
        path: &str,
        kinds: &[&'static str],
    ) -> Option<&'static str> {
        let value = table.remove("kind");
        let key = format!("{path}.kind");
        let word = value.as_ref().and_then(|value| value.get_ref().as_str()).unwrap_or("");
        let known = kinds.iter().find(|kind| **kind == word).copied();
        if known.is_none() {
            let remedy = suggestion(word, kinds.iter().copied());
            let what = if value.is_some() { "is none of the known kinds" } else { "is missing" };
            self.complain(&key, what, remedy, &value.map_or(span.clone(), |value| value.span()));
        }
        known
    }

    fn complain(
        &mut self,
        key: &str,
        what: impl Into<String>,
        remedy: String,
        span: &Range<usize>,
    ) {
        let problem = Problem::new(key, what, remedy, self.document.place(span));
        self.problems.push(problem.into_malformed());
    }
}

/// A validator's message, and what to do.
fn range_message(message: &str) -> (String, String) {
    if let Some(least) = message.strip_prefix("lower than ") {
        return (format!("is {message}"), format!("write a number of at least {least}"));
    }
    if let Some(most) = message.strip_prefix("greater than ") {
        return (format!("is {message}"), format!("write a number of at most {most}"));
    }
    let remedy = message.split_once("is not a ").map_or_else(
        || "change the value so that this no longer holds".to_owned(),
        |(_, wanted)| format!("write a {wanted}"),
    );
    (message.to_owned(), remedy)
}

/// A parser's message, and what to do.
fn type_message(message: &str) -> (String, String) {
    if let Some(rest) = message.strip_prefix("unknown field ") {
        return ("there is no such key here".to_owned(), among(rest));
    }
    if let Some(rest) = message.strip_prefix("unknown variant ") {
        return ("is none of the known words".to_owned(), among(rest));
    }
    let remedy = match message.split_once("expected ") {
        Some((given, "f64")) if given.contains("string") => {
            "write a number without quotes; its unit is the end of the key".to_owned()
        }
        Some((_, "f64")) => "write a number; its unit is the end of the key".to_owned(),
        Some((_, "u8" | "u16" | "u32" | "u64")) => "write a whole number, not negative".to_owned(),
        Some((_, "a boolean")) => "write true or false".to_owned(),
        Some((_, "a string")) => "write it in quotes".to_owned(),
        Some((_, "an array of length 3")) => "write three numbers, [x, y, z]".to_owned(),
        Some((_, wanted)) => format!("write {wanted}"),
        None => "add the missing key".to_owned(),
    };
    (message.to_owned(), remedy)
}

/// From "`given`, expected one of `a`, `b`" to a sentence.
fn among(message: &str) -> String {
    let mut quoted = message.split('`').skip(1).step_by(2);
    let given = quoted.next().unwrap_or("");
    let known: Vec<&str> = quoted.collect();
    suggestion(given, known.iter().copied())
}
