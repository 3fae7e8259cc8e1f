//! Every complaint names file or flag, line, key and remedy; every shipped scenario flies.

use super::{Override, Scenario, Settings, services, shipped};
use document::{Problem, ScenarioError};
use miette::{GraphicalReportHandler, GraphicalTheme};
use shared_types::Role;

fn refusal(text: &str) -> ScenarioError {
    Scenario::from_text("bad.toml", text, &[]).unwrap_err()
}

/// The one problem of `text`.
fn problem(text: &str) -> Problem {
    let error = refusal(text);
    let problems: Vec<_> = error.problems().cloned().collect();
    assert_eq!(problems.len(), 1, "{problems:#?}");
    problems.into_iter().next().unwrap()
}

fn overridden(name: &str, edits: &[Override]) -> Problem {
    Scenario::load(name, edits).unwrap_err().problems().next().unwrap().clone()
}

fn set(argument: &str) -> Override {
    Override::set(argument).unwrap()
}

#[track_caller]
fn assert_at(problem: &Problem, line: usize, key: &str, remedy: &str) {
    assert_eq!(problem.file(), Some("bad.toml"), "{problem:#?}");
    assert_eq!(problem.line(), Some(line), "{problem:#?}");
    assert_eq!(problem.key(), key, "{problem:#?}");
    assert!(problem.remedy().contains(remedy), "{problem:#?}");
}

#[test]
fn every_shipped_scenario_loads_without_a_warning_and_has_a_graph() {
    for name in shipped::names() {
        let scenario = Scenario::load(name, &[]).unwrap();
        assert!(scenario.warnings().is_empty(), "{name}: {:?}", scenario.warnings());
        assert_eq!(scenario.settings().scenario.name, name);
        assert!(!scenario.settings().scenario.description.is_empty());
        let graph = scenario.graph().unwrap();
        let rig = matches!(name, "attitude-step" | "disturbance");
        assert_eq!(graph.node(Role::Position).is_none(), rig, "{name}");
    }
}

#[test]
fn every_shipped_scenario_builds_every_component() {
    for name in shipped::names() {
        let scenario = Scenario::load(name, &[]).unwrap();
        scenario.filter().unwrap();
        scenario.position_law().unwrap();
        plant::Plant::new(&scenario.plant_config().unwrap()).unwrap();
        let vehicle = scenario.modelled_vehicle();
        attitude_mpc::AttitudeLaw::new(scenario.attitude_law().unwrap(), &vehicle).unwrap();
    }
}

#[test]
fn the_effective_text_reads_back_to_itself_with_every_float_exact() {
    let odd: [f64; 4] = [0.1 + 0.2, 1.0 / 3.0, 5e-324, 123_456.789_012_345_67];
    let edits = [
        set(&format!("start.position_w_m=[{:?},{:?},{:?}]", odd[0], odd[1], odd[3])),
        set(&format!("start.yaw_deg={:?}", odd[2])),
        Override::seed(9_007_199_254_740_993),
        Override::rate("position-mpc=33.333").unwrap(),
    ];
    for name in shipped::names() {
        let first = Scenario::load(name, &edits[1..]).unwrap();
        let again = Scenario::from_text("scenario.toml", first.to_toml(), &[]).unwrap();
        assert_eq!(first.to_toml(), again.to_toml());
        assert_eq!(format!("{:?}", first.settings()), format!("{:?}", again.settings()));
        assert_eq!(again.settings().scenario.seed, 9_007_199_254_740_993);
        assert_eq!(again.settings().start.yaw_deg.to_bits(), odd[2].to_bits());
    }
    // The fourth number is out of range, which shows that the values arrived as written.
    assert!(overridden("hover", &edits[..1]).key().starts_with("start.position_w_m[2]"));
}

