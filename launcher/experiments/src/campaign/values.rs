//! Ranges as people write them: `0..99` for seeds, `a..b/n` for anything else.

/// Most values that one range may stand for.
pub const MAX_VALUES: u64 = 1_000_000;

/// Seeds from `a..b`, both ends included, or a single number.
///
/// # Errors
/// What is wrong and how to write it.
pub fn seeds(text: &str) -> Result<Vec<u64>, String> {
    let wrong =
        || format!("`{text}` is not a valid range of seeds: write 0..99, both ends included");
    let whole = |part: &str| part.trim().parse::<u64>().map_err(|_| wrong());
    let (first, last) = match text.split_once("..") {
        Some((first, last)) => (whole(first)?, whole(last)?),
        None => (whole(text)?, whole(text)?),
    };
    if last < first {
        return Err(format!("`{text}` runs backwards: write the smaller seed first"));
    }
    if last - first >= MAX_VALUES {
        return Err(format!("`{text}` has more than {MAX_VALUES} seeds: split it"));
    }
    Ok((first..=last).collect())
}

/// `n` evenly spaced numbers from `a..b/n`, both ends included, as TOML; whole ones where both ends
/// and every step are whole.
///
/// # Errors
/// What is wrong and how to write it.
pub fn range(text: &str) -> Result<Vec<String>, String> {
    let wrong = || format!("`{text}` is not a valid range: write a..b/n, for example 0.8..1.2/5");
    let (first, rest) = text.split_once("..").ok_or_else(wrong)?;
    let (last, count) = rest.split_once('/').ok_or_else(wrong)?;
    let number = |part: &str| {
        let number = part.trim().parse::<f64>().map_err(|_| wrong())?;
        if number.is_finite() { Ok(number) } else { Err(wrong()) }
    };
    let (first, last) = (number(first)?, number(last)?);
    let count = count.trim().parse::<u32>().map_err(|_| wrong())?;
    if !(2..=MAX_VALUES).contains(&u64::from(count)) {
        return Err(format!("`{text}`: the number of values is from 2 to {MAX_VALUES}"));
    }
    let steps = f64::from(count - 1);
    let between = (1..count - 1).map(|i| {
        let i = f64::from(i);
        tidy((first * (steps - i) + last * i) / steps)
    });
    let numbers: Vec<f64> = [first].into_iter().chain(between).chain([last]).collect();
    let whole = numbers.iter().all(|n| n.fract() == 0.0 && n.abs() < 9e15);
    Ok(numbers.iter().map(|n| if whole { format!("{n:.0}") } else { format!("{n:?}") }).collect())
}

/// To twelve digits, so that 0.9 is not 0.9000000000000001.
fn tidy(number: f64) -> f64 {
    format!("{number:.11e}").parse().unwrap_or(number)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seeds_include_both_ends() {
        assert_eq!(seeds("0..3").unwrap(), [0, 1, 2, 3]);
        assert_eq!(seeds(" 7 ").unwrap(), [7]);
        for bad in ["3..0", "0..", "a..b", "-1..3", "0..99999999", ""] {
            assert!(seeds(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn a_range_has_its_ends_and_even_steps() {
        assert_eq!(range("0.8..1.2/5").unwrap(), ["0.8", "0.9", "1.0", "1.1", "1.2"]);
        assert_eq!(range("50..200/4").unwrap(), ["50", "100", "150", "200"]);
        assert_eq!(range("0..1/3").unwrap(), ["0.0", "0.5", "1.0"]);
        assert_eq!(range("-1..1/2").unwrap(), ["-1", "1"]);
        for bad in ["1..2", "1/2", "1..2/1", "1..2/x", "1..inf/3", "1..2/99999999", ""] {
            assert!(range(bad).is_err(), "{bad}");
        }
    }
}
