//! Names that were given up stay away.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

const RETIRED: &str = include_str!("../retired_words.toml");
/// Files that may contain retired names: the list, this file, and the record of changes.
const EXEMPT: [&str; 3] = ["tests/retired_words.toml", "tests/sources/words.rs", "CHANGELOG.md"];
/// What is written by people.
const KINDS: [&str; 8] = ["rs", "md", "toml", "py", "js", "html", "ipynb", "css"];

/// Files of these kinds below a folder, without what is built or hidden.
fn texts(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).expect("a folder").flatten().map(|entry| entry.path());
    let is_ours = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        !name.starts_with('.') && name != "target" && name != "node_modules"
    };
    let found = entries
        .filter(is_ours)
        .flat_map(|path| if path.is_dir() { texts(&path) } else { vec![path] });
    let is_text = |path: &PathBuf| {
        path.extension().is_some_and(|kind| KINDS.iter().any(|known| kind == *known))
    };
    found.filter(is_text).collect()
}

fn is_of_a_word(letter: char) -> bool {
    letter.is_alphanumeric() || letter == '_'
}

/// The retired name that a text has, if it has one, and the word for it.
fn retired_in<'r>(text: &str, retired: &'r Retired) -> Option<(&'r str, &'r str)> {
    let begins = |at: usize| !text[..at].ends_with(is_of_a_word);
    let is_whole =
        |at: usize, name: &str| begins(at) && !text[at + name.len()..].starts_with(is_of_a_word);
    let Retired { identifiers, prefixes, phrases, words } = retired;
    let mut found = identifiers
        .iter()
        .filter(|(name, _)| text.match_indices(name.as_str()).any(|(at, _)| is_whole(at, name)));
    let mut begun = prefixes
        .iter()
        .filter(|(name, _)| text.match_indices(name.as_str()).any(|(at, _)| begins(at)));
    let mut contained = phrases.iter().filter(|(name, _)| text.contains(name.as_str()));
    let called = words_of(text).find_map(|word| words.get_key_value(word.as_str()));
    let found = found.next().or_else(|| begun.next()).or_else(|| contained.next());
    let (name, word) = found.or(called)?;
    Some((name, word))
}

/// The words of a text in small letters, those in names of either form as well.
fn words_of(text: &str) -> impl Iterator<Item = String> {
    let parted = text.split(|letter: char| !letter.is_alphabetic());
    parted.flat_map(|name| {
        let letters = name.char_indices().zip(name.chars().skip(1));
        let mut at = vec![0];
        for ((place, letter), next) in letters {
            if letter.is_lowercase() && next.is_uppercase() {
                at.push(place + letter.len_utf8());
            }
        }
        at.push(name.len());
        let parts = at.windows(2).map(|ends| name[ends[0]..ends[1]].to_lowercase());
        parts.collect::<Vec<_>>()
    })
}

/// Each retired name with the word for it.
#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Retired {
    identifiers: BTreeMap<String, String>,
    prefixes: BTreeMap<String, String>,
    phrases: BTreeMap<String, String>,
    words: BTreeMap<String, String>,
}

#[test]
fn retired_words_stay_out_of_code_documents_and_help() {
    let retired: Retired = toml::from_str(RETIRED).expect("a list");
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut read = 0;
    for path in texts(root) {
        let name = path.strip_prefix(root).expect("inside").to_string_lossy().into_owned();
        if EXEMPT.contains(&name.as_str()) {
            continue;
        }
        // A file that is not text has nothing to check.
        let Ok(text) = fs::read_to_string(&path) else { continue };
        // A phrase may go on in the next line, behind the marks of a comment.
        let words =
            text.split_whitespace().filter(|word| !["//", "///", "//!", "#"].contains(word));
        let text = words.collect::<Vec<_>>().join(" ");
        read += 1;
        if let Some((old, word)) = retired_in(&text, &retired) {
            panic!("{name} says `{old}`: say {word}");
        }
    }
    assert!(read > 500, "{read} files");
}

#[test]
fn a_retired_word_is_found_as_a_whole_word_only() {
    let one = |name: &str| BTreeMap::from([(name.to_owned(), "other".to_owned())]);
    let retired = Retired {
        identifiers: one("Old"),
        prefixes: one("MOST_"),
        phrases: one("of old"),
        words: one("nobody"),
    };
    let found = |text: &str| retired_in(text, &retired).map(|(name, _)| name.to_owned());
    for text in [
        "struct Old;",
        "let x = Old::new();",
        "const MOST_ROWS: u8 = 1;",
        "a word of old",
        "Nobody",
        "fn and_nobody_waits()",
        "NobodyThere",
        "NOBODY_THERE",
    ] {
        assert!(found(text).is_some(), "{text}");
    }
    for text in ["struct Older;", "TheOld", "ALMOST_ALL", "const OLD: u8 = 1;", "nobodyelse"] {
        assert_eq!(found(text), None, "{text}");
    }
}

#[test]
fn names_of_tests_have_at_most_80_characters() {
    let mut named = 0;
    for path in texts(Path::new(env!("CARGO_MANIFEST_DIR"))) {
        if path.extension().is_none_or(|kind| kind != "rs") {
            continue;
        }
        let text = fs::read_to_string(&path).expect("a source");
        for test in text.split("#[test]\n").skip(1) {
            let name = test.split("fn ").nth(1).and_then(|rest| rest.split('(').next());
            let name = name.expect("a function");
            named += 1;
            assert!(name.len() <= 80, "{}: {name}", path.display());
        }
    }
    assert!(named > 1000, "{named} tests");
}
