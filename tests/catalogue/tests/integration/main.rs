//! Faulty controllers: rehearsed, swapped in, and watched.

mod rehearsal;
mod swapped;
mod watched;
