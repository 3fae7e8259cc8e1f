//! Trajectories from files: what they become, and what is wrong with them, at its line.

use crate::{Override, Plan, Problem, Scenario, ScenarioError};
use ::pilot::{Trajectory, TrajectoryConfig};
use std::fs;
use tempfile::TempDir;

/// A folder with a scenario that names a file, and that file.
fn folder(section: &str, name: &str, csv: &str) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let scenario = format!("[pilot]\nkind = \"trajectory\"\nfile = \"{name}\"\n{section}\n");
    fs::write(folder.path().join("mine.toml"), scenario).unwrap();
    fs::write(folder.path().join(name), csv).unwrap();
    folder
}

fn load(folder: &TempDir, edits: &[Override]) -> Result<Scenario, ScenarioError> {
    Scenario::load(folder.path().join("mine.toml").to_str().unwrap(), edits)
}

fn loaded(section: &str, csv: &str) -> Result<Scenario, ScenarioError> {
    load(&folder(section, "path.csv", csv), &[])
}

fn refused(section: &str, csv: &str) -> Problem {
    loaded(section, csv).unwrap_err().problems().next().unwrap().clone()
}

fn trajectory(scenario: &Scenario) -> Trajectory {
    let Plan::Flight(config) = scenario.plan() else { panic!("no trajectory") };
    Trajectory::new(&config.trajectory).unwrap()
}

/// Two pieces as planners write them: along x with x = t + t² / 2, then on without acceleration; z stays at 1.2 m.
fn pieces() -> String {
    let axes = ["x", "y", "z", "yaw"].map(|axis| (0..8).map(move |k| format!("{axis}^{k}")));
    let header: Vec<String> = axes.into_iter().flatten().collect();
    let row = |duration: &str, x: [&str; 3], yaw: &str| {
        let none = ["0"; 5].join(",");
        let still = |value: &str| format!("{value},0,0,{none}");
        format!("{duration},{},{none},{},{},{},", x.join(","), still("0"), still("1.2"), still(yaw))
    };
    let rows = [row("1.0", ["0.0", "1.0", "0.5"], "0.1"), row("0.5", ["1.5", "2", "0"], "0.1")];
    format!("duration,{},\n{}\n", header.join(","), rows.join("\n"))
}

#[test]
fn a_planners_file_is_flown_from_its_beginning_at_its_speed() {
    let scenario = loaded("", &pieces()).unwrap();
    assert_eq!(scenario.settings().scenario.name, "mine");
    let start = &scenario.settings().start;
    assert_eq!((start.position_w_m, start.velocity_w_m_s), ([0.0, 0.0, 1.2], [1.0, 0.0, 0.0]));
    assert!((start.yaw_deg - 0.1_f64.to_degrees()).abs() < 1e-12);
    // It brakes from 2 m/s for 2.5 s and rests for 2 s.
    assert!((scenario.settings().scenario.duration_s - 6.0).abs() < 1e-12);
    let point = trajectory(&scenario).at(1_250_000_000);
    assert!((point.position_w_m[0] - 2.0).abs() < 1e-12, "{point:?}");
    assert!((point.velocity_w_m_s[0] - 2.0).abs() < 1e-12, "{point:?}");
}

#[test]
fn the_rows_stand_in_the_scenario_and_the_file_is_not_needed_again() {
    let folder = folder("time_scale = 2.0\norigin_w_m = [1.0, 2.0, 0.3]", "path.csv", &pieces());
    let first = load(&folder, &[]).unwrap();
    drop(folder);
    assert!(!first.to_toml().contains("path.csv"), "{}", first.to_toml());
    let again = Scenario::from_text("scenario.toml", first.to_toml(), &[]).unwrap();
    assert_eq!(first.to_toml(), again.to_toml());
    assert_eq!(format!("{:?}", first.settings()), format!("{:?}", again.settings()));
    let point = trajectory(&again).at(2_500_000_000);
    for (found, wanted) in point.position_w_m.into_iter().zip([3.0, 2.0, 1.5]) {
        assert!((found - wanted).abs() < 1e-12, "{point:?}");
    }
    assert!((point.velocity_w_m_s[0] - 1.0).abs() < 1e-12, "{point:?}");
}

