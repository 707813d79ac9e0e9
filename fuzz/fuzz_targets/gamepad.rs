//! A stream of a gamepad's lines, cut anywhere, into the driver: whatever is written, what moves the robot is within its
//! limits, and comes to an end with the stream.
#![no_main]
use base::Duration;
use messages::Message;
use module::bench::Bench;
use module::{Event, Input, PortId, State};
use host::ports::gamepad_codec::{Line, Reader, encode};
use robot::place::Place;
use robot::topology;
use std::path::Path;

libfuzzer_sys::fuzz_target!(|chunks: Vec<Vec<u8>>| {
    let place = Place {
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
    for bytes in chunks.iter().take(100) {
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
});
