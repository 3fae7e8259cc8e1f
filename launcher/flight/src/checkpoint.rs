//! What the next launcher would have to know, in the run's folder: `launcher.json`.
//!
//! What a launcher publishes dies with it, so it keeps a checkpoint: registry, owner records, clock, and which process
//! it has started for which seat, as what. In lockstep that is only what the flight began with: time stands still without
//! the conductor that knows how far it went.

use serde::{Deserialize, Deserializer, Serialize, Serializer, de};
use shared_types::wire::{Value, Wire};
use shared_types::{
    ClockMode, ClockRecord, DisturbanceOrder, GuidanceOrder, Hello, OwnerRecord, Progress,
    Registry, RegistryEntry, Sample, Topic, TopicVisitor, topics,
};
use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use swap::PostNote;
use thiserror::Error;

/// Name of the file.
const FILE: &str = "launcher.json";
/// Raised when the file changes its shape.
const FORMAT: u32 = 7;

const DIGITS: &[u8; 16] = b"0123456789abcdef";

/// The launcher that wrote the checkpoint.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Author {
    format: u32,
    version: String,
    executable: PathBuf,
    /// By sample type.
    layouts: BTreeMap<String, String>,
}

/// Of which flight it is.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Of {
    pub(super) run: String,
    /// The first recording, before any launcher took over.
    pub(super) recording: Option<PathBuf>,
    /// File of the launcher that leads; none if it does not record.
    pub(super) file: Option<String>,
    /// Launchers that have taken over so far.
    pub(super) adoptions: u32,
    /// Whether all that they found left by others has been freed.
    pub(super) is_swept: bool,
    /// Unix time that stands for logical time 0 \[ns\].
    pub(super) epoch_unix_ns: u64,
    /// In which its processes are numbered, see [`pid_namespace`].
    pub(super) pid_namespace: Option<PathBuf>,
}

/// The PID namespace of this process, as the kernel names it; none where `/proc` is not there.
pub(super) fn pid_namespace() -> Option<PathBuf> {
    fs::read_link("/proc/self/ns/pid").ok()
}

/// Name of a file, for a text.
fn file_name(path: &Path) -> Option<String> {
    path.file_name().map(|name| name.to_string_lossy().into_owned())
}

impl Of {
    /// A flight that begins.
    pub(super) fn begun(run: &str, recording: Option<&Path>, epoch_unix_ns: u64) -> Self {
        let recording = recording.map(|path| path.canonicalize().unwrap_or(path.into()));
        Self {
            run: run.to_owned(),
            file: recording.as_deref().and_then(file_name),
            recording,
            adoptions: 0,
            is_swept: true,
            epoch_unix_ns,
            pid_namespace: pid_namespace(),
        }
    }

    /// The same flight under another launcher, which records at `recording`.
    pub(super) fn taken_over(&self, recording: Option<&Path>) -> Self {
        let file = recording.and_then(file_name);
        Self { adoptions: self.adoptions + 1, file, ..self.clone() }
    }
}

/// Everything that the next launcher needs.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Checkpoint {
    author: Author,
    pub(super) of: Of,
    pub(super) clock: Packed<ClockRecord>,
    pub(super) registry: Vec<Packed<RegistryEntry>>,
    /// The last of each slot.
    pub(super) owners: Vec<Packed<OwnerRecord>>,
    /// The one before it, which may still be in effect.
    pub(super) owners_before: Vec<Packed<OwnerRecord>>,
    pub(super) guidance: Packed<GuidanceOrder>,
    pub(super) disturbance: Packed<DisturbanceOrder>,
    pub(super) posts: Vec<PostNote>,
}

/// A value in its packed form, as hexadecimal digits.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Packed<T>(pub(super) T);

impl<T: Value> Serialize for Packed<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut bytes = vec![0; T::PACKED_SIZE];
        self.0.pack(&mut bytes);
        let digits =
            |byte: &u8| [byte >> 4, byte & 15].map(|digit| char::from(DIGITS[usize::from(digit)]));
        serializer.collect_str(&bytes.iter().flat_map(digits).collect::<String>())
    }
}

impl<'de, T: Value> Deserialize<'de> for Packed<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = String::deserialize(deserializer)?;
        let pair =
            |at: usize| text.get(at..at + 2).and_then(|two| u8::from_str_radix(two, 16).ok());
        let bytes: Option<Vec<u8>> = (0..text.len()).step_by(2).map(pair).collect();
        let bytes = bytes.filter(|bytes| bytes.len() == T::PACKED_SIZE);
        bytes.map(|bytes| Self(T::unpack(&bytes))).ok_or_else(|| {
            de::Error::custom(format!("not the {} bytes of a packed value", T::PACKED_SIZE))
        })
    }
}

