//! Words of commands that are printed to be copied.

use std::borrow::Cow;
use std::path::Path;

/// A word as a shell takes it in: in quotes if it has blanks, stars or the like in it.
#[must_use]
pub fn shell_word(word: &str) -> Cow<'_, str> {
    // No shell can pass a word with a NUL byte.
    shlex::try_quote(word).unwrap_or(Cow::Borrowed(word))
}

/// The same of a path.
#[must_use]
pub fn shell_path(path: &Path) -> String {
    shell_word(&path.to_string_lossy()).into_owned()
}

#[cfg(test)]
mod tests {
    use super::shell_word;

    #[test]
    fn a_word_is_quoted_only_if_a_shell_would_take_it_apart() {
        assert_eq!(shell_word("recordings/7f3a.mcap"), "recordings/7f3a.mcap");
        for word in ["sp ace/a b.mcap", "a'b", "$HOME", "*", ""] {
            assert_eq!(shlex::split(&shell_word(word)).unwrap(), [word], "{word}");
        }
    }
}
