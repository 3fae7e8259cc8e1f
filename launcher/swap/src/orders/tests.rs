//! Orders against the real state machine of a slot: which replies and notices they cause, and how they end.

use super::*;
use protocol::control::server::Answer;
use slot::{Clock, Event, Fault, GateFigures, Instance, Now, SlotConfig};

/// A flight whose attitude slot can change hands; its consumer confirms every record at once.
struct Flight {
    orders: Orders,
    machines: Machines,
    logical_ns: u64,
    /// The notices that the launcher itself prints.
    notices: Vec<String>,
}

impl Flight {
    fn new() -> Self {
        let mut orders = Orders::default();
        let candidate = Candidate::Service("attitude-mpc");
        let program = orders.program(Executable::new(candidate, None));
        let seat = Seat::ALL[0];
        orders.seat(Slot::Attitude, seat, program);
        assert_eq!(SlotConfig::LOCKSTEP.clock, Clock::Lockstep);
        let machine = slot::SlotMachine::new(SlotConfig::LOCKSTEP, seat, program);
        let machines = Machines::from([(Slot::Attitude, machine)]);
        let mut flight = Self { orders, machines, logical_ns: 1_000_000_000, notices: Vec::new() };
        flight.ready(seat);
        flight
    }

    fn now(&self) -> Now {
        Now { logical_ns: self.logical_ns, allowed_ns: self.logical_ns }
    }

    /// Lets an event happen, with all that follows from it.
    fn happen(&mut self, event: Event) {
        let now = self.now();
        let actions = self.machines.get_mut(&Slot::Attitude).unwrap().on(now, event);
        self.carry_out(actions);
    }

    fn carry_out(&mut self, actions: Vec<Action>) {
        let mut follows = Vec::new();
        for action in actions {
            match action {
                Action::Report(report) => {
                    self.notices.push(self.orders.notify(Slot::Attitude, &report));
                }
                Action::Spawn(seat, program) => self.orders.seat(Slot::Attitude, seat, program),
                Action::Publish(record) => follows.push(Event::Acknowledged {
                    epoch: record.epoch,
                    seat: record.owner,
                    at_ns: record.effective_ns,
                }),
                Action::AwaitExit(seat) | Action::Kill(seat) => follows.push(Event::Died(seat)),
                _ => {}
            }
        }
        for event in follows {
            self.happen(event);
        }
    }

    fn ready(&mut self, seat: Seat) {
        let instance = Instance { layout: 7, millihertz: 100_000, latency_ns: 1_000_000 };
        self.happen(Event::Ready(seat, instance));
    }

    /// Lets time go on to what the machine waits for.
    fn wait(&mut self) {
        self.logical_ns = self.machines[&Slot::Attitude].deadline_ns().expect("it waits");
        self.happen(Event::Time);
    }

    /// Asks; what comes back at once is in the answer.
    fn ask(&mut self, request: &Request) -> Box<dyn FnMut() -> Vec<Reply>> {
        let (answer, received) = Answer::with_receiver().expect("a descriptor");
        let ordered = match self.orders.understand(request, &self.machines) {
            Ok(ordered) => ordered.expect("an order"),
            Err(refusal) => {
                answer.send(Reply::Refused(refusal));
                return Box::new(received);
            }
        };
        let now = self.now();
        let machine = self.machines.get_mut(&ordered.slot).unwrap();
        let actions = machine.on(now, Event::Request(ordered.request));
        self.orders.follow(&ordered, &self.machines, &actions, answer);
        self.carry_out(actions);
        Box::new(received)
    }

    /// The one refusal that a request meets at once.
    fn refusal(&mut self, request: &Request) -> (Reason, u8, String) {
        let replies = (self.ask(request))();
        let [Reply::Refused(refusal)] = &replies[..] else { panic!("{replies:?}") };
        (refusal.reason, refusal.exit_code, refusal.text.clone())
    }
}

