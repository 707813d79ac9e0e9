//! The CAN buses of the drives: each has a port, a master of CANopen and a state of its own. All drives of all of them
//! are one body.

use super::bus::Bus;
use super::config::{Config, FurtherBus};
use super::{Canbus, SDO_TIMEOUT, SECOND_MASTER_TIMEOUT};
use base::{Fault, Instant, Severity};
use canopen::{Master, MasterConfig, NodeConfig};
use module::{Actions, PortId};

/// Distance of the numbers by which `LL_CMD_SDO` names the nodes of two buses.
const NODES_OF_BUS: i32 = 1000;

/// The number by which `LL_CMD_SDO` and `LL_DATA_SDO` name a node on a bus: its id, and 1000 more for each bus before
/// its own; `bus`: from 0, in the order of the module's buses.
#[must_use]
pub fn node_number(bus: usize, id: u8) -> i32 {
    let bus = i32::try_from(bus).unwrap_or(i32::MAX);
    bus.saturating_mul(NODES_OF_BUS).saturating_add(id.into())
}

/// A node, on which bus: ids are unique on a bus alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct NodeAt {
    /// Number of the bus, in the order of the module's buses.
    pub(super) bus: usize,
    pub(super) id: u8,
}

impl NodeAt {
    /// The node that `LL_CMD_SDO` names so: its id, and 1000 more for each bus before its own.
    pub(super) fn of_request(node: i32) -> Option<Self> {
        let bus = usize::try_from(node.div_euclid(NODES_OF_BUS)).ok()?;
        let id = u8::try_from(node.rem_euclid(NODES_OF_BUS)).ok().filter(|id| (1..=127).contains(id))?;
        Some(Self { bus, id })
    }
}

/// A CAN bus.
pub(super) struct Net {
    /// The bus; none: there is no CAN bus at all, and all drives are on serial lines.
    pub(super) bus: Option<Bus>,
    pub(super) port: PortId,
    pub(super) master: Master,
    /// There are nodes of CANopen. Without them the master gets neither frames nor time, and sends nothing.
    pub(super) has_canopen: bool,
}

impl Net {
    /// The first bus, or none.
    pub(super) fn first(config: &Config, nodes: &[NodeConfig]) -> Result<Self, canopen::master::ConfigError> {
        let &Config { node_id: id, bitrate: bit_rate, sync, time, .. } = config;
        let master = MasterConfig { id, bit_rate, sync, time, sdo_timeout: SDO_TIMEOUT, ..MasterConfig::default() };
        Ok(Self {
            bus: config.bus.as_ref().map(|bus| Bus::new(bus, bit_rate)),
            port: PortId(0),
            master: Master::new(master, nodes)?,
            has_canopen: !nodes.is_empty(),
        })
    }

    /// A further bus; `number`: from 1.
    pub(super) fn further(
        own: &FurtherBus,
        number: usize,
        port: PortId,
        nodes: &[NodeConfig],
    ) -> Result<Self, canopen::master::ConfigError> {
        let &FurtherBus { node_id: id, bitrate: bit_rate, sync, time, .. } = own;
        let tickets = u8::try_from(number).unwrap_or(u8::MAX);
        let usual = MasterConfig::default();
        let master = MasterConfig { id, bit_rate, sync, time, sdo_timeout: SDO_TIMEOUT, tickets, ..usual };
        Ok(Self {
            bus: Some(Bus::new(&own.bus, bit_rate)),
            port,
            master: Master::new(master, nodes)?,
            has_canopen: !nodes.is_empty(),
        })
    }

    /// Its name; empty without a bus.
    pub(super) fn name(&self) -> &str {
        self.bus.as_ref().map_or("", Bus::name)
    }

    /// True if there is a bus, and it is up.
    pub(super) fn is_up(&self) -> bool {
        self.bus.as_ref().is_some_and(Bus::is_up)
    }

    /// True if its master runs: it has nodes, and the bus is up.
    pub(super) fn is_served(&self) -> bool {
        self.is_up() && self.has_canopen
    }

    /// True unless another master has been seen on it recently.
    pub(super) fn is_alone(&self) -> bool {
        self.bus.as_ref().is_none_or(Bus::is_alone)
    }
}

impl Canbus {
    /// Name of a CAN bus; empty without one.
    pub(super) fn bus_name(&self, bus: usize) -> &str {
        self.nets.get(bus).map_or("", Net::name)
    }

    /// The bus at a port.
    pub(super) fn net_at(&self, port: PortId) -> Option<usize> {
        self.nets.iter().position(|net| net.port == port)
    }

    /// Words for a node that is not configured; without its bus on the first one.
    pub(super) fn node_in_words(&self, node: NodeAt) -> String {
        match node {
            NodeAt { id, .. } if self.nets.len() == 1 => format!("node {id}"),
            NodeAt { bus, id } => format!("node {id} on {}", self.bus_name(bus)),
        }
    }

    /// Another program commands nodes of a bus.
    pub(super) fn on_second_master(&mut self, now: Instant, bus: usize, by: impl std::fmt::Display, out: &mut Actions) {
        let name = self.bus_name(bus);
        let message = format!("another program commands the drives on {name} ({by}): the robot stops");
        out.raise(Severity::Error, Fault::SecondMaster, name, message);
        if let Some(bus) = self.nets.get_mut(bus).and_then(|net| net.bus.as_mut()) {
            bus.set_second_master(now + SECOND_MASTER_TIMEOUT);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_request_names_the_bus_by_its_thousands() {
        let of = |node| NodeAt::of_request(node).map(|at| (at.bus, at.id));
        assert_eq!([1, 127, 1001, 2127].map(of), [Some((0, 1)), Some((0, 127)), Some((1, 1)), Some((2, 127))]);
        assert_eq!([0, 128, 999, 1000, 1128, -1, -999, i32::MIN].map(of), [None; 8]);
        assert_eq!(of(i32::MAX), None);
        assert_eq!(of(node_number(3, 20)), Some((3, 20)));
    }
}
