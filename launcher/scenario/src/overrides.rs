//! Edits of a scenario from the command line.

use crate::candidate::share;
use crate::services::{self, LOOPS, Loop};
use document::{Edit, Place, Problem, ScenarioError, shell_word, suggestion};
use miette::NamedSource;
use shared_types::Slot;

/// One edit of the scenario, remembered with the flag that asked for it.
#[derive(Debug, Clone)]
pub struct Override(pub(super) Edit);

impl Override {
    /// `--set KEY=VALUE`: any key. A value that is no TOML is taken for a string.
    ///
    /// # Errors
    /// No `=`.
    pub fn set(argument: &str) -> Result<Self, ScenarioError> {
        let shown = format!("--set {argument}");
        let Some((key, value)) = argument.split_once('=') else {
            let remedy = "write --set SECTION.KEY=VALUE, for example --set plant.rate_hz=2000";
            return Err(refusal("--set", &shown, "has no `=`", remedy));
        };
        let (key, value) = (key.trim().to_owned(), value.trim());
        let is_toml = toml::de::ValueDeserializer::parse(value).is_ok();
        let value = if is_toml { value.to_owned() } else { format!("{value:?}") };
        Ok(Self(Edit::set(shown, key, value)))
    }

    /// `--rate NAME=HZ`: the rate of one loop.
    ///
    /// # Errors
    /// No `=`, an unknown name or no number.
    pub fn rate(argument: &str) -> Result<Self, ScenarioError> {
        let shown = format!("--rate {argument}");
        let Some((name, hz)) = argument.split_once('=') else {
            let remedy = "write --rate NAME=HZ, for example --rate attitude-mpc=500";
            return Err(refusal("--rate", &shown, "has no `=`", remedy));
        };
        let (name, hz) = (name.trim(), hz.trim());
        let Some(found) = Loop::named(name) else {
            let remedy = suggestion(name, LOOPS.iter().map(|known| known.name));
            return Err(refusal("--rate", &shown, &format!("no loop is called `{name}`"), &remedy));
        };
        if hz.parse::<f64>().is_err() {
            let remedy = "give the rate in Hz as a number, for example 500";
            return Err(refusal("--rate", &shown, &format!("`{hz}` is not a number"), remedy));
        }
        Ok(Self(Edit::set(shown, format!("{}.rate_hz", found.section), toml_number(hz))))
    }

    /// `--swap SLOT=NAME@TIME`, with `,shadow=TIME`, `,rollback=TIME`, `,max-bump=SHARE`, `,config=FILE`,
    /// `,rehearse`, `,no-rehearsal` and `,force`.
    ///
    /// # Errors
    /// Not of this form.
    pub fn swap(argument: &str) -> Result<Self, ScenarioError> {
        let shown = format!("--swap {argument}");
        let refuse = |what: &str| Err(refusal("--swap", &shown, what, SWAP_FORM));
        let mut parts = argument.split(',');
        let head = parts.next().unwrap_or_default();
        let Some((slot, (to, at_s))) =
            head.split_once('=').and_then(|(slot, rest)| Some((slot, named_at(rest)?)))
        else {
            return refuse("lacks which controller takes which slot when");
        };
        let mut entry = format!("slot = {slot:?}, to = {to:?}, at_s = {at_s:?}");
        for part in parts {
            let (name, value) = part.split_once('=').unwrap_or((part, ""));
            let number = match name {
                "shadow" | "rollback" => seconds(value).map(|s| format!("{name}_s = {s:?}")),
                "max-bump" => share(value).map(|share| format!("max_bump = {share:?}")),
                "config" if !value.is_empty() => Some(format!("config = {value:?}")),
                "force" if part == name => Some("force = true".to_owned()),
                "rehearse" | "no-rehearsal" if part == name => {
                    Some(format!("rehearse = {}", name == "rehearse"))
                }
                _ => None,
            };
            let Some(number) = number else { return refuse(&format!("`{part}` is unknown")) };
            entry = format!("{entry}, {number}");
        }
        Ok(Self::entry(shown, "swap", &entry))
    }

    /// `--standby SLOT=NAME`, with `@TIME` and `,shadow=TIME`.
    ///
    /// # Errors
    /// Not of this form.
    pub fn standby(argument: &str) -> Result<Self, ScenarioError> {
        let shown = format!("--standby {argument}");
        let (head, shadow) = match argument.split_once(",shadow=") {
            Some((head, shadow)) => (head, Some(seconds(shadow))),
            None => (argument, None),
        };
        let parts = head.split_once('=').filter(|(_, name)| !name.contains(','));
        let Some(((slot, name), at_s)) = parts.and_then(|(slot, name)| {
            let at = if name.contains('@') { Some(named_at(name)?) } else { None };
            Some(((slot, at.map_or(name, |(name, _)| name)), at.map(|(_, at_s)| at_s)))
        }) else {
            let what = "lacks which controller stands by for which slot";
            return Err(refusal("--standby", &shown, what, STANDBY_FORM));
        };
        let mut entry = format!("slot = {slot:?}, name = {name:?}");
        if let Some(at_s) = at_s {
            entry = format!("{entry}, at_s = {at_s:?}");
        }
        match shadow {
            Some(Some(shadow_s)) => entry = format!("{entry}, shadow_s = {shadow_s:?}"),
            Some(None) => {
                let what = "the shadow is no time";
                return Err(refusal("--standby", &shown, what, STANDBY_FORM));
            }
            None => {}
        }
        Ok(Self::entry(shown, "standby", &entry))
    }