fn swap(to: &str) -> SwapRequest {
    let (slot, to) = ("attitude".to_owned(), to.to_owned());
    let (shadow_ns, rollback_ns) = (2_000_000_000, 500_000_000);
    SwapRequest {
        slot,
        to,
        config: None,
        shadow_ns,
        max_bump: None,
        rollback_ns,
        force: false,
        rehearse: Some(false),
        dry_run: false,
    }
}

fn steps(replies: &[Reply]) -> Vec<&str> {
    replies.iter().map(step).collect()
}

fn step(reply: &Reply) -> &str {
    match reply {
        Reply::Progress(progress) => &progress.step,
        Reply::Done(done) => &done.outcome,
        Reply::Refused(_) => "refused",
        Reply::Status(_) => "status",
        Reply::Ordered(_) => "ordered",
    }
}

#[test]
fn a_swap_is_reported_step_by_step_until_its_window_is_over() {
    let mut flight = Flight::new();
    let mut received = flight.ask(&Request::Swap(swap("attitude-mpc")));
    assert_eq!(steps(&received()), ["accepted"]);
    flight.ready(Seat::ALL[1]);
    flight.wait();
    let figures = GateFigures { free: 200, ..GateFigures::default() };
    flight.happen(Event::Verdict(Seat::ALL[1], Ok(Box::new(figures))));
    let replies = received();
    assert_eq!(steps(&replies), ["joined", "gate", "flips", "flipped"]);
    let Reply::Progress(gate) = &replies[1] else { panic!("{replies:?}") };
    assert_eq!(gate.figures.as_ref().map(|figures| figures.free), Some(200));
    assert!(
        gate.text.contains("attitude slot: the gate lets attitude-mpc@1 through"),
        "{}",
        gate.text
    );
    let Reply::Progress(flips) = &replies[2] else { panic!("{replies:?}") };
    // Join at 1 s, shadow of 2 s, then the first effective instant of the candidate.
    assert_eq!(flips.at_ns, Some(3_001_000_000));
    assert!(flips.text.contains("at 3.001000 s"), "{}", flips.text);
    flight.wait();
    let replies = received();
    assert_eq!(steps(&replies), ["swapped"], "{replies:?}");
    assert!(replies[0].is_last());
    flight.assert_nothing_is_awaited();
}

impl Flight {
    /// No client waits for a reply any more.
    fn assert_nothing_is_awaited(&self) {
        assert!(self.orders.open.is_empty(), "{:?}", self.orders.open);
    }
}

#[test]
fn a_candidate_that_is_refused_or_dies_ends_the_order_with_1_and_its_name() {
    let refused = slot::Refusal::MissedDeadlines { missed: 3, limit: 0, at_ns: 1_500_000_000 };
    for (event, reason, expected) in [
        (Event::Verdict(Seat::ALL[1], Err(refused)), Reason::Gate, "missed 3 deadlines"),
        (Event::Died(Seat::ALL[1]), Reason::Failed, "its process ended"),
        (Event::Misbehaved(Seat::ALL[1], Fault::Stalled), Reason::Failed, "no progress"),
    ] {
        let mut flight = Flight::new();
        let mut received = flight.ask(&Request::Swap(swap("attitude-mpc")));
        flight.ready(Seat::ALL[1]);
        flight.happen(event);
        let replies = received();
        let ended = replies.iter().find(|reply| reply.is_last());
        let Some(Reply::Refused(refusal)) = ended else { panic!("{replies:?}") };
        assert_eq!((refusal.reason, refusal.exit_code), (reason, 1));
        let named = refusal.text.contains("attitude-mpc@1") && refusal.text.contains(expected);
        assert!(named, "{refusal}");
        flight.assert_nothing_is_awaited();
    }
}

