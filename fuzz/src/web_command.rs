//! Commands of the web page.

use base::{Duration, Instant};
use std::sync::LazyLock;
use web::center::access::Role;
use web::center::authority::{Authority, Limits, Motion, Output};
use web::center::command::{self, Command, Robot};
use web::center::publish::Publisher;

/// Channels of motion, on which nothing is published.
const DRIVES: [&str; 3] = ["LL_CMD_MOTION", "LL_CMD_VELOCITY", "LL_CMD_CREEP"];
static PUBLISHER: LazyLock<Publisher> = LazyLock::new(|| Publisher::new(true).expect("the robot's own types"));

/// Lines of a command socket: the first byte selects the page, the second is a delay in ms, the rest is the command.
///
/// Only the holder of control moves the robot, within the limits; after a drain no deadline is due.
pub fn web_command(data: &[u8]) {
    let limits = Limits { speed: 0.5, steering: 0.4, sideways: 0.3, rotation: 1.2 };
    let robot = Robot { limits, routes: Vec::new(), simulated: true };
    let mut authority = Authority::new(limits);
    let pages = ["a", "b"].map(|name| authority.join(name.into(), Role::Engineer, name.into()));
    let mut now = Instant::from_millis(1_000_000);
    for line in data.split(|byte| *byte == b'\n') {
        let [which, wait, text @ ..] = line else { continue };
        now += Duration::from_millis(u64::from(*wait));
        let page = pages[usize::from(which & 1)];
        match Command::read(&String::from_utf8_lossy(text)) {
            Ok(Command::Ping { t }) => authority.ping(now, page, t),
            Ok(Command::Take { from, .. }) => drop(authority.take(now, page, from)),
            Ok(Command::Release { .. }) => drop(authority.release(now, page)),
            Ok(Command::Stop { .. }) => authority.stop(now, page),
            Ok(Command::Resume { .. }) if authority.holds(page) => authority.resume(now, page),
            Ok(Command::Zero { hold, seq }) => authority.zero(now, page, hold, seq),
            Ok(Command::Sdo { node, index, subindex, data, .. }) => {
                drop(command::sdo(node, index, subindex, data.as_deref()));
            }
            Ok(Command::Publish { channel, message_type, message, .. }) => {
                let said = PUBLISHER.message(now, (&channel, &message_type), &message, (0, "web:a"));
                assert!(said.is_err() || !DRIVES.contains(&channel.as_str()), "nobody drives by it");
            }
            Ok(command) => match command.drive() {
                Some(drive) => authority.drive(now, page, drive),
                None => drop(command::message(&command, &robot, 0, "web:a")),
            },
            Err(_) => authority.nonsense(now, page),
        }
        authority.handle_timeout(now);
        while let Some(say) = authority.poll() {
            if let Output::Motion { motion, .. } = say {
                let (ahead, beside) = match motion {
                    Motion::Curve { speed, steering } => (speed, steering.abs() <= limits.steering),
                    Motion::Velocity { vx, vy, omega } => {
                        (vx, vy.abs() <= limits.sideways && omega.abs() <= limits.rotation)
                    }
                };
                assert!(authority.holds(page) && ahead.abs() <= limits.speed && beside);
            }
        }
        assert!(authority.poll_timeout().is_none_or(|due| due > now), "nothing is due after a drain");
    }
}
