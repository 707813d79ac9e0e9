//! The files of others, and what they taught. Which file is whose: `eds/others/README.md`.

use super::*;
use crate::Abort;
use crate::master::ConfigWrite;
use crate::pdo::{Layout, Mapped};
use std::format;
use std::string::ToString;
use std::vec::Vec;

macro_rules! file {
    ($name:literal) => {
        ($name, include_bytes!(concat!("../../eds/", $name)).as_slice())
    };
}

const EPOS4: &[u8] = include_bytes!("../../eds/others/maxon_epos4_50_15_node1.dcf");
const SAMPLE: &[u8] = include_bytes!("../../eds/others/python_canopen_sample.eds");
const FIBER: &[u8] = include_bytes!("../../eds/others/lely_coapp_fiber_master.dcf");
const TYPES: &[u8] = include_bytes!("../../eds/others/python_canopen_datatypes.eds");

fn eds(file: &[u8]) -> Eds {
    Eds::parse(file).unwrap_or_else(|error| panic!("{error}"))
}

/// A file with one object of these lines.
fn object(lines: &str) -> Result<Eds, Error> {
    Eds::parse(format!("[ManufacturerObjects]\nSupportedObjects=1\n1=0x2000\n[2000]\n{lines}\n").as_bytes())
}

fn notes(eds: &Eds) -> Vec<&str> {
    eds.warnings().iter().map(|note| note.text).collect()
}

#[test]
fn all_files_are_read_and_served() {
    for ((name, file), objects, warnings) in [
        (file!("epos_sim.eds"), 193, 1),
        (file!("icla_sim.eds"), 184, 1),
        (file!("others/canopennode_DS301_profile.eds"), 170, 0),
        (file!("others/canopennode_demoDevice.eds"), 282, 0),
        (file!("others/lely_co_nmt_slave.dcf"), 17, 0),
        (file!("others/lely_coapp_fiber_master.dcf"), 170, 0),
        (file!("others/maxon_epos4_50_15_node1.dcf"), 554, 0),
        (file!("others/python_canopen_datatypes.eds"), 28, 1),
        (file!("others/python_canopen_sample.eds"), 136, 45),
        (file!("others/ros2_cia402_slave.eds"), 154, 0),
    ] {
        let eds = eds(file);
        assert_eq!((eds.objects().len(), eds.warnings().len()), (objects, warnings), "{name}");
        let dictionary = eds.dictionary(5);
        for object in eds.objects() {
            let (index, sub) = (object.index, object.sub);
            let read = dictionary.read(index, sub);
            assert_eq!(read.is_ok(), object.access.reads(), "{name} {index:04X}:{sub}");
            assert_eq!(dictionary.check_write(index, sub, None).is_ok(), object.access.writes(), "{name} {index:04X}");
            assert!(eds.name(index, sub).is_some_and(|name| !name.to_string().is_empty()), "{name} {index:04X}:{sub}");
        }
    }
}

#[test]
fn a_dictionary_has_defaults_access_and_limits_of_its_file() {
    let mut dictionary = eds(SAMPLE).dictionary(5);
    assert_eq!((dictionary.get(0x1403, 1), dictionary.get(0x1A03, 2)), (Some(0x505), Some(0x606C_0020)));
    assert_eq!(dictionary.get(0x1018, 1), Some(1), "not writable: the value of the DCF");
    assert_eq!(&*dictionary.read(0x1008, 0).unwrap(), b"TEST DEVICE");
    assert_eq!(&*dictionary.read(0x3002, 0).unwrap(), &5.2_f32.to_le_bytes());
    for (index, data, expected) in [
        (0x3023, &[0x9B, 0xFF][..], Err(Abort::TOO_LOW)),
        (0x3023, &[0x9C, 0xFF], Ok(())),
        (0x3030, &[0, 0, 0, 0], Err(Abort::TOO_HIGH)),
        (0x3030, &[0, 0, 0, 0x80], Ok(())),
        (0x3031, &[0xFE, 0xFF, 0xFF], Err(Abort::TOO_LOW)),
        (0x3034, &[1, 0, 0, 0, 0, 0, 0], Err(Abort::TOO_HIGH)),
        (0x3040, &[0xF6, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF], Ok(())),
        (0x3040, &[0xF5, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF], Err(Abort::TOO_LOW)),
    ] {
        assert_eq!(dictionary.write(index, 0, data), expected, "{index:04X} {data:02X?}");
    }
    assert!(dictionary.find_mappable(0x6040, 0, 16, true).is_err());
    assert!(dictionary.find_mappable(0x2001, 0, 16, true).is_ok());
    let fiber = eds(FIBER).dictionary(2);
    let maps = |index, received| fiber.find_mappable(index, 1, 32, received).is_ok();
    assert_eq!([maps(0x2000, true), maps(0x2000, false)], [true, false], "rww");
    assert_eq!([maps(0x2200, true), maps(0x2200, false)], [false, true], "rwr");
}

