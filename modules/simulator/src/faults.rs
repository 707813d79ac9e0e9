//! Faults by name, as `SIM_CMD_FAULT` asks for them: `target`, `fault`, `value`, `duration` in seconds.
//!
//! | target | fault | what happens |
//! |---|---|---|
//! | a board | `silent` | it neither hears nor answers |
//! | a board | `slow` | it answers `value` s late (0: 0.03, beyond the master's patience) |
//! | a board | `garbled` | each word that it sends is wrong with probability `value` (0: 0.1) |
//! | a board | `bad_crc` | its answers have a wrong CRC |
//! | a board | `bad_length` | its answers have a byte too many, and a right CRC |
//! | a board | `babble` | it talks all the time, unasked: frames of its own; with `value` 1 words that are no frames |
//! | a board | `clash` | a second board has its address, and answers too |
//! | a board | `reset` | as after a short loss of its supply: it has forgotten what it was told |
//! | a board | `refuses` | it says of every instruction that it does not know it |
//! | an odometry board | `stuck` | its encoders stand still |
//! | an odometry board | `wrap` | its counters stand just before they wrap |
//! | a sonar board | `blind`, `stuck` | its sonars hear nothing; they say what they said |
//! | a sonar board | `crosstalk` | a sonar hears another's pulse with probability `value` (0: 0.1) |
//! | a beacon scanner | `hidden` | somebody stands before the beacon `value`; 0: before all |
//! | a beacon scanner | `false` | a sighting is of something else with probability `value` (0: 0.2) |
//! | a beacon scanner | `glare` | it rejects `value` pulses a second (0: 100): sun, lamps |
//! | a beacon scanner | `supply` | its supply is `value` V (0: 4) |
//! | a power controller | `bumper` | the bumper switch `value`, 1 to 8, is pressed |
//! | a power controller | `stop_button` | the stop button is pressed |
//! | a power controller | `battery` | the battery has `value` V at rest |
//! | a power controller | `cold` | its main switch is turned on: all channels are off, and start one after the other |
//! | a power controller | `trip` | its channel `value`, 1 to 7, switches itself off, as at an over-current |
//! | a power controller | `overload` | what its channel `value`, 0 to 7, feeds draws 12 A more |
//! | a power controller | `power_off` | the main switch is turned: the supply is cut in `value` s (0: 30) |
//! | `robot` | `put:X,Y,THETA` | it is carried there, where there is room; its wheels do not turn: `put:3,4.5,1.57` |
//! | `robot` | `kidnap` | the same, to somewhere; to where else with another `value` |
//! | a fan board | `silent`, `reset` | it does not hear; as after a short loss of its supply |
//! | a fan board | `wrong` | it reads FF everywhere |
//! | a fan board | `hold` | it holds SDA low: nobody can talk on its bus |
//! | a fan board | `stall` | its fan `value`, 1 or 2 (0: 1), is blocked |
//! | a fan board | `hot` | it is `value` °C warm in the box (0: 90) |
//! | a thermometer | `silent` | it is not connected |
//! | a thermometer | `wrong` | what it sends is damaged |
//! | a thermometer | `hot` | it is `value` °C warm (0: 90) |
//! | a lidar | `silent`, `garbled`, `stuck`, `reboot` | cut off, noise, the same again and again, a restart |
//! | a lidar | `blind`, `stall` | its optics are covered; its motor stands |
//! | a lidar | `false`, `loss` | a beam measures anything, or nothing, with probability `value` (0: 0.2; 0.05) |
//! | a Modbus line | `silent` | its devices neither hear nor answer |
//! | a CANopen device | `silent`, `reboot` | as a drive |
//! | a CANopen device | `layout`, `bad_length` | it is another product; its TPDOs and answers have a wrong length |
//! | a CANopen device | `opened` | its digital input `value`, 3 to 31, is 0 |
//! | `output`, `line` of `[stop]` | `silent` | it neither answers nor obeys |
//! | `line` | `stuck` | it keeps its level, whatever is set |
//! | an inertial unit | `silent`, `garbled`, `stuck`, `reboot` | cut off, noise, the same again and again |
//! | an inertial unit | `wrong` | it measures a tenth of the acceleration |
//! | an inertial unit | `biased` | it measures `value` rad/s (0: 0.2) too much about the vertical axis |
//! | a drive | `silent` | it neither hears nor speaks, and goes on with what it does until its heartbeat watch stops it |
//! | a drive | `fault` | emergency `value` (0: 0x1000, generic), and the fault state |
//! | a drive | `babble` | frames of the identifier `value` (0: that of its TPDO2) take half of the bus |
//! | a drive | `clash` | a second node has its number, boots up, and answers too |
//! | a drive | `reboot` | as after a short loss of its supply |
//! | the propulsion drive | `unbraked` | it does not brake, whatever it is told; without its feed it rolls out |
//! | the propulsion drive | `runaway` | once it turns it is `value` m/s (0: 0.3) faster than it is told |
//! | the drive of a wheel | `encoder` | its encoder counts `value` times the truth: 0 dead, -1 reversed, 1.3 slipping |
//! | the drive of a wheel | `swapped` | it has the encoder of the wheel `value`, from 1 on |
//! | a drive but the EPOS | `opened` | its digital input `value`, 3 to 31, is open, else closed |
//! | a drive but the EPOS | `layout` | it is another version, with other PDOs; it starts anew |
//! | a drive on a serial line | `garbled` | each byte that it sends is wrong with probability `value` (0: 0.1) |
//! | a serial line of a drive | `cut` | nothing passes it |
//! | a serial line of a drive | `noise`, `loss`, `duplicate`, `delay` | as on any other line |
//! | a CAN bus | `noise` | each bit on it is wrong with probability `value` (0: 0.0001); what it hits is sent again |
//! | a CAN bus | `corrupt` | each frame whose number `value` divides (0: 10) is destroyed, and sent again |
//! | a CAN bus | `lose` | the frame of number `value` from now on (0: 1) is received by nobody |
//! | a CAN bus | `bus_off` | the master's controller goes bus-off |
//! | a CAN bus | `cut` | the master is cut off the others |
//! | a bus | `loss` | each frame, on a serial line each piece of up to 14 words, is lost with probability `value` (0: 0.05), though it was sent |
//! | a bus | `duplicate` | with probability `value` (0: 0.05) it is received twice |
//! | a bus | `delay` | it is received `value` s late (0: 0.01), in order |
//! | a serial bus | `noise` | each bit on it is wrong with probability `value` (0: 0.0001) |
//! | `lcm` | `loss`, `duplicate`, `delay` | as on a bus: each receiver misses a message by itself |
//! | `lcm` | `reorder` | a message comes up to `value` s late (0: 0.01), and others overtake it |
//! | any | `none` | its faults are over |
//!
//! The target `gamepad` is asked to do things in the same way: `plug`, `unplug`, `hold`, `release`, `speed`,
//! `steering`, `sideways` (modules/simulator/src/gamepad.rs).
//!
//! A duration of 0, below, or not a number lasts until `none`. `fault`, `reboot`, `reset`, `power_off`, `cold`, `trip`,
//! `lose`, `put` and `kidnap` are of the moment; so is `bus_off` without a duration, and with one a restarted
//! controller goes off again till then. `none` gives a power controller its supply again.
//!
//! Where there is no CAN wire (live, over UDP multicast) the simulator loses frames instead: each one with the
//! probability that `noise` hits it, all of them both ways while the bus is `cut`, and for 0.1 s or longer at
//! `bus_off`; nobody sends them again there, and no controller tells of them.

