//! Whether and when the vehicle came to where it was sent.

use nalgebra::Vector3;
use record::read::RecordVisitor;
use shared_types::{GuidanceOrder, Sample, Topic, TopicInfo, Truth, topics};
use std::any::Any;
use vehicle::{euler_from_quaternion, rotation};

/// Closer than this to where it was sent is there \[m\], \[rad\].
const THERE_M: f64 = 0.05;
const THERE_RAD: f64 = 1.0_f64.to_radians();
/// So long it must be there to have come \[ns\].
const STAY_NS: u64 = 500_000_000;
/// Instants that are the same \[s\].
pub(super) const SAME_S: f64 = 1e-6;

/// What is ordered of the reference.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Goal {
    Position([f64; 3]),
    Yaw(f64),
    Morph(f64),
}

impl Goal {
    /// How far from it, in units of what is close enough.
    fn off(&self, truth: &Truth) -> f64 {
        match *self {
            Self::Position(goal) => {
                let off = Vector3::from(truth.position_w_m) - Vector3::from(goal);
                off.norm() / THERE_M
            }
            Self::Yaw(goal_rad) => {
                let q = rotation(truth.q_wb.to_array());
                let off_rad = euler_from_quaternion(&q).z - goal_rad;
                libm::atan2(libm::sin(off_rad), libm::cos(off_rad)).abs() / THERE_RAD
            }
            Self::Morph(goal_rad) => (truth.morph_angle_rad - goal_rad).abs() / THERE_RAD,
        }
    }

    fn text(&self, off: f64) -> String {
        match self {
            Self::Position(_) => format!("{:.1} mm", off * THERE_M * 1e3),
            Self::Yaw(_) | Self::Morph(_) => format!("{:.2}°", (off * THERE_RAD).to_degrees()),
        }
    }
}

/// Follows one part of the reference.
#[derive(Debug, Clone, Copy)]
struct Pursuit {
    goal: Goal,
    begin_ns: u64,
    /// Last instant, and how far off it was then.
    last: Option<(u64, f64)>,
    /// From when on another goal holds \[ns\].
    superseded_ns: Option<u64>,
    /// Since when it is there \[ns\].
    since_ns: Option<u64>,
    /// When it came to stay \[ns\].
    there_ns: Option<u64>,
}

impl Pursuit {
    fn see(&mut self, truth: &Truth) {
        let t_ns = truth.header.valid_ns;
        if t_ns < self.begin_ns {
            return;
        }
        let off = self.goal.off(truth);
        self.since_ns = if off > 1.0 { None } else { self.since_ns.or(Some(t_ns)) };
        // What drives it away again later is another matter.
        self.there_ns = self
            .there_ns
            .or(self.since_ns.filter(|since_ns| t_ns.saturating_sub(*since_ns) >= STAY_NS));
        self.last = Some((t_ns, off));
    }

    fn came(&self) -> String {
        let Some((last_ns, off)) = self.last else {
            return match self.superseded_ns {
                Some(at_ns) => {
                    format!("another order came before it, at {:.3} s", at_ns as f64 * 1e-9)
                }
                None => "the file ends before it".to_owned(),
            };
        };
        let (off, last_s) = (self.goal.text(off), last_ns as f64 * 1e-9);
        match self.there_ns {
            Some(there_ns) => format!(
                "within {} from {:.3} s on; {off} off at {last_s:.3} s{}",
                self.goal.text(1.0),
                there_ns as f64 * 1e-9,
                if self.since_ns == self.there_ns { "" } else { ", driven away meanwhile" }
            ),
            None => format!("not there: {off} off at {last_s:.3} s"),
        }
    }
}

/// Follows everything that is ordered of the reference.
#[derive(Debug, Default)]
pub(super) struct Pursuits {
    order: GuidanceOrder,
    now: Vec<Pursuit>,
    past: Vec<Pursuit>,
}

