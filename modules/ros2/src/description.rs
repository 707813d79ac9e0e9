//! `/robot_description` and `/joint_states`: what the robot looks like, by its configuration, and how its wheels
//! stand.
//!
//! A wheel has a link and a joint that turns about the wheel's axle; a steered one has another joint above it. Their
//! transforms are on `/tf` as well, so that no `robot_state_publisher` is needed.

use crate::topics::{Quality, Topic};
use logger::ros::{Fields, Pose};
use messages::lowlevel::DataAxes;
use std::fmt::Write as _;

/// What is drawn of the robot.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Description {
    /// Its name.
    pub name: String,
    /// Rear and front end of its body, m from the origin, and half its width, m.
    pub body: [f64; 3],
    /// Radius of its wheels, m.
    pub wheel_radius: f64,
    /// Its wheels.
    pub wheels: Vec<Wheel>,
    /// Sensors: frame, and place on the robot.
    pub sensors: Vec<(String, Pose)>,
}

/// A wheel.
#[derive(Clone, Debug, PartialEq)]
pub struct Wheel {
    /// Name of its link: `left_wheel`.
    pub name: String,
    /// Place of its contact point, and the direction in which it rolls.
    pub place: Pose,
    /// Axis in `LL_DATA_AXES` that turns it; `None`: none is measured.
    pub axis: Option<String>,
    /// How it is steered; `None`: it is not.
    pub steering: Option<Steering>,
}

/// Steering of a wheel by an axis that measures the angle of the equivalent single wheel.
#[derive(Clone, Debug, PartialEq)]
pub struct Steering {
    /// Axis in `LL_DATA_AXES`.
    pub axis: String,
    /// Place of the wheel forward of the axle that does not steer, m; below zero: behind it.
    pub x: f64,
}

impl Steering {
    /// Angle of the wheel, rad, to the left of the robot's middle by `y`, m: all axles meet in one point. Behind the
    /// fixed axle it is turned to the right for a curve to the left.
    fn angle(&self, equivalent: f64, y: f64) -> f64 {
        let (sin, cos) = libm::sincos(equivalent);
        libm::atan2(self.x * sin, self.x.abs() * cos - y * sin)
    }
}

/// State of a joint.
#[derive(Clone, Debug, PartialEq)]
struct Joint {
    name: String,
    /// Rad, and rad/s; NaN: not known.
    position: f64,
    velocity: f64,
}

impl Description {
    /// Topic of the description.
    #[must_use]
    pub fn topic() -> Topic {
        Topic::new("/robot_description", "std_msgs/msg/String", Quality::Latched)
    }

    /// `std_msgs/msg/String` with the URDF.
    #[must_use]
    pub fn message(&self) -> Vec<u8> {
        let mut cdr = Vec::new();
        Fields::new(&mut cdr).to.string(&self.urdf());
        cdr
    }

    /// The robot as URDF. No height is configured: the body is drawn as high as three radii of a wheel.
    #[must_use]
    pub fn urdf(&self) -> String {
        let [rear, front, half_width] = self.body;
        let radius = self.wheel_radius;
        let mut text = format!("<?xml version=\"1.0\"?>\n<robot name=\"{}\">\n", crate::node_name(&self.name));
        // Writing to a text does not fail.
        let _ = writeln!(
            text,
            "  <link name=\"base_link\"><visual><origin xyz=\"{} 0 {}\"/><geometry><box size=\"{} {} {}\"/></geometry>\
             <material name=\"body\"><color rgba=\"0.2 0.35 0.6 0.8\"/></material></visual></link>",
            (rear + front) / 2.0,
            2.0 * radius,
            front - rear,
            2.0 * half_width,
            3.0 * radius,
        );
        for Wheel { name, place, steering, .. } in &self.wheels {
            let Pose { x, y, theta } = *place;
            let _ = writeln!(
                text,
                "  <link name=\"{name}\"><visual><origin rpy=\"1.5708 0 0\"/><geometry><cylinder radius=\"{radius}\" \
                 length=\"{}\"/></geometry><material name=\"wheel\"><color rgba=\"0.1 0.1 0.1 1\"/></material></visual>\
                 </link>",
                radius / 2.0,
            );
            let origin = format!("<origin xyz=\"{x} {y} {radius}\" rpy=\"0 0 {theta}\"/>");
            let (parent, origin) = match steering {
                None => ("base_link".to_owned(), origin),
                Some(_) => {
                    let _ = writeln!(
                        text,
                        "  <link name=\"{name}_steering\"/>\n  <joint name=\"{name}_steering_joint\" \
                         type=\"continuous\">\
                         <parent link=\"base_link\"/><child link=\"{name}_steering\"/>{origin}<axis xyz=\"0 0 1\"/>\
                         </joint>",
                    );
                    (format!("{name}_steering"), String::new())
                }
            };
            let _ = writeln!(
                text,
                "  <joint name=\"{name}_joint\" type=\"continuous\"><parent link=\"{parent}\"/><child link=\"{name}\"/>\
                 {origin}<axis xyz=\"0 1 0\"/></joint>",
            );
        }
        for (frame, Pose { x, y, theta }) in &self.sensors {
            let _ = writeln!(
                text,
                "  <link name=\"{frame}\"/>\n  <joint name=\"{frame}_joint\" type=\"fixed\">\
                 <parent link=\"base_link\"/>\
                 <child link=\"{frame}\"/><origin xyz=\"{x} {y} 0\" rpy=\"0 0 {theta}\"/></joint>",
            );
        }
        text + "</robot>\n"
    }

