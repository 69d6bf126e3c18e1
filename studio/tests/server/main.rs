//! The server as a browser talks to it, over real HTTP on loopback, and as an attacker does.

mod attack;
mod client;
mod dances;
mod durable;
mod load;
mod place;
mod uploads;
