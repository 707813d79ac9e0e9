//! Description of the device itself in a file.

use super::fields::Notes;
use super::ini::{Ini, Line};
use super::number::number;
use alloc::string::String;
use alloc::vec::Vec;

/// `[DeviceInfo]`, `[FileInfo]`, `[Comments]`, `[DummyUsage]`, and `[DeviceComissioning]` of a DCF. What a file leaves
/// empty is `None` or empty here.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Device {
    /// The vendor's name.
    pub vendor_name: String,
    /// 0x1018:1.
    pub vendor: Option<u32>,
    /// The product's name.
    pub product_name: String,
    /// 0x1018:2.
    pub product: Option<u32>,
    /// 0x1018:3.
    pub revision: Option<u32>,
    /// The order code.
    pub order_code: String,
    /// Bit rates, in kbit/s, ascending.
    pub bit_rates: Vec<u16>,
    /// Granularity of its mappings, in bits; 0: they are fixed.
    pub granularity: Option<u8>,
    /// Number of RPDOs.
    pub rpdos: Option<u16>,
    /// Number of TPDOs.
    pub tpdos: Option<u16>,
    /// True if it is an LSS slave.
    pub lss: bool,
    /// True if it can be a simple boot-up master.
    pub boot_up_master: bool,
    /// Codes of the data types that may be mapped as dummies.
    pub dummies: Vec<u16>,
    /// The name of the file.
    pub file_name: String,
    /// Description of the file.
    pub description: String,
    /// The lines of `[Comments]`.
    pub comments: Vec<String>,
    /// Which of the devices it is; only in a DCF.
    pub commissioning: Option<Commissioning>,
}

/// `[DeviceComissioning]` of a DCF; the standard's own spelling, the other one is read too.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Commissioning {
    /// The node id, 1..=127.
    pub node: Option<u8>,
    /// The node's name.
    pub node_name: String,
    /// Bit rate in kbit/s; `None` also if the file has 0.
    pub bit_rate: Option<u16>,
    /// The network's number.
    pub network: Option<u32>,
    /// The network's name.
    pub network_name: String,
    /// True if it manages the network.
    pub manager: bool,
    /// Serial number for LSS.
    pub serial: Option<u32>,
}

const BIT_RATES: [u16; 9] = [10, 20, 50, 100, 125, 250, 500, 800, 1000];

impl Device {
    pub(super) fn read(ini: &Ini<'_>, notes: &mut Notes) -> Self {
        let lines = |name| ini.section(name).map_or(&[][..], |section| ini.lines(section));
        let mut device = Self::default();
        for line in lines("deviceinfo") {
            device.info(line, notes);
        }
        device.bit_rates.sort_unstable();
        device.bit_rates.dedup();
        for line in lines("fileinfo") {
            match () {
                () if line.is("filename") => device.file_name = notes.name(line),
                () if line.is("description") => device.description = notes.name(line),
                () => {}
            }
        }
        for line in lines("dummyusage") {
            let code = line.key.get(..5).filter(|dummy| dummy.eq_ignore_ascii_case("dummy"));
            let code = code.and_then(|_| u16::from_str_radix(&line.key[5..], 16).ok());
            device.dummies.extend(code.filter(|_| flag(line, notes)));
        }
        let comment = |line: &&Line<'_>| line.key.get(..4).is_some_and(|key| key.eq_ignore_ascii_case("line"));
        let comments = lines("comments").iter().filter(|line| !line.is("lines")).filter(comment);
        device.comments = comments.map(|line| String::from(line.value)).collect();
        let commissioning = ini.section("devicecomissioning").or(ini.section("devicecommissioning"));
        device.commissioning = commissioning.map(|section| Commissioning::read(ini.lines(section), notes));
        device
    }

    fn info(&mut self, line: &Line<'_>, notes: &mut Notes) {
        match () {
            () if line.is("vendorname") => self.vendor_name = notes.name(line),
            () if line.is("vendornumber") => self.vendor = field(line, notes),
            () if line.is("productname") => self.product_name = notes.name(line),
            () if line.is("productnumber") => self.product = field(line, notes),
            () if line.is("revisionnumber") => self.revision = field(line, notes),
            () if line.is("ordercode") => self.order_code = notes.name(line),
            () if line.is("granularity") => self.granularity = field(line, notes),
            () if line.is("nrofrxpdo") => self.rpdos = field(line, notes),
            () if line.is("nroftxpdo") => self.tpdos = field(line, notes),
            () if line.is("lss_supported") => self.lss = flag(line, notes),
            () if line.is("simplebootupmaster") => self.boot_up_master = flag(line, notes),
            () => {
                let rate = line.key.split_once('_').filter(|(key, _)| key.eq_ignore_ascii_case("baudrate"));
                let rate = rate.and_then(|(_, rate)| rate.trim().parse().ok());
                let rate = rate.filter(|rate| BIT_RATES.contains(rate));
                self.bit_rates.extend(rate.filter(|_| flag(line, notes)));
            }
        }
    }
}

impl Commissioning {
    fn read(lines: &[Line<'_>], notes: &mut Notes) -> Self {
        let mut all = Self::default();
        for line in lines {
            match () {
                () if line.is("nodeid") => {
                    all.node = field(line, notes).filter(|id| (1..=127).contains(id));
                    if all.node.is_none() {
                        notes.push(line, "not a node id of 1 to 127; none is taken");
                    }
                }
                () if line.is("nodename") => all.node_name = notes.name(line),
                () if line.is("baudrate") => all.bit_rate = field(line, notes).filter(|rate| *rate != 0),
                () if line.is("netnumber") => all.network = field(line, notes),
                () if line.is("networkname") => all.network_name = notes.name(line),
                () if line.is("canopenmanager") => all.manager = flag(line, notes),
                () if line.is("lss_serialnumber") => all.serial = field(line, notes),
                () => {}
            }
        }
        all
    }
}

fn field<T: TryFrom<i128>>(line: &Line<'_>, notes: &mut Notes) -> Option<T> {
    if line.value.is_empty() {
        return None;
    }
    let value = number(line.value).ok().and_then(|(number, _)| T::try_from(number.value).ok());
    if value.is_none() {
        notes.push(line, "expected a number that fits; none is taken");
    }
    value
}

fn flag(line: &Line<'_>, notes: &mut Notes) -> bool {
    field::<u8>(line, notes).is_some_and(|value| value != 0)
}
