//! Examples under the help of commands; the help of their arguments has the rest.

pub(super) const RUN: &str = "\
Examples:
  morphquad run
  morphquad run hover --clock realtime --for 60s
  morphquad run figure8-morph --set start.morph_angle_deg=120 --rate attitude-mpc=500 --seed 7
  morphquad run figure8-morph --swap attitude=attitude-lqr@6s --fault kill:estimator@9s
  morphquad run hover --goto 1,0,2@3s --morph 120@5s,over=1s
  morphquad run my-scenario.toml --in-process --format json

Ends with 0 flown, 1 FAILED or LOST, 2 usage or scenario, 3 unfit environment or incomplete recording, 4 crash, \
5 passed although a swap of the script was refused or taken back, 130 interrupted.";

pub(super) const LIST: &str = "Examples:\n  morphquad list\n  morphquad list --format json";

pub(super) const CHECK: &str = "\
Examples:
  morphquad check figure8-morph
  morphquad check my-scenario.toml --clock realtime --speed 0.1
  morphquad check hover --set plant.rate_hz=2000 --format toml > mine.toml
  ./generate | morphquad check -

Shows loops, rates, latencies and deadlines; as TOML the whole scenario, keys that were left out with their \
defaults, which `run` takes again, as JSON both. A scenario has at most 4 MB. Ends with 2 if it cannot be flown: file, line, key and remedy.";

pub(super) const REPLAY: &str = "\
Examples:
  morphquad replay recordings/7f3a.mcap --hash --verify
  morphquad replay recordings/7f3a.mcap --with attitude-lqr
  morphquad replay recordings/7f3a.mcap --branch @12.5s --set plant.mismatch.mass_scale=1.1
  morphquad replay recordings/7f3a.mcap --branch @5s --seeds 0..99

Ends with 0 identical, 1 something differs, 2 no such file, service or instant.";

pub(super) const PAPER: &str = "\
Examples:
  morphquad paper
  morphquad paper --test 3 --out paper-test-3";

pub(super) const CAMPAIGN: &str = "\
Examples:
  morphquad campaign launcher/campaigns/robustness.toml
  morphquad campaign robustness.toml --out results --restart

After an interruption the same command flies only what is missing.";

pub(super) const TYPES: &str = "Example:\n  morphquad types --python --out morphquad_types.py";

pub(super) const CONTROLLERS: &str = "Example:\n  morphquad study controllers --quick";

pub(super) const MORPHING: &str = "Example:\n  morphquad study morphing --quick --seeds 5";

pub(super) const RANDOM: &str = "\
Examples:
  morphquad study random
  morphquad study random --seeds 151..300 --set position_mpc.tilt_weight=2 --out study-tilt
  morphquad study random --controller position=position-pid,attitude=attitude-pid --quick

Tells how many flights stay how near to their path, and names the worst with the commands that fly them again. \
launcher/docs/random-flights.md has what is drawn. Ends with 1 if a vehicle was lost.";

pub(super) const TIMING: &str = "\
Examples:
  morphquad study timing
  morphquad study timing hover --set attitude_mpc.rate_hz=200 --out study-200
  morphquad study timing --controller attitude=attitude-pid --quick

One loop at a time, in simulated time: how long its steps may take, and by how much at most it may begin late, before \
anything is missed, the flight does not pass, or the vehicle is lost. launcher/docs/timing.md has what a script of \
times can say.";

pub(super) const TUNING: &str = "\
Examples:
  morphquad study tuning
  morphquad study tuning --candidates 200 --seed 7 --out study-tuning
  morphquad study tuning --quick

Closeness is the error of figure eights over that of the shipped set, robustness what 90 % of random flights stay within. \
The Pareto front is flown again by random flights that nothing was chosen by.";

pub(super) const STABILITY: &str =
    "Example:\n  morphquad study stability --rate 500 --angle 120 --out study-500";

pub(super) const WORST_CASE: &str = "Example:\n  morphquad study worst-case --quick";
