//! Devices on a serial line of their own, whichever they are and however many axes they have: one engine for all of
//! them, and their emulations.

use crate::config::{Axis, Config, ConfigError};
use crate::engine::{Engine, Protocol};
use crate::event::{CommandError, Event, Feedback, ReleaseError, State};
use crate::motor::Motor;
use crate::roboclaw::{self, RoboClaw, wire};
use crate::vesc::{self, VescUart};
use base::Instant;

/// Axes of the device that has most.
pub const AXES_MAX: usize = 2;

/// Bytes to be sent without a gap.
pub type Bytes = vesc::uart::Bytes;

/// Which device it must be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Device {
    /// A VESC on a UART: one axis.
    Vesc(vesc::Device),
    /// A RoboClaw by packet serial: two axes.
    RoboClaw(roboclaw::Device),
}

impl Device {
    /// Number of its axes.
    #[must_use]
    pub fn axes(&self) -> usize {
        match self {
            Self::Vesc(_) => 1,
            Self::RoboClaw(_) => 2,
        }
    }

    /// Its id, or its address.
    #[must_use]
    pub fn address(&self) -> u8 {
        match self {
            Self::Vesc(device) => device.id,
            Self::RoboClaw(device) => device.address,
        }
    }

    /// True if it shows by itself that its command time limit acts; one that does not needs a second way to stop.
    #[must_use]
    pub fn proves_time_limit(&self) -> bool {
        matches!(self, Self::Vesc(_))
    }
}

/// Engine of one device on a serial line. Feed it bytes and time as an [`Engine`].
#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "there is no allocator for a box, and a robot has a few of them")]
pub enum OnSerial {
    /// VESC.
    Vesc(VescUart),
    /// RoboClaw.
    RoboClaw(RoboClaw),
}

/// Passes a call on to the engine of the device.
macro_rules! of_engine {
    ($engine:expr, $own:ident => $call:expr) => {
        match $engine {
            OnSerial::Vesc($own) => $call,
            OnSerial::RoboClaw($own) => $call,
        }
    };
}

impl OnSerial {
    /// An engine for this device, with the default times. `axes` are those of the device, in their order;
    /// `second_way`: the robot has a second way to stop. Its first [`Self::handle_timeout`] starts it.
    ///
    /// # Errors
    /// What is wrong with the configuration; [`ConfigError::Device`] for another number of axes.
    pub fn new(axes: &[Axis], second_way: bool, device: Device) -> Result<Self, ConfigError> {
        match device {
            Device::Vesc(device) => VescUart::uart(&config(axes, second_way)?, device).map(Self::Vesc),
            Device::RoboClaw(device) => RoboClaw::new(&config(axes, second_way)?, device).map(Self::RoboClaw),
        }
    }

    /// [`Engine::state`].
    #[must_use]
    pub fn state(&self) -> State {
        of_engine!(self, own => own.state())
    }

    /// [`Engine::command`]: a velocity for each axis of the device, rad/s at the output.
    ///
    /// # Errors
    /// The command was not taken; what was in force stays so. An axis without a velocity is out of range.
    pub fn command(&mut self, now: Instant, velocity_radps: &[f64]) -> Result<(), CommandError> {
        fn all<P: Protocol<N>, const N: usize>(
            engine: &mut Engine<P, N>,
            now: Instant,
            velocity_radps: &[f64],
        ) -> Result<(), CommandError> {
            let missing = CommandError::OutOfRange { axis: velocity_radps.len() };
            engine.command(now, *velocity_radps.first_chunk().ok_or(missing)?)
        }
        of_engine!(self, own => all(own, now, velocity_radps))
    }

    /// [`Engine::quick_stop`]: of all axes.
    pub fn quick_stop(&mut self) {
        of_engine!(self, own => own.quick_stop());
    }

    /// [`Engine::is_quick_stop`].
    #[must_use]
    pub fn is_quick_stop(&self) -> bool {
        of_engine!(self, own => own.is_quick_stop())
    }

    /// [`Engine::release`]: of all axes.
    ///
    /// # Errors
    /// The quick stop stays active: an axis was not measured at standstill.
    pub fn release(&mut self, now: Instant) -> Result<(), ReleaseError> {
        of_engine!(self, own => own.release(now))
    }