    /// `--fault KIND:NAME@TIME`.
    ///
    /// # Errors
    /// Not of this form.
    pub fn fault(argument: &str) -> Result<Self, ScenarioError> {
        let shown = format!("--fault {argument}");
        let Some((kind, (name, at_s))) =
            argument.split_once(':').and_then(|(kind, rest)| Some((kind, named_at(rest)?)))
        else {
            let what = "lacks what happens to which process when";
            return Err(refusal("--fault", &shown, what, FAULT_FORM));
        };
        let entry = format!("kind = {kind:?}, name = {name:?}, at_s = {at_s:?}");
        Ok(Self::entry(shown, "fault", &entry))
    }

    /// One more entry of a list.
    pub(super) fn entry(shown: String, list: &str, entry: &str) -> Self {
        Self(Edit::added(shown, list, entry))
    }

    /// `--controller SLOT=NAME`: the service that fills a slot.
    ///
    /// # Errors
    /// No `=`, no such slot, or no service of that name that fills it.
    pub fn controller(argument: &str) -> Result<Self, ScenarioError> {
        let shown = format!("--controller {argument}");
        let (slot, name) = argument.split_once('=').unwrap_or((argument, ""));
        match services::filling(slot.trim(), name.trim()) {
            Ok((role, name)) => {
                let key = format!("controller.{}", role.label());
                Ok(Self(Edit::set(shown, key, format!("{name:?}"))))
            }
            Err(what) => {
                // One that flew from the start would be its own fallback, and no proven owner would be there to rehearse
                // it against.
                let remedy = match Slot::named(slot.trim()) {
                    Some(slot) if name.contains('/') => {
                        let swap = format!("{}={}@1s", slot.label(), name.trim());
                        format!(
                            "an executable takes its slot in flight: --swap {}",
                            shell_word(&swap)
                        )
                    }
                    _ => {
                        let known = services::fillings().join(" or ");
                        format!("write --controller SLOT=NAME with {known}")
                    }
                };
                Err(refusal("--controller", &shown, what, &remedy))
            }
        }
    }

    /// `--seed N`.
    #[must_use]
    pub fn seed(seed: u64) -> Self {
        Self::flag("--seed", &seed.to_string(), "scenario.seed", seed.to_string())
    }

    /// `--for DURATION`.
    #[must_use]
    pub fn duration(duration: core::time::Duration) -> Self {
        let seconds = duration.as_secs_f64();
        Self::flag("--for", &format!("{seconds}s"), "scenario.duration_s", format!("{seconds:?}"))
    }

    /// `--clock lockstep|realtime`.
    #[must_use]
    pub fn clock(clock: &str) -> Self {
        Self::flag("--clock", clock, "scenario.clock", format!("{clock:?}"))
    }

    /// `--speed N|max`.
    #[must_use]
    pub fn speed(speed: &str) -> Self {
        let value =
            if speed.parse::<f64>().is_ok() { toml_number(speed) } else { format!("{speed:?}") };
        Self::flag("--speed", speed, "scenario.speed", value)
    }

    fn flag(flag: &str, argument: &str, key: &str, value: String) -> Self {
        Self(Edit::set(format!("{flag} {argument}"), key.to_owned(), value))
    }
}

const SWAP_FORM: &str = "write --swap SLOT=NAME@TIME, for example --swap attitude=attitude-mpc@4.2s; behind it \
    may stand ,shadow=2s ,rollback=500ms ,max-bump=1% ,config=FILE ,rehearse ,no-rehearsal and ,force";

const STANDBY_FORM: &str = "write --standby SLOT=NAME, for example --standby attitude=attitude-pid; behind it may \
    stand @TIME and then ,shadow=TIME";

const FAULT_FORM: &str = "write --fault kill:NAME@TIME or --fault stop:NAME@TIME, for example --fault kill:estimator@4.2s";

/// From `NAME@TIME` to both \[s\].
pub(super) fn named_at(text: &str) -> Option<(&str, f64)> {
    let (name, at) = text.rsplit_once('@')?;
    Some((name, seconds(at)?))
}

pub(super) fn seconds(text: &str) -> Option<f64> {
    humantime::parse_duration(text.trim()).ok().map(|duration| duration.as_secs_f64())
}

/// A number that Rust can read, as TOML writes it: `.5` and `NaN` are none.
fn toml_number(number: &str) -> String {
    if toml::de::ValueDeserializer::parse(number).is_ok() {
        return number.to_owned();
    }
    number.parse::<f64>().map_or_else(
        |_| format!("{number:?}"),
        |value| if value.is_nan() { "nan".to_owned() } else { format!("{value:?}") },
    )
}

pub(super) fn refusal(flag: &str, shown: &str, what: &str, remedy: &str) -> ScenarioError {
    let source = NamedSource::new("command line", shown.to_owned());
    Problem::new(flag, what, remedy, Some(Place { source, span: 0..shown.len() })).into()
}