    /// The wheel's angle of rotation and of steering, with their rates; NaN: not known.
    fn measured(&self, wheel: &Wheel, axes: &DataAxes) -> [(f64, f64); 2] {
        let axis = |name: Option<&String>| axes.axes.iter().find(|axis| Some(&axis.name) == name);
        let rolled = axis(wheel.axis.as_ref()).map_or((f64::NAN, f64::NAN), |axis| {
            (axis.position / self.wheel_radius, axis.velocity / self.wheel_radius)
        });
        let steered = wheel.steering.as_ref().and_then(|steering| {
            let axis = axis(Some(&steering.axis))?;
            Some((steering.angle(axis.position, wheel.place.y), f64::NAN))
        });
        [rolled, steered.unwrap_or((f64::NAN, f64::NAN))]
    }

    /// True if the axis of this name turns a wheel.
    pub fn has_wheel(&self, axis: &str) -> bool {
        self.wheels.iter().any(|wheel| wheel.axis.as_deref() == Some(axis))
    }

    /// `sensor_msgs/msg/JointState` of the axes, in `buffer`; of joints that are measured.
    pub fn joint_states(&self, axes: &DataAxes, buffer: &mut Vec<u8>) -> Topic {
        let mut joints = Vec::new();
        for wheel in &self.wheels {
            let [rolled, steered] = self.measured(wheel, axes);
            for (suffix, (position, velocity)) in [("_steering_joint", steered), ("_joint", rolled)] {
                if position.is_finite() {
                    joints.push(Joint { name: format!("{}{suffix}", wheel.name), position, velocity });
                }
            }
        }
        let mut fields = Fields::new(buffer);
        fields.header(axes.timestamp, "");
        fields.to.count(joints.len());
        joints.iter().for_each(|joint| fields.to.string(&joint.name));
        for of in [|joint: &Joint| joint.position, |joint: &Joint| joint.velocity] {
            fields.to.count(joints.len());
            joints.iter().for_each(|joint| fields.to.f64(of(joint)));
        }
        fields.to.count(0); // efforts
        Topic::new("/joint_states", "sensor_msgs/msg/JointState", Quality::Reliable)
    }

