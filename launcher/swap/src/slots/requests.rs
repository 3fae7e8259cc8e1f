//! Orders from outside and of the script, given to the swap protocol.

use super::{SlotContext, Slots, SwapReport};
use crate::FlightError;
use crate::orders::Ordered;
use protocol::control::protocol::{Reason as Refused, Refusal};
use protocol::control::server::Answer;
use protocol::control::{Reply, Request as Asked};
use shared_types::Slot;
use slot::supervisor::Event;
use slot::{Action, Report, Request, Target};

/// Why no swap is accepted while the monitor does not step.
fn monitor_is_silent(silent_ns: u64) -> Refusal {
    let silent_ms = silent_ns / 1_000_000;
    let text = format!(
        "the monitor has not stepped for {silent_ms} ms, and nothing would watch a new owner: order the \
         swap again once it steps, as `morphquad top` shows"
    );
    Refusal::new(Refused::Busy, text)
}

impl Slots {
    /// Takes an order from outside, and answers it in the course of time.
    ///
    /// # Errors
    /// [`FlightError`] if the flight cannot go on.
    pub fn order(
        &mut self,
        asked: &Asked,
        answer: Answer,
        context: &mut SlotContext<'_>,
    ) -> Result<(), FlightError> {
        if let Asked::Order { order } = asked {
            self.give(order, &answer, context);
            return Ok(());
        }
        let understood = match (context.monitor_silent_ns, asked) {
            (Some(ns), Asked::Swap(_)) => Err(monitor_is_silent(ns)),
            _ => self.orders.understand(asked, &self.machines),
        };
        match understood {
            Ok(None) => Ok(()),
            Ok(Some(ordered)) => self.request(&ordered, Some(answer), context),
            Err(refusal) => {
                answer.send(Reply::Refused(refusal));
                Ok(())
            }
        }
    }

    /// Takes an order of the script.
    ///
    /// # Errors
    /// [`FlightError`] if the flight cannot go on.
    pub fn script(
        &mut self,
        asked: &Asked,
        context: &mut SlotContext<'_>,
    ) -> Result<(), FlightError> {
        match self.orders.understand(asked, &self.machines) {
            Ok(None) => Ok(()),
            Ok(Some(ordered)) => self.request(&ordered, None, context),
            Err(refusal) => {
                if let Asked::Swap(order) = asked
                    && let Some(slot) = Slot::named(&order.slot)
                {
                    let mut report =
                        SwapReport::new(slot, "", &order.to, context.now.logical_ns, true);
                    report.refuse(&refusal.text);
                    self.reports.push(report);
                }
                self.add_news(refusal.text, true);
                Ok(())
            }
        }
    }

    fn request(
        &mut self,
        ordered: &Ordered,
        answer: Option<Answer>,
        context: &mut SlotContext<'_>,
    ) -> Result<(), FlightError> {
        let slot = ordered.slot;
        let (Some(machine), Some(state)) =
            (self.machines.get_mut(&slot), self.states.get_mut(&slot))
        else {
            return Ok(());
        };
        let from = machine.record().map(|record| record.owner);
        let actions = machine.on(context.now, Event::Request(ordered.request));
        let refused =
            actions.iter().any(|action| matches!(action, Action::Report(Report::Refused(_))));
        if let Request::Swap(target, _) = ordered.request {
            if state.current.is_none() || refused {
                let to = match target {
                    Target::New(program) => {
                        let executable = self.orders.executable(program);
                        executable.map_or("?", |e| e.candidate.name()).to_owned()
                    }
                    Target::Seated(seat) => self.orders.name(slot, seat),
                };
                let from = from.map_or(String::new(), |seat| self.orders.name(slot, seat));
                let at_ns = context.now.logical_ns;
                self.reports.push(SwapReport::new(slot, &from, &to, at_ns, answer.is_none()));
            }
            if refused {
                self.end_last(&actions);
            } else {
                state.current = Some(self.reports.len() - 1);
                state.max_bump = ordered.max_bump;
            }
        }
        if ordered.skips_rehearsal && !refused {
            self.skip_rehearsal(slot);
        }
        let (is_answered, news_before) = (answer.is_some(), self.news.len());
        if let Some(answer) = answer {
            self.orders.follow(ordered, &self.machines, &actions, answer);
        }
        self.carry_out(slot, actions, context)?;
        if refused && is_answered {
            // The client that asked knows, and the flight is none the worse for it.
            self.news.iter_mut().skip(news_before).for_each(|news| news.warning = false);
        }
        if let (Request::Swap(Target::Seated(seat), _), Some(owner), false) =
            (ordered.request, from, refused)
        {
            // It has been there all along, and is handed nothing.
            let alike = self.machines.get(&slot).is_some_and(|m| m.are_alike(owner, seat));
            self.open_gate(slot, seat, alike, None, context);
        }
        Ok(())
    }
}
