//! Dependencies point one way. The rule is a table; the facts come from cargo.

use super::docs::sources;
use serde_json::Value;
use spdx::{Expression, ParseMode};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::process::Command;

/// Crates of this workspace that each of them may depend on.
const ALLOWED: [(&str, &[&str]); 46] = [
    (FEATURES, &[]),
    ("shared-types", &[]),
    ("qp", &[]),
    ("mpc", &["qp"]),
    ("vehicle", &[]),
    ("noise", &["shared-types"]),
    ("timing", &["noise", "shared-types"]),
    ("slot", &["shared-types"]),
    ("runtime", &["shared-types", "slot", "timing"]),
    ("host", &["runtime", "shared-types", "timing", "vehicle"]),
    ("plant", &["noise", "runtime", "shared-types", "slot", "vehicle"]),
    ("estimator", &["runtime", "shared-types", "vehicle"]),
    ("controller", &["runtime", "shared-types", "vehicle", "mpc"]),
    ("position-mpc", &["runtime", "shared-types", "vehicle", "mpc", "controller"]),
    ("position-pid", &["runtime", "shared-types", "vehicle", "controller"]),
    ("attitude-mpc", &["runtime", "shared-types", "slot", "vehicle", "mpc", "controller"]),
    ("attitude-lqr", &["runtime", "shared-types", "vehicle", "mpc", "controller"]),
    ("attitude-pid", &["runtime", "shared-types", "vehicle", "mpc", "controller"]),
    ("disturbance-injector", &["noise", "runtime", "shared-types"]),
    ("monitor", &["runtime", "shared-types", "vehicle", "controller"]),
    ("pilot", &["runtime", "shared-types", "vehicle"]),
    ("rehearsal", &["shared-types", "vehicle"]),
    ("figures", &[]),
    ("verdict", &[]),
    ("document", &["pilot"]),
    (
        "scenario",
        &[
            "attitude-lqr",
            "attitude-mpc",
            "attitude-pid",
            "controller",
            "disturbance-injector",
            "document",
            "estimator",
            "host",
            "monitor",
            "pilot",
            "plant",
            "position-mpc",
            "position-pid",
            "rehearsal",
            "runtime",
            "shared-types",
            "timing",
            "vehicle",
            "verdict",
        ],
    ),
    (
        "components",
        &[
            "controller",
            "disturbance-injector",
            "estimator",
            "monitor",
            "pilot",
            "plant",
            "runtime",
            "scenario",
            "shared-types",
        ],
    ),
    ("record", &["components", "scenario", "shared-types", "vehicle"]),
    (
        "observe",
        &["host", "plant", "record", "runtime", "scenario", "shared-types", "vehicle", "verdict"],
    ),
    (
        "replay",
        &["components", "document", "observe", "record", "runtime", "scenario", "shared-types"],
    ),
    ("protocol", &["host", "record", "runtime", "scenario", "shared-types", "slot"]),
    (
        "swap",
        &[
            "document",
            "monitor",
            "protocol",
            "rehearsal",
            "runtime",
            "scenario",
            "shared-types",
            "slot",
            "vehicle",
        ],
    ),
    (
        "simulate",
        &[
            "components",
            "host",
            "monitor",
            "observe",
            "pilot",
            "protocol",
            "record",
            "rehearsal",
            "replay",
            "runtime",
            "scenario",
            "shared-types",
            "slot",
            "swap",
            "timing",
            "vehicle",
            "verdict",
        ],
    ),
    (
        "flight",
        &[
            "components",
            "document",
            "host",
            "observe",
            "protocol",
            "record",
            "rehearsal",
            "runtime",
            "scenario",
            "shared-types",
            "simulate",
            "slot",
            "swap",
            "timing",
        ],
    ),
    ("doctor", &["host", "record", "runtime", "scenario", "shared-types"]),
    (
        "experiments",
        &[
            "document",
            "figures",
            "host",
            "observe",
            "record",
            "runtime",
            "scenario",
            "shared-types",
            "simulate",
            "verdict",
        ],
    ),
    (
        "bench",
        &[
            "document",
            "figures",
            "flight",
            "host",
            "observe",
            "protocol",
            "record",
            "runtime",
            "scenario",
            "shared-types",
            "simulate",
        ],
    ),
    (
        "viewers",
        &[
            "disturbance-injector",
            "document",
            "figures",
            "observe",
            "protocol",
            "record",
            "runtime",
            "scenario",
            "shared-types",
            "swap",
            "timing",
            "vehicle",
            "verdict",
        ],
    ),
    (
        "studies",
        &[
            "attitude-mpc",
            "document",
            "figures",
            "observe",
            "pilot",
            "position-mpc",
            "runtime",
            "scenario",
            "shared-types",
            "simulate",
            "vehicle",
            "verdict",
        ],
    ),
    ("my-attitude-controller", &["host", "runtime", "shared-types", "vehicle"]),
    ("my-position-controller", &["host", "runtime", "shared-types", "vehicle"]),
    (
        "catalogue",
        &[
            "components",
            "controller",
            "document",
            "host",
            "observe",
            "protocol",
            "record",
            "runtime",
            "scenario",
            "shared-types",
            "simulate",
            "swap",
            "vehicle",
        ],
    ),
    ("soak", &["runtime"]),
    ("benches", &[]),
    (
        "cli",
        &[
            "attitude-mpc",
            "bench",
            "components",
            "disturbance-injector",
            "doctor",
            "document",
            "experiments",
            "figures",
            "flight",
            "host",
            "monitor",
            "protocol",
            "record",
            "rehearsal",
            "replay",
            "runtime",
            "scenario",
            "shared-types",
            "simulate",
            "studies",
            "swap",
            "vehicle",
            "viewers",
        ],
    ),
    ("morphquad", &["cli", "host", "record"]),
];

