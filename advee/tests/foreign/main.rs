//! Modules in other languages, `examples/modules`, built on the official LCM by the recipe that docs/writing-a-module.md
//! gives: each alone against a robot that the test plays, and under the watchdog of the simulated one.

mod alone;
mod built;
mod milestones;
mod page;
mod supervised;
#[path = "../support.rs"]
mod support;