#[test]
fn every_data_type_has_its_default() {
    let eds = eds(TYPES);
    let shown = |index| {
        let object = eds.object(index, 0).unwrap();
        object.data_type.show(&object.default.as_ref().unwrap().data(1))
    };
    assert_eq!((&*shown(0x2008), &*shown(0x2011), &*shown(0x200A)), ("1.2", "1.6", "AB CD"));
    assert_eq!((&*shown(0x200B), &*shown(0x2009), &*shown(0x200F)), ("abc✓", "ABCD", "40 41 42 43 44"));
    assert_eq!(eds.objects().iter().filter(|object| object.index >= 0x2000).count(), 23);
}

#[test]
fn objects_are_found_by_address_and_by_name() {
    let eds = eds(EPOS4);
    for (text, expected) in [
        ("0x6041", Some((0x6041, 0))),
        ("6041", Some((0x6041, 0))),
        ("0x1018:1", Some((0x1018, 1))),
        ("1018:0x0A", Some((0x1018, 10))),
        ("1018sub1", Some((0x1018, 1))),
        ("0x1F81SubA", Some((0x1F81, 10))),
        ("controlword", Some((0x6040, 0))),
        ("Target-Velocity", Some((0x60FF, 0))),
        ("identity object.Vendor ID", Some((0x1018, 1))),
        ("Identity_Object", Some((0x1018, 0))),
        ("vendor id", None),
        ("", None),
        ("0x", None),
        ("0x1018:", None),
        ("0x1018:256", None),
        ("0x1018:+1", None),
        ("1018sub", None),
        ("0x60411", None),
        ("+104", None),
        ("éé", None),
    ] {
        assert_eq!(eds.resolve(text), expected, "{text}");
    }
    assert_eq!(eds.name(0x6040, 0).unwrap().to_string(), "Controlword");
    assert_eq!(eds.name(0x6040, 1), None);
}

#[test]
fn a_name_that_two_objects_have_is_nobodys() {
    let file = b"[2000]\nParameterName=Gain\nDataType=5\nAccessType=rw\nDenotation=left\n
        [2001]\nParameterName=GAIN\nDataType=5\nAccessType=rw\n";
    let eds = eds(file);
    assert_eq!((eds.resolve("gain"), eds.resolve("Left")), (None, Some((0x2000, 0))));
}

#[test]
fn compact_arrays_are_written_out() {
    let eds = eds(SAMPLE);
    assert_eq!(eds.name(0x3004, 2).unwrap().to_string(), "Sensor Status.Sensor Status 2");
    assert_eq!(eds.name(0x3006, 24).unwrap().sub, Some("Valve 1 % Open24"));
    assert_eq!((eds.dictionary(1).get(0x3004, 0), eds.dictionary(1).get(0x3004, 3)), (Some(3), Some(3)));
    assert_eq!((eds.object(0x3006, 25), eds.object(0x3006, 24).unwrap().data_type), (None, DataType::F32));
    let writes = Eds::parse(FIBER).unwrap().configuration(3);
    let value = |index, sub| writes.iter().rfind(|write| (write.index, write.sub) == (index, sub)).map(|w| &*w.value);
    assert_eq!(value(0x1016, 1), Some(&[0x00, 0x04, 0x7F, 0x00][..]));
    assert_eq!(value(0x1F81, 127), Some(&[5, 0, 0, 0][..]));
    assert_eq!(value(0x1FD0, 1), Some(&0x0024_0001_2003_007F_u64.to_le_bytes()[..]));
}

