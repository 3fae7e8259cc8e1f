//! Every program of the recorded closed loops against its exact solution, and the reader of them.

use crate::sequences::{Sequence, parse, read};
use nalgebra::DVector;
use qp::{ActiveSet, QpSolver, QpStatus, Settings, kkt_residuals};
use std::path::{Path, PathBuf};

const FILES: [&str; 3] = ["attA.bin", "lpv.bin", "pos.bin"];
/// Of the rate bound.
const FIRST_MOVE: f64 = 1e-6;
const RESIDUAL: f64 = 1e-9;

fn path(file: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/sequences").join(file)
}

fn all() -> Vec<Sequence> {
    FILES.iter().flat_map(|file| read(&path(file)).expect("it belongs to the project")).collect()
}

/// Flies a sequence; `start` prepares the solver for each tick.
fn fly(sequence: &Sequence, start: fn(&mut ActiveSet)) -> Vec<DVector<f64>> {
    let kept = sequence.bounded();
    let rows = sequence.stacked(&kept);
    let mut solver = ActiveSet::new(sequence.n(), kept.len(), Settings::default()).expect("n > 0");
    let mut answers = Vec::new();
    for (k, tick) in sequence.ticks.iter().enumerate() {
        let hessian = &sequence.constants(k).hessian;
        if k == 0 || sequence.varying {
            solver.set_matrices(hessian, &rows).expect("a solved one");
        }
        start(&mut solver);
        let (lower, upper) = sequence.bounds(k, &kept);
        let outcome = solver.solve(&tick.f, &lower, &upper);
        let (x, multipliers) = (solver.solution(), solver.multipliers());
        let case = format!("{} tick {k}", sequence.name);
        assert_eq!(outcome.status, QpStatus::Solved, "{case}");
        let error = sequence.first_move_error(k, x);
        assert!(error <= FIRST_MOVE, "{case}: first move off by {error:e} rate bounds");
        let residual = kkt_residuals(hessian, &rows, &tick.f, &lower, &upper, x, multipliers);
        assert!(residual.worst() <= RESIDUAL, "{case}: {residual:?}");
        answers.push(x.clone());
    }
    answers
}

#[test]
fn the_recorded_solutions_are_solutions() {
    for sequence in all() {
        let kept = sequence.bounded();
        let rows = sequence.stacked(&kept);
        for (k, tick) in sequence.ticks.iter().enumerate() {
            let (lower, upper) = sequence.bounds(k, &kept);
            let gradient = &sequence.constants(k).hessian * &tick.x + &tick.f;
            let values = &rows * &tick.x;
            let (room, slack) = (1e-9 * tick.f.amax().max(1e-3), 1e-12);
            // A step along the gradient that every held row allows would lower the cost.
            let held: Vec<usize> = (0..kept.len()).filter(|&i| tick.sides[kept[i]] != 0).collect();
            let normals = rows.select_rows(&held).transpose();
            let rest = if held.is_empty() {
                gradient.clone()
            } else {
                let q = normals.qr().q();
                &gradient - &q * q.tr_mul(&gradient)
            };
            assert!(rest.amax() <= room, "{} tick {k}: {:e}", sequence.name, rest.amax());
            for i in 0..kept.len() {
                let inside = lower[i] - slack <= values[i] && values[i] <= upper[i] + slack;
                assert!(inside, "{} tick {k}, row {i}", sequence.name);
            }
        }
    }
}

#[test]
fn every_recorded_program_is_solved_to_its_exact_first_move_warm_and_cold() {
    for sequence in all() {
        let warm = fly(&sequence, |_| {});
        let cold = fly(&sequence, QpSolver::clear);
        for (k, (warm, cold)) in warm.iter().zip(&cold).enumerate() {
            // The cost is flat along some moves: solutions agree to rounding times condition.
            let apart = (warm - cold).amax();
            assert!(apart <= 1e-6, "{} tick {k}: warm and cold {apart:e} apart", sequence.name);
        }
    }
}

