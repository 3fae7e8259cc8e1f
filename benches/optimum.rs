//! How near its path the vehicle could fly at most: the figure eight of `figure8-morph` in calm air, in ever shorter periods
//! and under several tilt bounds, flown by the position controllers, beside the non-causal optimum.
//!
//! The optimum knows the whole path and the vehicle exactly. For each horizontal axis it minimises Σ (y − r)² over the
//! flight, with y'' = g a − (c/m) y', T a' + a = v and |v| <= tan(bound), where v is the tangent of the tilt that is asked
//! for, T the lag of the attitude loop and c the drag; sampled exactly at 100 Hz and solved by clarabel, an interior-point
//! method. It has no bound on the rate of the tilt, no noise and no delay, and the height never binds, so that no
//! controller can be nearer for long.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus, ZeroConeT,
};
use figures::results::Table;
use mpc::LaggedAxis;
use observe::{Metrics, Tracking};
use scenario::{Override, Scenario};
use simulate::in_process::{StateSource, fly};
use std::error::Error;
use std::io::Write as _;

const SCENARIO: &str = "figure8-morph";
const PERIODS_S: [f64; 7] = [8.0, 6.0, 5.0, 4.5, 4.25, 4.0, 3.5];
const TILT_BOUNDS_RAD: [f64; 3] = [0.25, 0.35, 0.45];
const CONTROLLERS: [&str; 2] = ["position-mpc", "position-pid"];
/// Time between two samples of the optimum.
const SAMPLE_NS: u64 = 10_000_000;
/// y, y' and a at k+1, and v at k.
const PER_SAMPLE: usize = 4;

/// One axis over one sample: rows of y, y' and a, columns by the same and v.
fn axis(scenario: &Scenario) -> Result<[[f64; 4]; 3], Box<dyn Error>> {
    let vehicle = scenario.real_vehicle();
    let axis = LaggedAxis {
        gain: vehicle.gravity_m_s2,
        lag_s: scenario.position_law()?.tilt_lag_s,
        delay_s: 0.0,
        drag_per_s: vehicle.drag_n_s_m / vehicle.mass_kg,
    };
    let columns: [[f64; 4]; 4] = core::array::from_fn(|column| {
        let unit = core::array::from_fn(|row| f64::from(row == column && row < 3));
        axis.advance(unit, f64::from(column == 3), SAMPLE_NS as f64 * 1e-9)
    });
    Ok(core::array::from_fn(|row| columns.map(|column| column[row])))
}

/// Errors y − r of the optimum at each sample \[m\], from rest at the first point of `path_m`.
fn optimum(axis: &[[f64; 4]; 3], path_m: &[f64], bound: f64) -> Result<Vec<f64>, Box<dyn Error>> {
    let samples = path_m.len() - 1;
    let start_m = path_m[0];
    let unknowns = PER_SAMPLE * samples;
    let wanted = |k: usize| path_m[k + 1] - start_m;
    let is_y = |i: usize| i.is_multiple_of(PER_SAMPLE);
    let weight = |i: usize| if is_y(i) { 1.0 } else { 0.0 };
    let ys: Vec<usize> = (0..unknowns).filter(|i| is_y(*i)).collect();
    let cost = CscMatrix::new_from_triplets(unknowns, unknowns, ys.clone(), ys, vec![1.0; samples]);
    let slope: Vec<f64> = (0..unknowns).map(|i| -weight(i) * wanted(i / PER_SAMPLE)).collect();
    // x(k+1) − Φ x(k) − Γ v(k) = 0, then v <= bound and −v <= bound.
    let (mut rows, mut columns, mut values) = (vec![], vec![], vec![]);
    let mut entry = |row: usize, column: usize, value: f64| {
        rows.push(row);
        columns.push(column);
        values.push(value);
    };
    for k in 0..samples {
        for (i, by) in axis.iter().enumerate() {
            let row = 3 * k + i;
            entry(row, PER_SAMPLE * k + i, 1.0);
            entry(row, PER_SAMPLE * k + 3, -by[3]);
            for (j, by) in by[..3].iter().enumerate().filter(|_| k > 0) {
                entry(row, PER_SAMPLE * (k - 1) + j, -by);
            }
        }
        entry(3 * samples + 2 * k, PER_SAMPLE * k + 3, 1.0);
        entry(3 * samples + 2 * k + 1, PER_SAMPLE * k + 3, -1.0);
    }
    let constraints = CscMatrix::new_from_triplets(5 * samples, unknowns, rows, columns, values);
    let bounds: Vec<f64> =
        (0..5 * samples).map(|row| if row < 3 * samples { 0.0 } else { bound }).collect();
    let cones = [ZeroConeT(3 * samples), NonnegativeConeT(2 * samples)];
    let settings = DefaultSettings { verbose: false, ..DefaultSettings::default() };
    let mut solver = DefaultSolver::new(&cost, &slope, &constraints, &bounds, &cones, settings)?;
    solver.solve();
    if !matches!(solver.solution.status, SolverStatus::Solved) {
        return Err(format!("the optimum ended with {:?}", solver.solution.status).into());
    }
    Ok((0..samples).map(|k| solver.solution.x[PER_SAMPLE * k] - wanted(k)).collect())
}