#[test]
fn an_unknown_key_is_refused_with_the_nearest_known_one() {
    let text = "[scenario]\nname = \"x\"\n[plant]\nstate_evry = 3\n";
    assert_at(&problem(text), 4, "plant.state_evry", "`state_every`");
    assert_at(&problem("[estimater]\n"), 1, "estimater", "`estimator`");
}

#[test]
fn a_key_with_another_unit_leads_to_the_right_one() {
    let text = "[pilot]\nkind = \"figure8\"\nperiod_ms = 8000\n";
    assert_at(&problem(text), 3, "pilot.period_ms", "`period_s`: the unit is part of the key");
    assert_at(&problem("[vehicle]\nmass_g = 120\n"), 2, "vehicle.mass_g", "`mass_kg`");
}

#[test]
fn a_string_where_a_number_belongs_is_refused() {
    let text = "[vehicle]\n\nmass_kg = \"0.12\"\n";
    assert_at(&problem(text), 3, "vehicle.mass_kg", "number without quotes");
    let text = "[plant]\nimu = { rate_hz = \"fast\" }\n";
    assert_at(&problem(text), 2, "plant.imu.rate_hz", "whole number");
}

#[test]
fn rates_that_are_negative_zero_nan_or_too_fine_are_refused() {
    for (rate, remedy) in [
        ("-100", "at least"),
        ("0", "at least"),
        ("20000", "at most"),
        ("nan", "finite"),
        ("inf", "finite"),
        ("150.12345", "three decimals"),
    ] {
        for section in ["attitude_mpc", "estimator", "plant"] {
            let text = format!("[{section}]\nrate_hz = {rate}\n");
            assert_at(&problem(&text), 2, &format!("{section}.rate_hz"), remedy);
        }
    }
}

#[test]
fn several_ranges_are_complained_about_at_once() {
    let error = refusal("[vehicle]\nmass_kg = -1\nrotor_lag_s = 2\n[plant]\nrate_hz = 0\n");
    let keys: Vec<_> = error.problems().map(Problem::key).collect();
    assert_eq!(keys, ["vehicle.mass_kg", "vehicle.rotor_lag_s", "plant.rate_hz"]);
    let lines: Vec<_> = error.problems().map(Problem::line).collect();
    assert_eq!(lines, [Some(2), Some(3), Some(5)]);
}

#[test]
fn bounds_the_wrong_way_round_are_refused() {
    let text = "[position_mpc]\nthrust_min_weights = 1.7\nthrust_max_weights = 0.3\n";
    assert_at(&problem(text), 2, "position_mpc.thrust_min_weights", "thrust_max_weights");
}

#[test]
fn an_angle_outside_the_linkage_is_refused_at_start_and_in_the_schedule() {
    for angle in ["44.9", "160.1", "-45"] {
        let text = format!("[start]\nmorph_angle_deg = {angle}\n");
        assert_at(&problem(&text), 2, "start.morph_angle_deg", "write a number of at");
        let text = format!("[pilot]\nkind = \"hover\"\nmorph = [[0.0, 45.0], [1.0, {angle}]]\n");
        assert_at(&problem(&text), 3, "pilot.morph", "from 45 to 160");
    }
}

#[test]
fn a_sweep_that_the_servo_cannot_follow_is_refused() {
    let text = "[pilot]\nkind = \"hover\"\nmorph = [\n[0.0, 45.0],\n[0.2, 160.0],\n]\n";
    assert_at(&problem(text), 5, "pilot.morph[1]", "more time");
}

#[test]
fn horizons_that_look_too_short_or_move_too_long_are_refused() {
    let text = "[attitude_mpc]\nrate_hz = 500\nprediction_horizon = 20\ncontrol_horizon = 3\n";
    assert_at(&problem(text), 3, "attitude_mpc.prediction_horizon", "0.075 s ahead");
    let paper = format!("{text}model = \"paper\"\n");
    assert!(Scenario::from_text("good.toml", &paper, &[]).is_ok());
    let text = "[attitude_mpc]\nprediction_horizon = 20\ncontrol_horizon = 21\n";
    assert_at(&problem(text), 3, "attitude_mpc.control_horizon", "<= prediction_horizon");
    let text = "[position_mpc]\nprediction_horizon = 5\ncontrol_horizon = 6\n";
    assert_at(&problem(text), 3, "position_mpc.control_horizon", "<= prediction_horizon");
}