/// Has no code, and every crate depends on it: see there.
const FEATURES: &str = "workspace-hack";

/// What pure mathematics may know of the rest of the world.
const MATHEMATICS: [&str; 3] = ["nalgebra", "libm", "thiserror"];

/// One dependency as its crate declares it.
struct Dependency {
    name: String,
    /// False for dependencies of tests.
    shipped: bool,
}

/// What `cargo metadata` reports about the workspace.
fn metadata(arguments: &[&str]) -> Value {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--offline", "--format-version", "1"])
        .args(arguments)
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("cargo runs");
    serde_json::from_slice(&output.stdout).expect("cargo writes JSON")
}

fn text(value: &Value) -> String {
    value.as_str().expect("a name").to_owned()
}

/// Dependencies of every crate of the workspace.
fn workspace() -> BTreeMap<String, Vec<Dependency>> {
    let metadata = metadata(&["--no-deps"]);
    let packages = metadata["packages"].as_array().expect("packages").iter();
    packages
        .map(|package| {
            let declared = package["dependencies"].as_array().expect("dependencies").iter();
            let dependencies = declared.map(|dependency| Dependency {
                name: text(&dependency["name"]),
                shipped: dependency["kind"].is_null(),
            });
            (text(&package["name"]), dependencies.collect())
        })
        .collect()
}

#[test]
fn every_crate_depends_only_on_crates_further_up_the_stream() {
    let workspace = workspace();
    let ours: BTreeSet<&str> = workspace.keys().map(String::as_str).collect();
    let allowed = BTreeMap::from(ALLOWED);
    assert_eq!(ours, allowed.keys().copied().collect(), "a crate without a place in the table");
    for (name, dependencies) in &workspace {
        for dependency in dependencies.iter().filter(|d| d.shipped) {
            let inside = ours.contains(dependency.name.as_str());
            let inside = inside && dependency.name != FEATURES;
            let fine = !inside || allowed[name.as_str()].contains(&dependency.name.as_str());
            assert!(fine, "{name} depends on {}", dependency.name);
        }
    }
}

