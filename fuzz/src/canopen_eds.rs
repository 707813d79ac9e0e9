//! Electronic data sheets and configuration files of CANopen.

use base::Duration;
use canopen::axis::modes::Mode;
use canopen::dictionary::DataType;
use canopen::drives::derive::{Description, Limits, Quirks, brake_output, derive, position_mode, velocity_mode};
use canopen::eds::{Eds, MAX_NAME, MAX_WARNINGS, address, read_concise, write_concise};
use canopen::pdo::Layout;
use canopen::{Master, MasterConfig};

#[rustfmt::skip]
const WORDS: [&str; 56] = [
    "[", "]", "=", "\n", "\r\n", ";", "sub", "Sub0", "sub1", "1000", "1018", "1400", "1600", "1A00", "1800", "2000",
    "0x", "$NODEID", "+", "-", "0", "1", "7", "8", "9", "10", "254", "255", "0x60400010", "0xFFFFFFFF", "Name",
    "Value", "ParameterName", "ObjectType", "DataType", "AccessType", "rw", "ro", "wo", "rww", "const",
    "DefaultValue", "ParameterValue", "LowLimit", "HighLimit", "PDOMapping", "ObjFlags", "CompactSubObj",
    "NrOfEntries", "MandatoryObjects", "DeviceInfo", "DeviceComissioning", "NodeID", "1.5", "\u{e4}", " ",
];

fn check(file: &[u8]) {
    let eds = match Eds::parse(file) {
        Ok(eds) => eds,
        Err(error) => return assert_eq!(error.to_string().lines().count(), 1),
    };
    assert!(eds.warnings().len() <= MAX_WARNINGS);
    let dictionary = eds.dictionary(5);
    for object in eds.objects() {
        let (index, sub) = (object.index, object.sub);
        assert!(object.name.len() <= MAX_NAME);
        assert_eq!(eds.object(index, sub), Some(object));
        match dictionary.read(index, sub) {
            Ok(data) => assert!(object.access.reads() && object.data_type.width().is_none_or(|len| len == data.len())),
            Err(_) => assert!(!object.access.reads()),
        }
    }
    for object in eds.objects().iter().take(8) {
        let key = (object.index, object.sub);
        let name = eds.name(key.0, key.1).expect("it is there").to_string();
        // Unless the name is an address, or another one's too.
        let found = eds.resolve(&name);
        assert!(found.is_none() || found == Some(key) || address(&name) == found, "{name}");
    }
    let writes = eds.configuration(5);
    let again = read_concise(&write_concise(&writes)).expect("what was written");
    let same = again.iter().zip(&writes).all(|(a, b)| (a.index, a.sub, &a.value) == (b.index, b.sub, &b.value));
    assert!(same && again.len() == writes.len());
    check_drive(&eds);
    for record in (0x1400..0x1404).chain(0x1800..0x1804) {
        let layout = eds.pdo(record, 5).and_then(|pdo| Layout::new(&pdo.entries).ok());
        if let Some(layout) = layout.map(|layout| layout.with_names(&eds)) {
            let data: Vec<u8> = (0..layout.len() as u8).collect();
            let items = layout.items().iter().enumerate();
            let values: Vec<_> = items.map(|(at, _)| (at, layout.get(&data, at).expect("long enough"))).collect();
            let packed = layout.pack(values).expect("what was read fits");
            let unused = layout.len() * 8 - layout.bits();
            assert_eq!(packed.len(), data.len());
            if unused == 0 {
                assert_eq!(&packed[..], &data[..]);
            }
        }
    }
}

/// As a drive: refused, or one that a master takes.
fn check_drive(eds: &Eds) {
    let _ = (velocity_mode(eds, 5), position_mode(eds, 5), brake_output(eds));
    for (mode, homing) in [
        (Mode::ProfileVelocity, None),
        (Mode::ProfilePosition, Some(27)),
        (Mode::CyclicVelocity, None),
        (Mode::CyclicPosition, Some(27)),
        (Mode::Interpolated, None),
    ] {
        let description = Description {
            mode,
            per_turn: 1.0,
            gear: None,
            counts_per_turn: None,
            velocity_unit: None,
            limits: Limits { velocity: 1.0, acceleration: 1.0, deceleration: 1.0, quick_stop: 2.0 },
            range: Some([-1.0, 1.0]),
            homing,
            sync: Some(Duration::from_millis(10)),
            setpoints: None,
            master: 127,
            torque: true,
            second_way: true,
            quirks: Quirks::default(),
        };
        match derive(eds, 5, &description) {
            Err(refusal) => assert_eq!(refusal.to_string().lines().count(), 1),
            Ok(drive) => {
                let node = drive.table.node_config("drive", &drive.parameters);
                assert!(Master::new(MasterConfig::default(), &[node]).is_ok());
                assert!(drive.table.pack(u16::MAX, i32::MIN).len() <= 8);
            }
        }
    }
}

// Whole bytes, so that files serve as a corpus: a byte that says what they are, then they.
/// An EDS or DCF file, a concise DCF, or a value as text; the first byte of the input selects which.
///
/// An error has one line; what is parsed can be served, named, mapped and configured, and driven or refused as a drive;
/// its concise form, and a value's text, parse to the same again.
pub fn canopen_eds(input: &[u8]) {
    let Some((what, bytes)) = input.split_first() else { return };
    match what % 4 {
        0 => check(bytes),
        1 => drop(read_concise(bytes)),
        2 => {
            let data_type = DataType::ALL[usize::from(what / 4) % DataType::ALL.len()];
            let Ok(text) = core::str::from_utf8(bytes) else { return };
            if let Ok(data) = data_type.parse(text) {
                let again = data_type.parse(&data_type.show(&data));
                let escaped = matches!(data_type, DataType::Text | DataType::Unicode);
                // The bit pattern of what is no finite number can be written, but is not shown as one.
                let real = matches!(data_type, DataType::F32 | DataType::F64);
                // Reserved bits, and more than a day of milliseconds.
                let time = matches!(data_type, DataType::TimeOfDay | DataType::TimeDifference);
                assert!(escaped || real || time || again == Ok(data), "{} {text}", data_type.name());
            }
            drop(data_type.show(bytes));
        }
        _ => {
            let words = bytes.iter().map(|byte| WORDS[usize::from(*byte) % WORDS.len()]);
            check(words.collect::<String>().as_bytes());
        }
    }
}
