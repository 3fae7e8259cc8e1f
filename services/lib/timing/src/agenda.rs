//! Decides which loop has its turn next.

/// Why a loop has its turn. At one instant, loops whose step is over publish first, and loops whose
/// wait is over step last: what is published at the end of a wait is in time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum TurnKind {
    /// Its step is over.
    Publish,
    /// It has come, or has published: it may have reason to step at once, or has to rest or wait.
    Look,
    /// It has been woken, or its rest is over.
    Begin,
    /// It has waited long enough.
    Expire,
}

/// One loop's turn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Turn {
    /// When \[ns\].
    pub at_ns: u64,
    /// Why.
    pub kind: TurnKind,
    /// Which loop.
    pub index: usize,
}

/// What a loop has made of its turn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Answer {
    /// Its next turn, and when \[ns\]; none if it has had its last.
    pub next: Option<(TurnKind, u64)>,
    /// How far the others knew that it had got, if it has announced that it has got further \[ns\].
    pub announced_from_ns: Option<u64>,
    /// How far it has got \[ns\].
    pub mark_ns: u64,
}

/// The next turn of each loop.
#[derive(Debug, Clone, Default)]
pub struct Agenda {
    turns: Vec<Option<Turn>>,
    /// Which process of its seat each is, of those that have come.
    there: Vec<Option<u32>>,
}

impl Agenda {
    /// For so many loops, none of which has a turn.
    #[must_use]
    pub fn for_loops(loops: usize) -> Self {
        Self { turns: vec![None; loops], there: vec![None; loops] }
    }

    /// The next turn of all; none if no loop has one.
    #[must_use]
    pub fn next(&self) -> Option<Turn> {
        self.turns.iter().flatten().min().copied()
    }

    /// The next turn of a loop; none if it has none.
    #[must_use]
    pub fn of(&self, index: usize) -> Option<Turn> {
        self.turns.get(index).copied().flatten()
    }

    /// Takes in that a loop is there as this process of its seat; false if that is known.
    pub fn admit(&mut self, index: usize, generation: u32) -> bool {
        let there = self.there.get_mut(index);
        there.is_some_and(|there| there.replace(generation) != Some(generation))
    }

    /// Gives a loop its next turn, or none any more.
    pub fn go_on(&mut self, index: usize, next: Option<(TurnKind, u64)>) {
        match next {
            Some((kind, at_ns)) => self.plan(index, kind, at_ns),
            None => self.end(index),
        }
    }

    /// Gives a loop its next turn.
    pub fn plan(&mut self, index: usize, kind: TurnKind, at_ns: u64) {
        if let Some(turn) = self.turns.get_mut(index) {
            *turn = Some(Turn { at_ns, kind, index });
        }
    }

    /// Gives a loop no further turn.
    pub fn end(&mut self, index: usize) {
        if let Some(turn) = self.turns.get_mut(index) {
            *turn = None;
        }
    }

    /// Lets a loop that waits look at an instant, if that is before its wait is over \[ns\].
    pub fn wake(&mut self, index: usize, at_ns: u64) {
        let waits = |turn: &Turn| turn.kind == TurnKind::Expire && at_ns <= turn.at_ns;
        if self.of(index).as_ref().is_some_and(waits) {
            self.plan(index, TurnKind::Begin, at_ns);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_publication_comes_before_a_look_and_that_before_the_end_of_a_wait() {
        let mut agenda = Agenda::for_loops(4);
        assert_eq!(agenda.next(), None);
        agenda.plan(2, TurnKind::Look, 7);
        agenda.plan(0, TurnKind::Expire, 7);
        agenda.plan(1, TurnKind::Publish, 7);
        agenda.plan(3, TurnKind::Publish, 8);
        let mut order = Vec::new();
        while let Some(turn) = agenda.next() {
            order.push(turn.index);
            agenda.end(turn.index);
        }
        assert_eq!(order, [1, 2, 0, 3]);
    }

    #[test]
    fn a_loop_is_new_once_and_its_successor_is_new_again() {
        let mut agenda = Agenda::for_loops(2);
        assert!(agenda.admit(1, 0) && !agenda.admit(2, 0));
        assert!(!agenda.admit(1, 0));
        assert!(agenda.admit(1, 1));
        agenda.go_on(1, Some((TurnKind::Expire, 9)));
        assert_eq!(agenda.next(), Some(Turn { at_ns: 9, kind: TurnKind::Expire, index: 1 }));
        agenda.go_on(1, None);
        assert_eq!(agenda.next(), None);
    }

    #[test]
    fn only_a_loop_that_waits_is_woken_and_never_later_than_its_wait_ends() {
        let mut agenda = Agenda::for_loops(4);
        for (index, kind) in
            [TurnKind::Expire, TurnKind::Look, TurnKind::Publish].into_iter().enumerate()
        {
            agenda.plan(index, kind, 10);
        }
        (0..4).for_each(|index| agenda.wake(index, 5));
        let at_ns =
            |agenda: &Agenda| [0, 1, 2, 3].map(|index| agenda.of(index).map(|turn| turn.at_ns));
        assert_eq!(at_ns(&agenda), [Some(5), Some(10), Some(10), None]);
        agenda.plan(0, TurnKind::Expire, 10);
        agenda.wake(0, 11);
        assert_eq!(at_ns(&agenda)[0], Some(10));
    }
}