/// What a configured EPOS4 refuses when the procedure is not kept is what our node refuses.
#[test]
fn a_configuration_obeys_the_remapping_procedure() {
    let eds = eds(EPOS4);
    let node = eds.device().commissioning.as_ref().and_then(|device| device.node).unwrap();
    let writes = eds.configuration(node);
    let first: Vec<_> = writes.iter().take(6).map(|w| (w.index, w.sub, w.value.bits().unwrap())).collect();
    assert_eq!(
        first,
        [
            (0x1400, 1, 0x8000_0201),
            (0x1600, 0, 0),
            (0x1600, 1, 0x6040_0010),
            (0x1600, 2, 0x60FF_0020),
            (0x1600, 0, 2),
            (0x1400, 2, 1),
        ]
    );
    assert_eq!((writes[6].index, writes[6].sub, writes[6].value.bits()), (0x1400, 1, Some(0x201)));
    assert!(writes.iter().all(|write| ![0x1003, 0x1010, 0x1011, 0x6040].contains(&write.index)));
    let mut dictionary = eds.dictionary(node);
    for ConfigWrite { index, sub, value, .. } in &writes {
        assert_eq!(dictionary.write(*index, *sub, value), Ok(()), "{index:04X}:{sub} {value:?}");
    }
    // Everything that may be written is as the file wants it, and a second configuration would say the same.
    for object in eds.objects().iter().filter(|object| object.access.writes() && !object.refuses_write) {
        let Some(wanted) = object.parameter.as_ref().filter(|_| object.index != 0x6040) else { continue };
        let command = matches!(object.index, 0x1003 | 0x1010 | 0x1011 | 0x1F51);
        // Its TPDO4 carries nothing, whatever its entries say.
        let command = command || (object.index == 0x1A03 && object.sub > 0);
        let found = dictionary.read(object.index, object.sub);
        assert!(command || found.is_err() || found.as_ref() == Ok(&wanted.data(node)), "{:04X}", object.index);
    }
    assert_eq!(read_concise(&write_concise(&writes)).unwrap(), writes);
    assert!(Eds::parse(TYPES).unwrap().configuration(1).is_empty(), "an EDS configures nothing");
}

#[test]
fn a_pdo_of_which_only_the_type_differs_keeps_its_mapping() {
    let file = "[1800]\nObjectType=9\n[1800sub1]\nDataType=7\nAccessType=rw\nDefaultValue=$NODEID+0x180\n
        [1800sub2]\nDataType=5\nAccessType=rw\nDefaultValue=255\nParameterValue=1\n
        [1A00]\nObjectType=9\n[1A00sub0]\nDataType=5\nAccessType=rw\nDefaultValue=1\n
        [1A00sub1]\nDataType=7\nAccessType=rw\nDefaultValue=0x60410010\n";
    let eds = eds(file.as_bytes());
    let expected = [
        ConfigWrite::new(0x1800, 1, 0x8000_0183_u32),
        ConfigWrite::new(0x1800, 2, 1_u8),
        ConfigWrite::new(0x1800, 1, 0x183_u32),
    ];
    assert_eq!(eds.configuration(3), expected);
    let pdo = eds.pdo(0x1800, 3).unwrap();
    assert_eq!((pdo.id(), pdo.kind, &pdo.entries[..]), (Some(0x183), 1, &[0x6041_0010][..]));
    assert_eq!(eds.pdo(0x1801, 3), None);
}

#[test]
fn a_layout_takes_names_and_types_from_the_file() {
    let eds = eds(EPOS4);
    let entry = |index, bits| Mapped { index, sub: 0, bits }.entry();
    let layout = Layout::new(&[entry(0x6040, 16), entry(0x60FF, 32), entry(0x0005, 8)]).unwrap().with_names(&eds);
    let data = layout.pack([("controlword", 15), ("target velocity", -1500)]).unwrap();
    assert_eq!(&*data, &[0x0F, 0x00, 0x24, 0xFA, 0xFF, 0xFF, 0]);
    assert_eq!(layout.get(&data, "Target velocity"), Some(-1500));
    assert_eq!(layout.unpack(&data).unwrap().count(), 2);
}

