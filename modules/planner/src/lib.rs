//! From goals to motion: obstacles, planning, following.
#![forbid(unsafe_code)]
