//! No file of a crate needs another that needs it: none of the launcher's crates, and few of the services'.
//!
//! An edge goes from a file to the file in which an item that it imports, or names by a path, is declared;
//! re-exports are followed. A `pub use` is no edge, and neither is what a file takes from its ancestor's own
//! file: a module may use what its parent declares.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Files on circles, by crate of the services. They may only become fewer.
const KNOWN: [(&str, usize); 4] =
    [("attitude-mpc", 2), ("mpc", 4), ("position-mpc", 2), ("qp", 11)];

/// A module by the names on its way from the root of its crate.
type Module = Vec<String>;

/// What is imported or named: the segments of a path.
type Segments = Vec<String>;

/// The modules of one crate, each with its text.
struct Crate(BTreeMap<Module, String>);

fn segments(path: &str) -> Segments {
    path.split("::").map(str::trim).filter(|name| !name.is_empty()).map(str::to_owned).collect()
}

/// The paths of the tree of one `use`.
fn flatten(prefix: &[String], tree: &str, paths: &mut Vec<Segments>) {
    let tree = tree.trim();
    let Some((head, body)) = tree.split_once('{') else {
        let name = tree.split(" as ").next().unwrap_or(tree);
        paths.push([prefix, &segments(name)].concat());
        return;
    };
    let prefix = [prefix, &segments(head)].concat();
    let body = body.rsplit_once('}').map_or(body, |(body, _)| body);
    let (mut depth, mut from) = (0, 0);
    for (at, letter) in body.char_indices() {
        match letter {
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => {
                flatten(&prefix, &body[from..at], paths);
                from = at + 1;
            }
            _ => {}
        }
    }
    if !body[from..].trim().is_empty() {
        flatten(&prefix, &body[from..], paths);
    }
}

/// The `use` items of a text, with whether each is public.
fn uses(text: &str) -> Vec<(bool, Vec<Segments>)> {
    let mut all = Vec::new();
    let mut rest = text;
    while let Some(at) = rest.find("use ") {
        let line = rest[..at].rsplit('\n').next().unwrap_or("").trim();
        let is_item = line.is_empty() || (line.starts_with("pub") && !line.contains(';'));
        rest = &rest[at + 4..];
        let Some(end) = rest.find(';').filter(|_| is_item) else { continue };
        let mut paths = Vec::new();
        flatten(&[], &rest[..end], &mut paths);
        all.push((!line.is_empty(), paths));
        rest = &rest[end..];
    }
    all
}

/// The text without its `use` items.
fn without_uses(text: &str) -> String {
    let mut in_use = false;
    let is_kept = |line: &&str| {
        let begins = line.trim_start();
        let is_use =
            begins.starts_with("use ") || (begins.starts_with("pub") && begins.contains(" use "));
        let is_of_use = in_use || is_use;
        in_use = is_of_use && !line.contains(';');
        !is_of_use
    };
    text.lines().filter(is_kept).collect::<Vec<_>>().join("\n")
}

/// The text without comments and tests.
fn code(text: &str) -> String {
    let shipped = text.split("#[cfg(test)]\nmod tests {").next().unwrap_or(text);
    let lines = shipped.lines().map(|line| line.split("//").next().unwrap_or(line));
    lines.collect::<Vec<_>>().join("\n")
}

fn declares(text: &str, name: &str) -> bool {
    let kinds = ["struct", "enum", "fn", "const", "static", "trait", "type", "macro_rules!"];
    kinds.iter().any(|kind| {
        text.match_indices(&format!("{kind} {name}")).any(|(at, found)| {
            let next = text[at + found.len()..].chars().next();
            !next.is_some_and(|letter| letter.is_alphanumeric() || letter == '_')
        })
    })
}

impl Crate {
    fn read(folder: &Path) -> Self {
        let mut modules = BTreeMap::new();
        let mut folders = vec![folder.to_path_buf()];
        while let Some(open) = folders.pop() {
            for entry in std::fs::read_dir(&open).expect("a folder").flatten() {
                let path = entry.path();
                if path.is_dir() {
                    folders.push(path);
                    continue;
                }
                let way = path.strip_prefix(folder).expect("it is inside").with_extension("");
                let mut module: Module =
                    way.iter().map(|name| name.to_string_lossy().into_owned()).collect();
                if module.last().is_some_and(|name| ["mod", "lib", "main"].contains(&name.as_str()))
                {
                    module.pop();
                }
                let text = std::fs::read_to_string(&path).expect("text");
                modules.insert(module, code(&text));
            }
        }
        Self(modules)
    }