#[test]
fn what_the_scenario_sets_of_start_and_length_holds() {
    let keys = "[start]\nposition_w_m = [0.1, 0.0, 1.2]\nyaw_deg = 0.0\nvelocity_w_m_s = [0.0, 0.0, 0.0]\n\
                [scenario]\nduration_s = 9.0";
    let scenario = loaded(keys, &pieces()).unwrap();
    let start = &scenario.settings().start;
    assert_eq!((start.position_w_m, start.yaw_deg), ([0.1, 0.0, 1.2], 0.0));
    assert!(start.velocity_w_m_s.iter().all(|speed_m_s| *speed_m_s == 0.0));
    assert!((scenario.settings().scenario.duration_s - 9.0).abs() < 1e-12);
}

#[test]
fn samples_come_with_any_of_their_columns_and_separators() {
    let plain = "t,x,y,z\n0,0,0,1\n1,0.5,0,1\n2,1,0,1\n3,1.5,0,1\n";
    let semicolons = "\u{feff}T_s; X_m; Y_m; Z_m; yaw_rad\r\n# from a log\r\n5;0;0;1;0\r\n6;0.5;0;1;0\r\n\
                      7;1;0;1;0\r\n8;1.5;0;1;0\r\n";
    let whole =
        "time,x,y,z,heading,vx,vy,vz,ax,ay,az\n0,0,0,1,0,.5,0,0,0,0,0\n3,1.5,0,1,0,.5,0,0,0,0,0";
    let nameless = "0,0,0,1\n1.5,0.75,0,1\n3,1.5,0,1\n";
    let turned = "z [m],y [m],x (m),t [s]\n1,0,0,0\n1,0,.5,1\n1,0,1,2\n1,0,1.5,3";
    let without_yaw = "t,x,y,z,vx,vy,vz\n0,0,0,1,.5,0,0\n3,1.5,0,1,.5,0,0";
    for csv in [plain, semicolons, whole, nameless, turned, without_yaw] {
        let scenario = loaded("", csv).unwrap_or_else(|error| panic!("{csv}: {error:?}"));
        let point = trajectory(&scenario).at(1_700_000_000);
        assert!((point.position_w_m[0] - 0.85).abs() < 1e-9, "{csv}: {point:?}");
        assert!((point.velocity_w_m_s[0] - 0.5).abs() < 1e-9, "{csv}: {point:?}");
        assert!(scenario.settings().scenario.duration_s > 5.0, "{csv}");
    }
}

#[test]
fn names_of_columns_may_stand_in_the_comment_before_the_first_row() {
    for head in ["# t,x,y,z,vx,vy,vz,yaw", "# of a log\n\n#t;x;y;z;vx;vy;vz;yaw"] {
        let separator = if head.contains(';') { ";" } else { "," };
        let rows = ["0,0,0,1,.5,0,0,.1", "3,1.5,0,1,.5,0,0,.1"];
        let csv = format!("{head}\n{}\n", rows.join("\n")).replace(',', separator);
        let point = trajectory(&loaded("", &csv).unwrap()).at(1_500_000_000);
        assert!((point.velocity_w_m_s[0] - 0.5).abs() < 1e-9, "{head}: {point:?}");
        assert!((point.yaw_rad - 0.1).abs() < 1e-9, "{head}: {point:?}");
    }
}

