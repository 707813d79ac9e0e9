//! Any text on the command socket, from two pages, at any time: none panics, none moves the robot but as its holder said.
#![no_main]

use base::{Duration, Instant};
use libfuzzer_sys::fuzz_target;
use web::center::access::Role;
use web::center::authority::{Authority, Limits, Output};
use web::center::command::{self, Command, Robot};

fuzz_target!(|steps: Vec<(bool, u8, String)>| {
    let limits = Limits { speed: 0.5, steering: 0.4 };
    let robot = Robot { limits, routes: Vec::new(), simulated: true };
    let mut authority = Authority::new(limits);
    let pages = ["a", "b"].map(|name| authority.join(name.into(), Role::Engineer, name.into()));
    let mut now = Instant::from_millis(1_000_000);
    for (second, wait, text) in steps {
        now += Duration::from_millis(wait.into());
        let page = pages[usize::from(second)];
        match Command::read(&text) {
            Ok(Command::Ping { t }) => authority.ping(now, page, t),
            Ok(Command::Take { from, .. }) => drop(authority.take(now, page, from)),
            Ok(Command::Release { .. }) => drop(authority.release(now, page)),
            Ok(Command::Stop { .. }) => authority.stop(now, page),
            Ok(Command::Resume { .. }) if authority.holds(page) => authority.resume(now, page),
            Ok(Command::Zero { hold, seq }) => authority.zero(now, page, hold, seq),
            Ok(Command::Sdo { node, index, subindex, data, .. }) => {
                drop(command::sdo(node, index, subindex, data.as_deref()));
            }
            Ok(command) => match command.drive() {
                Some(drive) => authority.drive(now, page, drive),
                None => drop(command::message(&command, &robot, 0, "web:a")),
            },
            Err(_) => authority.nonsense(now, page),
        }
        authority.handle_timeout(now);
        while let Some(say) = authority.poll() {
            if let Output::Motion { speed, steering, .. } = say {
                assert!(authority.holds(page) && speed.abs() <= limits.speed && steering.abs() <= limits.steering);
            }
        }
        assert!(authority.poll_timeout().is_none_or(|due| due > now), "nothing is due after a drain");
    }
});
