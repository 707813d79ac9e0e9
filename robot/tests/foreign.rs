//! Modules in other languages, `examples/modules`, built on the official LCM by the recipe that docs/writing-a-module.md
//! gives: each alone against a robot that the test plays, and under the watchdog of the simulated one.

#[path = "foreign/alone.rs"]
mod alone;
#[path = "foreign/built.rs"]
mod built;
#[path = "foreign/milestones.rs"]
mod milestones;
#[path = "foreign/page.rs"]
mod page;
#[path = "foreign/supervised.rs"]
mod supervised;
mod support;
