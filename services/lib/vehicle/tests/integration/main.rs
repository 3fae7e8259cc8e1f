//! The vehicle: plants against closed forms, and the allocation of rotors.

mod allocation;
mod plant;