#[test]
fn a_command_that_the_gate_lets_expire_is_refused() {
    let text = "[plant.gate]\nvalidity_max_s = 0.01\n[attitude_mpc]\nrate_hz = 100\n";
    assert_at(&problem(text), 4, "attitude_mpc.rate_hz", "200 Hz");
}

#[test]
fn a_loop_without_latency_is_refused_by_name() {
    let text = "[latency]\nattitude_setpoint_s = 0.0\napplied_setpoint_s = 0.0\n";
    let problem = problem(text);
    assert_at(&problem, 1, "latency", "latencies");
    assert!(problem.to_string().contains("position -> attitude"), "{problem}");
}

#[test]
fn complaints_reach_into_a_script_and_a_manoeuvre() {
    let event = "[[disturbance_injector.script]]\nkind = \"wind\"\n";
    let key = "disturbance_injector.script[0]";
    let text = format!("{event}mean_w_m_s = [1.0, 0.0]\n");
    assert_at(&problem(&text), 3, &format!("{key}.mean_w_m_s"), "three numbers");
    let text = format!("{event}mean_w_m_s = [1.0, 0.0, 0.0]\nsigma_m_s = [1.0, 99.0, 0.0]\n");
    assert_at(&problem(&text), 4, &format!("{key}.sigma_m_s[1]"), "at most 50");
    let text = "[[disturbance_injector.script]]\nkind = \"gust\"\n";
    assert_at(&problem(text), 2, &format!("{key}.kind"), "`wind`");
    assert_at(&problem("[pilot]\nkind = \"figure9\"\n"), 2, "pilot.kind", "`figure8`");
    let text = "[pilot]\nkind = \"figure8\"\nyaw = \"along\"\n";
    assert_at(&problem(text), 3, "pilot.yaw", "`along path`");
}

#[test]
fn a_nose_that_points_away_from_its_path_at_the_start_is_warned_of_with_the_heading() {
    let along = |yaw_deg: &str| {
        let text = format!(
            "[pilot]\nkind = \"figure8\"\nyaw = \"along_path\"\n[start]\nyaw_deg = {yaw_deg}\n"
        );
        Scenario::from_text("mine.toml", &text, &[]).expect("a scenario")
    };
    let away = along("-120.0");
    let warning = away.warnings().iter().find(|it| it.key() == "start.yaw_deg").expect("a warning");
    let (_, yaw_deg) = warning.remedy().split_once("start.yaw_deg = ").expect("a value");
    assert!(along(yaw_deg).warnings().is_empty(), "{:?}", along(yaw_deg).warnings());
}

#[test]
fn text_that_is_no_toml_is_refused_at_its_line() {
    assert_at(&problem("[plant]\nrate_hz 1000\n"), 2, "", "TOML");
    assert_at(&problem("[plant]\nrate_hz = 1\nrate_hz = 2\n"), 3, "", "once");
}

#[test]
fn a_missing_file_and_an_unknown_name_are_answered_with_what_there_is() {
    let missing = overridden("nowhere/flight.toml", &[]);
    assert_eq!(missing.key(), "nowhere/flight.toml");
    assert!(missing.remedy().contains("figure8-morph"));
    let unknown = overridden("figure8-mroph", &[]);
    assert!(unknown.remedy().starts_with("did you mean `figure8-morph`?"), "{unknown:?}");
}

