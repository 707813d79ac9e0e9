//! Translation of messages to ROS 2.

use lcm_gen::Schema;
use lcm_gen::dynamic::Types;
use logger::ros::{RobotScene, Translator, Untranslated};
use messages::Channel;
use std::sync::LazyLock;

#[path = "../../foundation/lcm-gen/tests/ros2.rs"]
mod reader;

/// Arrays in arrays, strings in them, elements without bytes, all numbers, types that ROS 2 does not have.
const FOREIGN: &[(&str, &str)] = &[("f.lcm", "package f;
    enum e { RED, GREEN = 7 } struct nothing { } struct leaf { byte b; string s; double d; boolean t[3]; }
    struct wide { int8_t n; int16_t m; int64_t k; float grid[n][m]; leaf rows[m][2]; string words[2][n];
        nothing none[k]; e e; }
    struct many { nothing x[3000]; } struct more { int32_t n; many x[n]; int64_t timestamp; }
    struct tree { int8_t n; tree below[n]; string name; }")];

static FILES: LazyLock<Vec<Types>> = LazyLock::new(|| {
    let types = |files: &[(&str, &str)]| Types::new(&Schema::new(files).expect("they are built in"));
    vec![types(messages::LCM_FILES), types(FOREIGN)]
});

static BEGIN: LazyLock<Translator> = LazyLock::new(|| {
    let scene = RobotScene { outline: vec![[1.0, 0.0]; 3], ..RobotScene::default() };
    Translator::with_types(scene, FOREIGN).expect("they are built in")
});

/// Messages of the robot's and of foreign types, on any channel, converted to ROS 2's encoding.
///
/// Exactly the valid messages are converted; each result is parsed by its schema to the last byte.
pub fn ros(data: &[u8]) {
    let Some(input) = crate::input::<Vec<(u8, u8, Vec<u8>)>>(data) else { return };
    let mut translator = BEGIN.clone();
    for (channel, ty, body) in input {
        let channels = Channel::ALL.iter().map(|channel| channel.name());
        let channels = channels.chain(["pose", "range/1", "X", "LL_DATA_RAW_A"]);
        let channel = channels.cycle().nth(channel.into()).expect("there is always another");
        // The fingerprint is right, or nothing behind it would ever be reached.
        let all: Vec<_> = FILES.iter().flat_map(Types::iter).collect();
        let ty = all[usize::from(ty) % all.len()];
        let data = [&ty.fingerprint().to_be_bytes()[..], &body].concat();
        let mut told = 0;
        let done = translator.translate(channel, &data, &mut |topic, cdr| {
            told += 1;
            let _ = reader::Text::new(&topic.schema_text).read(cdr);
        });
        match done {
            Ok(()) => assert!(told > 0 && ty.decode(&data).is_ok()),
            Err(Untranslated::NoSuchType { name }) => assert_eq!((told, &*name), (0, "f.tree")),
            Err(_) => assert!(told == 0 && ty.decode(&data).is_err()),
        }
    }
}