/// A crate is compiled as a whole after each edit, and searched as a whole for anything that it contains.
const LINES_MAX: usize = 8000;

#[test]
fn no_crate_of_the_launcher_is_longer_than_8000_lines() {
    let launcher = Path::new(env!("CARGO_MANIFEST_DIR")).join("launcher");
    let mut lines = BTreeMap::<String, usize>::new();
    for path in sources(&launcher) {
        let inside = path.strip_prefix(&launcher).expect("inside");
        let name = inside.iter().next().expect("a folder").to_string_lossy().into_owned();
        let text = std::fs::read_to_string(&path).expect("text");
        *lines.entry(name).or_default() += text.lines().count();
    }
    assert!(lines.len() > 15, "{lines:?}");
    lines.retain(|_, count| *count > LINES_MAX);
    assert!(lines.is_empty(), "{lines:?}");
}

#[test]
fn only_scenario_components_and_observe_know_the_plant_not_even_tests_do() {
    for (name, dependencies) in workspace() {
        let knows = dependencies.iter().any(|d| d.name == "plant");
        assert_eq!(knows, ["components", "observe", "scenario"].contains(&name.as_str()), "{name}");
    }
}

#[test]
fn solver_controller_and_vehicle_mathematics_know_nothing_but_mathematics() {
    let workspace = workspace();
    for name in ["qp", "mpc", "vehicle"] {
        for dependency in workspace[name].iter().filter(|d| d.shipped && d.name != FEATURES) {
            let known = dependency.name.as_str();
            // A scenario configures the design of an MPC too, so its choices are deserialised.
            let of_mpc = name == "mpc" && ["qp", "serde"].contains(&known);
            let fine = MATHEMATICS.contains(&known) || of_mpc;
            assert!(fine, "{name} depends on {known}");
        }
    }
}

#[test]
fn only_the_runtime_and_tests_know_the_transport() {
    for (name, dependencies) in workspace() {
        let knows = dependencies.iter().any(|d| d.name == "iceoryx2" && d.shipped);
        assert!(!knows || name == "runtime", "{name}");
    }
}

/// Each dependency that a command builds, with every choice of its features that is built along edges of these kinds.
fn features(selection: &[&str], edges: &str) -> BTreeMap<String, BTreeSet<String>> {
    let output = Command::new(env!("CARGO"))
        .args(["tree", "--offline", "--prefix", "none", "--format", "{p}|{f}", "--edges", edges])
        .args(selection)
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("cargo runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let mut chosen: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for line in String::from_utf8(output.stdout).expect("text").lines() {
        let Some((package, features)) = line.trim_end_matches(" (*)").split_once('|') else {
            continue;
        };
        chosen.entry(package.to_owned()).or_default().insert(features.to_owned());
    }
    chosen
}

#[test]
fn every_selection_of_packages_shares_what_the_workspace_has_built() {
    let names: Vec<String> = workspace().into_keys().collect();
    // A package may have one choice of features for programs and another one for build scripts, so that what programs are
    // made of is compared alone too.
    for edges in ["normal,build,dev", "normal,dev,no-proc-macro"] {
        let whole = features(&["--workspace"], edges);
        assert!(whole.len() > 100, "{whole:?}");
        // The first is `cargo run`.
        let mut selections = vec![(edges.replace(",dev", ""), vec![])];
        selections.extend(names.iter().map(|name| (edges.to_owned(), vec!["-p", name.as_str()])));
        for (edges, selection) in selections {
            for (package, features) in features(&selection, &edges) {
                let built = &whole[&package];
                assert!(
                    features.is_subset(built),
                    "`cargo tree --edges {edges} {}` has {package} with {features:?} and the workspace with {built:?}: \
                     name all features in services/lib/workspace-hack/Cargo.toml",
                    selection.join(" ")
                );
            }
        }
    }
}

