//! The scenario's text with the command line's edits in it, and the way back from a value to the
//! place that it comes from.
//!
//! Every text that contributes (the file, then each flag) owns a range of one virtual text: it is
//! parsed behind as many blanks as there are characters before it. A byte range of the merged
//! document therefore identifies by itself the text that it comes from.

use super::problem::{Place, Problem};
use core::ops::Range;
use miette::NamedSource;
use serde::Deserialize;
use std::borrow::Cow;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// A parsed table, with places.
pub(crate) type Table<'t> = DeTable<'t>;
/// A key, with its place.
type Key<'t> = Spanned<Cow<'t, str>>;
/// A parsed value, with its place.
pub type Value<'t> = Spanned<DeValue<'t>>;

/// Sees path, place of the key and value of an entry.
pub(crate) type Visit<'v> = dyn FnMut(&str, Range<usize>, &Value<'_>) + 'v;

/// An edit that the command line asks for.
#[derive(Debug, Clone)]
pub struct Edit {
    /// The flag as typed.
    pub shown: String,
    /// Dotted key.
    pub key: String,
    /// Value in TOML.
    pub value: String,
    /// The value is a list whose entries are added to those that are there.
    pub added: bool,
    /// What it comes from, which complaints name.
    pub from: String,
}

/// What an edit that the command line asks for comes from.
pub const COMMAND_LINE: &str = "command line";

impl Edit {
    /// One more entry of a list.
    #[must_use]
    pub fn added(shown: String, list: &str, entry: &str) -> Self {
        Self { added: true, ..Self::set(shown, list.to_owned(), format!("[{{ {entry} }}]")) }
    }

    /// A value in place of what is there.
    #[must_use]
    pub fn set(shown: String, key: String, value: String) -> Self {
        Self { shown, key, value, added: false, from: COMMAND_LINE.to_owned() }
    }

    /// What a file that the scenario names adds to it.
    #[must_use]
    pub fn embedded(file: &str, key: String, value: String) -> Self {
        Self { from: file.to_owned(), ..Self::set(file.to_owned(), key, value) }
    }
}

/// One contributing text.
#[derive(Debug)]
struct Text {
    name: String,
    shown: String,
    start: usize,
    /// What was parsed is a part of what is shown.
    literal: bool,
    padded: String,
}

/// The virtual text.
#[derive(Debug)]
pub struct Texts(Vec<Text>);

impl Texts {
    /// The scenario itself and then the edits.
    #[must_use]
    pub fn new(name: &str, text: &str, edits: &[Edit]) -> Self {
        let mut texts = Self(Vec::new());
        texts.push(name, text, text);
        for edit in edits {
            texts.push(&edit.from, &edit.shown, &format!("{}={}", edit.key, edit.value));
        }
        texts
    }

    fn push(&mut self, name: &str, shown: &str, parsed: &str) {
        let start = self.0.last().map_or(0, |last| last.padded.len().max(last.start + 1) + 1);
        let offset = shown.rfind(parsed);
        let padded = " ".repeat(start + offset.unwrap_or(0)) + parsed;
        let (name, shown) = (name.to_owned(), shown.to_owned());
        self.0.push(Text { name, shown, start, literal: offset.is_some(), padded });
    }

    /// Where a byte range of the virtual text is.
    fn place(&self, span: &Range<usize>) -> Option<Place> {
        let text = self.0.iter().rfind(|text| text.start <= span.start)?;
        let whole = 0..text.shown.len();
        let clamp = |at: usize| (at - text.start).min(whole.end);
        let span = if text.literal { clamp(span.start)..clamp(span.end) } else { whole };
        let source = NamedSource::new(text.name.clone(), text.shown.clone());
        Some(Place { source, span })
    }
}

/// Sections that had another name before, and what they are called now, by the parts of their keys.
pub type Renamed = [(&'static [&'static str], &'static [&'static str])];

/// The merged document.
#[derive(Debug)]
pub struct Document<'t> {
    texts: &'t Texts,
    root: Table<'t>,
    names: &'static Renamed,
    renamed: Vec<Problem>,
}

impl<'t> Document<'t> {
    /// Parses the scenario, applies each edit to it, and gives sections the names of today.
    ///
    /// # Errors
    /// A text that is no TOML, or an edit of what is no table.
    pub fn parse(
        texts: &'t Texts,
        edits: &[Edit],
        names: &'static Renamed,
    ) -> Result<Self, Problem> {
        let mut document = Self { texts, root: Table::new(), names, renamed: Vec::new() };
        for (index, text) in texts.0.iter().enumerate() {
            let table = DeTable::parse(&text.padded).map_err(|error| {
                let place = error.span().and_then(|span| texts.place(&span));
                let remedy = "write TOML: `key = value` under `[section]`, each key once";
                Problem::new("", error.message(), remedy, place)
            })?;
            match index.checked_sub(1).and_then(|i| edits.get(i)) {
                None => document.root = table.into_inner(),
                Some(edit) => document.apply(edit, table.into_inner(), text)?,
            }
            document.rename()?;
        }
        Ok(document)
    }