#[test]
fn an_override_at_fault_is_named_with_its_flag() {
    let problem = overridden("hover", &[set("plant.rate_hz=-5")]);
    assert_eq!((problem.file(), problem.key()), (Some("command line"), "plant.rate_hz"));
    assert!(shown(&problem.into()).contains("--set plant.rate_hz=-5"));
    for (edit, key, flag) in [
        (set("plant.rate_khz=1"), "plant.rate_khz", "--set plant.rate_khz=1"),
        (set("vehicle.mass_g=120"), "vehicle.mass_g", "--set vehicle.mass_g=120"),
        (set("plant.imu.rate=1000"), "plant.imu.rate", "--set plant.imu.rate=1000"),
        (set("scenario.name.first=1"), "scenario.name.first", "--set scenario.name.first=1"),
        (set("scenario.clock=sundial"), "scenario.clock", "--set scenario.clock=sundial"),
        (Override::rate("plant=nan").unwrap(), "plant.rate_hz", "--rate plant=nan"),
        (Override::rate("plant=0").unwrap(), "plant.rate_hz", "--rate plant=0"),
        (Override::clock("fast"), "scenario.clock", "--clock fast"),
        (Override::speed("warp"), "scenario.speed", "--speed warp"),
        (Override::speed("-1"), "scenario.speed", "--speed -1"),
    ] {
        let problem = overridden("figure8-morph", &[edit]);
        assert_eq!((problem.file(), problem.key()), (Some("command line"), key));
        let shown = shown(&problem.into());
        assert!(shown.contains(flag) && shown.contains("help:"), "{shown}");
    }
}

#[test]
fn an_executable_as_the_first_controller_gets_how_it_takes_its_slot() {
    let refused = Override::controller("attitude=./my_controller.py").unwrap_err();
    let problem = refused.problems().next().unwrap();
    let (remedy, swap) = (problem.remedy(), "attitude=./my_controller.py@1s");
    assert!(remedy.contains("--swap ") && remedy.contains(swap), "{problem:?}");
    for other in ["atitude=./my_controller.py", "attitude=atitude-mpc", "position=attitude-mpc"] {
        let refused = Override::controller(other).unwrap_err();
        let problem = refused.problems().next().unwrap();
        assert!(problem.remedy().starts_with("write --controller SLOT=NAME"), "{problem:?}");
    }
}

#[test]
fn an_unknown_service_in_a_rate_is_refused_with_the_nearest_name() {
    let error = Override::rate("atitude-mpc=500").unwrap_err();
    let shown = shown(&error);
    assert!(shown.contains("--rate atitude-mpc=500"), "{shown}");
    assert!(shown.contains("did you mean `attitude-mpc`?"), "{shown}");
    for bad in ["plant", "plant=fast"] {
        assert!(Override::rate(bad).is_err(), "{bad}");
    }
    assert!(Override::set("plant.rate_hz").is_err());
}

#[test]
fn overrides_change_what_they_name_and_nothing_else() {
    let edits = [
        set("pilot.morph=[[0.0, 45.0], [2.0, 90.0]]"),
        set("disturbance_injector.script.0.mean_w_m_s=[0.5, 0.0, 0.0]"),
        set("scenario.clock=realtime"),
        set("vehicle.drag_n_s_m=0.06"),
        Override::rate("position=40").unwrap(),
    ];
    let scenario = Scenario::load("figure8-morph", &edits).unwrap();
    let settings = scenario.settings();
    assert_eq!(settings.pilot.common.morph, [[0.0, 45.0], [2.0, 90.0]]);
    assert_eq!(scenario.modelled_vehicle().drag_n_s_m.to_bits(), 0.06_f64.to_bits());
    assert_eq!(scenario.settings().scenario.pace(), Some(1.0));
    let graph = scenario.graph().unwrap();
    assert_eq!(graph.node(Role::Position).unwrap().rate, runtime::Rate::from_hz(40.0).unwrap());
    let before = Scenario::load("figure8-morph", &[]).unwrap();
    assert_eq!(settings.scenario.seed, before.settings().scenario.seed);
    let shown = format!("{:?}", settings.disturbance_injector.script[0]);
    assert!(shown.contains("[0.5, 0.0, 0.0]") && shown.contains("[0.7, 0.7, 0.35]"), "{shown}");
}

