//! The robot as its users run it, live: one program, so that all of it is linked once. Tests in virtual time, and those
//! that the documentation names by `--test`, are programs of their own.

mod bad_input;
mod bench_can;
mod bench_jitter;
mod can_tools;
mod canopen_peers;
#[path = "../support/command.rs"]
mod command;
mod configurations;
mod drive;
mod gamepad;
// The crate that has the bus has the hosts to prove it on.
#[path = "../../../foundation/lcm/tests/common/hosts.rs"]
mod hosts;
mod i2c_tools;
mod lcm_gen;
mod lcm_hub;
mod lcm_tools;
mod leftovers;
#[path = "../support/log.rs"]
mod log;
mod log_peers;
mod log_tools;
mod logger;
#[path = "../support/operator.rs"]
mod operator;
#[path = "../support/page.rs"]
mod page;
mod peers;
mod plan;
mod rs485_tools;
mod slcan_peer;
mod supervision;
#[path = "../support.rs"]
mod support;
mod two_hosts;
mod web;
mod web_command;
mod web_view;
