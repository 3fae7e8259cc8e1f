//! `morphquad new-controller`: a crate of one's own that flies a slot.
//!
//! What is written are the crates under `launcher/templates`, which this workspace builds and tests, under
//! another name and with the dependencies of this build.

use document::suggestion;
use miette::Diagnostic;
use shared_types::Role;
use std::fmt::Write as _;
use std::io;
use std::path::{Path, PathBuf};
use thiserror::Error;
use toml::{Table, Value};

/// Manifest of this workspace, which knows every dependency.
const WORKSPACE: &str = include_str!("../../../../Cargo.toml");
/// Where this executable was built from.
const SOURCE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");
/// A file that only this source tree has.
const MARK: &str = "services/lib/host/Cargo.toml";

/// Reserved names, which neither Rust nor cargo takes for a crate.
const RESERVED: &str = "abstract as async await become box break build const continue crate deps do dyn \
    else enum examples extern false final fn for gen if impl in incremental let loop macro match mod \
    move mut override priv pub ref return self static struct super trait true try type typeof unsafe \
    unsized use virtual where while yield";

/// A template, by the files that it consists of.
struct Template {
    slot: Role,
    name: &'static str,
    manifest: &'static str,
    main: &'static str,
    lib: &'static str,
}

const README: &str = include_str!("../../../templates/README.md");
const TEMPLATES: [Template; 2] = [
    Template {
        slot: Role::Attitude,
        name: "my-attitude-controller",
        manifest: include_str!("../../../templates/attitude-controller/Cargo.toml"),
        main: include_str!("../../../templates/attitude-controller/src/main.rs"),
        lib: include_str!("../../../templates/attitude-controller/src/lib.rs"),
    },
    Template {
        slot: Role::Position,
        name: "my-position-controller",
        manifest: include_str!("../../../templates/position-controller/Cargo.toml"),
        main: include_str!("../../../templates/position-controller/src/main.rs"),
        lib: include_str!("../../../templates/position-controller/src/lib.rs"),
    },
];

/// What to write and where.
#[derive(Debug, Clone)]
pub(super) struct NewController {
    /// Name of the crate and of the executable.
    pub name: String,
    /// Slot that it flies.
    pub slot: String,
    /// Folder to make; one of the crate's name if not given.
    pub dir: Option<PathBuf>,
    /// Source tree to build against; the one that this executable is from if not given.
    pub path: Option<PathBuf>,
}

/// Why nothing was written, or not all of it.
#[derive(Debug, Error, Diagnostic)]
pub(super) enum NewControllerError {
    /// A name that no crate can have, or that a crate among the dependencies has.
    #[error("{name} cannot be the name of a controller: {what}")]
    Name {
        /// As asked for.
        name: String,
        /// What is wrong with it.
        what: &'static str,
        /// What to do.
        #[help]
        remedy: String,
    },
    /// No template flies this slot.
    #[error("no slot is called {slot}")]
    Slot {
        /// As asked for.
        slot: String,
        /// What to do.
        #[help]
        remedy: String,
    },
    /// There is something already.
    #[error("{} is there already", dir.display())]
    #[diagnostic(help("give another name, another --dir, or remove it"))]
    Exists {
        /// Folder.
        dir: PathBuf,
    },
    /// Not the source of morphquad.
    #[error("{} is not a source tree of morphquad: it has no {MARK}", path.display())]
    #[diagnostic(help("give a checkout of this version with --path"))]
    Source {
        /// Folder.
        path: PathBuf,
    },
    /// The disk.
    #[error("cannot write {}: {source}", path.display())]
    Write {
        /// File or folder.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
}

impl NewControllerError {
    /// The command's exit code.
    #[must_use]
    pub(super) fn exit_code(&self) -> u8 {
        match self {
            Self::Write { .. } => host::exit::UNFIT,
            _ => host::exit::USAGE,
        }
    }
}

impl NewController {
    /// Writes the crate and returns its folder.
    ///
    /// # Errors
    /// [`NewControllerError`].
    pub(super) fn write(&self) -> Result<PathBuf, NewControllerError> {
        let template = template(&self.slot)?;
        let manifest = parse(template.manifest);
        self.check_name(&manifest)?;
        let source = self.path.clone().unwrap_or_else(|| SOURCE.into());
        let source = source.canonicalize().unwrap_or(source);
        if !source.join(MARK).is_file() {
            return Err(NewControllerError::Source { path: source });
        }
        let dir = self.dir.clone().unwrap_or_else(|| self.name.clone().into());
        if dir.symlink_metadata().is_ok() {
            return Err(NewControllerError::Exists { dir });
        }
        let named = |text: &str| {
            text.replace(template.name, &self.name)
                .replace(&template.name.replace('-', "_"), &self.name.replace('-', "_"))
        };
        let readme = README.replace("@NAME@", &self.name).replace("@SLOT@", &self.slot);
        for (file, text) in [
            ("Cargo.toml", self.manifest(&manifest, &source)),
            ("src/main.rs", named(template.main)),
            ("src/lib.rs", named(template.lib)),
            ("README.md", readme),
            (".gitignore", "/target\n".to_owned()),
        ] {
            write(&dir.join(file), |path| std::fs::write(path, &text))?;
        }
        // The same versions, by the same compiler, as whatever it flies with.
        for file in ["Cargo.lock", "rust-toolchain.toml"] {
            if source.join(file).is_file() {
                let copy = |path: &Path| std::fs::copy(source.join(file), path).map(|_| ());
                write(&dir.join(file), copy)?;
            }
        }
        Ok(dir)
    }

