//! `[[order]]`: what is ordered of pilot and injector at logical times, as a user could live.

use super::overrides::{named_at, refusal, seconds};
use super::{Override, Scenario};
use crate::orders::{Calm, Disturb, Goto, Morph, Order, Planner};
use document::{Complaint, Edit, ScenarioError};
use garde::Validate;
use schemars::JsonSchema;
use serde::Deserialize;
use shared_types::time::ns_from_s;

/// What is ordered at a time: one of `goto`, `morph`, `disturb` and `calm`.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
pub struct OrderSettings {
    /// When it is in effect \[s\].
    #[garde(range(min = 0.001, max = 1e6))]
    pub at_s: f64,
    /// Where to go.
    #[garde(skip)]
    pub goto: Option<Goto>,
    /// How wide to spread the arms.
    #[garde(skip)]
    pub morph: Option<Morph>,
    /// What to disturb.
    #[garde(skip)]
    pub disturb: Option<Disturb>,
    /// What disturbances to end.
    #[garde(skip)]
    pub calm: Option<Calm>,
}

impl OrderSettings {
    /// The order, if it is exactly one.
    #[must_use]
    pub fn order(&self) -> Option<Order> {
        let Self { goto, morph, disturb, calm, .. } = *self;
        let orders = [
            goto.map(Order::Goto),
            morph.map(Order::Morph),
            disturb.map(Order::Disturb),
            calm.map(Order::Calm),
        ];
        let mut orders = orders.into_iter().flatten();
        orders.next().filter(|_| orders.next().is_none())
    }
}

/// Orders that cannot be carried out; all of them are given to a planner as the flight would.
pub(super) fn check(scenario: &Scenario) -> Vec<Complaint> {
    let settings = &scenario.settings().order;
    let mut complaints = Vec::new();
    let (false, Ok(mut planner)) = (settings.is_empty(), Planner::of(scenario)) else {
        return complaints;
    };
    let mut by_time: Vec<usize> = (0..settings.len()).collect();
    by_time.sort_by(|a, b| settings[*a].at_s.total_cmp(&settings[*b].at_s));
    for index in by_time {
        let Some(order) = settings[index].order() else {
            let what = "has not exactly one of goto, morph, disturb and calm".to_owned();
            let remedy = "write one of them, for example goto = { position_w_m = [1.0, 0.0, 2.0] }";
            complaints.push((format!("order[{index}]"), what, remedy.to_owned()));
            continue;
        };
        let at_ns = ns_from_s(settings[index].at_s);
        if let Err(refused) = planner.order(&order, (at_ns, at_ns), true) {
            let refused = refused.to_string();
            let (what, remedy) = refused.split_once(": ").unwrap_or((&refused, "leave it away"));
            complaints.push((format!("order[{index}]"), what.to_owned(), remedy.to_owned()));
        }
    }
    complaints
}

const GOTO_FORM: &str = "write --goto X,Y,Z@TIME or --goto X,Y,Z,YAW@TIME in m and degrees, for example --goto 1,0,2,90@3s";

const MORPH_FORM: &str =
    "write --morph DEGREES@TIME, for example --morph 120@3s; behind it may stand ,over=2s";

fn numbers(text: &str) -> Option<Vec<f64>> {
    text.split(',').map(|word| word.trim().parse().ok()).collect()
}

impl Override {
    /// `--goto X,Y,Z@TIME`, with a heading in degrees after Z.
    ///
    /// # Errors
    /// Not of this form.
    pub fn goto(argument: &str) -> Result<Self, ScenarioError> {
        let shown = format!("--goto {argument}");
        let parts = named_at(argument).and_then(|(place, at_s)| Some((numbers(place)?, at_s)));
        let (place, yaw, at_s) = match parts {
            Some((place, at_s)) if place.len() == 3 => (place, None, at_s),
            Some((mut place, at_s)) if place.len() == 4 => {
                let yaw = place.pop();
                (place, yaw, at_s)
            }
            _ => {
                let what = "lacks where to go and when";
                return Err(refusal("--goto", &shown, what, GOTO_FORM));
            }
        };
        let yaw = yaw.map_or(String::new(), |yaw| format!(", yaw_deg = {yaw:?}"));
        let entry = format!("at_s = {at_s:?}, goto = {{ position_w_m = {place:?}{yaw} }}");
        Ok(Self(Edit::added(shown, "order", &entry)))
    }