#[test]
fn what_is_wrong_with_a_file_is_reported_at_its_line() {
    let apart = pieces().replace("0.5,1.5,2,", "0.5,1.6,2,");
    let degrees = pieces().replace("yaw^0", "yaw^0 [deg]");
    let cases = [
        ("t,x,y,z\n0,0,0,1\n1,abc,0,1\n", 3, "`abc` is not a number"),
        ("t,x,y,z\n0,0,0,1\n1,nan,0,1\n", 3, "`nan` is not a number"),
        ("t,x,y,z\n0,0,0,1\n1,0,0\n", 3, "3 values in 4 columns"),
        ("t,x,y,z\n\n# a; b\n0,0,0,1\n2,0,0,1\n  # words\n1,0,0,1\n", 7, "1.0 s comes after 2.0 s"),
        ("# a; b\nt,x,y,z\n \n0,0,0,1\n,,,\n1,0,0\n", 6, "3 values in 4 columns"),
        ("t,x,y,z\n", 1, "no rows"),
        ("t x y z\n0 0 0 1\n", 1, "not separated by commas"),
        ("t,x,y,z\n0,0,0,1\n1,1e9,0,1\n", 2, "samples[0]"),
        ("t,x,y,w\n0,0,0,1\n", 1, "no column `w`"),
        ("t,x,y,z,vx\n0,0,0,1,0\n", 1, "t,x,y,z,vx"),
        ("t,x,y,z,ax,ay,az\n0,0,0,1,0,0,0\n", 1, "t,x,y,z,ax"),
        ("t,x [mm],y,z\n0,0,0,1\n", 1, "`x` is in mm"),
        ("t [m],x,y,z\n0,0,0,1\n", 1, "`t` is in m"),
        ("t,x,y,z,yaw_deg [rad]\n0,0,0,1,0\n", 1, "`yaw_deg` is in rad"),
        ("t,x,y,z\n0,0,0,1\n#a,\"b\n2,0,0,1\n1,0,0,1\n", 5, "1.0 s comes after 2.0 s"),
        ("t,x,y,z\n0,0,0,1\n1,0,0,\"1\n2,0,0,1\n", 3, "is not a number"),
        (&degrees, 1, "`yaw^0` is in deg"),
        ("t,x,y\n0,0,0\n", 1, "t,x,y"),
        ("0,0\n", 1, "2 columns without names"),
        // The heading would be taken for a velocity, or the other way round.
        ("0,0,0,1,0,0,0,0.5\n", 1, "8 columns without names"),
        ("# seconds, metres, and the rest\n0,0,0,1,0,0,0,0.5\n", 2, "8 columns without names"),
        ("# t,x,y,z,w\n0,0,0,1,0\n", 1, "no column `w`"),
        ("timestamp,x,y,z\n0,0,0,1\n", 1, "call it t"),
        ("t,pos_x,pos_y,pos_z\n0,0,0,1\n", 1, "call it x"),
        (",t,x,y,z\n0,0,0,0,1\n", 1, "to_csv(index=False)"),
        ("", 1, "no rows"),
        ("duration,x^0,x^1\n1,0,0\n", 1, "25 or 33"),
        ("duration,x^0,y^0\n1,0,0\n", 1, "`y^0`"),
        (&apart, 3, "pieces[1]"),
    ];
    for (csv, line, reason) in cases {
        let problem = refused("", csv);
        let message = format!("{problem} {}", problem.remedy());
        assert!(message.contains(reason), "{csv}: {message}");
        assert_eq!(problem.line(), Some(line), "{csv}: {message}");
        assert!(
            problem.file().is_some_and(|file| file.ends_with("path.csv")),
            "{csv}: {problem:?}"
        );
    }
    let many: Vec<String> = (0..10_002).map(|i| format!("{i},0,0,1")).collect();
    assert!(refused("", &many.join("\n")).to_string().contains("10002 rows"));
}

#[test]
fn a_trajectory_without_rows_with_two_kinds_or_without_its_file_is_refused() {
    let alone = |section: &str| {
        let text = format!("[pilot]\nkind = \"trajectory\"\n{section}");
        Scenario::from_text("mine.toml", &text, &[]).unwrap_err().problems().next().unwrap().clone()
    };
    let nothing = alone("");
    assert!(nothing.remedy().contains("name a file"), "{nothing:?}");
    let missing = alone("file = \"nowhere.csv\"");
    assert!(missing.to_string().contains("nowhere.csv cannot be read"), "{missing:?}");
    assert_eq!(missing.line(), Some(3));
    let device = alone("file = \"/dev/zero\"");
    assert!(device.to_string().contains("device"), "{device:?}");
    let both = refused("samples = [[0.0, 0.0, 0.0, 1.0]]", &pieces());
    assert!(both.to_string().contains("in the scenario as well"), "{both:?}");
    let short = alone("samples = [[0.0, 0.0, 0.0, 1.0], [1.0, 2.0]]");
    assert!(short.to_string().contains("[1] has 2 numbers"), "{short:?}");
    let mixed = alone("samples = [[0.0, 0.0, 0.0, 1.0], [1.0, 2.0, 0.0, 1.0, 0.0]]");
    assert!(mixed.to_string().contains("as many in each row"), "{mixed:?}");
    let unordered = alone("samples = [[1.0, 0.0, 0.0, 1.0], [1.0, 0.0, 0.0, 1.0]]");
    assert_eq!((unordered.key(), unordered.line()), ("pilot.samples", Some(3)));
    let rows = "samples = [[0.0, 0.0, 0.0, 1.0]]\npieces = [";
    let both = alone(&format!("{rows}[1.0{}]]", ", 1.0".repeat(24)));
    assert_eq!((both.key(), both.line()), ("pilot.samples", Some(3)), "{both:?}");
    let not_a_number = alone("time_scale = nan\nsamples = [[0.0, 0.0, 0.0, 1.0]]");
    assert_eq!(not_a_number.key(), "pilot.time_scale");
}