#[test]
fn the_device_is_described() {
    let eds = eds(EPOS4);
    let device = eds.device();
    assert_eq!(
        (device.vendor, device.product, &*device.vendor_name),
        (Some(0xFB), Some(0x6552_0000), "maxon motor ag")
    );
    assert_eq!((&device.bit_rates[..2], device.lss, device.tpdos), (&[20, 50][..], true, Some(4)));
    assert_eq!((device.comments.len(), &*device.comments[1]), (4, "Hardware Version:    0x6552"));
    let commissioning = device.commissioning.as_ref().unwrap();
    assert_eq!((commissioning.node, commissioning.serial), (Some(1), Some(0x2900_1321)));
    let empty = Eds::parse(include_bytes!("../../eds/others/canopennode_DS301_profile.eds")).unwrap();
    assert_eq!((empty.device().vendor, empty.device().product, empty.device().rpdos), (None, None, Some(4)));
    let twice = b"[DeviceCommissioning]\nNodeID=0x85\n[2000]\nDataType=5\nAccessType=rw\n";
    let odd = Eds::parse(twice).unwrap();
    assert_eq!(odd.device().commissioning.as_ref().and_then(|device| device.node), None);
    assert_eq!(notes(&odd)[0], "not a node id of 1 to 127; none is taken");
}

#[test]
fn what_vendors_write_differently_is_tolerated_and_told() {
    for (lines, expected) in [
        ("Parameter Name = x \nDATATYPE=0x05\nAccessType=RW\nDefaultValue=010", &[][..]),
        ("DataType=5\nAccessType=rw\nDefaultValue=1 ; one", &["a comment behind the value is left out"]),
        ("DataType=5\nAccessType=rw\nDefaultValue=256", &["not a value of its data type; no default is taken"]),
        ("DataType=5\nAccessType=rw\nHighLimit=x", &["not a value of its data type; no limit is taken"]),
        (
            "DataType=5\nAccessType=rw\nLowLimit=2\nHighLimit=1",
            &["its LowLimit is above its HighLimit; neither is taken"],
        ),
        ("DataType=5", &["no AccessType of CiA 306; taken as ro"]),
        ("AccessType=rw", &["no data type of CiA 301; taken as DOMAIN"]),
        ("DataType=0x40\nAccessType=rw", &["no data type of CiA 301; taken as DOMAIN"]),
        ("ObjectType=2", &[]),
        ("ObjectType=77\nDataType=5\nAccessType=rw", &["no object type of CiA 301; left out"]),
        ("DataType=5\nDataType=6\nAccessType=rw", &["a second value; the first one counts"]),
        ("DataType=5\nAccessType=rw\nPDOMapping=maybe", &["expected a number; left out"]),
        ("DataType=5\nAccessType=rw\n[2001]\nDataType=5\nAccessType=ro", &["described, but not listed"]),
        ("DataType=5\nAccessType=rw\n[OptionalObjects]\n1=0x1234", &["listed, but not described"]),
        ("ObjectType=7\n[2000sub0]\nDataType=5\nAccessType=ro", &["has sub-indices; taken as a record"]),
        ("ObjectType=8\nDataType=5\nAccessType=rw\nCompactSubObj=2\n[2000Name]\n3=x", &["no such element; left out"]),
    ] {
        let eds = object(lines).unwrap_or_else(|error| panic!("{lines}: {error}"));
        assert_eq!(notes(&eds), expected, "{lines}");
    }
    assert_eq!(object("DataType=5\nAccessType=rw\nDefaultValue=010").unwrap().dictionary(1).get(0x2000, 0), Some(8));
}