/// Why a checkpoint is of no use here.
#[derive(Debug, Error)]
pub(super) enum CheckpointError {
    #[error(
        "{type_name} is laid out otherwise by its launcher ({theirs}) than by this executable ({ours}): take it over with the build that flies, {executable}"
    )]
    Layout { type_name: String, theirs: String, ours: String, executable: PathBuf },
    #[error(
        "it was started by morphquad {version}, whose checkpoint this one cannot read: take it over with the build that flies, {executable}"
    )]
    Version { version: String, executable: PathBuf },
    #[error("the checkpoint of its launcher in {path} cannot be read: {reason}")]
    Unreadable { path: PathBuf, reason: String },
}

impl Checkpoint {
    /// What the launcher of the run in `folder` has noted.
    pub(super) fn read(folder: &Path) -> Result<Self, CheckpointError> {
        #[derive(Deserialize)]
        struct Head {
            author: Author,
        }
        let path = folder.join(FILE);
        let unreadable =
            |reason: String| CheckpointError::Unreadable { path: path.clone(), reason };
        let text = fs::read_to_string(&path).map_err(|error| unreadable(error.to_string()))?;
        let head: Head =
            serde_json::from_str(&text).map_err(|error| unreadable(error.to_string()))?;
        head.author.require_same_build()?;
        serde_json::from_str(&text).map_err(|error| unreadable(error.to_string()))
    }

    /// Writes it into the folder of its run; a reader has the old checkpoint or the new one.
    pub(super) fn save(&self, folder: &Path) -> io::Result<()> {
        let path = folder.join(FILE);
        let draft = path.with_extension("draft");
        fs::write(&draft, serde_json::to_vec(self)?)?;
        fs::rename(draft, path)
    }
}

impl Author {
    fn this() -> Self {
        Self {
            format: FORMAT,
            version: env!("CARGO_PKG_VERSION").to_owned(),
            executable: std::env::current_exe().unwrap_or_default(),
            layouts: layouts(),
        }
    }

    fn require_same_build(self) -> Result<(), CheckpointError> {
        let Self { format, version, executable, layouts: theirs } = self;
        if format != FORMAT {
            return Err(CheckpointError::Version { version, executable });
        }
        for (type_name, ours) in layouts() {
            let theirs = theirs.get(&type_name).cloned().unwrap_or_else(|| "unknown".to_owned());
            if theirs != ours {
                return Err(CheckpointError::Layout { type_name, theirs, ours, executable });
            }
        }
        Ok(())
    }
}

/// Layouts of everything that processes send to one another.
fn layouts() -> BTreeMap<String, String> {
    struct Layouts(BTreeMap<String, String>);
    impl Layouts {
        fn add<T: Wire>(&mut self) {
            let hash = format!("{:016x}", T::SCHEMA.layout_hash);
            self.0.insert(T::SCHEMA.name.to_owned(), hash);
        }
    }
    impl TopicVisitor for Layouts {
        type Error = core::convert::Infallible;
        fn visit<T: Sample>(&mut self, _topic: &'static Topic<T>) -> Result<(), Self::Error> {
            self.add::<T>();
            Ok(())
        }
    }
    let mut layouts = Layouts(BTreeMap::new());
    let Ok(()) = topics::visit_all(&mut layouts);
    layouts.add::<ClockRecord>();
    layouts.add::<Registry>();
    layouts.add::<Hello>();
    layouts.add::<Progress>();
    layouts.0
}

/// Keeps the checkpoint of a flight.
pub(super) struct CheckpointWriter {
    folder: PathBuf,
    checkpoint: Checkpoint,
    trouble: Option<String>,
    troubled: bool,
}

impl CheckpointWriter {
    /// Opens the checkpoint of a flight and writes it for the first time.
    pub(super) fn open(folder: &Path, of: Of, mode: ClockMode) -> Self {
        let mut checkpoint_writer =
            Self::new(folder, of, &ClockRecord { mode, ..ClockRecord::default() });
        checkpoint_writer.save();
        checkpoint_writer
    }

    /// A checkpoint of which nothing is in the file yet: what is there stays until the first [`write`](Self::write).
    pub(super) fn new(folder: &Path, of: Of, clock: &ClockRecord) -> Self {
        let checkpoint = Checkpoint {
            author: Author::this(),
            of,
            clock: Packed(*clock),
            registry: Vec::new(),
            owners: Vec::new(),
            owners_before: Vec::new(),
            guidance: Packed::default(),
            disturbance: Packed::default(),
            posts: Vec::new(),
        };
        Self { folder: folder.to_path_buf(), checkpoint, trouble: None, troubled: false }
    }

    /// Notes how time runs; in the file with the next [`write`](Self::write).
    pub(super) fn clock(&mut self, record: &ClockRecord) {
        self.checkpoint.clock = Packed(*record);
    }

    /// Notes that what other launchers have left is free; in the file with the next [`write`](Self::write).
    pub(super) fn swept(&mut self) {
        self.checkpoint.of.is_swept = true;
    }

    /// Notes what has been ordered; in the file with the next [`write`](Self::write).
    pub(super) fn orders(&mut self, guidance: &GuidanceOrder, disturbance: &DisturbanceOrder) {
        self.checkpoint.guidance = Packed(*guidance);
        self.checkpoint.disturbance = Packed(*disturbance);
    }