#[test]
fn too_much_wind_for_the_tilt_bound_is_a_warning() {
    let edit = set("disturbance_injector.script.0.mean_w_m_s=[5.0, 0.0, 0.0]");
    let scenario = Scenario::load("figure8-morph", &[edit]).unwrap();
    let [warning] = scenario.warnings() else { panic!("{:?}", scenario.warnings()) };
    assert_eq!(warning.key(), "disturbance_injector.script[0]");
}

#[test]
fn the_figure_flies_the_flight_controller_and_the_rig_can_fly_the_papers() {
    let edits = [
        set("attitude_mpc.model=\"paper\""),
        set("attitude_mpc.increment_weight=0.25"),
        set("attitude_mpc.setpoint_ramp_s=0"),
        set("latency.wrench_command_s=0"),
        set("plant.model=linear"),
    ];
    let rig = Scenario::load("attitude-step", &edits).unwrap();
    let prompt = attitude_mpc::AttitudeLawConfig {
        command_latency_s: 0.0,
        ..attitude_mpc::AttitudeLawConfig::paper()
    };
    assert_eq!(rig.attitude_law().unwrap(), prompt);
    assert_eq!(rig.plant_config().unwrap().model, plant::ModelKind::Linear);
    let flight = Scenario::load("figure8-morph", &[]).unwrap().attitude_law().unwrap();
    assert_eq!(flight, attitude_mpc::AttitudeLawConfig::flight(100.0));
}

#[test]
fn a_rotor_lag_beyond_the_horizon_is_blamed_where_it_was_set() {
    let text = "[attitude_mpc]\nrotor_lag_s = 0.1\n";
    assert_at(&problem(text), 2, "attitude_mpc.rotor_lag_s", "horizon_s = 0.500");
    let text = "[vehicle]\nrotor_lag_s = 0.1\n";
    assert_at(&problem(text), 2, "vehicle.rotor_lag_s", "horizon_s = 0.500");
    let text = "[attitude_mpc]\nrotor_lag_s = 0.1\nhorizon_s = 0.2\n";
    assert_at(&problem(text), 3, "attitude_mpc.horizon_s", "0.500 s ahead");
}

#[test]
fn more_rows_than_a_working_set_holds_are_refused_with_what_they_are_made_of() {
    let horizons = "prediction_horizon = 200\ncontrol_horizon = 50\n";
    let text = format!("[attitude_mpc]\n{horizons}angle_max_rad = 0.5\nrate_max_rad_s = 4.0\n");
    let sum = "6 prediction_horizon + 6 control_horizon below 1024";
    assert_at(&problem(&text), 5, "attitude_mpc.rate_max_rad_s", sum);
    for fits in ["angle_max_rad = 0.5\n", "rate_max_rad_s = 4.0\n"] {
        let text = format!("[attitude_mpc]\n{horizons}{fits}");
        Scenario::from_text("good.toml", &text, &[]).unwrap();
    }
}

