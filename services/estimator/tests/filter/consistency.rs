//! The covariance matches the true errors: NEES and NIS over seeded Monte-Carlo runs.

use statrs::distribution::{ChiSquared, ContinuousCDF};

use super::world::{Instant, STEPS_PER_FIX, Script, Truth, error, figure_eight, fly, hover, nees};

const RUNS: usize = 100;
/// NEES is looked at every 50 ms, NIS at each fix.
const STEPS_PER_LOOK: usize = 50;

/// Means over the runs, per look: NEES of all states and of each block; NIS per arriving fix.
pub(crate) struct Means {
    pub(crate) nees: Vec<[f64; 6]>,
    pub(crate) nis: Vec<f64>,
}

/// Flies all runs, shows every instant of each and returns the means.
pub(crate) fn means(
    truth: &[Truth],
    runs: usize,
    script: impl Fn(usize) -> Script,
    mut see: impl FnMut(usize, &Instant),
) -> Means {
    let mut nees_sum = vec![[0.0; 6]; truth.len() / STEPS_PER_LOOK + 1];
    let mut nis_sum = vec![0.0; truth.len() / STEPS_PER_FIX + 1];
    for seed in 0..runs {
        fly(truth, &script(seed), |instant| {
            see(seed, instant);
            if instant.step % STEPS_PER_LOOK == 0 {
                let sums = &mut nees_sum[instant.step / STEPS_PER_LOOK];
                sums.iter_mut().zip(nees(instant)).for_each(|(sum, new)| *sum += new);
            }
            if instant.fixed {
                nis_sum[instant.step / STEPS_PER_FIX] += instant.filter.estimate().nis;
            }
        });
    }
    let runs = runs as f64;
    nees_sum.iter_mut().flatten().chain(&mut nis_sum).for_each(|sum| *sum /= runs);
    Means { nees: nees_sum, nis: nis_sum }
}

/// Share of the means inside the two-sided 95 % bounds of a mean of `runs` χ²(freedom).
pub(crate) fn share_inside(means: &[f64], freedom: f64, runs: usize) -> f64 {
    let sum = ChiSquared::new(freedom * runs as f64).expect("freedom is positive");
    let (low, high) = (sum.inverse_cdf(0.025) / runs as f64, sum.inverse_cdf(0.975) / runs as f64);
    let inside = means.iter().filter(|mean| (low..=high).contains(*mean)).count();
    inside as f64 / means.len() as f64
}

/// NEES of all states and each block, and NIS, from the first to before the second second.
pub(crate) fn assert_consistent(means: &Means, from_s: usize, to_s: usize, runs: usize) {
    let looks = &means.nees[from_s * 1000 / STEPS_PER_LOOK..to_s * 1000 / STEPS_PER_LOOK];
    let names = ["all", "position", "velocity", "attitude", "gyro bias", "accelerometer bias"];
    for (i, name) in names.iter().enumerate() {
        let series: Vec<f64> = looks.iter().map(|nees| nees[i]).collect();
        let share = share_inside(&series, if i == 0 { 15.0 } else { 3.0 }, runs);
        let mean = series.iter().sum::<f64>() / series.len() as f64;
        println!("{from_s}-{to_s} s, NEES {name}: mean {mean:.3}, {:.1} % inside", share * 100.0);
        // A block's error lasts for up to 2.5 s: a window holds few independent looks at one block.
        let wanted = if i == 0 { 0.9 } else { 0.8 };
        assert!(share >= wanted, "NEES of {name}: {share}, mean {mean}");
    }
    // The first fix arrives one latency after the start.
    let nis = &means.nis[(from_s * 1000 / STEPS_PER_FIX).max(1)..to_s * 1000 / STEPS_PER_FIX];
    let share = share_inside(nis, 6.0, runs);
    println!("{from_s}-{to_s} s, NIS: {:.1} % inside", share * 100.0);
    assert!(share >= 0.9, "NIS: {share}");
}

#[test]
fn nees_and_nis_stay_inside_their_bounds_in_nominal_flight() {
    let mut alarms = 0;
    let means = means(&figure_eight(20), RUNS, Script::nominal, |_, instant| {
        if instant.step == 20_000 {
            alarms += instant.filter.estimate().counters.nis_alarms;
        }
    });
    assert_consistent(&means, 0, 20, RUNS);
    // 2e5 overlapping windows at two in a million: less than one false alarm is expected.
    assert!(alarms <= 2, "{alarms} false alarms");
}

#[test]
fn a_slower_imu_keeps_the_filter_consistent() {
    // 200 Hz costs a fifth per run, so more of them bound the means more tightly.
    const RUNS: usize = 300;
    let script = |seed| Script { steps_per_imu: 5, ..Script::nominal(5000 + seed) };
    let means = means(&figure_eight(10), RUNS, script, |_, _| {});
    assert_consistent(&means, 0, 10, RUNS);
}

#[test]
fn nees_and_nis_are_inside_their_bounds_again_one_second_after_a_drop_out() {
    let truth = figure_eight(20);
    let script = |seed| Script { drop_out: (8000, 10_000), ..Script::nominal(1000 + seed) };
    let means = means(&truth, RUNS, script, |_, _| {});
    assert_consistent(&means, 0, 8, RUNS);
    assert_consistent(&means, 11, 20, RUNS);
}

#[test]
fn the_estimate_in_hover_is_as_sharp_as_the_controllers_need() {
    let mut squares = [0.0; 4];
    let mut looks = 0.0;
    let truth = hover(10);
    for seed in 0..10 {
        fly(&truth, &Script::nominal(2000 + seed), |instant| {
            if instant.step > 3000 && instant.step % STEPS_PER_LOOK == 7 {
                let error = error(instant);
                let rate = instant.filter.estimate().body_rate_b - instant.truth.omega;
                squares[0] += error.fixed_rows::<3>(0).norm_squared() / 3.0;
                squares[1] += error.fixed_rows::<3>(3).norm_squared() / 3.0;
                squares[2] += error.fixed_rows::<3>(6).norm_squared() / 3.0;
                squares[3] += rate.norm_squared() / 3.0;
                looks += 1.0;
            }
        });
    }
    let limits = [4e-3, 15e-3, 2e-3, 15e-3];
    for ((square, limit), name) in
        squares.iter().zip(limits).zip(["position", "velocity", "attitude", "rate"])
    {
        let rms = f64::sqrt(square / looks);
        println!("hover {name}: 1 sigma {rms:.2e}, aim {limit:.2e}");
        assert!(rms <= limit, "{name}: {rms}");
    }
}