/// A file of one run with one tick, n = 3 without rows.
fn small() -> Vec<u8> {
    let mut bytes = b"MQPS".to_vec();
    let mut push = |values: &[u32]| values.iter().for_each(|v| bytes.extend(v.to_le_bytes()));
    push(&[2, 1, 0, 4]);
    bytes.extend(b"tiny");
    let mut push = |values: &[u32]| values.iter().for_each(|v| bytes.extend(v.to_le_bytes()));
    push(&[3, 0, 1, 0, 10, 1, 3, 0]);
    let mut numbers = vec![0.01, 1.0, 1.0, 1.0, 0.0];
    numbers.extend([0.0; 54]);
    numbers.extend([-1.0, -1.0, -1.0, 1.0, 1.0, 1.0, 0.5, 0.5, 0.5, 2.0, 2.0, 2.0]);
    numbers.extend([2.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 2.0]);
    numbers.extend([f64::NEG_INFINITY; 3]);
    numbers.extend([0.25; 3]);
    numbers.extend([0.0; 15]);
    numbers.extend([-2.0, 0.0, 0.1]);
    numbers.extend([0.25, 0.0, -0.05]);
    bytes.extend(numbers.iter().flat_map(|v: &f64| v.to_le_bytes()));
    bytes.extend([1, 0, 0, 0, 0, 0, 0, 0]);
    bytes
}

#[test]
fn a_file_is_read_as_written() {
    let sequence = &parse("small", &small()).unwrap()[0];
    assert_eq!((sequence.name.as_str(), sequence.n(), sequence.varying), ("tiny", 3, false));
    assert_eq!(sequence.bounded(), [0, 1, 2]);
    let (lower, upper) = sequence.bounds(0, &[0, 2]);
    assert_eq!((lower[1], upper[1]), (f64::NEG_INFINITY, 0.25));
    assert_eq!(sequence.stacked(&[2]).as_slice(), [0.0, 0.0, 1.0]);
    assert_eq!(sequence.ticks[0].sides, [1, 0, 0]);
    let off = DVector::from_vec(vec![0.25, 0.125, -0.05]);
    assert_eq!(sequence.first_move_error(0, &off).to_bits(), 0.5_f64.to_bits());
}

#[test]
fn a_damaged_file_is_refused_with_its_name_and_place() {
    let whole = small();
    for length in 0..whole.len() {
        let error = parse("short.bin", &whole[..length]).unwrap_err();
        assert_eq!((error.file.as_str(), error.offset), ("short.bin", length), "{error}");
    }
    let damage = |at: usize, bytes: &[u8]| {
        let mut damaged = whole.clone();
        damaged[at..at + bytes.len()].copy_from_slice(bytes);
        parse("bad.bin", &damaged).unwrap_err()
    };
    let header = 24;
    let cases: [(usize, &[u8], usize, &str); 9] = [
        (0, b"X", 0, "MQPS"),
        (4, &[3], 4, "version 3"),
        (8, &[2], whole.len(), "the file ends"),
        (20, &[0xff], 20, "not UTF-8"),
        (header, &[1], header, "n = 1"),
        (header + 12, &[2], header + 12, "hvar = 2"),
        (header + 24, &[4], header + 24, "inputs = 4"),
        (header + 32, &f64::NAN.to_le_bytes(), header + 32, "Ts, w, pole[0] is NaN"),
        (whole.len() - 8, &[5], whole.len() - 8, "act[0] = 5"),
    ];
    for (at, bytes, offset, message) in cases {
        let error = damage(at, bytes);
        assert_eq!(error.offset, offset, "{error}");
        assert!(error.to_string().contains(message), "{error}");
    }
    let longer = [whole.as_slice(), &[0; 8]].concat();
    let error = parse("long.bin", &longer).unwrap_err();
    assert_eq!(
        error.to_string(),
        format!("long.bin, byte {}: 8 bytes after the last run", whole.len())
    );
    let error = read(Path::new("nowhere.bin")).unwrap_err();
    assert!(error.to_string().starts_with("nowhere.bin, byte 0: cannot be read"), "{error}");
}