/// RMS and largest error of the optimum of both axes \[m\].
fn best(scenario: &Scenario, bound_rad: f64) -> Result<[f64; 2], Box<dyn Error>> {
    let trajectory = scenario.trajectory().ok_or("the scenario has no path")?;
    let instants = 0..=scenario.duration_ns() / SAMPLE_NS;
    let path: Vec<[f64; 3]> = instants.map(|k| trajectory.at(k * SAMPLE_NS).position_w_m).collect();
    let sampled = axis(scenario)?;
    let mut squares = vec![0.0; path.len() - 1];
    for i in 0..2 {
        let along: Vec<f64> = path.iter().map(|point| point[i]).collect();
        let errors = optimum(&sampled, &along, libm::tan(bound_rad))?;
        squares.iter_mut().zip(errors).for_each(|(sum, error)| *sum += error * error);
    }
    let most = squares.iter().fold(0.0_f64, |most, square| most.max(*square));
    Ok([(squares.iter().sum::<f64>() / squares.len() as f64).sqrt(), most.sqrt()])
}

fn flown(scenario: &Scenario) -> Result<Tracking, Box<dyn Error>> {
    let mut metrics = fly(scenario, StateSource::Estimator, Metrics::of(scenario))?;
    metrics.finish();
    Ok(metrics.tracking())
}

fn main() -> Result<(), Box<dyn Error>> {
    let columns = ["tilt bound [rad]", "period [s]", "optimum rms, max [mm]"].map(str::to_owned);
    let controllers = CONTROLLERS.map(|name| format!("{name} rms, max [mm]"));
    let last = "position-mpc over 1.25 optimum + 4 mm".to_owned();
    let mut table = Table::new(columns.into_iter().chain(controllers).chain([last]));
    let pair = |[rms_m, max_m]: [f64; 2]| format!("{:.1}, {:.1}", rms_m * 1e3, max_m * 1e3);
    for bound_rad in TILT_BOUNDS_RAD {
        for period_s in PERIODS_S {
            let by = |name: &str| -> Result<Scenario, Box<dyn Error>> {
                let flags = [
                    format!("pilot.period_s={period_s:?}"),
                    "disturbance_injector.script=[]".to_owned(),
                    format!("position_mpc.tilt_max_rad={bound_rad:?}"),
                    format!("position_pid.tilt_max_rad={bound_rad:?}"),
                ];
                let assigned = Override::controller(&format!("position={name}"))?;
                let set: Result<Vec<_>, _> = flags.iter().map(|flag| Override::set(flag)).collect();
                Ok(Scenario::load(SCENARIO, &[set?, vec![assigned]].concat())?)
            };
            let least = best(&by(CONTROLLERS[0])?, bound_rad)?;
            let mut cells = vec![bound_rad.to_string(), period_s.to_string(), pair(least)];
            let mut ratio = f64::NAN;
            for name in CONTROLLERS {
                let Tracking { rms_m, max_m, .. } = flown(&by(name)?)?;
                if name == CONTROLLERS[0] {
                    ratio = rms_m / (1.25 * least[0] + 4e-3);
                }
                cells.push(pair([rms_m, max_m]));
            }
            cells.push(format!("{ratio:.2}"));
            table.push(cells);
        }
    }
    write!(std::io::stdout(), "{table}")?;
    Ok(())
}
