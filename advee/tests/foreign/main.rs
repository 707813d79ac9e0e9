//! Modules in other languages, `examples/modules`, built on the official LCM as described in docs/writing-a-module.md:
//! each alone against a robot simulated by the test, and under the watchdog of the simulated robot.

mod actions;
mod alone;
mod built;
mod gym;
mod hostile;
mod milestones;
mod page;
mod planner;
mod supervised;
#[path = "../support.rs"]
mod support;