use base::{Duration, Instant};
use navitools::Pose;

/// Fault of a target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum InjectedFault {
    /// Neither receives nor sends.
    Silent,
    /// Answers with this delay.
    Slow(Duration),
    /// Garbles each word with this probability.
    Garbled(f64),
    /// Answers have a wrong CRC.
    BadCrc,
    /// Answers have a byte too many.
    BadLength,
    /// Sends unsolicited frames.
    Babble {
        /// Words that are no frames.
        noise: bool,
        /// The identifier of a drive's frames, 0 for one of its own.
        id: u16,
    },
    /// Another board has its address.
    Clash,
    /// Processor resets.
    Reset,
    /// Refuses all instructions.
    Refuses,
    /// Measurements are frozen.
    Stuck,
    /// Counters are just before their wrap.
    Wrap,
    /// Receives no echo.
    Blind,
    /// Receives foreign sound with this probability.
    Crosstalk(f64),
    /// The beacon of this number is hidden; 0: all are.
    Hidden(u8),
    /// Reports false sightings with this probability.
    False(f64),
    /// So many pulses a second are rejected.
    Glare(f64),
    /// The supply voltage, V.
    Supply(f64),
    /// The bumper switch of this number is pressed.
    Bumper(u8),
    /// The stop button is pressed.
    StopButton,
    /// Reads FF, or damaged.
    Wrong,
    /// Holds SDA.
    Hold,
    /// The fan of this number, 1 or 2, is blocked.
    Stall(u8),
    /// Temperature, °C.
    Hot(f64),
    /// The battery's voltage at rest, V.
    Battery(f64),
    /// Starts with all channels off.
    Cold,
    /// The channel of this number switches itself off.
    Trip(u8),
    /// The channel of this number draws more.
    Overload(u8),
    /// Supply is cut after this time, s.
    PowerOff(u8),
    /// Raises an internal fault.
    Fault(u16),
    /// Restarts.
    Reboot,
    /// Does not brake.
    Unbraked,
    /// Faster than told by so much, m/s.
    Runaway(f64),
    /// Its encoder counts this multiple of the truth.
    Encoder(f64),
    /// It has the encoder of the wheel of this number, from 1 on.
    Swapped(u8),
    /// This digital input of a drive is open.
    Opened(u8),
    /// Measures so much more rotation than there is, rad/s.
    Biased(f64),
    /// Another version, with other PDOs.
    Layout,
    /// Garbles each bit on the bus with this probability.
    Noise(f64),
    /// Destroys each frame whose number this divides.
    Corrupt(u64),
    /// Lets no node receive the frame of this number from now on.
    Lose(u64),
    /// The master's controller leaves the bus.
    BusOff,
    /// The master is cut off the others.
    Cut,
    /// Lost with this probability.
    Loss(f64),
    /// Received twice with this probability.
    Duplicate(f64),
    /// Received so late, in order.
    Delay(Duration),
    /// Received up to so late, out of order.
    Reorder(Duration),
    /// No fault.
    None,
}