#[test]
fn keys_that_change_nothing_are_warned_of_at_their_line() {
    let idle = [
        ("attitude_mpc", "state_penalty = 1.0", ""),
        ("attitude_mpc", "increment_penalty = 1.0", "increment_bound = false"),
        ("attitude_mpc", "morph_preview_s = 0.1", "morph_preview = false"),
        ("attitude_mpc", "morph_preview_s = 0.1", "fixed_morph_angle_deg = 45.0"),
        ("attitude_mpc", "morph_preview = true", "fixed_morph_angle_deg = 45.0"),
        ("attitude_mpc", "rebuild_tolerance_deg = 1.0", "fixed_morph_angle_deg = 45.0"),
        ("position_mpc", "state_penalty = 1.0", ""),
    ];
    for (section, line, beside) in idle {
        let text = format!("[{section}]\n{beside}\n{line}\n");
        let scenario = Scenario::from_text("bad.toml", &text, &[]).unwrap();
        let [warning] = scenario.warnings() else { panic!("{text}{:?}", scenario.warnings()) };
        let key = line.split(' ').next().unwrap();
        assert_at(warning, 3, &format!("{section}.{key}"), "drop");
    }
    let text = "[attitude_mpc]\nstate_penalty = 1.0\nangle_max_rad = 0.5\nlaguerre_pole = [0.5, 0.5, 0.5]\n";
    assert!(Scenario::from_text("good.toml", text, &[]).unwrap().warnings().is_empty());
    for (line, key) in [
        ("output_weight = [1.0, 0.0, 1.0]", "attitude_mpc.output_weight[1]"),
        ("level_penalty = 10.0", "attitude_mpc.level_penalty"),
    ] {
        let text = format!("[attitude_mpc]\n{line}\n");
        let scenario = Scenario::from_text("bad.toml", &text, &[]).unwrap();
        let [warning] = scenario.warnings() else { panic!("{text}{:?}", scenario.warnings()) };
        assert_eq!((warning.line(), warning.key()), (Some(2), key));
    }
    let rig = Scenario::load("attitude-step", &[set("position_mpc.tilt_weight=1.0")]).unwrap();
    assert_eq!(rig.warnings().len(), 1);
    assert_eq!(rig.warnings()[0].key(), "position_mpc");
}

#[test]
fn a_key_of_before_is_known_by_its_name_of_today_and_no_other_is() {
    let known = [
        ("crew", Some("controller")),
        ("watch.enabled", Some("monitor.enabled")),
        ("realtime.watch.priority", Some("realtime.monitor.priority")),
        ("watching", None),
        ("monitor.enabled", None),
    ];
    for (old, new) in known {
        assert_eq!(super::renamed(old).as_deref(), new, "{old}");
    }
}

#[test]
fn a_section_under_the_name_of_before_is_read_with_a_warning() {
    let text = "[scenario]\n[watch]\ntilt_rad = 0.9\n[realtime.watch]\npriority = 7\n";
    let scenario = Scenario::from_text("old.toml", text, &[set("watch.enabled=false")]).unwrap();
    let Settings { monitor, realtime, .. } = scenario.settings();
    assert_eq!((monitor.tilt_rad, monitor.enabled), (0.9, false));
    assert_eq!(realtime.monitor.priority, Some(7));
    let places: Vec<_> = scenario.warnings().iter().map(|w| (w.key(), w.line())).collect();
    assert_eq!(places, [("watch", Some(2)), ("realtime.watch", Some(4)), ("watch", Some(1))]);
    assert_eq!(scenario.warnings()[1].remedy(), "write `realtime.monitor`");
    let again = Scenario::from_text("new.toml", scenario.to_toml(), &[]).unwrap();
    assert!(again.warnings().is_empty() && !again.to_toml().contains("watch"));
    let crew = set("crew.attitude=attitude-lqr");
    let scenario =
        Scenario::from_text("old.toml", "[crew]\nposition = \"position-pid\"\n", &[crew]).unwrap();
    let places: Vec<_> = scenario.warnings().iter().map(|w| (w.key(), w.file())).collect();
    assert_eq!(places, [("crew", Some("old.toml")), ("crew", Some("command line"))]);
    let assignment = services::Assignment::of(scenario.settings());
    let flies = [Role::Attitude, Role::Position].map(|role| assignment.name(role));
    assert_eq!(flies, ["attitude-lqr", "position-pid"]);
    let whole =
        Scenario::from_text("new.toml", "", &[set("realtime={watch={priority=7}}")]).unwrap();
    assert_eq!(whole.settings().realtime.monitor.priority, Some(7));
    for (both, key) in [
        ("[watch]\ntilt_rad = 0.9\n[monitor]\ntilt_rad = 0.8\n", "watch"),
        ("[realtime.monitor]\n[realtime.watch]\n", "realtime.watch"),
        ("[controller]\n[crew]\n", "crew"),
    ] {
        let problem = problem(both);
        assert_eq!((problem.key(), problem.remedy()), (key, "keep one of the two"));
    }
}