#[test]
fn a_trajectory_in_or_on_the_ground_is_refused_with_where_its_origin_may_be() {
    for (height, expected) in [("-0.2", "-0.200 m"), ("0", "no higher than 0.00 m")] {
        let csv = format!("t,x,y,z\n0,0,0,{height}\n9,1,0,{height}\n");
        let problem = refused("[start]\nposition_w_m = [0.0, 0.0, 1.0]", &csv);
        assert!(problem.to_string().contains(expected), "{problem:?}");
        let (_, remedy) = problem.remedy().split_once("with ").unwrap();
        let (key, value) = remedy.split_once(" = ").unwrap();
        let lifted = folder("", "path.csv", &csv);
        load(&lifted, &[Override::set(&format!("{key}={value}")).unwrap()]).unwrap();
    }
}

#[test]
fn a_trajectory_that_is_too_fast_is_refused_with_how_slow_it_can_be_flown() {
    let csv = "t,x,y,z\n0,0,0,1.5\n1,1,0,1.5\n2,-1,0,1.5\n3,1,0,1.5\n4,0,0,1.5\n";
    let fast = loaded("", csv).unwrap();
    let warning = fast.warnings().first().expect("a warning");
    let (_, scale) = warning.remedy().split_once("pilot.time_scale = ").unwrap();
    let (scale, _) = scale.split_once(' ').unwrap();
    assert!(scale.parse::<f64>().unwrap() > 1.0, "{warning:?}");
    let slow = loaded(&format!("time_scale = {scale}"), csv).unwrap();
    assert!(slow.warnings().is_empty(), "{:?}", slow.warnings());
}

/// Up and down by `metres`, there and back within two seconds, and nowhere else.
fn bump(metres: f64) -> String {
    let up = |t_s: f64| {
        let s = if t_s < 1.0 { t_s } else { 2.0 - t_s };
        1.5 + metres * s * s * s * (10.0 + s * (6.0 * s - 15.0))
    };
    let rows = (0..=100).map(|i| f64::from(i) * 0.02).map(|t_s| format!("{t_s},0,0,{}", up(t_s)));
    format!("t,x,y,z\n{}\n", rows.collect::<Vec<_>>().join("\n"))
}

#[test]
fn what_climbs_is_judged_by_the_bounds_on_thrust_and_not_by_that_on_tilt() {
    // 5.8 m/s^2 at most.
    let fine = loaded("", &bump(1.0)).unwrap();
    assert!(fine.warnings().is_empty(), "{:?}", fine.warnings());
    let steep = loaded("", &bump(2.0)).unwrap();
    let warnings: Vec<String> = steep.warnings().iter().map(ToString::to_string).collect();
    assert!(warnings.iter().any(|it| it.contains("upwards with 11.")), "{warnings:?}");
    assert!(warnings.iter().any(|it| it.contains("downwards with 11.")), "{warnings:?}");
    assert!(!warnings.iter().any(|it| it.contains("sideways")), "{warnings:?}");
    let (_, scale) = steep.warnings()[0].remedy().split_once("pilot.time_scale = ").unwrap();
    let (scale, _) = scale.split_once(' ').unwrap();
    let slow = loaded(&format!("time_scale = {scale}"), &bump(2.0)).unwrap();
    assert!(slow.warnings().is_empty(), "{:?}", slow.warnings());
}

#[test]
fn a_path_on_the_command_line_begins_where_the_command_runs() {
    let folder = folder("", "path.csv", &pieces());
    let path = folder.path().join("path.csv");
    let set = |edit: String| Override::set(&edit).unwrap();
    let edits =
        [set("pilot.kind=trajectory".to_owned()), set(format!("pilot.file={}", path.display()))];
    let scenario = Scenario::from_text("empty.toml", "", &edits).unwrap();
    let Plan::Flight(config) = scenario.plan() else { panic!("no trajectory") };
    assert!(matches!(config.trajectory, TrajectoryConfig::Pieces(pieces) if pieces.len() == 2));
}

#[test]
fn what_is_not_flown_of_a_trajectory_is_not_judged() {
    let height_m = |t_s: u32| if t_s == 5 { -1.0 } else { 1.5 };
    let rows: Vec<String> = (0..21).map(|t_s| format!("{t_s},0,0,{}", height_m(t_s))).collect();
    let csv = &format!("t,x,y,z\n{}\n", rows.join("\n"));
    assert!(refused("", csv).to_string().contains("leads down"));
    let before = "[start]\nat_s = 0x8";
    let later = loaded(before, csv).unwrap();
    assert!(later.warnings().is_empty(), "{:?}", later.warnings());
    assert!(
        (later.settings().scenario.duration_s - 14.0).abs() < 0.5,
        "{:?}",
        later.settings().scenario
    );
    let across = format!("{before}\n[scenario]\nduration_s = 3.0");
    let first = loaded(&across.replace("0x8", "3.0"), csv).unwrap_err();
    assert!(first.problems().next().unwrap().to_string().contains("leads down"));
}

