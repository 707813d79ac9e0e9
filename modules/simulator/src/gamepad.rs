//! A simulated gamepad: two sticks, some buttons, and the hand that holds it; or a foreign one that is played.
//!
//! Requests come as `SIM_CMD_FAULT` with the target `gamepad`, though none of them is a fault:
//!
//! | fault | what happens |
//! |---|---|
//! | `plug`, `unplug` | it is plugged in, or unplugged |
//! | `hold`, `release` | its dead-man button, `BTN_TL`, is held, or let go |
//! | `speed`, `sideways` | its left stick is pushed forward, or to the left, by `value`, -1 to 1 |
//! | `steering` | its right stick is pushed to the left |
//!
//! With a duration `plug` and `hold` are taken back after it, and the sticks are let go.

use base::Instant;
use base::gamepad::{
    ABS_RX, ABS_RY, ABS_X, ABS_Y, Axis, BTN_EAST, BTN_NORTH, BTN_SOUTH, BTN_TL, BTN_TR, BTN_WEST, Button, Device, Event,
};
use std::collections::VecDeque;

/// Target of the requests.
pub(crate) const TARGET: &str = "gamepad";
/// Requests.
pub(crate) const NAMES: &[&str] = &["plug", "unplug", "hold", "release", "speed", "steering", "sideways"];
/// Name of the device.
const NAME: &str = "Simulated gamepad";
/// Axes that are pushed.
const AXES: [u16; 3] = [ABS_Y, ABS_RX, ABS_X];
/// From the middle of a stick to its end.
const WAY: f64 = 32_767.0;

/// Positions, present or requested.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Held {
    plugged: bool,
    dead_man: bool,
    /// Of [`AXES`].
    sticks: [i32; 3],
}

/// The gamepad.
#[derive(Debug, Default)]
pub(crate) struct Gamepad {
    plugged: Instant,
    dead_man: Instant,
    sticks: [(i32, Instant); 3],
    told: Held,
    tells: VecDeque<Event>,
}

impl Gamepad {
    /// Takes a request that lasts until an instant; false if it is unknown.
    pub fn ask(&mut self, now: Instant, what: &str, value: f64, until: Instant) -> bool {
        match what {
            "plug" => self.plugged = until,
            "unplug" => self.plugged = now,
            "hold" => self.dead_man = until,
            "release" => self.dead_man = now,
            "speed" if value.abs() <= 1.0 => self.sticks[0] = (towards(value), until),
            "steering" if value.abs() <= 1.0 => self.sticks[1] = (towards(value), until),
            "sideways" if value.abs() <= 1.0 => self.sticks[2] = (towards(value), until),
            _ => return false,
        }
        self.handle_timeout(now);
        true
    }

    /// Takes an event of a foreign gamepad.
    pub fn play(&mut self, now: Instant, event: Event) {
        if let Event::Found(_) = event {
            self.plugged = now;
            self.told.plugged = false;
        }
        self.tells.push_back(event);
    }

    /// Handles what is due.
    pub fn handle_timeout(&mut self, now: Instant) {
        let is = Held {
            plugged: self.plugged > now,
            dead_man: self.dead_man > now,
            sticks: self.sticks.map(|(raw, until)| if until > now { raw } else { 0 }),
        };
        let was = std::mem::replace(&mut self.told, is);
        match (was.plugged, is.plugged) {
            (false, true) => self.tells.push_back(Event::Found(Box::new(device(is)))),
            (true, false) => self.tells.push_back(Event::Gone),
            (true, true) if was != is => {
                for ((code, was), is) in AXES.into_iter().zip(was.sticks).zip(is.sticks) {
                    if was != is {
                        self.tells.push_back(Event::Axis { code, value: is });
                    }
                }
                if was.dead_man != is.dead_man {
                    self.tells.push_back(Event::Button { code: BTN_TL, pressed: is.dead_man });
                }
                self.tells.push_back(Event::Frame);
            }
            _ => {}
        }
    }

    /// Next event.
    pub fn poll(&mut self) -> Option<Event> {
        self.tells.pop_front()
    }