    fn check_name(&self, manifest: &Table) -> Result<(), NewControllerError> {
        let refuse = |what| {
            let remedy = "take lower-case letters, digits and hyphens, such as `my-controller`";
            Err(NewControllerError::Name { name: self.name.clone(), what, remedy: remedy.into() })
        };
        let fits = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
        let begins = self.name.starts_with(|c: char| c.is_ascii_lowercase());
        if !begins || !self.name.chars().all(fits) || self.name.ends_with('-') {
            return refuse("it is not the name of a crate");
        }
        if self.name.len() > 60 {
            return refuse("it is too long");
        }
        let taken = dependencies(manifest).any(|(name, _)| *name == self.name);
        if taken || ["core", "std", "alloc", "test", "proc-macro"].contains(&self.name.as_str()) {
            return refuse("a crate that it is built from has it");
        }
        if RESERVED.split(' ').any(|name| name == self.name) {
            return refuse("it is a word of Rust or of cargo");
        }
        Ok(())
    }

    /// The template's manifest without its workspace.
    fn manifest(&self, template: &Table, source: &Path) -> String {
        let workspace = parse(WORKSPACE);
        let known = workspace["workspace"].get("dependencies").and_then(Value::as_table);
        let resolve = |(name, _): (&String, &Value)| {
            let mut spec = known.and_then(|known| known.get(name))?.clone();
            if let Some(path) = spec.get_mut("path") {
                let inside = path.as_str().unwrap_or_default();
                *path = source.join(inside).display().to_string().into();
            }
            Some((name.clone(), spec))
        };
        let resolved: Table = dependencies(template).filter_map(resolve).collect();
        let mut lines = format!(
            "[package]\nname = \"{}\"\nversion = \"0.1.0\"\nedition = \"2024\"\npublish = false\n\n\
             # A workspace of its own, whatever folder it is in.\n[workspace]\n\n[dependencies]\n",
            self.name
        );
        for (name, spec) in &resolved {
            let _ = writeln!(lines, "{name} = {}", inline(spec));
        }
        lines.push_str("\n# As morphquad itself is built.\n[profile.release]\n");
        let profile = workspace["profile"].get("release").and_then(Value::as_table);
        for (key, value) in profile.into_iter().flatten().filter(|(_, value)| !value.is_table()) {
            let _ = writeln!(lines, "{key} = {}", inline(value));
        }
        lines
    }
}

fn template(slot: &str) -> Result<&'static Template, NewControllerError> {
    let known = || TEMPLATES.iter().map(|template| template.slot.label());
    TEMPLATES.iter().find(|template| template.slot.label() == slot).ok_or_else(|| {
        NewControllerError::Slot { slot: slot.to_owned(), remedy: suggestion(slot, known()) }
    })
}

