//! Settings of an EIA-485 bus that its drivers share: the check of its frames, and the boards on it.

use base::Duration;
use rs485::crc::Crc8;
use settings::{Table, settings};

settings! {
    /// Keys of `[rs485.<name>]` for the drivers.
    #[derive(Clone, Debug, PartialEq)]
    pub struct BusConfig {
        /// Check of the frames; absent: CRC-8/SAE-J1850.
        crc: Crc = table;
        /// Boards.
        nodes: Vec<Node> = [];
    }
    check BusConfig::check;
}

settings! {
    /// `crc = { … }`: the check of the frames, in the words of the Rocksoft model.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub struct Crc {
        /// Polynomial without the leading 1.
        polynomial: u8 = 0x1D, 1..=255;
        /// Initial value.
        initial: u8 = 0xFF, 0..=255;
        /// Both input and output are reflected.
        reflected: bool = false;
        /// Final exclusive or.
        final_xor: u8 = 0xFF, 0..=255;
    }
}

settings! {
    /// `[[rs485.<name>.nodes]]`: a board.
    #[derive(Clone, Debug, PartialEq)]
    pub struct Node {
        /// Address.
        address: u8 = required, 1..=254;
        /// Kind of board.
        driver as kind: Kind = required;
        /// Name in messages and reports; absent: driver and address.
        name: String = derived format!("{}_{address:02x}", kind.name());
        /// Rate of requests. A rate beyond the wire's limit gives what the wire gives.
        rate_hz was rate: f64 = required, 0.1..=100.0;
        /// Longest time to an answer.
        timeout_s as timeout: Duration = 0.02, 0.001..=1.0;
        /// Least supply voltage of the board that is not reported; only of an `sbs1`, which measures it.
        supply_min_v: f64 = 4.5, 1.0..=60.0;
        /// Greatest one.
        supply_max_v: f64 = 5.5, 1.0..=60.0;
    }
    check Node::check;
}

settings! {
    /// Boards with a driver.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Kind {
        /// BR-SD1, distances.
        Sd1 = "sd1",
        /// BR-SO1, odometry. One on the bus at most.
        So1 = "so1",
        /// BR-SBS1, beacon scanner.
        Sbs1 = "sbs1",
        /// BR-PSC1, power controller.
        Psc1 = "psc1",
    }
}

impl BusConfig {
    fn check(&self, table: &Table<'_>) {
        let of = "one that no other node of the bus has";
        table.unique("nodes", "address", &self.nodes.iter().map(|node| node.address).collect::<Vec<_>>(), of);
        table.unique("nodes", "name", &self.nodes.iter().map(|node| &node.name).collect::<Vec<_>>(), of);
        let odometry = self.nodes.iter().enumerate().filter(|(_, node)| node.kind == Kind::So1);
        for item in odometry.skip(1).filter_map(|(n, _)| table.item("nodes", n)) {
            item.refuse("driver", "no second so1 on the bus");
        }
    }
}

impl Node {
    fn check(&self, table: &Table<'_>) {
        for key in ["supply_min_v", "supply_max_v"].into_iter().filter(|key| table.has(key)) {
            if self.kind != Kind::Sbs1 {
                table.refuse(key, "nothing: only an sbs1 measures its supply");
            } else if self.supply_min_v >= self.supply_max_v {
                table.refuse(key, "a least voltage below the greatest one");
            }
        }
    }
}

impl From<Crc> for Crc8 {
    fn from(crc: Crc) -> Self {
        Self { poly: crc.polynomial, init: crc.initial, reflected: crc.reflected, xorout: crc.final_xor }
    }
}
