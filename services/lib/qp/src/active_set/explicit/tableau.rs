//! The tableaux of a block.

use super::super::inverse::times;
use super::super::walk::{NOISE, WEAK};
use super::cell::Cell;
use super::{TALL, Tall, WIDE, combine, members};

/// What is known of a working set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum State {
    Unmet,
    Sound,
    /// A row almost depends on the others.
    Weak,
    /// A row depends on the others.
    Refused,
}

#[derive(Debug, Clone)]
pub(super) struct Tableau {
    pub(super) rows: [Tall; TALL],
    /// Rows that can join the set, as a mask.
    pub(super) open: u8,
}

pub(super) const BLANK: Tableau = Tableau { rows: [[0.0; TALL]; TALL], open: 0 };

impl Cell {
    /// Makes sure of the tableau of a set; false if its rows depend on each other.
    pub(super) fn meet(&self, set: u8, states: &mut [State], tableaux: &mut [Tableau]) -> bool {
        match states[set as usize] {
            State::Unmet => self.make(set, states, tableaux),
            state => state != State::Refused,
        }
    }

    /// Makes the tableau of a set, and those on the way to it, row by row.
    #[cold]
    pub(super) fn make(&self, set: u8, states: &mut [State], tableaux: &mut [Tableau]) -> bool {
        if states[0] == State::Unmet {
            self.begin(&mut tableaux[0]);
            states[0] = State::Sound;
        }
        let mut before = 0;
        for p in members(set) {
            let now = before | 1 << p;
            if states[now as usize] == State::Unmet {
                let open = tableaux[before as usize].open >> p & 1 == 1;
                states[now as usize] = State::Refused;
                if open {
                    let [source, target] = [before, now].map(usize::from);
                    let (left, right) = tableaux.split_at_mut(target);
                    pivot(&left[source].rows, &mut right[0].rows, before, p);
                    states[now as usize] = self.judge(now, &left[0].rows, &mut right[0]);
                }
            }
            if states[now as usize] == State::Refused {
                states[set as usize] = State::Refused;
                return false;
            }
            before = now;
        }
        true
    }

    /// The Gram matrix, the tableau of the empty set.
    pub(super) fn begin(&self, target: &mut Tableau) {
        for (row, normal) in target.rows.iter_mut().zip(&self.normals).take(self.m) {
            let mut image = [0.0; WIDE];
            times(self.inverse.as_flattened(), normal, &mut image);
            *row = combine(&self.columns, &image);
        }
        target.open = 0;
        for k in 0..self.m {
            if self.most > 0 && target.rows[k][k] > 0.0 {
                target.open |= 1 << k;
            }
        }
    }

    /// Finds what can join a set and how sound it is.
    pub(super) fn judge(&self, set: u8, gram: &[Tall; TALL], tableau: &mut Tableau) -> State {
        let rows = &tableau.rows;
        tableau.open = 0;
        for k in 0..self.m {
            let growth = 1.0 + members(set).map(|j| rows[j][k].abs()).sum::<f64>();
            let independent = rows[k][k] > NOISE * gram[k][k] * growth * growth;
            let room = (set.count_ones() as usize) < self.most;
            if independent && room && set >> k & 1 == 0 {
                tableau.open |= 1 << k;
            }
        }
        let weak = members(set).any(|k| WEAK * rows[k][k] * gram[k][k] > 1.0);
        if weak { State::Weak } else { State::Sound }
    }
}

/// Brings row `p` into the set of a tableau.
fn pivot(source: &[Tall; TALL], target: &mut [Tall; TALL], set: u8, p: usize) {
    let inverse = 1.0 / source[p][p];
    let mut new = source[p].map(|entry| entry * inverse);
    for j in members(set) {
        new[j] = -source[p][j] * inverse;
    }
    new[p] = inverse;
    for (k, (row, old)) in target.iter_mut().zip(source).enumerate() {
        let share = old[p];
        *row = *old;
        row[p] = 0.0;
        for (entry, new) in row.iter_mut().zip(&new) {
            *entry -= share * new;
        }
        if k == p {
            *row = new;
        }
    }
    for j in members(set | 1 << p) {
        let row = target[j];
        for (other, entry) in target.iter_mut().zip(row) {
            other[j] = entry;
        }
    }
}
