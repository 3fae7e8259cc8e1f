//! Times as users write them.

use core::time::Duration;

/// A time with its unit, such as 20s, 500ms or 2m.
///
/// Arguments that take one let hyphens through, so that it is refused here, as what it is.
pub(super) fn duration(text: &str) -> Result<Duration, String> {
    let example = "write for example 20s, 500ms or 2m";
    humantime::parse_duration(text).map_err(|_| match text.strip_prefix('-') {
        Some(time) if humantime::parse_duration(time).is_ok() => {
            format!("a duration must not be negative: {example}")
        }
        _ if text.parse::<f64>().is_ok() => format!("it needs a unit: {example}"),
        _ => format!("this is no duration: {example}"),
    })
}

#[cfg(test)]
mod tests {
    use super::duration;

    #[test]
    fn what_is_wrong_with_a_duration_is_reported_with_an_example() {
        assert_eq!(duration("1m 30s").map(|d| d.as_secs_f64()), Ok(90.0));
        for (text, reason) in [
            ("-3s", "must not be negative"),
            ("-1m 500ms", "must not be negative"),
            ("3", "needs a unit"),
            ("-3", "needs a unit"),
            ("--seed", "no duration"),
            ("abc", "no duration"),
            ("", "no duration"),
        ] {
            let error = duration(text).unwrap_err();
            assert!(error.contains(reason) && error.contains("500ms"), "{text}: {error}");
        }
    }
}