    /// Notes which processes there are and which command: of each slot the record before the last one, and that one.
    pub(super) fn write<'a>(
        &mut self,
        registry: &[RegistryEntry],
        owners: impl Iterator<Item = [&'a OwnerRecord; 2]>,
        posts: impl Iterator<Item = PostNote>,
    ) {
        if self.checkpoint.clock.0.mode == ClockMode::Lockstep {
            return;
        }
        self.checkpoint.registry = registry.iter().copied().map(Packed).collect();
        let (before, last): (Vec<_>, Vec<_>) = owners.map(|[before, last]| (before, last)).unzip();
        let noted = |records: Vec<&OwnerRecord>| -> Vec<_> {
            records.into_iter().filter(|record| record.epoch > 0).copied().map(Packed).collect()
        };
        (self.checkpoint.owners_before, self.checkpoint.owners) = (noted(before), noted(last));
        self.checkpoint.posts = posts.collect();
        self.save();
    }

    fn save(&mut self) {
        if let Err(error) = self.checkpoint.save(&self.folder)
            && !core::mem::replace(&mut self.troubled, true)
        {
            self.trouble = Some(format!(
                "cannot note in {} who flies: {error}; if this launcher dies, no other can take over",
                self.folder.join(FILE).display()
            ));
        }
    }

    /// What is wrong with the checkpoint, once.
    pub(super) fn take_trouble(&mut self) -> Option<String> {
        self.trouble.take()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(name: &str) -> PathBuf {
        let folder = std::env::temp_dir().join(format!("checkpoint-{name}-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        folder
    }

    fn of() -> Of {
        Of::begun("7f3a", None, 5)
    }

    #[test]
    fn what_was_noted_is_read_again_number_by_number() {
        let folder = folder("again");
        let mut checkpoint_writer = CheckpointWriter::open(&folder, of(), ClockMode::Realtime);
        let entry = RegistryEntry { node: [u64::MAX, 7], period_ns: 3, ..RegistryEntry::default() };
        let record = OwnerRecord { epoch: 4, owner: 1, ..OwnerRecord::default() };
        let before = OwnerRecord { epoch: 3, ..record };
        let clock = ClockRecord {
            speed: 0.1,
            end_ns: u64::MAX - 1,
            mode: ClockMode::Realtime,
            ..ClockRecord::default()
        };
        checkpoint_writer.clock(&clock);
        checkpoint_writer.write(
            &[entry],
            [[&before, &record], [&OwnerRecord::default(); 2]].into_iter(),
            core::iter::empty(),
        );
        assert_eq!(checkpoint_writer.take_trouble(), None);
        let checkpoint = Checkpoint::read(&folder).unwrap();
        assert_eq!(
            (checkpoint.registry[0].0.node, checkpoint.registry[0].0.period_ns),
            ([u64::MAX, 7], 3)
        );
        assert_eq!(checkpoint.owners.len(), 1, "before the first there is none");
        assert_eq!((checkpoint.owners[0].0.epoch, checkpoint.owners[0].0.owner), (4, 1));
        let before: Vec<_> = checkpoint.owners_before.iter().map(|record| record.0.epoch).collect();
        assert_eq!(before, [3]);
        assert_eq!(checkpoint.clock.0.end_ns, u64::MAX - 1);
        assert_eq!(checkpoint.clock.0.speed.to_bits(), 0.1_f64.to_bits());
        fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn notes_of_another_build_are_refused_with_what_differs() {
        let folder = folder("build");
        let refused = |edit: &dyn Fn(&mut serde_json::Value)| {
            CheckpointWriter::open(&folder, of(), ClockMode::Realtime);
            let path = folder.join(FILE);
            let mut value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
            edit(&mut value);
            fs::write(&path, value.to_string()).unwrap();
            Checkpoint::read(&folder).unwrap_err().to_string()
        };
        let layout = refused(&|checkpoint| checkpoint["author"]["layouts"]["Imu"] = "1".into());
        assert!(layout.starts_with("Imu is laid out otherwise"), "{layout}");
        let format = refused(&|checkpoint| {
            checkpoint["author"]["format"] = 99.into();
            checkpoint["author"]["version"] = "9.9.9".into();
        });
        assert!(format.contains("morphquad 9.9.9"), "{format}");
        let clock = refused(&|checkpoint| checkpoint["clock"] = "00".into());
        assert!(clock.contains("cannot be read"), "{clock}");
        fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn notes_that_cannot_be_written_are_a_trouble_once() {
        let mut checkpoint_writer =
            CheckpointWriter::open(Path::new("/nowhere/at/all"), of(), ClockMode::Realtime);
        assert!(checkpoint_writer.take_trouble().unwrap().contains("/nowhere/at/all"));
        checkpoint_writer.write(&[], core::iter::empty(), core::iter::empty());
        assert_eq!(checkpoint_writer.take_trouble(), None);
    }
}