    /// [`Engine::disarm`]: all axes.
    pub fn disarm(&mut self, now: Instant) {
        of_engine!(self, own => own.disarm(now));
    }

    /// [`Engine::restart`].
    pub fn restart(&mut self, now: Instant) {
        of_engine!(self, own => own.restart(now));
    }

    /// [`Engine::feedback`].
    #[must_use]
    pub fn feedback(&self, axis: usize) -> Option<&Feedback> {
        of_engine!(self, own => own.feedback(axis))
    }

    /// [`Engine::rejected`].
    #[must_use]
    pub fn rejected(&self) -> u32 {
        of_engine!(self, own => own.rejected())
    }

    /// [`Engine::handle_rx`].
    pub fn handle_rx(&mut self, now: Instant, bytes: &[u8]) {
        of_engine!(self, own => own.handle_rx(now, bytes));
    }

    /// [`Engine::handle_timeout`].
    pub fn handle_timeout(&mut self, now: Instant) {
        of_engine!(self, own => own.handle_timeout(now));
    }

    /// [`Engine::poll_tx`].
    pub fn poll_tx(&mut self, now: Instant) -> Option<Bytes> {
        match self {
            Self::Vesc(own) => own.poll_tx(now),
            Self::RoboClaw(own) => own.poll_tx(now).map(|packet| packet.into_iter().collect()),
        }
    }

    /// [`Engine::poll_event`].
    pub fn poll_event(&mut self) -> Option<Event> {
        of_engine!(self, own => own.poll_event())
    }

    /// [`Engine::poll_timeout`].
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        of_engine!(self, own => own.poll_timeout())
    }
}

fn config<const N: usize>(axes: &[Axis], second_way: bool) -> Result<Config<N>, ConfigError> {
    let axes = <[Axis; N]>::try_from(axes).map_err(|_| ConfigError::Device)?;
    Ok(Config { second_way, ..Config::new(axes) })
}

/// The other end of any of them, for the simulator and for tests.
#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "there is no allocator for a box, and a robot has a few of them")]
pub enum Emulated {
    /// A VESC.
    Vesc(vesc::device::Device<vesc::uart::Link>),
    /// A RoboClaw.
    RoboClaw(roboclaw::device::Device),
}

impl Emulated {
    /// A device at power-on.
    #[must_use]
    pub fn new(device: Device) -> Self {
        match device {
            Device::Vesc(device) => {
                let mut own = vesc::device::Device::new(device, vesc::uart::Link::new());
                own.fault_stop = vesc::device::FAULT_STOP;
                Self::Vesc(own)
            }
            Device::RoboClaw(device) => Self::RoboClaw(roboclaw::device::Device::new(device)),
        }
    }

    /// Its motors, in the order of its axes.
    #[must_use]
    pub fn motors(&self) -> &[Motor] {
        match self {
            Self::Vesc(own) => core::slice::from_ref(&own.motor),
            Self::RoboClaw(own) => &own.motors,
        }
    }

    /// Its motors, in the order of its axes.
    pub fn motors_mut(&mut self) -> &mut [Motor] {
        match self {
            Self::Vesc(own) => core::slice::from_mut(&mut own.motor),
            Self::RoboClaw(own) => &mut own.motors,
        }
    }

    /// Raises a fault, as its own checks do: the code of a VESC, from 1; error bits of a RoboClaw, which is in
    /// emergency stop with 0.
    pub fn raise(&mut self, fault: u16) {
        match self {
            Self::Vesc(own) => own.raise(u8::try_from(fault).unwrap_or(u8::MAX).max(1)),
            Self::RoboClaw(own) => match u32::from(fault) & wire::ERRORS {
                0 => own.raise(wire::E_STOP),
                bits => own.raise(bits),
            },
        }
    }

    /// Takes bytes from the line.
    pub fn handle_rx(&mut self, now: Instant, bytes: &[u8]) {
        match self {
            Self::Vesc(own) => own.handle_rx(now, bytes),
            Self::RoboClaw(own) => own.handle_rx(now, bytes),
        }
    }

    /// Moves the motors, checks, and sends what is due.
    pub fn handle_timeout(&mut self, now: Instant) {
        match self {
            Self::Vesc(own) => own.handle_timeout(now),
            Self::RoboClaw(own) => own.handle_timeout(now),
        }
    }