    /// Instant of the next [`Gamepad::handle_timeout`].
    pub fn poll_timeout(&self) -> Instant {
        let Held { plugged, dead_man, sticks } = self.told;
        let ends = [(plugged, self.plugged), (dead_man, self.dead_man)].into_iter();
        let ends = ends.chain(sticks.into_iter().zip(self.sticks).map(|(raw, (_, until))| (raw != 0, until)));
        ends.filter(|(on, _)| *on).map(|(_, until)| until).fold(Instant::NEVER, Instant::min)
    }
}

/// Forward and left are a stick's lower values.
fn towards(share: f64) -> i32 {
    libm::round(-share * WAY) as i32
}

fn device(is: Held) -> Device {
    let mut device = Device::new(NAME);
    for code in [ABS_X, ABS_Y, ABS_RX, ABS_RY] {
        device.add_axis(Axis { code, min: -32_768, max: 32_767, fuzz: 16, flat: 128, value: 0 });
    }
    for code in [BTN_SOUTH, BTN_EAST, BTN_NORTH, BTN_WEST, BTN_TL, BTN_TR] {
        device.add_button(Button { code, pressed: false });
    }
    for (code, value) in AXES.into_iter().zip(is.sticks) {
        device.set_axis(code, value);
    }
    device.set_button(BTN_TL, is.dead_man);
    device
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(gamepad: &mut Gamepad) -> String {
        let mut text = Vec::new();
        while let Some(event) = gamepad.poll() {
            text.push(match event {
                Event::Found(device) => {
                    format!("found {:?} {}", device.button(BTN_TL).unwrap(), device.axis(ABS_Y).unwrap().value)
                }
                Event::Gone => "gone".into(),
                Event::Axis { code, value } => format!("abs {code} {value}"),
                Event::Button { pressed, .. } => format!("key {pressed}"),
                Event::Frame => "frame".into(),
            });
        }
        text.join(", ")
    }

    #[test]
    fn it_tells_what_is_done_with_it_and_takes_it_back_in_time() {
        let (mut gamepad, at) = (Gamepad::default(), Instant::from_millis);
        assert!(gamepad.ask(at(0), "hold", 0.0, at(500)));
        assert_eq!((told(&mut gamepad).as_str(), gamepad.poll_timeout()), ("", at(500)), "in somebody's hand");
        assert!(gamepad.ask(at(0), "plug", 0.0, Instant::NEVER));
        assert!(gamepad.ask(at(100), "speed", 1.0, at(300)) && gamepad.ask(at(100), "steering", -0.5, Instant::NEVER));
        assert_eq!(told(&mut gamepad), "found true 0, abs 1 -32767, frame, abs 3 16384, frame");
        assert_eq!(gamepad.poll_timeout(), at(300));
        gamepad.handle_timeout(at(300));
        gamepad.handle_timeout(at(500));
        assert_eq!(told(&mut gamepad), "abs 1 0, frame, key false, frame");
        assert!(gamepad.ask(at(500), "sideways", 0.25, at(550)));
        gamepad.handle_timeout(at(550));
        assert_eq!(told(&mut gamepad), "abs 0 -8192, frame, abs 0 0, frame");
        assert_eq!(gamepad.poll_timeout(), Instant::NEVER);
        assert!(gamepad.ask(at(600), "unplug", 0.0, Instant::NEVER));
        assert_eq!(told(&mut gamepad), "gone");
    }

    #[test]
    fn what_nobody_can_do_is_refused() {
        let mut gamepad = Gamepad::default();
        for (what, value) in [("eat", 0.0), ("speed", 1.5), ("steering", f64::NAN), ("none", 0.0)] {
            assert!(!gamepad.ask(Instant::ZERO, what, value, Instant::NEVER), "{what} {value}");
        }
    }

    #[test]
    fn one_that_is_played_takes_its_place() {
        let mut gamepad = Gamepad::default();
        assert!(gamepad.ask(Instant::ZERO, "plug", 0.0, Instant::NEVER));
        told(&mut gamepad);
        gamepad.play(Instant::from_millis(1), Event::Found(Box::new(device(Held::default()))));
        gamepad.handle_timeout(Instant::from_millis(1));
        assert_eq!(told(&mut gamepad), "found false 0", "the own one is not told to be gone");
        assert!(gamepad.ask(Instant::from_millis(2), "plug", 0.0, Instant::NEVER));
        assert_eq!(told(&mut gamepad), "found false 0");
    }
}
