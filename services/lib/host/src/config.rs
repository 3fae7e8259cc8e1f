//! A controller's own configuration.

use crate::HostError;
use serde::de::DeserializeOwned;
use std::path::PathBuf;

/// The file that the user gave a controller with `--config`, if any.
#[derive(Debug, Clone, Default)]
pub struct Config {
    path: Option<PathBuf>,
}

impl Config {
    /// A configuration that is read from `path`; the controller's defaults without one.
    #[must_use]
    pub fn new(path: Option<PathBuf>) -> Self {
        Self { path }
    }

    /// The content of the file, as TOML; `T`'s defaults if there is no file.
    ///
    /// # Errors
    /// The file cannot be read, or has a key that `T` has no place for.
    pub fn read<T: DeserializeOwned + Default>(&self) -> Result<T, HostError> {
        let Some(path) = &self.path else { return Ok(T::default()) };
        let text = std::fs::read_to_string(path)
            .map_err(|error| HostError::Config { path: path.clone(), reason: error.to_string() })?;
        toml::from_str(&text)
            .map_err(|error| HostError::Config { path: path.clone(), reason: error.to_string() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Deserialize;

    #[derive(Debug, PartialEq, Deserialize)]
    #[serde(deny_unknown_fields, default)]
    struct Gains {
        proportional: f64,
        derivative: f64,
    }

    impl Default for Gains {
        fn default() -> Self {
            Self { proportional: 1.0, derivative: 0.5 }
        }
    }

    fn read(text: &str) -> Result<Gains, HostError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("gains.toml");
        std::fs::write(&path, text).unwrap();
        Config::new(Some(path)).read()
    }

    #[test]
    fn a_file_overrides_the_defaults_and_without_one_they_stand() {
        assert_eq!(Config::default().read::<Gains>().unwrap(), Gains::default());
        let read = read("derivative = 0.25").unwrap();
        assert_eq!(read, Gains { proportional: 1.0, derivative: 0.25 });
    }

    #[test]
    fn an_unknown_key_and_a_missing_file_are_named() {
        let error = read("derivatve = 0.25").unwrap_err().to_string();
        assert!(error.contains("gains.toml") && error.contains("derivatve"), "{error}");
        let missing = Config::new(Some("no/such.toml".into())).read::<Gains>();
        assert!(missing.unwrap_err().to_string().contains("no/such.toml"));
    }
}
