//! The slots: roles whose process can be exchanged in flight.
//!
//! What is done for each slot iterates over [`Slot::ALL`]; what differs between them, and is no control law, stands in
//! [`Slot::spec`].

use crate::{OwnerRecord, Role, Topic, TopicInfo, topics};
use core::ops::Index;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::collections::BTreeMap;

/// A place in the data flow whose process can be exchanged in flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Slot {
    /// Torques for the attitude set point.
    Attitude,
    /// Thrust and tilt for the trajectory.
    Position,
}

/// The differences between slots for the code that carries, records and supervises.
#[derive(Debug)]
pub struct SlotSpec {
    /// Role of the controllers that fill it.
    pub role: Role,
    /// What its owner commands.
    pub command: &'static TopicInfo,
    /// Which seat owns it from when.
    pub owner: &'static Topic<OwnerRecord>,
    /// Role that commands instead in a flight that has no controller for the slot.
    pub stand_in: Option<Role>,
}

static ATTITUDE: SlotSpec = SlotSpec {
    role: Role::Attitude,
    command: &topics::WRENCH_COMMAND.info,
    owner: &topics::ATTITUDE_OWNER,
    stand_in: None,
};

static POSITION: SlotSpec = SlotSpec {
    role: Role::Position,
    command: &topics::ATTITUDE_SETPOINT.info,
    owner: &topics::POSITION_OWNER,
    // On a rig, which holds the vehicle in its place.
    stand_in: Some(Role::Pilot),
};

impl Slot {
    /// Every slot.
    pub const ALL: [Self; 2] = [Self::Attitude, Self::Position];
    /// How many there are.
    pub const COUNT: usize = Self::ALL.len();

    /// Place among [`Slot::ALL`].
    #[must_use]
    pub const fn index(self) -> usize {
        self as usize
    }

    /// What distinguishes it from the others.
    #[must_use]
    pub const fn spec(self) -> &'static SlotSpec {
        match self {
            Self::Attitude => &ATTITUDE,
            Self::Position => &POSITION,
        }
    }

    /// Role that fills it.
    #[must_use]
    pub const fn role(self) -> Role {
        self.spec().role
    }

    /// The slot that a role fills.
    #[must_use]
    pub fn of(role: Role) -> Option<Self> {
        Self::ALL.into_iter().find(|slot| slot.role() == role)
    }

    /// The slot whose owner records are on a topic.
    #[must_use]
    pub fn of_owner_records(topic: &TopicInfo) -> Option<Self> {
        Self::ALL.into_iter().find(|slot| slot.spec().owner.info.name == topic.name)
    }

    /// As written in commands and scenarios.
    #[must_use]
    pub fn label(self) -> &'static str {
        self.role().label()
    }

    /// The slot of that name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|slot| slot.label() == name)
    }
}

/// One value for each slot; in text a table by their labels, in which a slot that is left out has the default.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct PerSlot<T>([T; Slot::COUNT]);

impl<T> PerSlot<T> {
    /// The value of each slot by the slot.
    pub fn from_fn(value: impl FnMut(Slot) -> T) -> Self {
        Self(Slot::ALL.map(value))
    }

    /// Each slot with its value.
    pub fn iter(&self) -> impl Iterator<Item = (Slot, &T)> {
        Slot::ALL.into_iter().zip(&self.0)
    }
}

impl<T> Index<Slot> for PerSlot<T> {
    type Output = T;
    fn index(&self, slot: Slot) -> &T {
        &self.0[slot.index()]
    }
}

impl<T: Serialize> Serialize for PerSlot<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.iter())
    }
}

impl<'de, T: Deserialize<'de> + Default> Deserialize<'de> for PerSlot<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let mut values: BTreeMap<Slot, T> = BTreeMap::deserialize(deserializer)?;
        Ok(Self::from_fn(|slot| values.remove(&slot).unwrap_or_default()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_of_slots_are_found_by_the_slot() {
        let values = PerSlot::from_fn(Slot::label);
        for (slot, label) in values.iter() {
            assert_eq!((values[slot], Slot::ALL[slot.index()]), (*label, slot));
        }
    }

    #[test]
    fn each_slot_is_found_by_its_role_its_name_and_its_owner_records() {
        for slot in Slot::ALL {
            let SlotSpec { role, command, owner, stand_in } = slot.spec();
            assert_eq!(Slot::of(*role), Some(slot));
            assert_eq!(Slot::named(role.label()), Some(slot));
            assert_eq!(Slot::of_owner_records(&owner.info), Some(slot));
            assert_eq!((command.from, role.is_slot()), (*role, true));
            assert!(stand_in.is_none_or(|role| Slot::of(role).is_none()));
        }
        let slots = Role::STEPPING.into_iter().filter(|role| role.is_slot());
        assert_eq!(slots.count(), Slot::ALL.len());
        assert_eq!((Slot::of(Role::Plant), Slot::named("plant")), (None, None));
    }
}