/// Names of all faults.
pub const NAMES: &[&str] = &[
    "silent",
    "slow",
    "garbled",
    "bad_crc",
    "bad_length",
    "babble",
    "clash",
    "reset",
    "bumper",
    "stop_button",
    "battery",
    "power_off",
    "cold",
    "trip",
    "overload",
    "wrong",
    "hold",
    "stall",
    "hot",
    "refuses",
    "stuck",
    "wrap",
    "blind",
    "crosstalk",
    "hidden",
    "false",
    "glare",
    "supply",
    "fault",
    "reboot",
    "unbraked",
    "runaway",
    "encoder",
    "swapped",
    "biased",
    "opened",
    "layout",
    "noise",
    "corrupt",
    "lose",
    "bus_off",
    "cut",
    "loss",
    "duplicate",
    "delay",
    "reorder",
    "none",
];

/// What a fault does, in words, with its value; empty for an unknown one. The same name does the same to every target,
/// as far as the target has it.
#[must_use]
pub fn about(name: &str) -> &'static str {
    match name {
        "silent" => "neither receives nor answers",
        "slow" => "answers VALUE s late (0: 0.03)",
        "garbled" => "each word that it sends is wrong with probability VALUE (0: 0.1)",
        "bad_crc" => "its answers have a wrong CRC",
        "bad_length" => "its answers have a byte too many, and a right CRC",
        "babble" => {
            "sends unasked all the time; of a board, VALUE 1: words that are no frames; of a drive, VALUE: identifier"
        }
        "clash" => "a second node has its address, and answers too",
        "reset" => "restarts, as after a short loss of its supply",
        "bumper" => "the bumper switch VALUE, 1 to 8, is pressed",
        "stop_button" => "the stop button is pressed",
        "battery" => "the battery has VALUE V at rest, 8 to 40",
        "power_off" => "the main switch is turned: the supply is cut in VALUE s (0: 30)",
        "cold" => "its main switch is turned on: all channels are off, and start one after the other",
        "trip" => "its channel VALUE, 1 to 7, switches itself off, as at an over-current",
        "overload" => "what its channel VALUE, 0 to 7, feeds draws 12 A more",
        "wrong" => "what it sends is damaged; of an inertial unit: a tenth of the acceleration",
        "hold" => "holds the bus: nobody can send there; of the gamepad: the dead-man button is held",
        "stall" => "its fan VALUE, 1 or 2 (0: 1), or its motor, is blocked",
        "hot" => "is VALUE degrees Celsius warm (0: 90)",
        "refuses" => "answers to every instruction that it does not know it",
        "stuck" => "what it measures, or its level, stays as it is",
        "wrap" => "its counters are just before they wrap",
        "blind" => "its sonars receive no echo; of a lidar: its optics are covered",
        "crosstalk" => "a sonar receives another's pulse with probability VALUE (0: 0.1)",
        "hidden" => "somebody stands before the beacon VALUE (0: before all)",
        "false" => "a sighting, or a beam of a lidar, is of something else with probability VALUE (0: 0.2)",
        "glare" => "rejects VALUE pulses a second (0: 100): sun, lamps",
        "supply" => "its supply is VALUE V (0: 4)",
        "fault" => "goes into its fault state with the emergency VALUE (0: 0x1000, generic)",
        "reboot" => "restarts, as after a short loss of its supply",
        "unbraked" => "does not brake, whatever is commanded; without its feed it rolls out",
        "runaway" => "once it turns, is VALUE m/s (0: 0.3) faster than commanded",
        "encoder" => "its encoder counts VALUE times the truth: 0 dead, -1 reversed, 1.3 slipping",
        "swapped" => "it has the encoder of the wheel VALUE, from 1 on",
        "biased" => "measures VALUE rad/s (0: 0.2) more rotation than there is",
        "opened" => "its digital input VALUE, 3 to 31, is open",
        "layout" => "is another version, with other PDOs; it restarts",
        "noise" => "each bit on it is wrong with probability VALUE (0: 0.0001)",
        "corrupt" => "each frame whose number VALUE divides (0: 10) is destroyed, and sent again",
        "lose" => "the frame of number VALUE from now on (0: 1) is received by nobody",
        "bus_off" => "the master's controller goes bus-off",
        "cut" => "the master is cut off the others; of a serial line: nothing passes it",
        "loss" => "each frame, of a lidar each echo, is lost with probability VALUE (0: 0.05)",
        "duplicate" => "each frame is received twice with probability VALUE (0: 0.05)",
        "delay" => "what is sent is received VALUE s late (0: 0.01), in order",
        "reorder" => "messages are received up to VALUE s late (0: 0.01), out of order",
        "none" => "ends its faults",
        "kidnap" => "the robot is carried to another place; another VALUE: to another one",
        "put" => "put:X,Y,THETA: the robot is carried there (m, m, rad), if there is room",
        "plug" => "it is plugged in",
        "unplug" => "it is unplugged",
        "release" => "its dead-man button is released",
        "speed" => "its left stick is pushed forward by VALUE, -1 to 1",
        "steering" => "its right stick is pushed to the left by VALUE, -1 to 1",
        "sideways" => "its left stick is pushed to the left by VALUE, -1 to 1",
        _ => "",
    }
}

