//! Turns of the loops of a flight whose clock is moved by its launcher, and what they have made of them.
//!
//! Both go through named pipes of the run's folder: an order or an answer is one write of fewer bytes than a pipe keeps
//! together, and wakes the process that it is for.

use super::{Bus, PortError};
use core::time::Duration;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{CWD, FileType, Mode, OFlags, mknodat, open};
use rustix::io::{read, write};
use shared_types::{Role, Seat};
use std::os::fd::OwnedFd;
use std::path::PathBuf;
use timing::{Answer, TurnKind};

/// What the launcher wants of a process.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Order {
    /// To take its turn at an instant of the flight's clock \[ns\].
    Turn(TurnKind, u64),
    /// To take what has come to its ports out of them.
    Collect,
    /// To run each release before an instant that has not run, because the process before it had
    /// \[ns\]; the answer reports how far it has got.
    CatchUp(u64),
    /// To look which processes have come and gone; this one is not answered.
    LookAround,
    /// To leave if its time on the seat is over; neither is this one.
    Leave,
}

/// An order for one process of a seat, with its number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NumberedOrder {
    /// What.
    pub order: Order,
    /// How many processes have had the seat before.
    pub generation: u32,
    /// Its number, which the answer repeats.
    pub number: u32,
}

/// An answer, with its process and the order that it belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NumberedAnswer {
    /// By [`Seat::number`].
    pub seat: usize,
    /// How many processes have had the seat before.
    pub generation: u32,
    /// Number of the order.
    pub number: u32,
    /// What came of a turn; none of another order.
    pub answer: Option<Answer>,
}

/// An order in bytes, and an answer.
const ORDER: usize = 3 * 8;
const ANSWER: usize = 6 * 8;

/// Codes of what is no turn.
const COLLECT: u64 = 4;
const LOOK_AROUND: u64 = 5;
const CATCH_UP: u64 = 6;
const LEAVE: u64 = 7;
/// In place of an instant or of a kind: there is none.
const NONE: u64 = u64::MAX;

const KINDS: [TurnKind; 4] = [TurnKind::Publish, TurnKind::Look, TurnKind::Begin, TurnKind::Expire];

fn code(kind: TurnKind) -> u64 {
    KINDS.into_iter().zip(0..).find(|(of, _)| *of == kind).map_or(NONE, |(_, code)| code)
}

fn kind(code: u64) -> Option<TurnKind> {
    KINDS.get(usize::try_from(code).ok()?).copied()
}

fn pack<const N: usize>(words: &[u64]) -> [u8; N] {
    let mut bytes = [0; N];
    for (slot, word) in bytes.chunks_exact_mut(8).zip(words) {
        slot.copy_from_slice(&word.to_le_bytes());
    }
    bytes
}

fn unpack<const WORDS: usize>(bytes: &[u8]) -> [u64; WORDS] {
    let mut words = [0; WORDS];
    for (word, bytes) in words.iter_mut().zip(bytes.chunks_exact(8)) {
        *word = bytes.try_into().map_or(0, u64::from_le_bytes);
    }
    words
}

/// Two numbers in one word.
fn pair(high: u32, low: u32) -> u64 {
    u64::from(high) << 32 | u64::from(low)
}

#[expect(clippy::cast_possible_truncation, reason = "the two halves")]
fn halves(word: u64) -> (u32, u32) {
    ((word >> 32) as u32, word as u32)
}

impl NumberedOrder {
    fn pack(self) -> [u8; ORDER] {
        let (code, at_ns) = match self.order {
            Order::Turn(kind, at_ns) => (code(kind), at_ns),
            Order::Collect => (COLLECT, 0),
            Order::CatchUp(until_ns) => (CATCH_UP, until_ns),
            Order::LookAround => (LOOK_AROUND, 0),
            Order::Leave => (LEAVE, 0),
        };
        pack(&[code, at_ns, pair(self.generation, self.number)])
    }

    fn unpack(bytes: &[u8; ORDER]) -> Option<Self> {
        let [code, at_ns, packed] = unpack(bytes);
        let (generation, number) = halves(packed);
        let order = match code {
            COLLECT => Order::Collect,
            CATCH_UP => Order::CatchUp(at_ns),
            LOOK_AROUND => Order::LookAround,
            LEAVE => Order::Leave,
            code => Order::Turn(kind(code)?, at_ns),
        };
        Some(Self { order, generation, number })
    }
}

impl NumberedAnswer {
    fn pack(self) -> [u8; ANSWER] {
        let Self { seat, generation, number, answer } = self;
        let next = answer.and_then(|answer| answer.next);
        let (kind, at_ns) = next.map_or((NONE, 0), |(kind, at_ns)| (code(kind), at_ns));
        let from_ns = answer.and_then(|answer| answer.announced_from_ns).unwrap_or(NONE);
        let mark_ns = answer.map_or(NONE, |answer| answer.mark_ns);
        pack(&[seat as u64, pair(generation, number), kind, at_ns, from_ns, mark_ns])
    }

    fn unpack(bytes: &[u8; ANSWER]) -> Option<Self> {
        let [seat, packed, code, at_ns, from_ns, mark_ns] = unpack(bytes);
        let (generation, number) = halves(packed);
        let answer = (mark_ns != NONE).then(|| Answer {
            next: kind(code).map(|kind| (kind, at_ns)),
            announced_from_ns: Some(from_ns).filter(|from_ns| *from_ns != NONE),
            mark_ns,
        });
        Some(Self { seat: usize::try_from(seat).ok()?, generation, number, answer })
    }
}