    /// `--morph DEGREES@TIME`, with `,over=TIME`.
    ///
    /// # Errors
    /// Not of this form.
    pub fn morph(argument: &str) -> Result<Self, ScenarioError> {
        let shown = format!("--morph {argument}");
        let (head, over) = match argument.split_once(",over=") {
            Some((head, over)) => (head, Some(seconds(over))),
            None => (argument, None),
        };
        let parts = named_at(head).and_then(|(angle, at_s)| {
            let [angle_deg] = numbers(angle)?[..] else { return None };
            Some((angle_deg, at_s))
        });
        let (Some((angle_deg, at_s)), None | Some(Some(_))) = (parts, over) else {
            let what = "lacks how wide to spread the arms and when";
            return Err(refusal("--morph", &shown, what, MORPH_FORM));
        };
        let over = over.flatten().map_or(String::new(), |over_s| format!(", over_s = {over_s:?}"));
        let entry = format!("at_s = {at_s:?}, morph = {{ angle_deg = {angle_deg:?}{over} }}");
        Ok(Self(Edit::added(shown, "order", &entry)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flown(text: &str, flags: &[Override]) -> Result<Scenario, String> {
        Scenario::from_text("x.toml", &format!("[scenario]\nduration_s = 10.0\n{text}"), flags)
            .map_err(|error| {
                let problems = error.problems().map(|p| format!("{p}: {}", p.remedy()));
                problems.collect::<Vec<_>>().join(
                    "
",
                )
            })
    }

    #[test]
    fn orders_stand_in_a_scenario_or_come_from_flags() {
        let text = "[[order]]\nat_s = 2.0\ndisturb = { load = { force_w_n = [0.1, 0.0, 0.0] }, for_s = 1.0 }\n";
        let flags = [
            Override::goto("1,-0.5,2,90@3s").unwrap(),
            Override::goto("0, 0, 1.5@6s").unwrap(),
            Override::morph("120@500ms,over=1.5s").unwrap(),
        ];
        let scenario = flown(text, &flags).unwrap();
        let orders: Vec<String> =
            scenario.settings().order.iter().map(|o| o.order().unwrap().to_string()).collect();
        assert_eq!(
            orders,
            [
                "disturb force 0.1 0 0 N for 1 s",
                "goto 1 -0.5 2 m, heading 90 deg",
                "goto 0 0 1.5 m",
                "morph 120 deg over 1.5 s"
            ]
        );
        // The processes of the flight read the same.
        let again = Scenario::from_text("again.toml", scenario.to_toml(), &[]).unwrap();
        assert_eq!(again.settings().order.len(), 4);
        assert!(again.settings().is_scripted());
    }

    #[test]
    fn orders_that_cannot_be_carried_out_are_refused_with_their_range() {
        let refused = |flag: Override, parts: &[&str]| {
            let message = flown("", &[flag]).unwrap_err();
            for part in parts {
                assert!(message.contains(part), "{part}: {message}");
            }
        };
        let goto = |text| Override::goto(text).unwrap();
        refused(goto("0,0,-1@3s"), &["z -1", "from 0.2 to 100 m", "order[0]"]);
        refused(goto("400,0,1@3s"), &["x 400", "from -100 to 100 m"]);
        refused(goto("0,0,1@10s"), &["flight ends at 10 s"]);
        refused(Override::morph("170@3s").unwrap(), &["angle 170", "from 45 to 160 deg"]);
        refused(Override::morph("160@3s,over=200ms").unwrap(), &["700 deg/s", "at least 0.24"]);
        let both = "[[order]]\nat_s = 1.0\ncalm = {}\nmorph = { angle_deg = 50.0 }\n";
        assert!(flown(both, &[]).unwrap_err().contains("exactly one"));
        assert!(flown("[[order]]\nat_s = 1.0\n", &[]).unwrap_err().contains("exactly one"));
        for bad in ["", "1,2@3s", "1,2,3", "1,2,x@3s", "1,2,3,4,5@3s"] {
            let error = Override::goto(bad).unwrap_err();
            assert!(error.problems().next().unwrap().remedy().contains("--goto X,Y,Z@TIME"));
        }
        for bad in ["", "50", "x@3s", "50@3s,over=long", "50,60@3s"] {
            assert!(Override::morph(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn a_rig_morphs_and_goes_nowhere() {
        let rig = "[pilot]\nkind = \"attitude_step\"\n";
        assert!(flown(rig, &[Override::morph("90@3s").unwrap()]).is_ok());
        let message = flown(rig, &[Override::goto("0,0,1@3s").unwrap()]).unwrap_err();
        assert!(message.contains("rig"), "{message}");
    }
}