/// True for a fault that is over at once: nothing of it has to be ended.
#[must_use]
pub fn is_momentary(name: &str) -> bool {
    const MOMENTARY: &[&str] = &[
        "fault",
        "reboot",
        "reset",
        "power_off",
        "cold",
        "trip",
        "lose",
        "wrap",
        "layout",
        "kidnap",
        "none",
        "unplug",
        "release",
    ];
    MOMENTARY.contains(&name) || name.starts_with("put:")
}

impl InjectedFault {
    /// Fault of a name; `None` if it is unknown.
    #[must_use]
    pub fn from_name(name: &str, value: f64) -> Option<Self> {
        match name {
            "silent" => Some(Self::Silent),
            "slow" => Some(Self::Slow(seconds(or(value, 0.03).min(1.0)))),
            "garbled" => Some(Self::Garbled(or(value, 0.1).min(1.0))),
            "bad_crc" => Some(Self::BadCrc),
            "bad_length" => Some(Self::BadLength),
            "babble" => Some(Self::Babble { noise: value > 0.0, id: value as u16 & 0x7FF }),
            "clash" => Some(Self::Clash),
            "reset" => Some(Self::Reset),
            "bumper" => (1..=8).find(|number| f64::from(*number) == value).map(Self::Bumper),
            "stop_button" => Some(Self::StopButton),
            "battery" => (8.0..=40.0).contains(&value).then_some(Self::Battery(value)),
            "power_off" => Some(Self::PowerOff(or(value, 30.0) as u8)),
            "cold" => Some(Self::Cold),
            "trip" => (1..=7).find(|channel| f64::from(*channel) == value).map(Self::Trip),
            "overload" => (0..=7).find(|channel| f64::from(*channel) == value).map(Self::Overload),
            "wrong" => Some(Self::Wrong),
            "hold" => Some(Self::Hold),
            "stall" => [1, 2].into_iter().find(|fan| f64::from(*fan) == or(value, 1.0)).map(Self::Stall),
            "hot" => Some(Self::Hot(or(value, 90.0).min(200.0))),
            "refuses" => Some(Self::Refuses),
            "stuck" => Some(Self::Stuck),
            "wrap" => Some(Self::Wrap),
            "blind" => Some(Self::Blind),
            "crosstalk" => Some(Self::Crosstalk(or(value, 0.1).min(1.0))),
            "hidden" => Some(Self::Hidden(or(value, 0.0) as u8)),
            "false" => Some(Self::False(or(value, 0.2).min(1.0))),
            "glare" => Some(Self::Glare(or(value, 100.0).min(5000.0))),
            "supply" => Some(Self::Supply(or(value, 4.0).min(60.0))),
            // As casts saturate, no value is out of range.
            "fault" => Some(Self::Fault(if value > 0.0 { value as u16 } else { 0x1000 })),
            "reboot" => Some(Self::Reboot),
            "unbraked" => Some(Self::Unbraked),
            "runaway" => Some(Self::Runaway(or(value, 0.3).min(2.0))),
            "encoder" => value.is_finite().then(|| Self::Encoder(value.clamp(-2.0, 2.0))),
            "swapped" => (1..=u8::MAX).find(|wheel| f64::from(*wheel) == value).map(Self::Swapped),
            "biased" => Some(Self::Biased(or(value, 0.2).min(30.0))),
            "opened" => (3..32).find(|bit| f64::from(*bit) == value).map(Self::Opened),
            "layout" => Some(Self::Layout),
            "noise" => Some(Self::Noise(or(value, 1e-4).min(1.0))),
            "corrupt" => Some(Self::Corrupt((or(value, 10.0) as u64).max(1))),
            "lose" => Some(Self::Lose((or(value, 1.0) as u64).max(1))),
            "bus_off" => Some(Self::BusOff),
            "cut" => Some(Self::Cut),
            "loss" => Some(Self::Loss(or(value, 0.05).min(1.0))),
            "duplicate" => Some(Self::Duplicate(or(value, 0.05).min(1.0))),
            "delay" => Some(Self::Delay(seconds(or(value, 0.01).min(1.0)))),
            "reorder" => Some(Self::Reorder(seconds(or(value, 0.01).min(1.0)))),
            "none" => Some(Self::None),
            _ => None,
        }
    }
}