/// Waits until there is something in a pipe; false if there is not before the limit.
fn await_bytes(pipe: &OwnedFd, limit: Duration) -> bool {
    let limit = Timespec::try_from(limit).ok();
    let mut waited_for = [PollFd::new(pipe, PollFlags::IN)];
    // A signal interrupts the wait; the caller looks at its flags either way.
    poll(&mut waited_for, limit.as_ref()).is_ok_and(|ready| ready > 0)
}

/// Reads one message, which another process has written as a whole.
fn read_message<const N: usize>(pipe: &OwnedFd) -> Option<[u8; N]> {
    let mut bytes = [0; N];
    (read(pipe, &mut bytes).ok()? == N).then_some(bytes)
}

impl Bus {
    /// Creates the pipes of orders and answers (launcher only); they live as long as the run's folder.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn create_turns(&self) -> Result<(), PortError> {
        let seats = Role::STEPPING.into_iter().flat_map(Seat::all);
        let paths = seats.map(|seat| self.orders_path(seat)).chain([self.answers_path()]);
        for path in paths {
            mknodat(CWD, path, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0)
                .map_err(PortError::transport("turns", "create the pipe"))?;
        }
        Ok(())
    }

    fn orders_path(&self, seat: Seat) -> PathBuf {
        self.folder.join(format!("turns-{}", seat.label()))
    }

    fn answers_path(&self) -> PathBuf {
        self.folder.join("answers")
    }
}

fn open_pipe(path: PathBuf) -> Result<OwnedFd, PortError> {
    // Both directions at each end: neither has to wait for, or survive, the other end.
    let flags = OFlags::RDWR | OFlags::NONBLOCK | OFlags::CLOEXEC;
    open(path, flags, Mode::empty()).map_err(PortError::transport("turns", "open the pipe"))
}

/// The launcher's end.
#[derive(Debug)]
pub struct TurnGiver {
    /// By [`Seat::number`].
    orders: Vec<Option<OwnedFd>>,
    answers: OwnedFd,
}

impl TurnGiver {
    /// Opens the pipes of all seats.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn open(bus: &Bus) -> Result<Self, PortError> {
        let mut orders: Vec<_> = (0..Seat::COUNT).map(|_| None).collect();
        for seat in Role::STEPPING.into_iter().flat_map(Seat::all) {
            if let Some(slot) = seat.number().and_then(|number| orders.get_mut(number)) {
                *slot = Some(open_pipe(bus.orders_path(seat))?);
            }
        }
        Ok(Self { orders, answers: open_pipe(bus.answers_path())? })
    }

    /// Gives an order to a seat, by [`Seat::number`]; false if there is no room for it in the pipe.
    #[must_use]
    pub fn give(&self, seat: usize, order: NumberedOrder) -> bool {
        let pipe = self.orders.get(seat).and_then(Option::as_ref);
        pipe.is_some_and(|pipe| write(pipe, &order.pack()).is_ok_and(|count| count == ORDER))
    }

    /// The next answer, if one comes before the limit.
    #[must_use]
    pub fn await_answer(&self, limit: Duration) -> Option<NumberedAnswer> {
        await_bytes(&self.answers, limit)
            .then(|| read_message(&self.answers))
            .flatten()
            .and_then(|bytes| NumberedAnswer::unpack(&bytes))
    }
}

/// A process's end.
#[derive(Debug)]
pub struct TurnTaker {
    seat: usize,
    generation: u32,
    orders: OwnedFd,
    answers: OwnedFd,
}

impl TurnTaker {
    /// Opens the pipes of one's own seat.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn open(bus: &Bus, seat: Seat, generation: u32) -> Result<Self, PortError> {
        let number = seat.number().unwrap_or(usize::MAX);
        let (orders, answers) = (open_pipe(bus.orders_path(seat))?, open_pipe(bus.answers_path())?);
        Ok(Self { seat: number, generation, orders, answers })
    }

    /// The next order for this process, if one comes before the limit.
    #[must_use]
    pub fn await_order(&self, limit: Duration) -> Option<NumberedOrder> {
        await_bytes(&self.orders, limit)
            .then(|| read_message(&self.orders))
            .flatten()
            .and_then(|bytes| NumberedOrder::unpack(&bytes))
            .filter(|order| order.generation == self.generation)
    }

    /// Answers an order: with what came of it if it was a turn.
    pub fn answer(&self, order: &NumberedOrder, answer: Option<Answer>) {
        let (seat, generation, number) = (self.seat, self.generation, order.number);
        // It is awaited before the next order of its kind, so that there is room for it.
        let _ = write(&self.answers, &NumberedAnswer { seat, generation, number, answer }.pack());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_order_and_an_answer_arrive_as_they_were_sent() {
        let turns = KINDS.map(|kind| Order::Turn(kind, u64::MAX - 1));
        for order in turns.into_iter().chain([
            Order::Collect,
            Order::CatchUp(9),
            Order::LookAround,
            Order::Leave,
        ]) {
            let order = NumberedOrder { order, generation: 7, number: u32::MAX };
            assert_eq!(NumberedOrder::unpack(&order.pack()), Some(order));
        }
        let answer = Answer { next: None, announced_from_ns: None, mark_ns: 3 };
        let next = Some((TurnKind::Expire, 9));
        let full = Answer { next, announced_from_ns: Some(0), mark_ns: 5 };
        for answer in [None, Some(answer), Some(full)] {
            let answer = NumberedAnswer { seat: 27, generation: u32::MAX, number: 1, answer };
            assert_eq!(NumberedAnswer::unpack(&answer.pack()), Some(answer));
        }
        assert_eq!(NumberedOrder::unpack(&pack(&[8, 0, 0])), None);
    }
}
