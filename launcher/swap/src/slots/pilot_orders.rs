//! Orders to pilot and injector, which concern no slot: they only come the same way.

use super::{News, SlotContext, Slots};
use protocol::control::server::Answer;
use protocol::control::{Reason, Refusal, Reply};
use scenario::orders::{Order, OrderReport, Planner, RefusedOrder};

impl SlotContext<'_> {
    /// Carries an order out that shows from `begin_ns` on.
    fn carry_out(
        &mut self,
        order: &Order,
        begin_ns: u64,
        scripted: bool,
    ) -> Result<OrderReport, RefusedOrder> {
        let at = (self.now.logical_ns, begin_ns);
        let planned = self.orders.order(order, at, scripted)?;
        self.posts.send_order(&planned.sent);
        Ok(planned.report)
    }
}

impl Slots {
    /// Takes an order from outside.
    pub(super) fn give(&mut self, order: &Order, answer: &Answer, context: &mut SlotContext<'_>) {
        let now = context.now;
        let begin_ns = Planner::begin_ns(order, context.graph, now.logical_ns, now.allowed_ns);
        let reply = match context.carry_out(order, begin_ns, false) {
            Ok(report) => {
                self.add_news(format!("ordered {}", report.sentence()), false);
                Reply::Ordered(report)
            }
            Err(refused) => {
                let reason = match refused {
                    RefusedOrder::TooMany => Reason::Busy,
                    RefusedOrder::Rig | RefusedOrder::TooLate { .. } => Reason::NoSense,
                    RefusedOrder::OutOfRange(_) | RefusedOrder::TooFast { .. } => {
                        Reason::OutOfRange
                    }
                };
                Reply::Refused(Refusal::new(reason, refused.to_string()))
            }
        };
        answer.send(reply);
    }

    /// Takes an order of the script, for its instant.
    pub(super) fn give_scripted(
        &mut self,
        order: &Order,
        at_ns: u64,
        context: &mut SlotContext<'_>,
    ) {
        let (text, warning) = match context.carry_out(order, at_ns, true) {
            Ok(report) => (format!("script: {}", report.sentence()), false),
            Err(refused) => (format!("script: {order}: {refused}"), true),
        };
        self.news.push(News { text, warning });
    }
}