    /// Gives sections the names of today.
    fn rename(&mut self) -> Result<(), Problem> {
        for (old, new) in self.names {
            let Some((key, value)) = take(&mut self.root, old) else { continue };
            if get(&self.root, new).is_some() {
                let what = format!("is called `{}` now, and that is there too", new.join("."));
                let place = self.texts.place(&key.span());
                return Err(Problem::new(old.join("."), what, "keep one of the two", place));
            }
            // Only a table was taken out of where this goes.
            let _ = put(&mut self.root, new, &key.span(), value);
            self.warn_of_name(old, new, &key.span());
        }
        Ok(())
    }

    /// Once for each text.
    fn warn_of_name(&mut self, old: &[&str], new: &[&str], span: &Range<usize>) {
        let (old, new) = (old.join("."), new.join("."));
        let (what, remedy) = (format!("is called `{new}` now"), format!("write `{new}`"));
        let place = self.texts.place(span);
        let warning = Problem::new(old, what, remedy, place).into_warning();
        let is_same =
            |known: &Problem| (known.key(), known.file()) == (warning.key(), warning.file());
        if !self.renamed.iter().any(is_same) {
            self.renamed.push(warning);
        }
    }

    /// Warnings about names of before.
    #[must_use]
    pub fn renamed(&self) -> &[Problem] {
        &self.renamed
    }

    fn apply(&mut self, edit: &Edit, mut table: Table<'t>, text: &Text) -> Result<(), Problem> {
        let keys: Vec<&str> = edit.key.split('.').map(str::trim).collect();
        let place = self.texts.place(&(text.start..text.start + 1));
        let Some((key, value)) = take(&mut table, &keys) else {
            let remedy = "write --set SECTION.KEY=VALUE with the value in TOML";
            let what = "is not a plain dotted key";
            return Err(Problem::new(&*edit.key, what, remedy, place).into_malformed());
        };
        let renamed =
            self.names.iter().find_map(|(old, new)| Some((*old, *new, keys.strip_prefix(*old)?)));
        let keys = match renamed {
            Some((old, new, rest)) => {
                self.warn_of_name(old, new, &key.span());
                [new, rest].concat()
            }
            None => keys,
        };
        let value = if edit.added { joined(self.root.get(keys[0]), value) } else { value };
        put(&mut self.root, &keys, &key.span(), value).map_err(|blocking| {
            let what = format!("`{blocking}` is a value and has no such entry");
            Problem::new(&*edit.key, what, format!("set `{blocking}` itself"), place)
                .into_malformed()
        })
    }

    /// The merged document.
    #[must_use]
    pub fn root(&self) -> &Table<'t> {
        &self.root
    }

    /// Whether there is a value at a dotted key.
    #[must_use]
    pub fn has(&self, key: &str) -> bool {
        self.value(key).is_some()
    }

    /// The number at a dotted key.
    #[must_use]
    pub fn number(&self, key: &str) -> Option<f64> {
        match self.value(key)?.get_ref() {
            DeValue::Float(number) => number.as_str().parse().ok(),
            DeValue::Integer(number) => i64::from_str_radix(number.as_str(), number.radix())
                .ok()
                .map(|number| number as f64),
            _ => None,
        }
    }

    fn value(&self, key: &str) -> Option<&Value<'t>> {
        let keys: Vec<&str> = key.split('.').collect();
        get(&self.root, &keys)
    }

    /// Takes a value out.
    pub fn remove(&mut self, section: &str, key: &str) {
        if let Some(DeValue::Table(table)) = self.root.get_mut(section).map(Spanned::get_mut) {
            table.remove(key);
        }
    }

    /// The merged document as plain values.
    ///
    /// # Errors
    /// It holds a date, which is none.
    pub fn to_table(&self) -> Result<toml::Table, toml::de::Error> {
        let value = Spanned::new(0..0, DeValue::Table(self.root.clone()));
        toml::Table::deserialize(toml::de::ValueDeserializer::from(value))
    }

    /// Where a byte range of the virtual text is.
    #[must_use]
    pub fn place(&self, span: &Range<usize>) -> Option<Place> {
        self.texts.place(span)
    }

    /// Where the value at `path` is, or else the innermost section around it that exists.
    #[must_use]
    pub fn place_of(&self, path: &str) -> Option<Place> {
        let mut found: Option<Range<usize>> = None;
        let mut table = Some(&self.root);
        let mut value: Option<&Value<'_>> = None;
        for part in path.split(['.', '[', ']']).filter(|part| !part.is_empty()) {
            if let Ok(index) = part.parse::<usize>() {
                let array = value.and_then(|v| v.get_ref().as_array());
                value = array.and_then(|array| array.get(index));
            } else {
                value = table.and_then(|t| t.get(part));
            }
            let Some(v) = value else { break };
            found = Some(v.span());
            table = v.get_ref().as_table();
        }
        found.and_then(|span| self.place(&span))
    }

    /// Dotted key of the value or key that a byte range belongs to.
    #[must_use]
    pub fn key_at(&self, span: &Range<usize>) -> String {
        let mut best = (usize::MAX, String::new());
        walk(&self.root, "", &mut |path, key, value| {
            for own in [key, value.span()] {
                if own.start <= span.start && span.end <= own.end && own.len() <= best.0 {
                    best = (own.len(), path.to_owned());
                }
            }
        });
        best.1
    }

    /// Calls `visit` with path, place of the key and value, for every entry of every table.
    pub fn walk(&self, visit: &mut Visit<'_>) {
        walk(&self.root, "", visit);
    }
}

