//! Gamepad port: bytes of an input device.

use base::Duration;
use messages::Message;
use module::bench::Bench;
use module::{Event, Input, PortId, State};
use host::ports::gamepad_codec::{Line, Reader, encode};
use robot::place::RobotLocation;
use robot::topology;
use std::path::Path;

/// A stream of a gamepad's lines into the driver; the first byte is the length of the chunks in which it arrives.
///
/// A line survives encoding and decoding; commands are within the limits; after the end of the stream the last command
/// is zero.
pub fn gamepad(data: &[u8]) {
    let Some((len, stream)) = data.split_first() else { return };
    let place = RobotLocation {
        config: Path::new(env!("CARGO_MANIFEST_DIR")).join("../conf/advee"),
        run_dir: "/nowhere".into(),
        lcm_url: "udpm://239.255.76.67:7667?ttl=0".into(),
        sets: Vec::new(),
        sim: true,
        world: None,
    };
    let (shell, _) = topology::module(&place, "driver_joydev", State::Run).expect("the shipped robot");
    let mut bench = Bench::new(shell);
    bench.start();
    let (mut reader, mut last) = (Reader::default(), 0.0);
    let mut follow = |bench: &mut Bench| {
        for message in bench.published() {
            if let Message::LlCmdMotion(command) = message {
                assert!(command.speed.abs() <= 0.6 && command.steering.abs() <= 0.6109, "{command:?}");
                last = command.speed;
            }
        }
        last
    };
    for bytes in stream.chunks(usize::from(*len).max(1)).take(100) {
        reader.push(bytes);
        while let Some(line) = reader.poll() {
            match line {
                Ok(Line::Event(event)) => {
                    let mut text = String::new();
                    encode(&event, &mut text);
                    let mut again = Reader::default();
                    again.push(text.as_bytes());
                    assert_eq!(again.poll(), Some(Ok(Line::Event(event.clone()))), "{text}");
                    let input = Input::Gamepad(event.as_input());
                    bench.event(Event::Port { port: PortId(0), input });
                }
                Ok(Line::Wait(wait)) => bench.pass(wait.min(Duration::from_secs(1))),
                Err(why) => assert!(!why.is_empty()),
            }
            follow(&mut bench);
        }
    }
    bench.event(Event::Port { port: PortId(0), input: Input::Gamepad(base::gamepad::Input::Gone) });
    assert_eq!(follow(&mut bench), 0.0, "its last word");
}
