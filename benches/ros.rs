//! Conversion of messages to ROS 2 in the logger: `cargo bench -p logger --bench ros`.
//!
//! Messages of the robot in their usual size: `--bench cdr` of `lcm-gen` measures the type alone; this one includes the
//! lookup of topics and the standard types, of which a message of sonars produces sixteen.
#![allow(clippy::disallowed_methods, reason = "a bench asks the time")]

use std::error::Error;
use std::hint::black_box;
use std::time::Instant;

use logger::ros::{RobotScene, Sensor, Translator};
use messages::common::{DataProcesses, DataState, Process};
use messages::lowlevel::{DataOdo, DataRaw, DataSrfs, Range};
use messages::middlelevel::DataEstimate;
use messages::{Message, Raw};

const ROUNDS: usize = 50;
const CALLS: usize = 2000;

fn main() -> Result<(), Box<dyn Error>> {
    let scene = RobotScene {
        name: "advee".into(),
        outline: vec![[0.75, 0.3], [-0.15, 0.3], [-0.15, -0.3], [0.75, -0.3]],
        sonar: Sensor::srf08(0.96),
        infrared: Sensor::GP2Y0A41,
        ..RobotScene::default()
    };
    let mut translator = Translator::new(scene);
    let srfs = (0..16).map(|id| Range { id, distance: 1.5, valid: true, ..Range::default() }).collect();
    let process = Process { module: "driver_canbus".into(), uptime: 12.5, ..Process::default() };
    let frame = DataRaw { data: vec![7; 8], ..DataRaw::default() };
    let messages: [Message; 6] = [
        DataSrfs { srfs, ..DataSrfs::default() }.into(),
        DataOdo::default().into(),
        DataEstimate::default().into(),
        DataState { module: "driver_canbus".into(), ..DataState::default() }.into(),
        DataProcesses { processes: vec![process; 10], ..DataProcesses::default() }.into(),
        Raw { bus: "MAIN".into(), frame }.into(),
    ];
    println!("{:20} {:>7} {:>9} {:>9} {:>7} {:>7}", "", "bytes", "messages", "of bytes", "ns", "MB/s");
    for message in &messages {
        let (channel, mut data) = (message.channel_name(), Vec::new());
        message.encode(&mut data)?;
        let (mut count, mut bytes) = (0, 0);
        translator.translate(&channel, &data, &mut |_, cdr| (count, bytes) = (count + 1, bytes + cdr.len()))?;
        let mut best = f64::INFINITY;
        for _ in 0..ROUNDS {
            let begin = Instant::now();
            for _ in 0..CALLS {
                let _ = translator.translate(&channel, black_box(&data), &mut |topic, cdr| {
                    black_box((topic, cdr));
                });
            }
            best = best.min(begin.elapsed().as_nanos() as f64 / CALLS as f64);
        }
        let speed = data.len() as f64 / best * 1e3;
        println!("{channel:20} {:7} {count:9} {bytes:9} {best:7.0} {speed:7.0}", data.len());
    }
    Ok(())
}
