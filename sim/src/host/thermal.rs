//! Temperatures of the computer as served by the kernel.

use super::owner::Owner;
use super::served::Server;
use base::Duration;
use base::thermal::State;

/// Duration of reading the files.
const READING: Duration = Duration::from_micros(500);

/// The temperatures as described by their emulator.
#[derive(Debug, Default)]
pub(super) struct Zones {
    /// The port that emulates them.
    emulator: Option<Owner>,
    state: State,
}

impl Zones {
    /// The port `owner` emulates the temperatures from now on.
    pub fn emulated_by(&mut self, owner: Owner) {
        self.emulator = Some(owner);
    }

    /// Sets the temperatures from now on.
    pub fn is(&mut self, owner: Owner, state: State) {
        if self.emulator == Some(owner) {
            self.state = state;
        }
    }
}

impl Server for Zones {
    type Request = ();
    type Answer = State;

    fn duration(&self, (): &()) -> Duration {
        READING
    }

    fn perform(&mut self, _owner: Owner, (): ()) -> State {
        self.state.clone()
    }

    fn gone(&mut self, pid: u32) {
        if self.emulator.take_if(|emulator| emulator.pid == pid).is_some() {
            self.state = State::default();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::served::Served;
    use super::*;
    use base::Instant;
    use module::PortId;

    #[test]
    fn what_the_emulator_says_is_read_until_it_is_gone() {
        let [kernel, reader] = [1, 2].map(|pid| Owner { pid, port: PortId(0) });
        let mut wire = Served::<Zones>::default();
        wire.server.emulated_by(kernel);
        let mut state = State::default();
        assert!(state.push("cpu", 45_000));
        wire.server.is(reader, state.clone());
        let ask = |wire: &mut Served<Zones>| {
            wire.send(Instant::ZERO, reader, ());
            let over = wire.poll_timeout().unwrap();
            wire.handle_timeout(over).unwrap()
        };
        assert_eq!(ask(&mut wire), (reader, State::default()), "nobody but the emulator");
        wire.server.is(kernel, state.clone());
        assert_eq!(ask(&mut wire), (reader, state));
        wire.close(1);
        assert_eq!(ask(&mut wire).1, State::default());
    }
}
