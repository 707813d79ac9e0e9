//! Objects that the standards define, by name: for nodes without an electronic data sheet.

use canopen::dictionary::DataType::{self, *};

/// Index, sub-index, type, name (CiA 301 v4.02, 7.5; CiA 402-2, 5 to 15).
#[rustfmt::skip]
const OBJECTS: &[(u16, u8, DataType, &str)] = &[
    (0x1000, 0, U32, "Device type"),
    (0x1001, 0, U8, "Error register"),
    (0x1002, 0, U32, "Manufacturer status register"),
    (0x1003, 0, U8, "Pre-defined error field"),
    (0x1005, 0, U32, "COB-ID SYNC"),
    (0x1006, 0, U32, "Communication cycle period"),
    (0x1007, 0, U32, "Synchronous window length"),
    (0x1008, 0, Text, "Manufacturer device name"),
    (0x1009, 0, Text, "Manufacturer hardware version"),
    (0x100A, 0, Text, "Manufacturer software version"),
    (0x100C, 0, U16, "Guard time"),
    (0x100D, 0, U8, "Life time factor"),
    (0x1010, 0, U8, "Store parameters"),
    (0x1010, 1, U32, "Save all parameters"),
    (0x1011, 0, U8, "Restore default parameters"),
    (0x1011, 1, U32, "Restore all default parameters"),
    (0x1012, 0, U32, "COB-ID TIME"),
    (0x1014, 0, U32, "COB-ID EMCY"),
    (0x1015, 0, U16, "Inhibit time EMCY"),
    (0x1016, 0, U8, "Consumer heartbeat time"),
    (0x1017, 0, U16, "Producer heartbeat time"),
    (0x1018, 0, U8, "Identity"),
    (0x1018, 1, U32, "Vendor ID"),
    (0x1018, 2, U32, "Product code"),
    (0x1018, 3, U32, "Revision number"),
    (0x1018, 4, U32, "Serial number"),
    (0x1019, 0, U8, "Synchronous counter overflow value"),
    (0x1020, 0, U8, "Verify configuration"),
    (0x1020, 1, U32, "Configuration date"),
    (0x1020, 2, U32, "Configuration time"),
    (0x1029, 0, U8, "Error behaviour"),
    (0x1029, 1, U8, "Communication error"),
    (0x1F50, 1, Domain, "Program data"),
    (0x1F51, 1, U8, "Program control"),
    (0x1F56, 1, U32, "Program software identification"),
    (0x6007, 0, I16, "Abort connection option code"),
    (0x603F, 0, U16, "Error code"),
    (0x6040, 0, U16, "Controlword"),
    (0x6041, 0, U16, "Statusword"),
    (0x605A, 0, I16, "Quick stop option code"),
    (0x605B, 0, I16, "Shutdown option code"),
    (0x605C, 0, I16, "Disable operation option code"),
    (0x605D, 0, I16, "Halt option code"),
    (0x605E, 0, I16, "Fault reaction option code"),
    (0x6060, 0, I8, "Modes of operation"),
    (0x6061, 0, I8, "Modes of operation display"),
    (0x6062, 0, I32, "Position demand value"),
    (0x6063, 0, I32, "Position actual internal value"),
    (0x6064, 0, I32, "Position actual value"),
    (0x6065, 0, U32, "Following error window"),
    (0x6066, 0, U16, "Following error time out"),
    (0x6067, 0, U32, "Position window"),
    (0x6068, 0, U16, "Position window time"),
    (0x6069, 0, I32, "Velocity sensor actual value"),
    (0x606B, 0, I32, "Velocity demand value"),
    (0x606C, 0, I32, "Velocity actual value"),
    (0x606D, 0, U16, "Velocity window"),
    (0x606E, 0, U16, "Velocity window time"),
    (0x606F, 0, U16, "Velocity threshold"),
    (0x6070, 0, U16, "Velocity threshold time"),
    (0x6071, 0, I16, "Target torque"),
    (0x6072, 0, U16, "Max torque"),
    (0x6073, 0, U16, "Max current"),
    (0x6074, 0, I16, "Torque demand"),
    (0x6075, 0, U32, "Motor rated current"),
    (0x6076, 0, U32, "Motor rated torque"),
    (0x6077, 0, I16, "Torque actual value"),
    (0x6078, 0, I16, "Current actual value"),
    (0x6079, 0, U32, "DC link circuit voltage"),
    (0x607A, 0, I32, "Target position"),
    (0x607B, 1, I32, "Min position range limit"),
    (0x607B, 2, I32, "Max position range limit"),
    (0x607C, 0, I32, "Home offset"),
    (0x607D, 1, I32, "Min position limit"),
    (0x607D, 2, I32, "Max position limit"),
    (0x607E, 0, U8, "Polarity"),
    (0x607F, 0, U32, "Max profile velocity"),
    (0x6080, 0, U32, "Max motor speed"),
    (0x6081, 0, U32, "Profile velocity"),
    (0x6082, 0, U32, "End velocity"),
    (0x6083, 0, U32, "Profile acceleration"),
    (0x6084, 0, U32, "Profile deceleration"),
    (0x6085, 0, U32, "Quick stop deceleration"),
    (0x6086, 0, I16, "Motion profile type"),
    (0x6087, 0, U32, "Torque slope"),
    (0x608F, 1, U32, "Encoder increments"),
    (0x608F, 2, U32, "Motor revolutions of the encoder"),
    (0x6091, 1, U32, "Motor shaft revolutions"),
    (0x6091, 2, U32, "Driving shaft revolutions"),
    (0x6092, 1, U32, "Feed"),
    (0x6092, 2, U32, "Shaft revolutions of the feed"),
    (0x6098, 0, I8, "Homing method"),
    (0x6099, 1, U32, "Speed during search for switch"),
    (0x6099, 2, U32, "Speed during search for zero"),
    (0x609A, 0, U32, "Homing acceleration"),
    (0x60B0, 0, I32, "Position offset"),
    (0x60B1, 0, I32, "Velocity offset"),
    (0x60B2, 0, I16, "Torque offset"),
    (0x60C1, 1, I32, "Interpolation data record"),
    (0x60C2, 1, U8, "Interpolation time period value"),
    (0x60C2, 2, I8, "Interpolation time index"),
    (0x60F4, 0, I32, "Following error actual value"),
    (0x60FD, 0, U32, "Digital inputs"),
    (0x60FE, 1, U32, "Physical outputs"),
    (0x60FE, 2, U32, "Output mask"),
    (0x60FF, 0, I32, "Target velocity"),
    (0x6402, 0, U16, "Motor type"),
    (0x6502, 0, U32, "Supported drive modes"),
];

