//! Measured flights in processes of their own: the transport knows one run per process.

use super::BenchError;
use super::report::LoopsReport;
use host::exit;
use serde_json::Value;
use std::io::Read as _;
use std::process::{Child, Command, Stdio};

/// A `morphquad bench loops` under way.
#[derive(Debug)]
pub struct Flight(Child);

/// How one ended.
#[derive(Debug)]
pub enum Flown {
    /// With a result.
    Measured(Box<LoopsReport>),
    /// The scenario cannot be flown so, and why.
    Refused(String),
    /// It crashed, or was lost, and how.
    Lost(String),
}

impl Flight {
    /// Begins: this executable, which is `morphquad`, with these arguments after `bench loops`.
    ///
    /// # Errors
    /// It cannot be started.
    pub fn start(mut morphquad: Command, arguments: &[String]) -> Result<Self, BenchError> {
        let failed = |source| BenchError::System { action: "start a flight".to_owned(), source };
        let child = morphquad
            .args(["bench", "loops"])
            .args(arguments)
            .args(["--no-floor", "--format", "json"])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn();
        child.map(Self).map_err(failed)
    }

    /// Waits for its end.
    ///
    /// # Errors
    /// It ends without a result that can be read, or this machine let it not begin.
    pub fn wait(mut self) -> Result<Flown, BenchError> {
        let mut output = String::new();
        if let Some(out) = &mut self.0.stdout {
            // What cannot be read is no answer.
            let _ = out.read_to_string(&mut output);
        }
        let status = self.0.wait().map_err(|source| BenchError::System {
            action: "wait for a flight".to_owned(),
            source,
        })?;
        let result: Value = serde_json::from_str(&output).unwrap_or_default();
        let error = result["error"].as_str().map(str::to_owned);
        match (status.code().and_then(|code| u8::try_from(code).ok()), error) {
            (Some(exit::USAGE), Some(error)) => Ok(Flown::Refused(error)),
            (Some(exit::UNFIT), Some(error)) => Err(BenchError::Unfit(error)),
            (_, Some(error)) => Ok(Flown::Lost(error)),
            (Some(exit::PASS | exit::FAILED), None) => {
                let report = serde_json::from_value(result["report"].clone());
                let report = report.map_err(|error| {
                    BenchError::Peer(format!("gave a result that means nothing: {error}"))
                })?;
                Ok(Flown::Measured(Box::new(report)))
            }
            (code, None) => Ok(Flown::Lost(format!("ended with {code:?}"))),
        }
    }
}

impl Drop for Flight {
    fn drop(&mut self) {
        // A flight that is not waited for any more is killed; its processes leave by themselves.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}