/// One of the manifests that are part of this executable.
fn parse(manifest: &str) -> Table {
    manifest.parse().unwrap_or_default()
}

fn dependencies(manifest: &Table) -> impl Iterator<Item = (&String, &Value)> {
    manifest.get("dependencies").and_then(Value::as_table).into_iter().flatten()
}

/// A value on one line.
fn inline(value: &Value) -> String {
    match value {
        Value::Table(table) => {
            let pairs = table.iter().map(|(key, value)| format!("{key} = {}", inline(value)));
            format!("{{ {} }}", pairs.collect::<Vec<_>>().join(", "))
        }
        other => other.to_string(),
    }
}

/// Makes the folder of a file, then the file.
fn write(
    path: &Path,
    write: impl FnOnce(&Path) -> io::Result<()>,
) -> Result<(), NewControllerError> {
    let made = path.parent().map_or(Ok(()), std::fs::create_dir_all);
    made.and_then(|()| write(path))
        .map_err(|source| NewControllerError::Write { path: path.to_owned(), source })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn new(name: &str, slot: &str, dir: &Path) -> NewController {
        NewController { name: name.into(), slot: slot.into(), dir: Some(dir.into()), path: None }
    }

    #[test]
    fn nothing_of_the_template_or_its_workspace_is_left_in_a_new_crate() {
        let folder = tempfile::tempdir().unwrap();
        for template in &TEMPLATES {
            let slot = template.slot.label();
            let dir = folder.path().join(slot);
            assert_eq!(new("quick-fox", slot, &dir).write().unwrap(), dir);
            let read = |file: &str| std::fs::read_to_string(dir.join(file)).unwrap();
            for file in ["Cargo.toml", "src/main.rs", "src/lib.rs", "README.md"] {
                let text = read(file);
                assert!(!text.contains("my-") && !text.contains("my_"), "{file}: {text}");
                assert!(!text.contains(".workspace") && !text.contains('@'), "{file}: {text}");
            }
            assert!(read("src/main.rs").contains("use quick_fox::Controller"));
            let manifest = parse(&read("Cargo.toml"));
            let named: Vec<_> = dependencies(&manifest).map(|(name, _)| name.clone()).collect();
            let wanted = parse(template.manifest);
            assert_eq!(named, dependencies(&wanted).map(|(n, _)| n.clone()).collect::<Vec<_>>());
            let host = manifest["dependencies"]["host"]["path"].as_str().unwrap();
            assert!(Path::new(host).join("Cargo.toml").is_file(), "{host}");
            assert_eq!(manifest["profile"]["release"]["overflow-checks"].as_bool(), Some(true));
            assert!(read("Cargo.lock").contains("iceoryx2"));
        }
    }

    #[test]
    fn what_cannot_be_written_is_refused_before_anything_is() {
        let folder = tempfile::tempdir().unwrap();
        let dir = folder.path().join("new");
        for name in ["", "My", "9", "a b", "../a", "host", "nalgebra", "fn", "test", "a-", "ä"] {
            let error = new(name, "attitude", &dir).write().unwrap_err();
            assert!(matches!(error, NewControllerError::Name { .. }), "{name}: {error}");
            assert_eq!(error.exit_code(), host::exit::USAGE);
        }
        let error = new("fox", "atitude", &dir).write().unwrap_err();
        assert!(matches!(error, NewControllerError::Slot { .. }), "{error}");
        let elsewhere = NewController { path: Some("/".into()), ..new("fox", "attitude", &dir) };
        let error = elsewhere.write().unwrap_err();
        assert!(matches!(error, NewControllerError::Source { .. }), "{error}");
        assert!(!dir.exists());
        new("fox", "attitude", &dir).write().unwrap();
        let error = new("fox", "attitude", &dir).write().unwrap_err();
        assert!(matches!(error, NewControllerError::Exists { .. }), "{error}");
    }
}
