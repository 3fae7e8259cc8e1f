//! The programs to solve, in the form every contender is given them.

use nalgebra::{DMatrix, DVector};
use std::path::{Path, PathBuf};

use crate::sequences::{self, Damaged, Sequence};

/// One program of a series.
#[derive(Debug)]
pub(crate) struct Tick {
    /// The Hessian, if it is a new one: then taking it over is part of the tick.
    pub(crate) hessian: Option<DMatrix<f64>>,
    pub(crate) f: DVector<f64>,
    pub(crate) lower: DVector<f64>,
    pub(crate) upper: DVector<f64>,
}

/// One closed-loop run.
#[derive(Debug)]
pub(crate) struct Series {
    /// The Hessian before the first tick.
    pub(crate) hessian: DMatrix<f64>,
    pub(crate) rows: DMatrix<f64>,
    pub(crate) ticks: Vec<Tick>,
    /// Where the solutions are known.
    pub(crate) recorded: Option<Sequence>,
}

impl Series {
    pub(crate) fn n(&self) -> usize {
        self.rows.ncols()
    }

    pub(crate) fn m(&self) -> usize {
        self.rows.nrows()
    }

    /// The Hessian in force at a tick.
    pub(crate) fn hessian_at(&self, tick: usize) -> &DMatrix<f64> {
        let latest = self.ticks[..=tick].iter().rev().find_map(|tick| tick.hessian.as_ref());
        latest.unwrap_or(&self.hessian)
    }

    /// True if the Hessian changes within the series.
    pub(crate) fn varies(&self) -> bool {
        self.ticks.iter().any(|tick| tick.hessian.is_some())
    }

    fn from_recorded(sequence: Sequence) -> Self {
        let kept = sequence.bounded();
        let tick = |k: usize| {
            let (lower, upper) = sequence.bounds(k, &kept);
            let hessian = sequence.varying.then(|| sequence.constants(k).hessian.clone());
            Tick { hessian, f: sequence.ticks[k].f.clone(), lower, upper }
        };
        Self {
            hessian: sequence.constants(0).hessian.clone(),
            rows: sequence.stacked(&kept),
            ticks: (0..sequence.ticks.len()).map(tick).collect(),
            recorded: Some(sequence),
        }
    }
}

/// Series of one origin and size, measured together.
#[derive(Debug)]
pub(crate) struct Group {
    pub(crate) name: String,
    pub(crate) series: Vec<Series>,
}

impl Group {
    pub(crate) fn ticks(&self) -> usize {
        self.series.iter().map(|series| series.ticks.len()).sum()
    }

    pub(crate) fn varies(&self) -> bool {
        self.series.iter().any(Series::varies)
    }
}

/// The files at `path`: itself, or what of this format lies in the folder, in order of name.
fn files(path: &Path) -> Result<Vec<PathBuf>, Damaged> {
    if !path.is_dir() {
        return Ok(vec![path.to_owned()]);
    }
    let unreadable = |error: std::io::Error| Damaged {
        file: path.display().to_string(),
        offset: 0,
        what: format!("the folder cannot be listed: {error}"),
    };
    let mut found = Vec::new();
    for entry in std::fs::read_dir(path).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        if path.extension().is_some_and(|extension| extension == "bin") {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

/// Reads all files at the paths and groups their runs by file and size, smallest first.
pub(crate) fn recorded(paths: &[PathBuf]) -> Result<Vec<Group>, Damaged> {
    let mut groups = Vec::new();
    for path in paths {
        for file in files(path)? {
            let stem = file.file_stem().map_or_else(String::new, |s| s.to_string_lossy().into());
            let mut sequences = sequences::read(&file)?;
            sequences.sort_by_key(Sequence::n);
            for same in sequences.chunk_by(|a, b| a.n() == b.n()) {
                let name = format!("{stem} n={}", same[0].n());
                let series = same.iter().cloned().map(Series::from_recorded).collect();
                groups.push(Group { name, series });
            }
        }
    }
    Ok(groups)
}
