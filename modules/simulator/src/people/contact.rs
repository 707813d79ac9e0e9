//! Contacts between the robot and people or objects.

use core::fmt;
use core::str::FromStr;
use navitools::Point;

/// The robot moves towards what it touches when it does so faster than this, m/s.
pub const TOWARDS: f64 = 0.01;

/// Party that moved into the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mover {
    /// The robot: where it was touched it moved towards the other at more than [`TOWARDS`].
    Robot,
    /// A person, into a robot that stood, or moved away or past.
    Person,
}

/// A contact of the robot's body. Its text is the line that the simulator prints, and can be read back: `contact: by
/// person, robot 0.000 m/s, person 3 1.250 of 1.300 m/s, at 3.210 4.500`, `contact: by robot, robot 0.412 m/s, wall, at
/// …`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    /// Party that moved.
    pub mover: Mover,
    /// The person; none: a wall or a column.
    pub person: Option<Touched>,
    /// Speed of the robot towards the other at the contact, m/s.
    pub robot_mps: f64,
    /// Position in the world.
    pub at: Point,
}

/// A person at a contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Touched {
    /// Number of the person.
    pub number: u32,
    /// How fast it moved towards the robot, m/s.
    pub towards_mps: f64,
    /// How fast it walked, in whatever direction, m/s.
    pub speed_mps: f64,
}

impl fmt::Display for Contact {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mover = if self.mover == Mover::Robot { "robot" } else { "person" };
        write!(f, "contact: by {mover}, robot {:.3} m/s, ", self.robot_mps)?;
        match self.person {
            Some(Touched { number, towards_mps, speed_mps }) => {
                write!(f, "person {number} {towards_mps:.3} of {speed_mps:.3} m/s, ")?;
            }
            None => write!(f, "wall, ")?,
        }
        write!(f, "at {:.3} {:.3}", self.at.x, self.at.y)
    }
}

/// Line that is no contact.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NoContact;

impl FromStr for Contact {
    type Err = NoContact;

    fn from_str(line: &str) -> Result<Self, NoContact> {
        read(line).ok_or(NoContact)
    }
}

fn read(line: &str) -> Option<Contact> {
    let mut parts = line.strip_prefix("contact: by ")?.split(", ");
    let mover = match parts.next()? {
        "robot" => Mover::Robot,
        "person" => Mover::Person,
        _ => return None,
    };
    let robot_mps = parts.next()?.strip_prefix("robot ")?.strip_suffix(" m/s")?.parse().ok()?;
    let person = match parts.next()? {
        "wall" => None,
        person => {
            let (number, speeds) = person.strip_prefix("person ")?.strip_suffix(" m/s")?.split_once(' ')?;
            // Older logs have the first speed alone.
            let (towards, speed) = speeds.split_once(" of ").unwrap_or((speeds, speeds));
            let (towards_mps, speed_mps) = (towards.parse().ok()?, speed.parse().ok()?);
            Some(Touched { number: number.parse().ok()?, towards_mps, speed_mps })
        }
    };
    let (x, y) = parts.next()?.strip_prefix("at ")?.split_once(' ')?;
    Some(Contact { mover, person, robot_mps, at: Point { x: x.parse().ok()?, y: y.parse().ok()? } })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn its_line_can_be_read_back() {
        let at = Point { x: 3.25, y: -4.5 };
        let touched = Touched { number: 3, towards_mps: 1.25, speed_mps: 1.5 };
        let person = Contact { mover: Mover::Person, person: Some(touched), robot_mps: -0.5, at };
        let line = "contact: by person, robot -0.500 m/s, person 3 1.250 of 1.500 m/s, at 3.250 -4.500";
        assert_eq!(person.to_string(), line);
        let wall = Contact { mover: Mover::Robot, person: None, robot_mps: 0.375, at };
        for contact in [person, wall] {
            assert_eq!(contact.to_string().parse(), Ok(contact));
        }
        let old = "contact: by person, robot -0.500 m/s, person 3 1.250 m/s, at 3.250 -4.500".parse::<Contact>();
        assert!(old.is_ok_and(|old| old.person.is_some_and(|person| person.towards_mps == 1.25)));
        assert_eq!("contact: by robot, at 1 2".parse::<Contact>(), Err(NoContact));
    }
}