    /// The module in which what `path` names in `from` is declared; none if it is of another crate.
    fn declaring(&self, from: &Module, path: &[String], depth: usize) -> Option<Module> {
        let mut rest = path;
        let mut at = match rest.first()?.as_str() {
            "crate" => Vec::new(),
            "self" | "super" => from.clone(),
            child if self.0.contains_key(&[from.as_slice(), &[child.to_owned()]].concat()) => {
                from.clone()
            }
            _ => return None,
        };
        while let Some(word) =
            rest.first().filter(|w| ["crate", "self", "super"].contains(&w.as_str()))
        {
            if word == "super" {
                at.pop();
            }
            rest = &rest[1..];
        }
        while let Some(word) = rest.first() {
            let child = [at.as_slice(), std::slice::from_ref(word)].concat();
            if !self.0.contains_key(&child) {
                break;
            }
            at = child;
            rest = &rest[1..];
        }
        let Some(name) = rest.first().filter(|name| *name != "*") else { return Some(at) };
        let text = &self.0[&at];
        if depth == 0 || declares(text, name) {
            return Some(at);
        }
        let imported = uses(text).into_iter().flat_map(|(_, paths)| paths);
        let imported =
            imported.into_iter().find(|other| other.last() == Some(name) && other != path);
        match imported {
            Some(other) => self.declaring(&at, &other, depth - 1),
            None => Some(at),
        }
    }

    fn edges(&self, module: &Module) -> BTreeSet<Module> {
        let text = &self.0[module];
        let mut paths: Vec<Segments> = uses(text)
            .into_iter()
            .filter(|(public, _)| !public)
            .flat_map(|(_, paths)| paths)
            .collect();
        let text = without_uses(text);
        for begin in ["crate::", "super::"] {
            for (at, _) in text.match_indices(begin) {
                let inside = text[..at].chars().next_back();
                if inside.is_some_and(|c| c.is_alphanumeric() || c == '_' || c == ':') {
                    continue;
                }
                if text[..at].ends_with("(in ") {
                    continue;
                }
                let is_path = |c: char| c.is_alphanumeric() || c == '_' || c == ':';
                let end = text[at..].find(|c| !is_path(c)).map_or(text.len(), |end| at + end);
                paths.push(segments(&text[at..end]));
            }
        }
        let declared = paths.iter().filter_map(|path| self.declaring(module, path, 8));
        // A module may use what its ancestors declare.
        declared.filter(|target| !module.starts_with(target)).collect()
    }

    /// Files that can be reached from themselves.
    fn on_circles(&self) -> BTreeSet<Module> {
        let is_test = |module: &Module| module.last().is_some_and(|name| name == "tests");
        let edges: BTreeMap<&Module, BTreeSet<Module>> = self
            .0
            .keys()
            .filter(|module| !is_test(module))
            .map(|module| (module, self.edges(module)))
            .collect();
        let comes_back = |module: &&Module| {
            let mut seen = BTreeSet::new();
            let mut next: Vec<&Module> = edges[*module].iter().collect();
            while let Some(at) = next.pop() {
                if at == *module {
                    return true;
                }
                if seen.insert(at) {
                    next.extend(edges.get(at).into_iter().flatten());
                }
            }
            false
        };
        edges.keys().filter(|module| comes_back(module)).map(|module| (*module).clone()).collect()
    }
}

/// The files on circles of each crate in a folder.
fn circles_in(folder: &str) -> BTreeMap<String, BTreeSet<Module>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join(folder);
    let entries = std::fs::read_dir(folder).expect("a folder").flatten();
    let crates = entries.filter_map(|entry| {
        let sources = entry.path().join("src");
        let name = entry.file_name().to_string_lossy().into_owned();
        sources.is_dir().then(|| (name, Crate::read(&sources).on_circles()))
    });
    crates.collect()
}

#[test]
fn no_file_of_the_launcher_needs_another_that_needs_it() {
    let circles = circles_in("launcher");
    assert!(circles.len() > 10, "{} crates", circles.len());
    for (name, files) in circles {
        assert!(files.is_empty(), "{name}: {files:?}");
    }
}

#[test]
fn the_circles_of_the_services_do_not_grow() {
    let known = BTreeMap::from(KNOWN);
    let circles = [circles_in("services"), circles_in("services/lib")];
    for (name, files) in circles.into_iter().flatten() {
        // A smaller number fails too, so that the table is kept up to date.
        let allowed = known.get(name.as_str()).copied().unwrap_or(0);
        assert_eq!(files.len(), allowed, "{name}: {files:?}");
    }
}

#[test]
fn a_circle_is_found_through_a_re_export_and_not_through_what_the_parent_declares() {
    let of = |texts: &[(&str, &str)]| {
        let modules = texts.iter().map(|(name, text)| (segments(name), (*text).to_owned()));
        Crate(modules.collect()).on_circles().into_iter().map(|m| m.join("::")).collect::<Vec<_>>()
    };
    let root = "mod a;\nmod b;\npub use b::B;\npub struct Root;\n";
    let circle = [
        ("", root),
        ("a", "use crate::B;\npub fn f() {}\n"),
        ("b", "use super::a::f;\npub struct B;\n"),
    ];
    assert_eq!(of(&circle), ["a", "b"]);
    let tree = [
        ("", root),
        ("a", "use crate::Root;\npub fn f() {}\n"),
        ("b", "use super::a::f;\npub struct B;\n"),
    ];
    assert!(of(&tree).is_empty());
}
