//! What had another name before.

use document::Renamed;

/// Sections that had another name in scenarios and recordings of before, and what they are called now.
pub(crate) static RENAMED: [(&[&str], &[&str]); 3] = [
    (&["crew"], &["controller"]),
    (&["watch"], &["monitor"]),
    (&["realtime", "watch"], &["realtime", "monitor"]),
];

/// What a key or section is called now that had another name before; none if it had not.
#[must_use]
pub fn renamed(key: &str) -> Option<String> {
    let names: &Renamed = &RENAMED;
    names.iter().find_map(|(old, new)| {
        let rest = key.strip_prefix(old.join(".").as_str())?;
        (rest.is_empty() || rest.starts_with('.')).then(|| new.join(".") + rest)
    })
}