#[test]
fn an_error_says_where_and_what_was_expected() {
    for (file, expected) in [
        ("", "the file: describes no object"),
        ("[2000]\0", "the file: expected text in UTF-8 or Latin-1"),
        ("; a comment\r\nkey=1", "line 2: `key=1`: expected a [section] first"),
        ("[2000", "line 1: `[2000`: expected `]`"),
        ("[2000]\n\nDataType 5", "line 3: `DataType 5`: expected key=value, a [section] or a ; comment"),
        ("[2000]\nDataType=5\n[2000]", "line 3: `2000`: a second section of this name"),
        ("[2000]\nDataType=5\nParameterValue=256", "line 3: `256`: expected a value of its data type"),
        ("[2000]\nDataType=10\nParameterValue=xy", "line 3: `xy`: expected a value of its data type"),
        ("[2000]\nParameterValue=1", "line 2: `1`: a value to be configured, but no data type of CiA 301"),
        ("[2000]\nObjectType=8\nDataType=5\nCompactSubObj=255", "line 1: `2000`: CompactSubObj: expected 1 to 254"),
        ("[2000]\nDataType=5\nParameterValue=\u{1b}[2J", "line 3: `?[2J`: expected a value of its data type"),
    ] {
        assert_eq!(Eds::parse(file.as_bytes()).unwrap_err().to_string(), expected);
    }
    let long = format!("[{}", "x".repeat(100));
    assert!(Eds::parse(long.as_bytes()).unwrap_err().to_string().len() < 100);
}

#[test]
fn encodings_line_ends_and_marks_of_old_editors_do_not_matter() {
    let text = "[2000]\r\nParameterName=Drehgeschwindigkeit für Öl\r\nDataType=5\r\nAccessType=rw\r\n\x1A";
    let latin: Vec<u8> = text.chars().map(|c| c as u8).collect();
    let marked = [b"\xEF\xBB\xBF", text.as_bytes()].concat();
    for file in [text.as_bytes(), &latin, &marked] {
        assert_eq!(eds(file).name(0x2000, 0).unwrap().to_string(), "Drehgeschwindigkeit für Öl");
    }
}

/// Variants of each file.
const VARIANTS: u64 = 1000;

/// Changes a file as a broken editor, a broken transfer or somebody with bad intent does.
fn vary(random: &mut testing::Random, file: &[u8]) -> Vec<u8> {
    /// Values and lines that a parser may not expect.
    const ODD: [&str; 14] = [
        "",
        "0xFFFFFFFF",
        "-1",
        "99999999999999999999",
        "$NODEID+0xFFFFFFFF",
        "0x-80000000",
        "1e9",
        "NaN",
        "\0",
        "0x",
        "254",
        "[",
        "[1A00sub0]",
        "CompactSubObj=254",
    ];
    let mut lines: Vec<Vec<u8>> = file.split(|byte| *byte == b'\n').map(<[u8]>::to_vec).collect();
    for _ in 0..=random.index(12) {
        let (at, other) = (random.index(lines.len()), random.index(lines.len()));
        let odd = ODD[random.index(ODD.len())].as_bytes();
        match random.index(8) {
            0 => drop(lines.remove(at)),
            1 => lines.insert(at, lines[other].clone()),
            2 => lines.swap(at, other),
            3 => lines.insert(at, odd.to_vec()),
            4 => {
                let len = random.index(40);
                lines[at] = random.bytes(len);
            }
            5 => lines.truncate(at.max(1)),
            6 if !lines[at].is_empty() => {
                let byte = random.index(lines[at].len());
                lines[at][byte] ^= 1 << random.index(8);
            }
            _ => {
                if let Some(equals) = lines[at].iter().position(|byte| *byte == b'=') {
                    lines[at].truncate(equals + 1);
                    lines[at].extend_from_slice(odd);
                }
            }
        }
        if lines.is_empty() {
            lines.push(Vec::new());
        }
    }
    lines.join(&b'\n')
}

