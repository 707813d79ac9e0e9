//! Virtual time beside real time, for a simulated robot that programs outside it see and command (`advee up --sim
//! --speed N`): its pace ([`pacer`]), and what passes between its bus and theirs ([`gateway`]).
//!
//! Both are handed real time as they are handed virtual time, as an [`Instant`](base::Instant), and own no clock.

pub mod gateway;
pub mod pacer;