/// The pose of `x,y,theta`, if those are three numbers.
#[must_use]
pub fn pose(text: &str) -> Option<Pose> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|number| number.trim().parse().ok()).collect();
    let [x, y, theta] = <[f64; 3]>::try_from(numbers?).ok()?;
    [x, y, theta].iter().all(|number| libm::fabs(*number) <= 1e4).then(|| Pose::new(x, y, theta))
}

/// Replaces a value that is not above 0 by the default.
fn or(value: f64, usual: f64) -> f64 {
    if value > 0.0 { value } else { usual }
}

/// A share as parts per million, at least one.
pub(crate) fn parts_per_million(share: f64) -> u32 {
    libm::round(1e6 * share).clamp(1.0, 1e6) as u32
}

/// Saturates: a very long time is forever.
fn seconds(seconds: f64) -> Duration {
    Duration::from_nanos((seconds * 1e9) as u64)
}

/// End of a fault of this duration, s.
#[must_use]
pub fn until(now: Instant, lasts: f64) -> Instant {
    if lasts > 0.0 { now + seconds(lasts) } else { Instant::NEVER }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fault_without_a_duration_stays() {
        let now = Instant::from_millis(10);
        assert_eq!(until(now, 0.5), Instant::from_millis(510));
        for odd in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert_eq!(until(now, odd), Instant::NEVER, "{odd}");
        }
    }

    #[test]
    fn a_pose_is_three_numbers() {
        assert_eq!(pose("3, 4.5,1.5"), Some(Pose::new(3.0, 4.5, 1.5)));
        for odd in ["", "1,2", "1,2,3,4", "1,2,x", "1,2,NaN", "1,inf,0"] {
            assert_eq!(pose(odd), None, "{odd}");
        }
    }

    #[test]
    fn the_list_of_names_is_whole() {
        let text = include_str!("faults.rs");
        let begin = text.find("pub fn from_name").unwrap();
        let arms = &text[begin..begin + text[begin..].find("_ => None").unwrap()];
        let name = |line: &'static str| line.trim().strip_prefix('"')?.split_once("\" =>").map(|(name, _)| name);
        assert_eq!(arms.lines().filter_map(name).collect::<Vec<_>>(), NAMES);
        let works = |name: &str| [0.0, 1.0, 24.0].iter().any(|value| InjectedFault::from_name(name, *value).is_some());
        assert!(NAMES.iter().all(|name| works(name)));
    }

    #[test]
    fn every_fault_is_described_in_a_line() {
        for name in NAMES.iter().chain(crate::gamepad::NAMES).chain(&["kidnap", "put"]) {
            assert!((5..110).contains(&about(name).len()), "{name}: {:?}", about(name));
        }
        assert_eq!(about("on fire"), "");
        assert!(is_momentary("put:1,2,3") && is_momentary("kidnap") && !is_momentary("stall"));
        assert!(NAMES.iter().chain(crate::gamepad::NAMES).filter(|name| is_momentary(name)).count() == 12);
    }

    #[test]
    fn names_are_known_or_not() {
        assert_eq!(InjectedFault::from_name("fault", 8976.0), Some(InjectedFault::Fault(0x2310)));
        assert_eq!(InjectedFault::from_name("fault", f64::NAN), Some(InjectedFault::Fault(0x1000)));
        assert_eq!(InjectedFault::from_name("on fire", 0.0), None);
        assert_eq!(InjectedFault::from_name("bumper", 8.0), Some(InjectedFault::Bumper(8)));
        assert_eq!(InjectedFault::from_name("stall", 2.0), Some(InjectedFault::Stall(2)));
        assert_eq!(InjectedFault::from_name("hot", f64::INFINITY), Some(InjectedFault::Hot(200.0)));
        for (name, value) in [("stall", 3.0), ("bumper", 0.0), ("bumper", 9.0), ("bumper", 1.5), ("battery", 50.0)] {
            assert_eq!(InjectedFault::from_name(name, value), None, "{name} {value}");
        }
        assert_eq!(InjectedFault::from_name("slow", 1e300), Some(InjectedFault::Slow(Duration::from_secs(1))));
        assert_eq!(InjectedFault::from_name("garbled", f64::NAN), Some(InjectedFault::Garbled(0.1)));
        let parts = [0.0, 1e-9, 0.0001, 0.0295, 0.057, 0.1, 0.3, 1.0, 2.0];
        let ppm = [1, 1, 100, 29_500, 57_000, 100_000, 300_000, 1_000_000, 1_000_000];
        assert_eq!(parts.map(parts_per_million), ppm);
        assert_eq!(InjectedFault::from_name("power_off", 1e9), Some(InjectedFault::PowerOff(255)));
        assert_eq!(InjectedFault::from_name("noise", 7.0), Some(InjectedFault::Noise(1.0)));
        assert_eq!(InjectedFault::from_name("lose", 0.1), Some(InjectedFault::Lose(1)));
        assert_eq!(InjectedFault::from_name("corrupt", f64::NAN), Some(InjectedFault::Corrupt(10)));
        assert_eq!(InjectedFault::from_name("babble", 129.0), Some(InjectedFault::Babble { noise: true, id: 0x81 }));
    }
}