#[test]
fn stderr_of_a_dead_candidate_is_whole_for_its_client_and_brief_otherwise() {
    let stderr = "its last words:\n  File \"law.py\", line 6\nValueError: no gains\n";
    let ended = |event: Event| -> (String, String) {
        let mut flight = Flight::new();
        let mut received = flight.ask(&Request::Swap(swap("attitude-mpc")));
        flight.ready(Seat::ALL[1]);
        flight.orders.explain(Slot::Attitude, Seat::ALL[1], stderr);
        flight.happen(event);
        let replies = received();
        let Some(Reply::Refused(refusal)) = replies.last() else { panic!("{replies:?}") };
        (refusal.text.clone(), flight.notices.last().unwrap().clone())
    };
    let (answer, notice) = ended(Event::Died(Seat::ALL[1]));
    assert!(answer.contains("line 6\nValueError: no gains"), "{answer}");
    assert!(notice.ends_with("its last words: ValueError: no gains"), "{notice}");
    assert!(!notice.contains('\n'), "{notice}");
    // Nothing was reported before about a candidate that the launcher kills.
    let (answer, notice) = ended(Event::Misbehaved(Seat::ALL[1], Fault::Stalled));
    assert!(notice == answer && notice.contains("line 6\nValueError: no gains"), "{notice}");
}

#[test]
fn only_a_built_in_controller_with_the_settings_of_the_flight_is_trusted() {
    let mut flight = Flight::new();
    let here = std::env::current_exe().unwrap().display().to_string();
    let own = |to: &str| SwapRequest { config: Some(here.clone().into()), ..swap(to) };
    for (request, expected) in [
        (swap("attitude-mpc"), true),
        (swap("attitude-pid"), true),
        (own("attitude-pid"), false),
        (swap(&here), false),
    ] {
        let Flight { orders, machines, .. } = &mut flight;
        let to = request.to.clone();
        let ordered = orders.understand(&Request::Swap(request), machines).unwrap().unwrap();
        let slot::Request::Swap(Target::New(program), _) = ordered.request else { panic!("{to}") };
        assert_eq!(program.is_trusted, expected, "{to}");
    }
}

#[test]
fn what_makes_no_sense_is_refused_with_2_and_what_comes_too_early_with_3() {
    let mut flight = Flight::new();
    let to = |to: &str| Request::Swap(swap(to));
    let elsewhere = SwapRequest { slot: "altitude".to_owned(), ..swap("attitude-mpc") };
    let not_here = SwapRequest { slot: "position".to_owned(), ..swap("position-mpc") };
    let bump = SwapRequest { max_bump: Some(f64::NAN), ..swap("attitude-mpc") };
    let eternal = SwapRequest { shadow_ns: u64::MAX, ..swap("attitude-mpc") };
    let config = SwapRequest { config: Some("/nowhere/x.toml".into()), ..swap("attitude-mpc") };
    let back = Request::Rollback { slot: "attitude".to_owned() };
    let retire = |name: &str| Request::Retire { name: name.to_owned() };
    for (request, reason, expected) in [
        (Request::Swap(elsewhere), Reason::UnknownSlot, "did you mean `attitude`?"),
        (Request::Swap(not_here), Reason::UnknownSlot, "no slot position"),
        (to("attitude-mpq"), Reason::UnknownName, "did you mean `attitude-mpc`?"),
        (to("plant"), Reason::UnknownName, "plant fills plant, not attitude"),
        (to("/nowhere/a@2"), Reason::UnknownName, "cannot be started"),
        (to("attitude-mpc@3"), Reason::UnknownName, "there are attitude-mpc@0"),
        (to("attitude-lqr@0"), Reason::UnknownName, "there are attitude-mpc@0"),
        (to("attitude-mpc@9"), Reason::UnknownName, "there are attitude-mpc@0"),
        (to("attitude-mpc@0"), Reason::NoSense, "attitude-mpc@0 already owns the slot"),
        (Request::Swap(bump), Reason::BadRequest, "max_bump"),
        (Request::Swap(eternal), Reason::BadRequest, "too long"),
        (Request::Swap(config), Reason::BadRequest, "/nowhere/x.toml is not a file"),
        (back, Reason::NoSense, "no swap to roll back"),
        (retire("attitude-mpc"), Reason::NoSense, "attitude-mpc@0 owns the slot"),
        (retire("unknown"), Reason::UnknownName, "there are attitude-mpc@0"),
    ] {
        let (refused, code, text) = flight.refusal(&request);
        assert_eq!((refused, code), (reason, 2), "{text}");
        assert!(text.contains(expected), "{text}");
    }
    let _first = flight.ask(&to("attitude-mpc"));
    let (reason, code, text) = flight.refusal(&to("attitude-mpc"));
    assert_eq!((reason, code), (Reason::Busy, 3), "{text}");
    assert!(text.contains("in progress on attitude-mpc@1"), "{text}");
}

