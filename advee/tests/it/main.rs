//! Whole robot as used from the shell, live: one binary, so that everything is linked once. Tests in virtual time, and
//! those that the documentation names by `--test`, are separate binaries.

mod action;
mod bad_input;
mod bench_can;
mod bench_jitter;
mod bridge;
mod can_tools;
mod canopen_peers;
#[path = "../support/command.rs"]
mod command;
mod configurations;
mod drive;
mod gamepad;
mod gym;
mod hostile;
// The hosts come from the tests of the crate that implements the bus.
#[path = "../../../foundation/lcm/tests/common/hosts.rs"]
mod hosts;
mod i2c_tools;
mod lcm_gen;
mod lcm_hub;
mod lcm_tools;
mod leftovers;
mod lidar_line;
mod lidar_tools;
#[path = "../support/log.rs"]
mod log;
mod log_peers;
mod log_tools;
mod logger;
mod no_filter;
mod operate;
#[path = "../support/operator.rs"]
mod operator;
#[path = "../support/page.rs"]
mod page;
mod peers;
mod plan;
mod ros2_actions;
mod ros2_examples;
mod ros2_hashes;
mod ros2_lifecycle;
mod ros2_peers;
mod ros2_record;
mod rs485_tools;
mod slcan_peer;
mod speed;
mod supervision;
#[path = "../support.rs"]
mod support;
mod ts7800;
mod two_hosts;
mod users;
mod web;
mod web_command;
mod web_view;
