//! What was probably meant.

/// Ends of keys that name the unit.
const UNITS: [&str; 22] = [
    "s", "ms", "us", "ns", "m", "mm", "cm", "kg", "g", "n", "nm", "mn", "rad", "deg", "hz", "khz",
    "s2", "m2", "sqrt", "rpm", "pct", "weights",
];

/// Below this similarity a guess only confuses.
const MIN_SIMILARITY: f64 = 0.75;

/// A sentence that leads from `given` to one of `known`.
pub fn remedy<'a>(given: &str, known: impl Iterator<Item = &'a str> + Clone) -> String {
    let stem = without_unit(given);
    if let Some(key) = known.clone().find(|key| !stem.is_empty() && without_unit(key) == stem) {
        return format!("write `{key}`: the unit is part of the key, so give the value in it");
    }
    let list = known.clone().map(|key| format!("`{key}`")).collect::<Vec<_>>().join(", ");
    closest(given, known).map_or_else(
        || format!("known are {list}"),
        |key| format!("did you mean `{key}`? Known are {list}"),
    )
}

fn closest<'a>(given: &str, known: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    known
        .map(|key| (strsim::jaro_winkler(given, key), key))
        .filter(|(similarity, _)| *similarity >= MIN_SIMILARITY)
        .max_by(|(a, _), (b, _)| a.total_cmp(b))
        .map(|(_, key)| key)
}

fn without_unit(key: &str) -> String {
    let parts: Vec<&str> = key.split('_').collect();
    let kept = parts.iter().rposition(|part| !UNITS.contains(part)).map_or(0, |last| last + 1);
    parts[..kept].join("_")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn another_unit_leads_to_the_key_with_the_right_one() {
        let known = ["name", "duration_s", "seed"];
        assert!(remedy("duration_ms", known.into_iter()).starts_with("write `duration_s`"));
    }

    #[test]
    fn a_typing_mistake_leads_to_the_closest_word_and_nonsense_to_none() {
        let known = ["hover", "figure8-morph", "attitude-step", "disturbance"];
        assert!(remedy("figur8-morph", known.into_iter()).contains("mean `figure8-morph`"));
        assert!(remedy("zzz", known.into_iter()).starts_with("known are `hover`"));
    }
}