#[test]
fn a_rollback_ends_the_swap_for_one_and_is_done_for_the_other() {
    let mut flight = Flight::new();
    let mut swapping = flight.ask(&Request::Swap(swap("attitude-mpc")));
    flight.ready(Seat::ALL[1]);
    flight.wait();
    flight.happen(Event::Verdict(Seat::ALL[1], Ok(Box::default())));
    let mut rolling = flight.ask(&Request::Rollback { slot: "attitude".to_owned() });
    let swapping = swapping();
    let Some(Reply::Refused(refusal)) = swapping.last() else { panic!("{swapping:?}") };
    assert!(refusal.exit_code == 1 && refusal.text.contains("rolled back"), "{refusal}");
    let rolling = rolling();
    assert_eq!(steps(&rolling).last(), Some(&"rolled back"), "{rolling:?}");
    flight.assert_nothing_is_awaited();
}

#[test]
fn a_standby_is_named_by_its_program_as_long_as_only_one_can_be_meant() {
    let mut flight = Flight::new();
    let standby = Request::Standby {
        slot: "attitude".to_owned(),
        name: "attitude-mpc".to_owned(),
        shadow_ns: 1_000_000_000,
        rehearse: Some(false),
    };
    let mut standing_by = flight.ask(&standby);
    flight.ready(Seat::ALL[1]);
    flight.wait();
    flight.happen(Event::Verdict(Seat::ALL[1], Ok(Box::default())));
    assert_eq!(steps(&standing_by()).last(), Some(&"stands by"));
    let mut swapping = flight.ask(&Request::Swap(swap("attitude-mpc")));
    assert_eq!(steps(&swapping()), ["accepted"]);
    let retire = |name: &str| Request::Retire { name: name.to_owned() };
    let (reason, code, text) = flight.refusal(&retire("attitude-mpc"));
    assert_eq!((reason, code), (Reason::UnknownName, 2));
    assert!(text.contains("attitude-mpc@1, attitude-mpc@2"), "{text}");
    let mut retiring = flight.ask(&retire("attitude-mpc@2"));
    assert_eq!(steps(&retiring()).last(), Some(&"retired"));
    assert_eq!(steps(&swapping()).last(), Some(&"refused"));
    let mut retiring = flight.ask(&retire("attitude-mpc"));
    assert_eq!(steps(&retiring()).last(), Some(&"retired"));
    flight.assert_nothing_is_awaited();
}

#[test]
fn requests_are_plain_json_with_the_defaults_of_the_command() {
    let text = r#"{"request":"swap","slot":"attitude","to":"attitude-mpc"}"#;
    let request: Request = serde_json::from_str(text).unwrap();
    let order = SwapRequest { rehearse: None, shadow_ns: 1_000_000_000, ..swap("attitude-mpc") };
    assert_eq!(request, Request::Swap(order));
    let text = r#"{"request":"retire","name":"attitude-mpc@1"}"#;
    let request: Request = serde_json::from_str(text).unwrap();
    assert_eq!(request, Request::Retire { name: "attitude-mpc@1".to_owned() });
    for bad in [
        r#"{"request":"swap","slot":"attitude"}"#,
        r#"{"request":"swap","slot":"attitude","to":"x","shadow":"2s"}"#,
        r#"{"request":"rollback"}"#,
        r#"{"request":"retire","name":7}"#,
    ] {
        assert!(serde_json::from_str::<Request>(bad).is_err(), "{bad}");
    }
}