/// `deny.toml`, which cargo-deny reads too.
fn rules() -> toml::Table {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("deny.toml");
    std::fs::read_to_string(path).expect("a file").parse().expect("TOML")
}

fn strings(list: &toml::Value) -> BTreeSet<String> {
    let list = list.as_array().expect("a list").iter();
    list.map(|item| item.as_str().expect("a word").to_owned()).collect()
}

#[test]
fn every_crate_that_is_built_may_be_given_away_under_the_licences_of_this_one() {
    let allowed = strings(&rules()["licenses"]["allow"]);
    let mut used = BTreeSet::new();
    for package in of_this_platform()["packages"].as_array().expect("packages") {
        let (name, licence) = (text(&package["name"]), package["license"].as_str());
        let licence = licence.unwrap_or_else(|| panic!("{name} names no licence"));
        let expression = Expression::parse_mode(licence, ParseMode::LAX).expect("SPDX");
        let may = expression.evaluate(|asked| {
            let asked = asked.to_string();
            used.insert(asked.clone());
            allowed.contains(&asked)
        });
        assert!(may, "{name} comes under {licence}");
    }
    assert!(allowed.is_subset(&used), "allowed, but met nowhere: {:?}", &allowed - &used);
}

#[test]
fn every_locked_crate_is_from_the_public_registry_and_those_that_must_be_one_are() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("Cargo.lock");
    let locked = std::fs::read_to_string(path).expect("a file");
    let locked: toml::Table = locked.parse().expect("TOML");
    let registries = strings(&rules()["sources"]["allow-registry"]);
    let mut versions = BTreeMap::<_, u32>::new();
    for package in locked["package"].as_array().expect("packages") {
        *versions.entry(package["name"].as_str().expect("a name")).or_default() += 1;
        let source = package.get("source").map(|source| source.as_str().expect("a source"));
        let known = source.is_none_or(|source| {
            source.strip_prefix("registry+").is_some_and(|registry| registries.contains(registry))
        });
        assert!(known, "{} comes from {source:?}", package["name"]);
    }
    let rules = rules();
    for rule in rules["bans"]["deny"].as_array().expect("a list") {
        let name = rule["crate"].as_str().expect("a name");
        assert!(rule["deny-multiple-versions"].as_bool().expect("a flag"), "{name}");
        assert_eq!(versions.get(name), Some(&1), "versions of {name}");
    }
}

/// Everything that is built here: crates for other systems need not have been fetched.
fn of_this_platform() -> Value {
    let platform = format!("{}-unknown-linux-gnu", std::env::consts::ARCH);
    metadata(&["--filter-platform", &platform])
}

/// With its feature `std` nalgebra multiplies large matrices in a way that depends on whether the
/// processor has FMA, and without `libm-force` its functions are the C library's.
#[test]
fn the_linear_algebra_of_a_flight_asks_neither_the_processor_nor_the_c_library() {
    let metadata = of_this_platform();
    let nodes = metadata["resolve"]["nodes"].as_array().expect("nodes").iter();
    let of = |name: &str| {
        let named = format!("#{name}@");
        nodes.clone().filter(move |node| text(&node["id"]).contains(&named))
    };
    assert_eq!(of("matrixmultiply").count(), 0, "something brings in matrixmultiply");
    for node in of("nalgebra") {
        let features = node["features"].as_array().expect("features");
        let features: BTreeSet<String> = features.iter().map(text).collect();
        assert_eq!(features, BTreeSet::from(["alloc".to_owned(), "libm-force".to_owned()]));
    }
    assert_eq!(of("nalgebra").count(), 1);
}

/// Its kernels are chosen by the processor: good enough for a map of eigenvalues, not for a flight.
#[test]
fn only_studies_know_the_dispatching_linear_algebra() {
    for (name, dependencies) in workspace() {
        // The gains of the LQR are compared with it, and are not its.
        let knows = dependencies.iter().any(|d| d.name == "faer" && d.shipped);
        assert_eq!(knows, name == "studies", "{name}");
    }
}
