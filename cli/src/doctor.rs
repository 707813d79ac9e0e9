//! `advee doctor`: checks machine and configuration. Every check is a small function over given facts; the code that
//! gathers them is beside it, or in [`network`] (which only reads) and [`probe`] (which sends and receives).

mod bridge;
mod buffer;
mod bus;
mod devices;
mod entering;
mod finding;
mod guard;
mod lcm_bus;
mod machine;
mod network;
mod probe;
mod real_time;
mod report;
mod tables;
#[cfg(test)]
mod tests;

use super::{Common, Outcome, print};
use crate::style::Style;
use drivers::canbus::{self, SecondWay};
use finding::{Finding, Level};
use host::ports::GpioConfig;
use host::ports::settings::CanInterface;
use robot::config::{self, Config, ConfigError};
use robot::preflight;
use simulator::world::World;
use std::fs;
use std::process::ExitCode;

#[derive(clap::Args)]
pub struct Doctor {
    /// The simulated robot, which needs no devices
    #[arg(long)]
    sim: bool,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
    /// Within a network name space of its own: what a datagram of another computer comes to
    #[arg(long, hide = true)]
    entering: bool,
}

/// A heading with its findings.
type Group = (&'static str, Vec<Finding>);

/// Exit status 0 when nothing fails.
pub fn doctor(common: &Common, command: &Doctor) -> Outcome {
    if command.entering {
        print(entering::inside()?)?;
        return Ok(ExitCode::SUCCESS);
    }
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let capable = |capability| tables::capable(&status, capability);
    let user = user();
    let loaded = common.load(command.sim).and_then(|config| {
        let place = common.place(command.sim);
        let world = if place.sim { config::world(&place.config, None, &place.sets)? } else { World::default() };
        preflight::check_live(&place, &config, &world)?;
        Ok(config)
    });
    let wanted = loaded
        .as_ref()
        .ok()
        .and_then(|config| config.modules.iter().filter_map(|module| module.limits.rt_priority).max());
    let groups: [Group; 4] = [
        ("bus", lcm_bus::check(&common.lcm_url())),
        ("configuration", configuration_group(common, &loaded, &user)),
        ("machine", machine_group(common, wanted, capable, &user)),
        ("real time", real_time::check(wanted, loaded.as_ref().ok().map(|config| &config.robot))),
    ];
    let all = || groups.iter().flat_map(|(_, findings)| findings);
    let count = |level| all().filter(|finding| finding.level == level).count();
    let failed = count(Level::Fail) > 0;
    if command.json {
        let groups: serde_json::Map<_, _> =
            groups.iter().map(|(name, findings)| ((*name).into(), serde_json::json!(findings))).collect();
        print(serde_json::json!({ "ok": !failed, "lcm_url": common.lcm_url(), "checks": groups }))?;
    } else {
        let style = Style::of_stdout();
        let counts = [Level::Fail, Level::Warning, Level::Ok].map(|level| (level, count(level)));
        print(style.text(&groups, &counts).trim_end())?;
    }
    Ok(ExitCode::from(u8::from(failed)))
}

/// The user's name.
fn user() -> String {
    let uid = nix::unistd::geteuid();
    let user = nix::unistd::User::from_uid(uid).ok().flatten();
    user.map_or_else(|| uid.to_string(), |user| user.name)
}

fn configuration_group(common: &Common, loaded: &Result<Config, ConfigError>, user: &str) -> Vec<Finding> {
    let mut findings = devices::configuration(loaded, &common.config_dir());
    let Ok(config) = loaded else { return findings };
    findings.extend(config.robot.can.iter().filter_map(|bus| match &bus.port.interface {
        CanInterface::Socket(name) => devices::can(bus, &devices::Can::gather(name)),
        CanInterface::Slcan(path) => Some(devices::adapter(bus, path, &devices::Device::gather(path), user)),
        CanInterface::Udp { .. } => None,
    }));
    findings.extend(
        config
            .robot
            .rs485
            .iter()
            .filter_map(|bus| devices::serial(bus, &devices::Device::gather(&bus.line.port), user)),
    );
    findings.extend(devices::streams(&config.robot, devices::Device::gather, user));
    findings.extend(config.robot.i2c.iter().filter_map(|bus| devices::i2c(bus, devices::Device::gather, user)));
    findings.extend(config.robot.w1.iter().filter_map(devices::w1));
    let gamepad = config.robot.gamepad.as_ref();
    findings.extend(gamepad.and_then(|gamepad| devices::gamepad(gamepad, devices::Device::gather, user)));
    findings.extend(devices::commands(&config.modules, devices::executable));
    findings.push(second_way(&config.robot));
    findings.push(emergency_stop(&config.robot));
    if let Some(canbus::GpioConfig { chip, line, active_low }) = config.robot.stop.feed_line().cloned() {
        let line = GpioConfig { chip, line, active_low };
        findings.extend(devices::feed_line(&line, devices::Device::gather, GpioConfig::foreign_holder, user));
    }
    findings.extend(guard_findings(&config.robot));
    findings.extend(bridge::check(config, &common.config_dir(), &common.lcm_url()));
    findings
}

/// What the robot's guard can promise.
fn guard_findings(robot: &robot::config::Robot) -> Vec<Finding> {
    let config = robot.guard_config();
    let mut findings = vec![guard::ranging(&config)];
    if let Some(coverage) = guard::coverage(&config) {
        findings.extend([guard::deceleration(&config, &robot.limits, &robot.stop), coverage]);
    }
    findings.extend(guard::fields(&config));
    findings
}

/// What stops the robot if a drive does not brake.
fn second_way(robot: &robot::config::Robot) -> Finding {
    let check = "second way to stop";
    if robot.power.is_some() && robot.stop.second_way == SecondWay::Power {
        return Finding::ok(check, "the power controller cuts the motors' feed");
    }
    if let Some(output) = robot.stop.feed_output() {
        let canbus::OutputConfig { node, index, subindex, .. } = output;
        return Finding::ok(check, format!("node {node} cuts the motors' feed by its object 0x{index:04X}:{subindex}"));
    }
    if let Some(canbus::GpioConfig { chip, line, active_low }) = robot.stop.feed_line() {
        let (cut, chip) = (if *active_low { "high" } else { "low" }, chip.display());
        return Finding::ok(check, format!("line {line} of {chip} cuts the motors' feed at its {cut} level"));
    }
    let why = "a drive that does not brake as commanded is not cut off its feed".into();
    Finding { why, ..Finding::warning(check, "none") }
}

/// What reads the emergency stop.
fn emergency_stop(robot: &robot::config::Robot) -> Finding {
    let check = "emergency stop";
    let line = robot.power.iter().map(|_| "the PAUSE line of the power controller".to_owned());
    let inputs = robot.stop.inputs.iter().map(|input| messages::StopSource::in_words(&input.source()));
    let read: Vec<String> = line.chain(inputs).collect();
    if !read.is_empty() {
        return Finding::ok(check, format!("read: {}", read.join(", ")));
    }
    let why = "one that is pressed must stop the robot without this computer, which does not know of it".into();
    Finding { why, ..Finding::warning(check, "not read: no [power], and no inputs in [stop]") }
}

fn machine_group(common: &Common, wanted: Option<u8>, capable: impl Fn(u32) -> bool, user: &str) -> Vec<Finding> {
    let days =
        std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).map_or(0, |since| since.as_secs() / 86_400);
    // Accurate enough to recognize an unset clock.
    let year = 1970 + (days as f64 / 365.2425) as i64;
    vec![
        machine::real_time(&machine::RealTime::gather(wanted, capable), user),
        machine::clock(&machine::gather_clock(), year),
        machine::governors(&machine::gather_governors()),
        machine::temperatures(&machine::Heat::gather()),
        machine::run_folder(&machine::Folder::gather(&common.run_dir()), user),
    ]
}
