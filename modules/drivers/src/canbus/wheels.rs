//! The drives of all wheels. They are commanded together: if one refuses, is lost or does not follow, all stop.

use super::controller::Controller;
use super::drive::Drive;
use super::lines::LineEngine;
use super::net::NodeAt;
use super::propulsion::Propulsion;
use super::servo::Servo;
use super::{Axis, Config, ConfigError, STANDSTILL_MPS};
use base::Instant;
use canopen::NodeConfig;
use kinematics::{PerWheel, WheelState};

/// At least one, in the order of the configuration.
pub(super) struct Wheels(Vec<Propulsion>);

impl Wheels {
    /// `lines`: the devices of the serial lines.
    pub(super) fn new(config: &Config, lines: &[LineEngine]) -> Result<Self, ConfigError> {
        let wheels: Result<Vec<_>, _> = config.wheels.iter().map(|own| Propulsion::new(own, config, lines)).collect();
        wheels.map(Self)
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = &Propulsion> + Clone {
        self.0.iter()
    }

    pub(super) fn iter_mut(&mut self) -> impl Iterator<Item = &mut Propulsion> {
        self.0.iter_mut()
    }

    /// The CANopen drives.
    pub(super) fn drives(&self) -> impl Iterator<Item = &Drive> + Clone {
        self.0.iter().filter_map(Propulsion::drive_ref)
    }

    /// What the CANopen drives move, in the same order.
    pub(super) fn drive_axes(&self) -> impl Iterator<Item = Axis> + Clone {
        self.0.iter().filter(|wheel| wheel.drive_ref().is_some()).map(|wheel| wheel.axis)
    }

    pub(super) fn drives_mut(&mut self) -> impl Iterator<Item = &mut Drive> {
        self.0.iter_mut().filter_map(Propulsion::drive_mut)
    }

    /// The motor controllers without CANopen.
    pub(super) fn controllers(&self) -> impl Iterator<Item = &Controller> + Clone {
        self.0.iter().filter_map(Propulsion::controller)
    }

    pub(super) fn controllers_mut(&mut self) -> impl Iterator<Item = &mut Controller> {
        self.0.iter_mut().filter_map(Propulsion::controller_mut)
    }

    /// The motor controllers on a serial line.
    pub(super) fn controllers_on(&mut self, line: usize) -> impl Iterator<Item = &mut Controller> {
        self.controllers_mut().filter(move |controller| controller.line() == Some(line))
    }

    /// The motor controllers on a CAN bus.
    pub(super) fn controllers_of_bus(&mut self, bus: usize) -> impl Iterator<Item = &mut Controller> {
        let wheels = self.0.iter_mut().filter(move |wheel| wheel.bus == bus);
        wheels.filter_map(Propulsion::controller_mut).filter(|controller| controller.line().is_none())
    }

    /// The wheel whose drive is this node of CANopen.
    pub(super) fn of_mut(&mut self, node: NodeAt) -> Option<&mut Propulsion> {
        self.0.iter_mut().find(|wheel| wheel.is_node(node))
    }

    /// Number of the wheel whose drive is this node of CANopen.
    pub(super) fn place(&self, node: NodeAt) -> Option<usize> {
        self.0.iter().position(|wheel| wheel.is_node(node))
    }

    pub(super) fn get_mut(&mut self, number: usize) -> Option<&mut Propulsion> {
        self.0.get_mut(number)
    }

    pub(super) fn count(&self) -> usize {
        self.0.len()
    }

    /// Configurations of the nodes on a bus.
    pub(super) fn node_configs(&self, bus: usize) -> impl Iterator<Item = NodeConfig> {
        self.0.iter().filter(move |wheel| wheel.bus == bus).filter_map(Propulsion::servo).map(Servo::node_config)
    }

    /// Measured states; NaN where one is unknown.
    pub(super) fn measured(&self) -> PerWheel<WheelState> {
        self.0.iter().map(|wheel| WheelState { speed_mps: wheel.measured(), steering_rad: 0.0 }).collect()
    }

    /// True if all are known to be slower than `limit`, m/s.
    pub(super) fn are_slower(&self, now: Instant, limit: f64) -> bool {
        self.0.iter().all(|wheel| wheel.is_slower(now, limit))
    }

    /// True if each is known to be slower than `limit`, m/s, or cannot be asked.
    pub(super) fn are_slower_or_absent(&self, now: Instant, limit: f64) -> bool {
        self.0.iter().all(|wheel| wheel.is_slower(now, limit) || !wheel.is_up())
    }

    /// True if each is known to stand, or has no power because it gained speed against its brake, and cannot be asked.
    pub(super) fn stand_or_are_cut(&self, now: Instant) -> bool {
        self.0.iter().all(|wheel| wheel.is_slower(now, STANDSTILL_MPS) || wheel.is_cut() && !wheel.is_up())
    }

    /// True if each takes commands: it is booted, or started.
    pub(super) fn are_up(&self) -> bool {
        self.0.iter().all(Propulsion::is_up)
    }

    pub(super) fn are_enabled(&self) -> bool {
        self.0.iter().all(Propulsion::is_enabled)
    }

    /// True if at least one brakes by its quick stop, or may.
    pub(super) fn may_be_stopping(&self) -> bool {
        self.0.iter().any(Propulsion::may_be_stopping)
    }

    pub(super) fn are_quick_stopped(&self) -> bool {
        self.0.iter().all(Propulsion::is_quick_stopped)
    }

    /// Drives each at its speed, m/s; one without a speed stands.
    pub(super) fn drive(&mut self, speeds: &[f64]) {
        for (number, wheel) in self.0.iter_mut().enumerate() {
            wheel.drive(speeds.get(number).copied().unwrap_or(0.0));
        }
    }

    pub(super) fn quick_stop(&mut self) {
        self.0.iter_mut().for_each(Propulsion::quick_stop);
    }

    pub(super) fn switch_off(&mut self) {
        self.0.iter_mut().for_each(Propulsion::switch_off);
    }
}