    /// `tf2_msgs/msg/TFMessage` of the wheels, in `buffer`. What is not measured is shown at rest.
    pub fn transforms(&self, axes: &DataAxes, buffer: &mut Vec<u8>) {
        let mut fields = Fields::new(buffer);
        fields.to.count(self.wheels.iter().map(|wheel| 1 + usize::from(wheel.steering.is_some())).sum());
        for wheel in &self.wheels {
            let Pose { x, y, theta } = wheel.place;
            let [(rolled, _), (steered, _)] =
                self.measured(wheel, axes).map(|(angle, rate)| (if angle.is_finite() { angle } else { 0.0 }, rate));
            let mut link = |parent: &str, child: &str, at: [f64; 3], turn: f64, roll: f64| {
                fields.header(axes.timestamp, parent);
                fields.to.string(child);
                fields.vector(at[0], at[1], at[2]);
                // About the vertical, then about the wheel's axle.
                let ((sin, cos), (sin_roll, cos_roll)) = (libm::sincos(turn / 2.0), libm::sincos(roll / 2.0));
                let quaternion = [-sin * sin_roll, cos * sin_roll, sin * cos_roll, cos * cos_roll];
                quaternion.into_iter().for_each(|number| fields.to.f64(number));
            };
            let at = [x, y, self.wheel_radius];
            if wheel.steering.is_some() {
                let steering = format!("{}_steering", wheel.name);
                link("base_link", &steering, at, theta + steered, 0.0);
                link(&steering, &wheel.name, [0.0; 3], 0.0, rolled);
            } else {
                link("base_link", &wheel.name, at, theta, rolled);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cdr::Reader;
    use messages::lowlevel::Axis;
    use std::f64::consts::PI;

    fn wheel(name: &str, y: f64, steered: bool) -> Wheel {
        let steering = steered.then(|| Steering { axis: "steering".into(), x: 0.6 });
        let axis = (!steered).then(|| "propulsion".to_owned());
        Wheel { name: name.into(), place: Pose { x: if steered { 0.6 } else { 0.0 }, y, theta: 0.0 }, axis, steering }
    }

    fn robot() -> Description {
        Description {
            name: "R2-D2".into(),
            body: [-0.3, 0.7, 0.25],
            wheel_radius: 0.1,
            wheels: vec![wheel("rear_left_wheel", 0.2, false), wheel("front_left_wheel", 0.2, true)],
            sensors: vec![("lidar_top".into(), Pose { x: 0.5, y: 0.0, theta: PI })],
        }
    }

    fn axes(way: f64, angle: f64) -> DataAxes {
        let axis =
            |name: &str, position, velocity| Axis { name: name.into(), position, velocity, ..Default::default() };
        DataAxes { timestamp: 1, axes: vec![axis("propulsion", way, 0.5), axis("steering", angle, 0.0)] }
    }

    #[test]
    fn every_joint_of_the_description_has_its_two_links_and_every_element_its_end() {
        let text = robot().urdf();
        assert!(text.starts_with("<?xml") && text.contains("<robot name=\"R2_D2\">"), "{text}");
        let names = |before: &str| -> Vec<String> {
            let parts = text.split(before).skip(1).filter_map(|rest| rest.split_once('"'));
            parts.map(|(name, _)| name.to_owned()).collect()
        };
        let links = names("<link name=\"");
        assert_eq!(
            links,
            ["base_link", "rear_left_wheel", "front_left_wheel", "front_left_wheel_steering", "lidar_top"]
        );
        // A tree: each link but the first is the child of one joint, whose parent is a link.
        let mut children = names("<child link=\"");
        children.sort();
        let mut others = links[1..].to_vec();
        others.sort();
        assert_eq!(children, others);
        assert!(names("<parent link=\"").iter().all(|parent| links.contains(parent)));
        for element in ["robot", "joint"] {
            let begins = text.matches(&format!("<{element} ")).count();
            assert_eq!(begins, text.matches(&format!("</{element}>")).count(), "{element}");
        }
    }

    #[test]
    fn joints_are_angles_of_wheels_and_those_that_are_not_measured_are_left_out() {
        let mut buffer = Vec::new();
        robot().joint_states(&axes(0.05, 0.3), &mut buffer);
        let mut reader = Reader::new(&buffer).unwrap();
        assert_eq!((reader.i32(), reader.u32().is_some(), reader.string()), (Some(0), true, Some("")));
        assert_eq!(reader.u32(), Some(2));
        let names = ["rear_left_wheel_joint", "front_left_wheel_steering_joint"];
        assert_eq!([reader.string(), reader.string()], names.map(Some));
        assert_eq!(reader.u32(), Some(2));
        let [rolled, steered] = reader.f64s().unwrap();
        assert_eq!(rolled, 0.5);
        // The left wheel is the inner one of a turn to the left: 0.6 / (0.6 / tan 0.3 - 0.2).
        assert!((steered - libm::atan(0.6 / (0.6 / libm::tan(0.3) - 0.2))).abs() < 1e-12, "{steered}");
        assert_eq!((reader.u32(), reader.f64()), (Some(2), Some(5.0)));
    }

    #[test]
    fn transforms_turn_a_wheel_about_its_axle() {
        let mut buffer = Vec::new();
        let robot = Description { wheels: vec![wheel("wheel", 0.2, false)], ..robot() };
        robot.transforms(&axes(0.1 * PI / 2.0, 0.0), &mut buffer);
        let mut reader = Reader::new(&buffer).unwrap();
        assert_eq!((reader.u32(), reader.i32(), reader.u32().is_some()), (Some(1), Some(0), true));
        assert_eq!((reader.string(), reader.string()), (Some("base_link"), Some("wheel")));
        let [x, y, z, qx, qy, qz, qw] = reader.f64s().unwrap();
        assert_eq!([x, y, z, qx, qz], [0.0, 0.2, 0.1, 0.0, 0.0]);
        let half = libm::sqrt(0.5);
        assert!((qy - half).abs() < 1e-12 && (qw - half).abs() < 1e-12, "{qy} {qw}");
        // Nothing is measured: at rest.
        robot.transforms(&DataAxes::default(), &mut buffer);
        assert_eq!(buffer[buffer.len() - 8..], 1.0_f64.to_le_bytes());
    }
}