#[test]
fn the_rig_flies_at_every_rate_and_size_without_a_warning() {
    for rate in [50, 75, 100, 150, 200, 333, 500, 1000] {
        for angle in [45.0, 94.5, 160.0] {
            let edits = [
                Override::rate(&format!("attitude-mpc={rate}")).unwrap(),
                set(&format!("start.morph_angle_deg={angle}")),
            ];
            let scenario = Scenario::load("attitude-step", &edits).unwrap();
            assert!(scenario.warnings().is_empty(), "{rate} Hz: {:?}", scenario.warnings());
        }
    }
}

#[test]
fn a_figure_cut_short_flies_on_to_the_end() {
    let edit = Override::duration(core::time::Duration::from_millis(500));
    assert_eq!(Scenario::load("figure8-morph", &[edit]).unwrap().duration_ns(), 500_000_000);
}

fn shown(error: &ScenarioError) -> String {
    let mut text = String::new();
    let handler = GraphicalReportHandler::new_themed(GraphicalTheme::unicode_nocolor());
    handler.render_report(&mut text, error).unwrap();
    text
}

#[test]
fn a_report_shows_file_line_caret_key_and_remedy() {
    let text = shown(&refusal("[vehicle]\nmass_kg = \"heavy\"\n"));
    for part in ["bad.toml:2:11", "vehicle.mass_kg", "mass_kg = \"heavy\"", "help:", "quotes"] {
        assert!(text.contains(part), "`{part}` in\n{text}");
    }
}

#[test]
fn an_unproven_owner_is_held_to_the_laws_of_its_slot_unless_those_may_ask_for_more() {
    let range = |edits: &[&str]| {
        let edits: Vec<_> = edits.iter().map(|edit| Override::set(edit).unwrap()).collect();
        let scenario = Scenario::load("hover", &edits).unwrap();
        scenario.plant_config().unwrap().unproven.map(|range| range.thrust_n)
    };
    let weight_n = Scenario::load("hover", &[]).unwrap().modelled_vehicle().weight_n();
    let [least_n, most_n] = range(&[]).unwrap();
    assert!((least_n / weight_n - 0.2).abs() < 1e-12 && (most_n / weight_n - 2.1).abs() < 1e-12);
    // The vehicle's real mass is not known on board.
    assert_eq!(range(&["plant.mismatch.mass_scale=1.2"]), range(&[]));
    assert_eq!(range(&["monitor.enabled=false"]), None);
    assert_eq!(range(&["attitude_mpc.torque_bound=\"rotor-thrusts\""]), None);
}

#[test]
fn a_vehicle_that_its_rotors_or_its_bounds_cannot_carry_is_found_before_it_flies() {
    let weak = "[vehicle]\nrotor_thrust_max_n = 0.3\n";
    assert_at(&problem(weak), 2, "vehicle.rotor_thrust_max_n", "0.309 N or more");
    let heavy = Scenario::from_text("heavy.toml", "[plant.mismatch]\nmass_scale = 1.75\n", &[]);
    let warnings = format!("{:?}", heavy.unwrap().warnings());
    assert!(warnings.contains("2.06 N") && warnings.contains("2.00 N"), "{warnings}");
}

#[test]
fn a_look_beyond_the_known_reference_is_reported_with_a_spacing_that_suffices() {
    let far = "[position_mpc]\nprediction_horizon = 200\n";
    let far = Scenario::from_text("far.toml", far, &[]).unwrap();
    let warnings = format!("{:?}", far.warnings());
    assert!(warnings.contains("2.33 s") && warnings.contains("write 0.087 or more"), "{warnings}");
}