    /// Next bytes for the line.
    pub fn poll_tx(&mut self, now: Instant) -> Option<Bytes> {
        match self {
            Self::Vesc(own) => own.poll_tx(),
            Self::RoboClaw(own) => own.poll_tx(now).map(|bytes| bytes.into_iter().collect()),
        }
    }

    /// Instant of the next [`Self::handle_timeout`] and [`Self::poll_tx`]; a past instant means at once.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Instant> {
        match self {
            Self::Vesc(own) => own.poll_timeout(),
            Self::RoboClaw(own) => own.poll_timeout(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::Duration;

    const AXIS: Axis = Axis { gear: 8.0, velocity_max_radps: 10.0, acceleration_radps2: 20.0 };
    const DEVICES: [Device; 2] = [
        Device::Vesc(vesc::Device { erpm_min: 60.0, ..vesc::Device::EXAMPLE }),
        Device::RoboClaw(roboclaw::Device::EXAMPLE),
    ];

    fn exchange(now: Instant, engine: &mut OnSerial, end: &mut Emulated) {
        engine.handle_timeout(now);
        end.handle_timeout(now);
        while let Some(bytes) = engine.poll_tx(now) {
            end.handle_rx(now, &bytes);
        }
        while let Some(bytes) = end.poll_tx(now) {
            engine.handle_rx(now, &bytes);
        }
    }

    #[test]
    fn one_engine_drives_any_device_each_axis_at_its_own_speed() {
        for device in DEVICES {
            let wanted = &[2.0, -1.5][..device.axes()];
            let mut engine = OnSerial::new(&[AXIS, AXIS][..device.axes()], true, device).unwrap();
            let mut end = Emulated::new(device);
            assert_eq!((end.motors().len(), end.motors_mut().len()), (device.axes(), device.axes()));
            for now in (1..3000).map(Instant::from_millis) {
                exchange(now, &mut engine, &mut end);
                if engine.state() == State::Ready {
                    engine.command(now, wanted).unwrap();
                }
            }
            for (axis, wanted) in wanted.iter().enumerate() {
                let velocity = engine.feedback(axis).unwrap().velocity_radps;
                assert!((velocity - wanted).abs() < 0.02, "{device:?} {axis}: {velocity}");
            }
            assert!(engine.feedback(device.axes()).is_none());
        }
    }

    #[test]
    fn what_does_not_fit_the_device_is_refused() {
        for device in DEVICES {
            let axes = &[AXIS, AXIS, AXIS][..device.axes() + 1];
            for wrong in [&axes[1..1], axes] {
                assert_eq!(OnSerial::new(wrong, true, device).err(), Some(ConfigError::Device), "{device:?}");
            }
            let mut engine = OnSerial::new(&axes[1..], true, device).unwrap();
            let missing = CommandError::OutOfRange { axis: 0 };
            assert_eq!(engine.command(Instant::ZERO, &[]), Err(missing), "{device:?}");
        }
    }

    #[test]
    fn a_device_that_cannot_prove_its_time_limit_is_refused_without_a_second_way() {
        for device in DEVICES {
            let mut engine = OnSerial::new(&[AXIS, AXIS][..device.axes()], false, device).unwrap();
            let mut end = Emulated::new(device);
            let start = Instant::from_millis(1);
            for n in 0..1000 {
                exchange(start + Duration::from_millis(1) * n, &mut engine, &mut end);
            }
            assert_eq!(engine.state() == State::Ready, device.proves_time_limit(), "{device:?}");
        }
    }

    #[test]
    fn a_fault_of_any_number_is_one_of_the_device() {
        for (device, fault) in DEVICES.iter().flat_map(|device| [0, 1, 0x1000, 0xC000].map(|fault| (*device, fault))) {
            let mut engine = OnSerial::new(&[AXIS, AXIS][..device.axes()], true, device).unwrap();
            let mut end = Emulated::new(device);
            let run = |from, engine: &mut OnSerial, end: &mut Emulated| {
                (from..from + 1000).for_each(|ms| exchange(Instant::from_millis(ms), engine, end));
            };
            run(1, &mut engine, &mut end);
            assert_eq!(engine.state(), State::Ready, "{device:?}");
            end.raise(fault);
            run(1001, &mut engine, &mut end);
            assert_ne!(engine.state(), State::Ready, "{device:?} {fault:#x}");
        }
    }
}
