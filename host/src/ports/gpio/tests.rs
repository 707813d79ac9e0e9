//! Both ends of the simulator's output, and lines that cannot be had. Real lines: `lab/checks/gpio_lines.py`.

use super::*;
use crate::ports::threaded::Threaded;
use crate::ports::{Device, Received};
use base::Instant;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use std::path::Path;

fn path(name: &str) -> PathBuf {
    std::env::temp_dir().join(format!("advee-gpio-{}-{name}", std::process::id()))
}

fn ends(path: &Path) -> (Socket, Socket) {
    (Socket::new(path.into(), true), Socket::new(path.into(), false))
}

fn came(end: &mut Socket) -> Option<Signal> {
    match end.receive(Instant::ZERO).unwrap() {
        Received::Input { input: Input::Gpio(signal), .. } => Some(signal),
        Received::Nothing => None,
        _ => panic!(),
    }
}

fn send(end: &mut Socket, signal: Signal) -> Result<bool, Lost> {
    end.send(Instant::ZERO, &Output::Gpio(signal))
}

#[test]
fn signals_reach_the_other_end_in_order_and_a_new_owner_is_answered() {
    let path = path("ends");
    let (mut simulator, mut owner) = ends(&path);
    simulator.open().unwrap();
    for _process in 0..2 {
        owner.open().unwrap();
        for signal in [Signal::Read, Signal::Level(false), Signal::Level(true)] {
            assert_eq!(send(&mut owner, signal), Ok(true));
        }
        let asked: Vec<Signal> = std::iter::from_fn(|| came(&mut simulator)).collect();
        assert_eq!(asked, [Signal::Read, Signal::Level(false), Signal::Level(true)]);
        assert_eq!(send(&mut simulator, Signal::Level(true)), Ok(true));
        assert_eq!((came(&mut owner), came(&mut owner)), (Some(Signal::Level(true)), None));
        owner = Socket::new(path.clone(), false);
        assert_eq!(send(&mut simulator, Signal::Level(true)), Ok(true), "the owner has ended");
    }
    drop((simulator, owner));
    assert!(!path.exists() && !path.with_extension("owner").exists());
}

#[test]
fn without_the_simulator_the_output_is_lost() {
    let path = path("alone");
    let (_, mut owner) = ends(&path);
    owner.open().unwrap();
    assert!(send(&mut owner, Signal::Read).unwrap_err().starts_with(&format!("{}: ", path.display())));
}

#[test]
fn a_line_that_cannot_be_had_is_a_lost_port_with_a_reason() {
    let why = |chip: &str, line: LineId| {
        let mut port = Threaded::new(Line(GpioConfig { chip: chip.into(), line, active_low: false }));
        port.open().unwrap();
        assert_eq!(port.send(Instant::ZERO, &Output::Gpio(Signal::Read)), Ok(true));
        poll(&mut [PollFd::new(port.fd().unwrap(), PollFlags::POLLIN)], PollTimeout::NONE).unwrap();
        port.receive(Instant::ZERO).err().expect("there is no such line")
    };
    let missing = why("/dev/gpiochip-of-no-computer", LineId::Number(17));
    assert!(missing.starts_with("/dev/gpiochip-of-no-computer: No such file"), "{missing}");
    let no_chip = why("/dev/zero", LineId::Number(17));
    assert!(no_chip.starts_with("/dev/zero: line 17: "), "{no_chip}");
    assert_eq!(why("/dev/zero", LineId::Name("FEED".into())), "/dev/zero: no line is named FEED");
}

#[test]
fn an_input_that_cannot_be_had_is_a_lost_port_with_a_reason() {
    let why = |chip: &str, line: LineId| {
        let config = GpioInput {
            chip: chip.into(),
            line,
            active_low: false,
            bias: base::gpio::Bias::PullUp,
            debounce: base::Duration::from_millis(5),
        };
        InputLine::new(config).open().expect_err("there is no such line")
    };
    let missing = why("/dev/gpiochip-of-no-computer", LineId::Number(17));
    assert!(missing.starts_with("/dev/gpiochip-of-no-computer: No such file"), "{missing}");
    let no_chip = why("/dev/zero", LineId::Number(17));
    assert!(no_chip.starts_with("/dev/zero: line 17: "), "{no_chip}");
    assert_eq!(why("/dev/zero", LineId::Name("DOOR".into())), "/dev/zero: no line is named DOOR");
}
