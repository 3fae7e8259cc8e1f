//! What a producer sent twice, sample by sample: what both times had, and what only one had.

use super::fields::{first_difference, numbers_of};
use shared_types::{Header, Sample};

/// One sample of two runs.
#[derive(Debug)]
pub enum Pair<'a, T> {
    /// Of both.
    Both(&'a T, &'a T),
    /// Of the recorded one alone.
    Recorded(&'a T),
    /// Of the other alone.
    Again(&'a T),
}

/// Pairs two runs by a key that rises in both: the sequence, or release and sequence.
pub fn pairs<'a, T: 'a, K: Ord>(
    recorded: impl Iterator<Item = &'a T>,
    again: impl Iterator<Item = &'a T>,
    key: impl Fn(&T) -> K,
) -> impl Iterator<Item = Pair<'a, T>> {
    let (mut recorded, mut again) = (recorded.peekable(), again.peekable());
    core::iter::from_fn(move || {
        let next = (recorded.peek().map(|item| key(item)), again.peek().map(|item| key(item)));
        match next {
            (Some(old), Some(new)) if old == new => {
                Some(Pair::Both(recorded.next()?, again.next()?))
            }
            (Some(old), new) if new.as_ref().is_none_or(|new| old < *new) => {
                Some(Pair::Recorded(recorded.next()?))
            }
            _ => Some(Pair::Again(again.next()?)),
        }
    })
}

/// Name and both values of the first field in which two samples differ in any bit. What the machine
/// determines is left out, except for the fields in `keep`; host stamps always are.
pub fn difference<T: Sample>(old: &T, new: &T, keep: &[&str]) -> Option<(String, String, String)> {
    // Lent stamps make the rest comparable at once.
    let (mut lent, stamps) = (*new, *old.header());
    let generation =
        if keep.contains(&"generation") { new.header().generation } else { stamps.generation };
    *lent.header_mut() = Header {
        receive_mono_ns: stamps.receive_mono_ns,
        release_mono_ns: stamps.release_mono_ns,
        start_mono_ns: stamps.start_mono_ns,
        publish_mono_ns: stamps.publish_mono_ns,
        generation,
        ..*new.header()
    };
    let packed = |sample: &T| {
        let mut bytes = vec![0; T::PACKED_SIZE];
        sample.pack(&mut bytes);
        bytes
    };
    if packed(old) == packed(&lent) {
        return None;
    }
    first_difference(&numbers_of(old, "", keep), &numbers_of(new, "", keep))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_are_paired_by_sequence_and_gaps_are_reported() {
        let listed = |recorded: &[u64], again: &[u64]| {
            let shown = |pair: Pair<'_, u64>| match pair {
                Pair::Both(old, new) => format!("{old}={new}"),
                Pair::Recorded(old) => format!("{old}-"),
                Pair::Again(new) => format!("+{new}"),
            };
            pairs(recorded.iter(), again.iter(), |item| *item)
                .map(shown)
                .collect::<Vec<_>>()
                .join(" ")
        };
        assert_eq!(listed(&[1, 2, 4, 6], &[2, 3, 4, 5, 6, 7]), "1- 2=2 +3 4=4 +5 6=6 +7");
        assert_eq!(listed(&[1, 2], &[]), "1- 2-");
        assert_eq!(listed(&[], &[3]), "+3");
    }
}
