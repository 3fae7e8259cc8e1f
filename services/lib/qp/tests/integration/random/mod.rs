//! Random strictly convex programs whose answer is known by construction.
//!
//! `MORPHQUAD_PROGRAMS=100000 cargo test --release -p qp random` solves 100 000 of them,
//! from the seed `MORPHQUAD_FIRST_PROGRAM` on (0 if not set).
//! A failure names its seed; `MORPHQUAD_PROGRAM=<seed>` solves that one and prints it.

mod judge;
mod kinds;

use kinds::{Case, Truth};
use nalgebra::DVector;
use qp::{ActiveSet, QpOutcome, QpSolver, QpStatus};
use rand::RngExt;

fn number(variable: &str) -> Option<u64> {
    std::env::var(variable).ok()?.parse().ok()
}

fn solver(case: &Case) -> ActiveSet {
    let mut solver = case.problem.active_set().expect("every case is strictly convex");
    solver.set_compliance(&case.compliance).expect("compliances are positive");
    solver
}

fn solve(case: &Case, solver: &mut ActiveSet, f: &DVector<f64>) -> QpOutcome {
    solver.solve(f, &case.problem.lower, &case.problem.upper)
}

/// Solves a case cold, from a random working set, and from the set of a neighbour.
fn faults(seed: u64, case: &Case) -> Vec<String> {
    let mut random = crate::support::generator(!seed);
    let mut solver = solver(case);
    let f = &case.problem.f;
    let mut found = Vec::new();
    let mut judge = |start: &str, solver: &ActiveSet, outcome| {
        if let Some(fault) = judge::fault(case, solver, outcome) {
            let (kind, n, m) = (case.kind, case.problem.n(), case.problem.m());
            found.push(format!("seed {seed}, {kind}, n = {n}, m = {m}, {start}: {fault}"));
        }
    };
    let outcome = solve(case, &mut solver, f);
    judge("cold", &solver, outcome);
    let cold = solver.solution().clone();
    let set: Vec<i8> = (0..case.problem.m()).map(|_| random.random_range(-1..2_i8)).collect();
    solver.set_working_set(&set).expect("it has the length and the sides");
    let outcome = solve(case, &mut solver, f);
    judge("random start", &solver, outcome);
    let step = crate::support::vector(&mut random, case.problem.n()) * 0.1;
    let neighbour = f.component_mul(&(step.add_scalar(1.0)));
    solve(case, &mut solver, &neighbour);
    let outcome = solve(case, &mut solver, f);
    judge("warm", &solver, outcome);
    // Where rows are almost parallel, equally good answers may be apart.
    let comparable = !matches!(case.truth, Truth::Feasible) || case.kind.starts_with("tied");
    if outcome.status == QpStatus::Solved && comparable {
        let apart = judge::energy(case, &(solver.solution() - &cold)) / judge::size(case, &cold);
        if apart > 1e-6 {
            found.push(format!("seed {seed}, {}: warm and cold {apart:.1e} apart", case.kind));
        }
    }
    found
}

#[test]
fn programs_of_known_answer_are_answered_right_and_contradictions_are_found() {
    if let Some(seed) = number("MORPHQUAD_PROGRAM") {
        let case = kinds::case(seed);
        println!("{case:#?}");
        assert_eq!(faults(seed, &case), Vec::<String>::new());
        return;
    }
    let count = number("MORPHQUAD_PROGRAMS").unwrap_or(5000);
    let mut tally = std::collections::BTreeMap::new();
    let mut found = Vec::new();
    let first = number("MORPHQUAD_FIRST_PROGRAM").unwrap_or(0);
    for seed in first..first + count {
        let case = kinds::case(seed);
        let faults = faults(seed, &case);
        let entry: &mut (u64, u64) = tally.entry(case.kind).or_default();
        entry.0 += 1;
        entry.1 += u64::from(!faults.is_empty());
        found.extend(faults);
    }
    for (kind, (solved, failed)) in &tally {
        println!("{kind}: {solved} programs, {failed} failed");
    }
    found.truncate(40);
    assert!(found.is_empty(), "{}", found.join("\n"));
}