impl Pursuits {
    fn order(&mut self, order: &GuidanceOrder) {
        let before = core::mem::replace(&mut self.order, *order);
        let GuidanceOrder { position, yaw, morph, .. } = order;
        for (is, begin_ns, before_ns, goal) in [
            (
                position.ordered.is_set(),
                position.begin_ns,
                before.position.begin_ns,
                Goal::Position(position.goal_w_m),
            ),
            (
                yaw.ordered.is_set() && yaw.move_s > 0.0,
                yaw.begin_ns,
                before.yaw.begin_ns,
                Goal::Yaw(yaw.goal_rad),
            ),
            (
                morph.ordered.is_set(),
                morph.begin_ns,
                before.morph.begin_ns,
                Goal::Morph(morph.goal_rad),
            ),
        ] {
            if is && begin_ns != before_ns {
                let kind = core::mem::discriminant(&goal);
                let same = |known: &Pursuit| core::mem::discriminant(&known.goal) == kind;
                if let Some(place) = self.now.iter().position(same) {
                    let superseded_ns = Some(order.header.release_ns);
                    self.past.push(Pursuit { superseded_ns, ..self.now.swap_remove(place) });
                }
                self.now.push(Pursuit {
                    goal,
                    begin_ns,
                    last: None,
                    superseded_ns: None,
                    since_ns: None,
                    there_ns: None,
                });
            }
        }
    }

    /// What became of the goal that holds from an instant on \[s\].
    pub(super) fn came(&self, begins_s: f64, text: &str) -> Option<String> {
        let mut all = self.past.iter().chain(&self.now);
        let found = all.find(|one| {
            let prefix = match one.goal {
                Goal::Position(_) => "go to",
                Goal::Yaw(_) => "heading",
                Goal::Morph(_) => "deployable",
            };
            (one.begin_ns as f64 * 1e-9 - begins_s).abs() < SAME_S && text.starts_with(prefix)
        });
        found.map(Pursuit::came)
    }
}

impl RecordVisitor for Pursuits {
    fn wants(&self, topic: &TopicInfo) -> bool {
        [topics::GUIDANCE_ORDER.info.name, topics::TRUTH.info.name].contains(&topic.name)
    }

    fn sample<T: Sample>(&mut self, _topic: &'static Topic<T>, sample: &T) {
        let any: &dyn Any = sample;
        if let Some(truth) = any.downcast_ref::<Truth>() {
            self.now.iter_mut().for_each(|pursuit| pursuit.see(truth));
        } else if let Some(order) = any.downcast_ref::<GuidanceOrder>() {
            self.order(order);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::Header;

    fn truth(t_ns: u64, x_m: f64) -> Truth {
        let header = Header { valid_ns: t_ns, ..Header::default() };
        Truth { header, position_w_m: [x_m, 0.0, 2.0], ..Truth::default() }
    }

    #[test]
    fn a_vehicle_that_was_sent_somewhere_is_there_once_it_stays_there() {
        let mut order = GuidanceOrder::default();
        order.position.ordered = true.into();
        (order.position.begin_ns, order.position.goal_w_m) = (1_000_000_000, [1.0, 0.0, 2.0]);
        let mut pursuits = Pursuits::default();
        pursuits.sample(&topics::GUIDANCE_ORDER, &order);
        let way = [(0, 1.0), (1, 0.0), (2, 0.98), (3, 0.8), (4, 0.96), (5, 0.999)];
        for (t_s, x_m) in way {
            pursuits.sample(&topics::TRUTH, &truth(t_s * 1_000_000_000, x_m));
        }
        let came = pursuits.came(1.0, "go to (1, 0, 2) m");
        assert_eq!(came.as_deref(), Some("within 50.0 mm from 4.000 s on; 1.0 mm off at 5.000 s"));
        // The next order ends the first.
        (order.position.begin_ns, order.position.goal_w_m) = (6_000_000_000, [0.0, 0.0, 2.0]);
        pursuits.sample(&topics::GUIDANCE_ORDER, &order);
        pursuits.sample(&topics::TRUTH, &truth(7_000_000_000, 0.5));
        assert_eq!(pursuits.came(1.0, "go to"), came);
        let second = pursuits.came(6.0, "go to").expect("it is known");
        assert_eq!(second, "not there: 500.0 mm off at 7.000 s");
        assert_eq!(pursuits.came(1.0, "deployable angle"), None);
        // Two more, and the second comes before the first begins.
        for (at_s, begin_s) in [(8, 10), (9, 11)] {
            order.header.release_ns = at_s * 1_000_000_000;
            order.position.begin_ns = begin_s * 1_000_000_000;
            pursuits.sample(&topics::GUIDANCE_ORDER, &order);
        }
        let came = pursuits.came(10.0, "go to (1, 0, 2) m");
        assert_eq!(came.as_deref(), Some("another order came before it, at 9.000 s"));
        let came = pursuits.came(11.0, "go to (1, 0, 2) m");
        assert_eq!(came.as_deref(), Some("the file ends before it"));
    }
}
