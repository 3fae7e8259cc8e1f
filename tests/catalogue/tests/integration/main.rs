//! Faulty controllers: rehearsed, swapped in, and watched.

mod realtime;
mod rehearsal;
mod swapped;
mod watched;
