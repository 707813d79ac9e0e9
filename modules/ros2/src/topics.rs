//! Names, types and qualities of topics, in ROS and in DDS.

use messages::Channel;

/// Package of the robot's own types: `packaging/ros2/advee_msgs`, made from the messages.
pub const PACKAGE: &str = "advee_msgs";
/// What no type of ROS expresses, in types of the robot's own: channel, and topic.
pub const OWN: [(Channel, &str); 9] = [
    (Channel::CmDataState, "/advee/state"),
    (Channel::CmDataFaults, "/advee/faults"),
    (Channel::CmDataProcesses, "/advee/processes"),
    (Channel::LlDataHold, "/advee/holds"),
    (Channel::LlDataGuard, "/advee/guard"),
    (Channel::LlEventStop, "/advee/stop"),
    (Channel::LlDataPower, "/advee/power"),
    (Channel::MlDataGoal, "/advee/goal"),
    (Channel::HlDataAction, "/advee/action"),
];

/// How samples of a topic are delivered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quality {
    /// Measurements of sensors: best effort, as the drivers of the field do.
    Sensor,
    /// Reliable, the last ten.
    Reliable,
    /// Reliable; who comes later gets the last one.
    Latched,
    /// Reliable; who comes later gets the last hundred.
    History,
}

/// A topic of the robot.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Topic {
    /// Name in ROS, without the namespace: `/odom`.
    pub name: String,
    /// Type in ROS: `nav_msgs/msg/Odometry`.
    pub type_name: String,
    /// Delivery.
    pub quality: Quality,
}

/// Devices of a robot whose topics have their names if there are several.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Devices {
    /// Lidars.
    pub lidars: usize,
    /// Inertial measurement units.
    pub imus: usize,
    /// Batteries, that of the power controller included.
    pub batteries: usize,
}

/// Name of the topic of a device: that of the topic alone where there is one device.
fn one_or_named(topic: &str, count: usize, name: &str) -> String {
    if count <= 1 { topic.to_owned() } else { format!("{topic}_{name}") }
}

/// Topics that are the computer's, not the robot's: they have no namespace.
const GLOBAL: [&str; 3] = ["/clock", "/diagnostics", "/rosout"];

impl Topic {
    pub(crate) fn new(name: &str, type_name: &str, quality: Quality) -> Self {
        Self { name: name.into(), type_name: type_name.into(), quality }
    }

    /// Topic of a message that the translation of logs has on the topic `name`; `None`: it is not for ROS. Names there
    /// may be such that ROS refuses: a part of a name does not begin with a digit.
    pub(crate) fn of_translated(name: &str, type_name: &str, has: Devices) -> Option<Self> {
        let channel = name.strip_prefix('/').and_then(Channel::from_name);
        if let Some((_, own)) = OWN.iter().find(|(own, _)| Some(*own) == channel) {
            let short = type_name.rsplit_once('/').map_or(type_name, |(_, short)| short);
            return Some(Self::new(own, &format!("{PACKAGE}/msg/{short}"), Quality::Reliable));
        }
        let (name, quality) = match name {
            "/battery" => ("/battery_state".to_owned(), Quality::Reliable),
            "/diagnostics" | "/plan" => (name.to_owned(), Quality::Reliable),
            "/pose" => ("/amcl_pose".to_owned(), Quality::Latched),
            "/rosout" => (name.to_owned(), Quality::History),
            "/scene" => (name.to_owned(), Quality::Sensor),
            "/tf_static" => (name.to_owned(), Quality::Latched),
            _ => {
                if let Some(id) = name.strip_prefix("/range/") {
                    let kind = if id.starts_with(|c: char| c.is_ascii_digit()) { "sonar_" } else { "" };
                    (format!("/range/{kind}{id}"), Quality::Sensor)
                } else if let Some(lidar) = name.strip_prefix("/scan/") {
                    (one_or_named("/scan", has.lidars, lidar), Quality::Sensor)
                } else if let Some(imu) = name.strip_prefix("/imu/") {
                    (one_or_named("/imu", has.imus, imu), Quality::Sensor)
                } else if let Some(battery) = name.strip_prefix("/battery/") {
                    (one_or_named("/battery_state", has.batteries, battery), Quality::Reliable)
                } else {
                    (format!("/temperature_{}", name.strip_prefix("/temperature/")?), Quality::Sensor)
                }
            }
        };
        Some(Self { name, type_name: type_name.into(), quality })
    }

    /// Name in DDS, in a namespace of ROS.
    #[must_use]
    pub fn dds_name(&self, namespace: &str) -> String {
        let namespace = if GLOBAL.contains(&&*self.name) { "" } else { namespace };
        format!("rt{namespace}{}", self.name)
    }

    /// Type in DDS: `nav_msgs::msg::dds_::Odometry_`.
    #[must_use]
    pub fn dds_type(&self) -> String {
        let (package, name) = self.type_name.rsplit_once('/').unwrap_or(("", &self.type_name));
        format!("{}::dds_::{name}_", package.replace('/', "::"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_those_of_dds() {
        let odom = Topic::new("/odom", "nav_msgs/msg/Odometry", Quality::Reliable);
        assert_eq!(odom.dds_type(), "nav_msgs::msg::dds_::Odometry_");
        assert_eq!([odom.dds_name(""), odom.dds_name("/r1")], ["rt/odom", "rt/r1/odom"]);
        assert_eq!(Topic::new("/rosout", "", Quality::History).dds_name("/r1"), "rt/rosout");
    }

    #[test]
    fn every_part_of_a_translated_name_is_one_that_ros_takes() {
        let has = |count| Devices { lidars: count, imus: count, batteries: count };
        let name = |name| Topic::of_translated(name, "x/msg/X", has(2)).map(|topic| topic.name);
        let expected = [
            ("/range/7", Some("/range/sonar_7")),
            ("/range/ir_1", Some("/range/ir_1")),
            ("/scan/2nd", Some("/scan_2nd")),
            ("/temperature/1_wire", Some("/temperature_1_wire")),
            ("/battery", Some("/battery_state")),
            ("/battery/pack", Some("/battery_state_pack")),
            ("/imu/base", Some("/imu_base")),
            ("/odometry", None),
            ("/LL_DATA_ODO", None),
            ("/LL_DATA_HOLD", Some("/advee/holds")),
        ];
        for (from, to) in expected {
            assert_eq!(name(from).as_deref(), to, "{from}");
        }
        for (from, to) in [("/scan/top", "/scan"), ("/imu/base", "/imu"), ("/battery/pack", "/battery_state")] {
            assert_eq!(Topic::of_translated(from, "x/msg/X", has(1)).unwrap().name, to);
        }
    }
}