/// Name and type of an object; none when no standard defines it.
pub fn object(index: u16, sub: u8) -> Option<(String, DataType)> {
    if let Ok(at) = OBJECTS.binary_search_by_key(&(index, sub), |(index, sub, _, _)| (*index, *sub)) {
        let (_, _, data_type, name) = OBJECTS[at];
        return Some((name.into(), data_type));
    }
    let pdo = |first: u16| index - first + 1;
    Some(match (index, sub) {
        (0x1003, sub) => (format!("Error {sub}"), U32),
        (0x1016, sub) => (format!("Heartbeat consumer {sub}"), U32),
        (0x1400..=0x15FF, sub) => record(format!("RPDO{}", pdo(0x1400)), sub)?,
        (0x1600..=0x17FF, sub) => mapping(format!("RPDO{}", pdo(0x1600)), sub),
        (0x1800..=0x19FF, sub) => record(format!("TPDO{}", pdo(0x1800)), sub)?,
        (0x1A00..=0x1BFF, sub) => mapping(format!("TPDO{}", pdo(0x1A00)), sub),
        _ => return None,
    })
}

fn record(pdo: String, sub: u8) -> Option<(String, DataType)> {
    let (name, data_type) = match sub {
        0 => ("parameters", U8),
        1 => ("COB-ID", U32),
        2 => ("transmission type", U8),
        3 => ("inhibit time", U16),
        5 => ("event timer", U16),
        6 => ("SYNC start value", U8),
        _ => return None,
    };
    Some((format!("{pdo} {name}"), data_type))
}

fn mapping(pdo: String, sub: u8) -> (String, DataType) {
    if sub == 0 { (format!("{pdo} mapped objects"), U8) } else { (format!("{pdo} mapped object {sub}"), U32) }
}

/// The object of a name, in which case, spaces, dashes and underscores do not count.
pub fn resolve(text: &str) -> Option<(u16, u8)> {
    let plain = |text: &str| -> String {
        text.chars().filter(|c| !matches!(c, ' ' | '-' | '_')).flat_map(char::to_lowercase).collect()
    };
    let wanted = plain(text);
    let found = OBJECTS.iter().find(|(_, _, _, name)| plain(name) == wanted);
    found.map(|(index, sub, _, _)| (*index, *sub))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_sorted_and_its_names_are_of_one_object_each() {
        assert!(OBJECTS.windows(2).all(|pair| (pair[0].0, pair[0].1) < (pair[1].0, pair[1].1)));
        let mut names: Vec<&str> = OBJECTS.iter().map(|object| object.3).collect();
        names.sort_unstable();
        assert!(names.windows(2).all(|pair| pair[0] != pair[1]));
    }

    #[test]
    fn records_are_named_by_rule() {
        let name = |index, sub| object(index, sub).map(|(name, _)| name);
        assert_eq!(name(0x1403, 1).as_deref(), Some("RPDO4 COB-ID"));
        assert_eq!(name(0x1A00, 2).as_deref(), Some("TPDO1 mapped object 2"));
        assert_eq!(object(0x1016, 1).map(|(_, data_type)| data_type), Some(U32));
        assert_eq!((name(0x1800, 4), name(0x2000, 0)), (None, None));
        assert_eq!(resolve("control-word"), Some((0x6040, 0)));
    }
}