/// The entries of both lists; `more` alone if there is no list yet.
fn joined<'t>(list: Option<&Value<'t>>, more: Value<'t>) -> Value<'t> {
    let (Some(DeValue::Array(list)), DeValue::Array(entries)) =
        (list.map(Spanned::get_ref), more.get_ref())
    else {
        return more;
    };
    let mut both = list.clone();
    for entry in entries {
        both.push(entry.clone());
    }
    Spanned::new(more.span(), DeValue::Array(both))
}

fn get<'d, 't>(table: &'d Table<'t>, keys: &[&str]) -> Option<&'d Value<'t>> {
    let (first, rest) = keys.split_first()?;
    let value = table.get(*first)?;
    if rest.is_empty() { Some(value) } else { get(value.get_ref().as_table()?, rest) }
}

fn take<'t>(table: &mut Table<'t>, keys: &[&str]) -> Option<(Key<'t>, Value<'t>)> {
    let (first, rest) = keys.split_first()?;
    if rest.is_empty() {
        return table.remove_entry(*first);
    }
    match table.get_mut(*first)?.get_mut() {
        DeValue::Table(inner) => take(inner, rest),
        _ => None,
    }
}

/// Puts `value` at `keys`, which stand at `span`; gives back the key that is in the way.
fn put<'t>(
    table: &mut Table<'t>,
    keys: &[&str],
    span: &Range<usize>,
    value: Value<'t>,
) -> Result<(), String> {
    let Some((first, rest)) = keys.split_first() else { return Ok(()) };
    let key = Spanned::new(span.clone(), Cow::Owned((*first).to_owned()));
    if rest.is_empty() {
        // A key that was there keeps its old place unless it is taken out first.
        table.remove(*first);
        table.insert(key, value);
        return Ok(());
    }
    let section = || Spanned::new(span.clone(), DeValue::Table(Table::new()));
    put_into(table.entry(key).or_insert_with(section).get_mut(), keys, span, value)
}

/// As [`put`], below the first of `keys`.
fn put_into<'t>(
    target: &mut DeValue<'t>,
    keys: &[&str],
    span: &Range<usize>,
    value: Value<'t>,
) -> Result<(), String> {
    let Some((name, rest)) = keys.split_first() else { return Ok(()) };
    let index = rest.first().and_then(|key| key.parse::<usize>().ok());
    match (target, index) {
        (DeValue::Table(table), _) => put(table, rest, span, value),
        (DeValue::Array(array), Some(index)) => {
            let item = array.get_mut(index).ok_or_else(|| (*name).to_owned())?;
            if rest.len() == 1 {
                *item = value;
                return Ok(());
            }
            put_into(item.get_mut(), rest, span, value)
        }
        _ => Err((*name).to_owned()),
    }
}

fn walk(table: &Table<'_>, prefix: &str, visit: &mut Visit<'_>) {
    for (key, value) in table {
        let path = if prefix.is_empty() {
            key.get_ref().to_string()
        } else {
            format!("{prefix}.{}", key.get_ref())
        };
        visit(&path, key.span(), value);
        walk_value(value, &path, visit);
    }
}

fn walk_value(value: &Value<'_>, path: &str, visit: &mut Visit<'_>) {
    match value.get_ref() {
        DeValue::Table(table) => walk(table, path, visit),
        DeValue::Array(array) => {
            for (index, item) in array.iter().enumerate() {
                let path = format!("{path}[{index}]");
                visit(&path, item.span(), item);
                walk_value(item, &path, visit);
            }
        }
        _ => {}
    }
}