#[test]
fn what_a_flight_cannot_begin_with_is_reported_of_the_trajectory() {
    let fast = refused("", "t,x,y,z\n0,0,0,1\n1,500,0,1\n2,1000,0,1\n");
    assert!(fast.to_string().contains("begins with 500.0 m/s"), "{fast:?}");
    let rest = |t_s: &str, x_m: &str| format!("{t_s},{x_m},0,1,0,0,0\n");
    let rows = [("0", "0"), ("1", "0"), ("1.00001", "0.1"), ("2", "0.1")];
    let rows: Vec<String> = rows.iter().map(|(t_s, x_m)| rest(t_s, x_m)).collect();
    let leap = refused("", &format!("t,x,y,z,vx,vy,vz\n{}", rows.concat()));
    assert!(leap.to_string().contains("leads along at up to"), "{leap:?}");
    let long = refused("time_scale = 100.0", "t,x,y,z\n0,0,0,1\n10000,1,0,1\n");
    assert!(long.remedy().contains("scenario.duration_s"), "{long:?}");
}

#[test]
fn a_flight_is_called_as_its_file_where_that_is_a_name() {
    let folder = folder("", "path.csv", &pieces());
    let named = |name: &str, more: &str| {
        let path = folder.path().join(name);
        let text = fs::read_to_string(folder.path().join("mine.toml")).unwrap();
        fs::write(&path, text + more).unwrap();
        Scenario::load(path.to_str().unwrap(), &[]).map(|it| it.settings().scenario.name.clone())
    };
    assert_eq!(named("my flight.toml", "").unwrap(), "my flight");
    assert_eq!(named(&format!("{}.toml", "x".repeat(80)), "").unwrap(), "unnamed");
    assert_eq!(named("other.toml", "[scenario]\nname = \"own\"\n").unwrap(), "own");
}

#[test]
fn a_heading_in_degrees_is_one_and_one_that_seems_to_be_is_warned_of() {
    for names in ["t,x,y,z,yaw_deg", "t,x,y,z,yaw [deg]"] {
        let turn = loaded("", &format!("{names}\n0,0,0,1,0\n3,1,0,1,90\n6,2,0,1,180\n")).unwrap();
        let turned_rad = trajectory(&turn).at(3_000_000_000).yaw_rad;
        assert!((turned_rad - core::f64::consts::FRAC_PI_2).abs() < 1e-9, "{names}: {turned_rad}");
        assert!(turn.warnings().is_empty(), "{:?}", turn.warnings());
    }
    let units = pieces().replace("x^1,", "x^1 [m/s],").replace("yaw^0", "yaw^0 [rad]");
    loaded("", &units).unwrap();
    // Six hundred turns, each written within one.
    let row =
        |i: u32| format!("{i},0,0,1,{}", libm::fmod(1.5 * f64::from(i), core::f64::consts::TAU));
    let rows: Vec<String> = (0..3000).map(row).collect();
    loaded("", &format!("t,x,y,z,yaw\n{}\n", rows.join("\n"))).unwrap();
    let wrong = loaded("", "t,x,y,z,yaw\n0,0,0,1,0\n1,0,0,1,3\n2,0,0,1,6\n3,0,0,1,91\n").unwrap();
    assert!(
        wrong.warnings().iter().any(|it| it.remedy().contains("yaw_deg")),
        "{:?}",
        wrong.warnings()
    );
}

#[test]
fn a_flight_that_begins_elsewhere_or_ends_too_soon_is_warned_of() {
    let csv = "t,x,y,z\n0,0,0,1\n3,0,0,1\n6,0,0,1\n";
    let away = loaded("[start]\nposition_w_m = [1.0, 0.0, 1.0]", csv).unwrap();
    assert_eq!(away.warnings()[0].key(), "start.position_w_m");
    let short = loaded("[scenario]\nduration_s = 4.0", csv).unwrap();
    assert_eq!(short.warnings()[0].key(), "scenario.duration_s");
    assert!(loaded("", csv).unwrap().warnings().is_empty());
}