/// All that a data sheet is used for: the objects, the configuration of a DCF, and the tables of a drive in both modes.
/// True if a drive is made of it.
fn use_it(file: &[u8]) -> bool {
    use crate::axis::modes::Mode;
    use crate::drives::derive::{Description, Limits, Quirks, VelocityUnit, derive};
    let Ok(eds) = Eds::parse(file) else { return false };
    assert!(eds.objects().len() <= MAX_OBJECTS && eds.warnings().len() <= MAX_WARNINGS);
    let dictionary = eds.dictionary(5);
    for object in eds.objects() {
        let _ = dictionary.read(object.index, object.sub);
    }
    let _ = eds.configuration(5);
    [Mode::ProfileVelocity, Mode::ProfilePosition].map(|mode| {
        let description = Description {
            mode,
            per_turn: 0.5,
            gear: Some(20.0),
            counts_per_turn: Some(4096),
            velocity_unit: Some(VelocityUnit::Rpm),
            limits: Limits { velocity: 1.0, acceleration: 1.0, deceleration: 1.0, quick_stop: 2.0 },
            range: (mode == Mode::ProfilePosition).then_some([-100.0, 100.0]),
            homing: None,
            sync: None,
            setpoints: None,
            master: 127,
            torque: true,
            second_way: true,
            quirks: Quirks::default(),
        };
        derive(&eds, 5, &description).is_ok()
    }) != [false; 2]
}

#[test]
fn a_thousand_broken_variants_of_each_file_are_refused_or_used() {
    let files = [
        file!("epos_sim.eds"),
        file!("icla_sim.eds"),
        file!("others/canopennode_DS301_profile.eds"),
        file!("others/canopennode_demoDevice.eds"),
        file!("others/lely_co_nmt_slave.dcf"),
        file!("others/lely_coapp_fiber_master.dcf"),
        file!("others/maxon_epos4_50_15_node1.dcf"),
        file!("others/python_canopen_datatypes.eds"),
        file!("others/python_canopen_sample.eds"),
        file!("others/ros2_cia402_slave.eds"),
    ];
    let (mut drives, mut none) = (0, 0);
    for (number, (_, file)) in (0..).zip(files) {
        for seed in 0..VARIANTS {
            let variant = vary(&mut testing::Random::new(number * VARIANTS + seed + 1), file);
            *(if use_it(&variant) { &mut drives } else { &mut none }) += 1;
        }
    }
    // Variants that nothing was made of, or everything, would prove little.
    assert!(drives > 500 && none > 500, "{drives} drives, {none} others");
}

#[test]
fn size_names_objects_and_warnings_are_bounded() {
    assert_eq!(Eds::parse(&[b' '; MAX_FILE + 1]).unwrap_err().text, "longer than 4 MiB");
    let array = |index| format!("[{index:04X}]\nObjectType=8\nDataType=7\nAccessType=rw\nCompactSubObj=254\n");
    let most: String = (0x2000..0x2101).map(array).collect();
    assert_eq!(eds(most.as_bytes()).objects().len(), 257 * 255);
    let many: String = (0x2000..0x2102).map(array).collect();
    assert_eq!(Eds::parse(many.as_bytes()).unwrap_err().text, "more than 65536 objects");
    let name = "ä".repeat(MAX_NAME);
    let eds = object(&format!("ParameterName={name}\nDataType=5\nAccessType=rw")).unwrap();
    assert_eq!((eds.objects()[0].name.len(), notes(&eds)), (MAX_NAME, ["a name this long is cut off"].into()));
    let longest = "n".repeat(MAX_NAME);
    let eds = object(&format!("ParameterName={longest}\nObjectType=8\nDataType=5\nAccessType=rw\nCompactSubObj=100"));
    assert_eq!(eds.unwrap().object(0x2000, 100).unwrap().name.len(), MAX_NAME);
    let text = "x".repeat(1000);
    let compact = format!("ObjectType=8\nDataType=9\nAccessType=rw\nDefaultValue={text}\nCompactSubObj=254");
    assert_eq!(notes(&object(&compact).unwrap()), ["a long default for each element is left out"]);
    let warned: String = (0..MAX_WARNINGS * 2).map(|at| format!("[{:04X}]\nDataType=5\n", 0x2000 + at)).collect();
    assert_eq!(Eds::parse(warned.as_bytes()).unwrap().warnings().len(), MAX_WARNINGS);
}
