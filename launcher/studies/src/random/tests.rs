use super::*;
use position_mpc::PositionLawConfig;
use vehicle::VehicleParameters;

fn plan(seeds: Vec<u64>, flags: &[&str]) -> Plan {
    let overrides = flags.iter().map(|flag| Override::set(flag).unwrap()).collect();
    let flags: Vec<String> = flags.iter().map(|flag| format!("--set {flag}")).collect();
    Plan { seeds, overrides, flags: flags.join(" ") }
}

#[test]
fn a_seed_draws_within_the_ranges_and_the_same_again() {
    let draws: Vec<Draw> = (0..2_000).map(Draw::of).collect();
    for (place, Range { name, least, most }) in RANGES.into_iter().enumerate() {
        let drawn = || draws.iter().map(|draw| draw.values[place]);
        assert!(drawn().all(|value| (least..=most).contains(&value)), "{name}");
        // Evenly: the mean of 2,000 is within four of its standard deviations.
        let mean = drawn().sum::<f64>() / 2e3;
        let deviation = (most - least) / (12.0 * 2e3_f64).sqrt();
        assert!((mean - 0.5 * (least + most)).abs() < 4.0 * deviation, "{name}: {mean}");
    }
    assert!((1..=4).all(|rotor| draws.iter().filter(|draw| draw.rotor == rotor).count() > 400));
    assert_eq!(Draw::of(7), draws[7]);
}

#[test]
fn what_no_law_could_hold_still_is_left_out_with_the_bound_that_it_breaks() {
    let (bounds, model) = (PositionLawConfig::default(), VehicleParameters::default());
    // Mass over the model's, wind, thrust of the weak rotor.
    let of = |mass: f64, wind: f64, efficiency: f64| {
        let mut draw = Draw::of(1);
        (draw.values[2], draw.values[3], draw.values[6]) = (mass, wind, efficiency);
        draw.without_trim(&bounds, &model).unwrap_or_default()
    };
    assert_eq!(of(1.0, 0.0, 1.0), "");
    assert_eq!(of(1.45, 4.0, 0.7), "");
    // tan 0.35 of the weight is a wind of 6.9 m/s at the lightest.
    assert!(of(0.8, 7.0, 1.0).contains("a tilt of 0.35"), "{}", of(0.8, 7.0, 1.0));
    // (1 + (1/e - 1)/4) of 1.45 weights.
    assert!(of(1.45, 0.0, 0.5).contains("a thrust of 2.13 N, bound 2.00 N"));
    // (1/e - 1)/4 of the thrust over half of it.
    assert!(of(1.0, 0.0, 0.35).contains("93 % of a torque bound"), "{}", of(1.0, 0.0, 0.35));
    let left_out =
        (1..=10_000).filter(|seed| Draw::of(*seed).without_trim(&bounds, &model).is_some());
    assert!((1..=200).contains(&left_out.count()), "one in fifty at most");
}

#[test]
fn a_draw_is_a_scenario_that_its_models_do_not_know() {
    let draw = Draw::of(3);
    let given = [Override::set("pilot.period_s=6").unwrap()];
    let base = Scenario::load(SCENARIO, &given).unwrap();
    let flown = draw.scenario(&given, &draw.flags(&base)).unwrap();
    let [lag_s, inertia, mass, ..] = draw.values;
    let (real, believed) = (flown.real_vehicle(), flown.modelled_vehicle());
    assert_eq!(believed, base.modelled_vehicle());
    assert!((real.rotor_lag_s - lag_s).abs() < 1e-15);
    assert!((real.mass_kg - mass * believed.mass_kg).abs() < 1e-15);
    assert!((real.inertia_scale - inertia).abs() < 1e-15);
    assert_eq!(flown.settings().scenario.seed, 3);
    let configured_s = |of: &Scenario| of.attitude_law().unwrap().command_delay_s;
    assert!((configured_s(&flown) - configured_s(&base)).abs() < 1e-15);
    assert!(flown.settings().latency.wrench_command_s > configured_s(&flown));
}

#[test]
fn the_family_is_flown_the_same_twice_and_its_numbers_add_up() {
    let plan = plan(vec![1, 2, 3], &["scenario.duration_s=6.0"]);
    let flown_count = std::sync::atomic::AtomicUsize::new(0);
    let count = || {
        flown_count.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
    };
    let study = fly(&plan, &count).unwrap();
    assert_eq!(flown_count.into_inner(), plan.flights());
    assert_eq!(study.flights.len() + study.left_out.len(), 3);
    assert_eq!(study.flights, fly(&plan, &|| ()).unwrap().flights);
    assert!(study.flights.iter().all(|flown| flown.max_m > flown.rms_m && flown.rms_m > 0.0));
    assert!(study.quantile_m(0.5) <= study.quantile_m(1.0));
    assert_eq!(study.beyond(study.quantile_m(1.0)), 0);
    let worst = report::worst(&study);
    let most_mm = format!(" {:.1} mm: ", study.quantile_m(1.0) * 1e3);
    let given = "--set scenario.duration_s=6.0 --set 'plant.mismatch.rotor_lag_s=";
    assert!(worst[0].contains(&most_mm) && worst[0].contains(given), "{worst:?}");
}

#[test]
fn the_page_has_the_ranges_that_are_drawn_from() {
    let page = include_str!("../../../docs/random-flights.md");
    let row = |range: &Range| {
        let end = |value: f64| ((value * 1e3).round() / 1e3).to_string();
        format!("| {} | {} | {} |\n", range.name, end(range.least), end(range.most))
    };
    let rows: String = RANGES.iter().map(row).collect();
    assert!(page.contains(&rows), "{rows}");
}
