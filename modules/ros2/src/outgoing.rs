//! Messages of the robot as those of ROS. What the translation of logs has is taken from there; odometry and transforms
//! are those that navigation expects (REP 105): `map` → `odom` → `base_link` → sensors.

use crate::description::Description;
use crate::odometry::{Motion, Odometry};
use crate::topics::{Devices, OWN, Quality, Topic};
use crate::ways::Ways;
use logger::ros::{Fields, Pose, RobotScene, Translator, has_standard};
use messages::{Channel, Message};
use planner::map::{Cell, Map};
use std::collections::BTreeMap;
use std::sync::Arc;

/// What the odometry is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OdometrySource {
    /// Encoders beside the drives: `LL_DATA_ODO`.
    Wheels,
    /// The drives: `LL_DATA_VELOCITY`.
    Drives,
}

/// What the translation has to know of the robot.
#[derive(Clone, Debug)]
pub struct Config {
    /// Constant parts.
    pub scene: RobotScene,
    /// What the odometry is made of.
    pub odometry: OdometrySource,
    /// Number of lidars and the like: the scans of a single one are on `/scan`.
    pub devices: Devices,
    /// Time is simulated: it comes on `/clock`.
    pub simulated: bool,
    /// What the robot looks like.
    pub description: Description,
}

/// Consumer of messages of ROS: topic, and message as CDR.
pub type Sink<'a> = dyn FnMut(&Topic, &[u8]) + 'a;

/// The translation.
#[derive(Debug)]
pub struct Outgoing {
    config: Config,
    translator: Translator,
    /// Topics by their names in the translation of logs; `None`: not for ROS.
    translated: BTreeMap<Arc<str>, Option<Topic>>,
    odometry: Odometry,
    ways: Ways,
    own: Own,
    buffer: Vec<u8>,
}

/// Topics that are made here.
#[derive(Debug)]
struct Own {
    odom: Topic,
    tf: Topic,
    clock: Topic,
}

/// Further channels that are read.
const OTHERS: [Channel; 4] =
    [Channel::LlDataOdo, Channel::LlDataVelocity, Channel::LlDataAxes, Channel::MlDataEstimate];
/// Channels whose messages are kept for who comes later, on `/rosout`.
const KEPT: [Channel; 2] = [Channel::CmEventText, Channel::CmEventError];

impl Outgoing {
    /// Creates the translation of a robot.
    #[must_use]
    pub fn new(config: Config) -> Self {
        let own = Own {
            odom: Topic::new("/odom", "nav_msgs/msg/Odometry", Quality::Reliable),
            tf: Topic::new("/tf", "tf2_msgs/msg/TFMessage", Quality::Reliable),
            clock: Topic::new("/clock", "rosgraph_msgs/msg/Clock", Quality::Sensor),
        };
        Self {
            translator: Translator::new(config.scene.clone()).live(),
            translated: BTreeMap::new(),
            odometry: Odometry::default(),
            ways: Ways::default(),
            own,
            buffer: Vec::new(),
            config,
        }
    }

    /// Channels of the bus that are translated.
    #[must_use]
    pub fn channels() -> Vec<&'static str> {
        let channels = Channel::ALL.iter().filter(|channel| is_translated(**channel) || OTHERS.contains(channel));
        channels.map(|channel| channel.name()).collect()
    }

    /// Translates a message of the bus. Without `listeners` only what lasts is kept up to date.
    pub fn translate(&mut self, channel: &str, data: &[u8], listeners: bool, sink: &mut Sink<'_>) {
        let Some(listed) = Channel::from_name(channel) else { return };
        if OTHERS.contains(&listed)
            && let Ok(message) = Message::decode(listed, data)
        {
            self.moving(&message, sink);
        }
        if !(listeners || KEPT.contains(&listed)) || !is_translated(listed) {
            return;
        }
        let Self { translator, translated: topics, config, .. } = self;
        let translated = translator.translate(channel, data, &mut |topic, cdr| {
            let known = topics
                .entry(topic.name.clone())
                .or_insert_with(|| Topic::of_translated(&topic.name, &topic.schema_name, config.devices));
            if let Some(topic) = known {
                sink(topic, cdr);
            }
        });
        // What is malformed every process on the bus hears, and those that act on it report.
        let _ = translated;
    }

    fn moving(&mut self, message: &Message, sink: &mut Sink<'_>) {
        let motion = match message {
            Message::LlDataOdo(odo) if self.config.odometry == OdometrySource::Wheels => self.odometry.on_odo(odo),
            Message::LlDataVelocity(velocity) if self.config.odometry == OdometrySource::Drives => {
                self.odometry.on_velocity(velocity)
            }
            Message::LlDataAxes(axes) => {
                let mut axes = axes.clone();
                self.ways.complete(&mut axes, |name| self.config.description.has_wheel(name));
                let joints = self.config.description.joint_states(&axes, &mut self.buffer);
                sink(&joints, &self.buffer);
                self.config.description.transforms(&axes, &mut self.buffer);
                sink(&self.own.tf, &self.buffer);
                None
            }
            Message::MlDataEstimate(estimate) => {
                let pose = Pose { x: estimate.x, y: estimate.y, theta: estimate.theta };
                let odom = self.odometry.in_map(estimate.timestamp, pose).filter(|odom| odom.is_finite());
                if let Some(odom) = odom {
                    self.transform(estimate.timestamp, "map", "odom", odom, sink);
                }
                None
            }
            _ => None,
        };
        let Some(Motion { timestamp, pose, vx, vy, omega }) = motion else { return };
        if self.config.simulated {
            Fields::new(&mut self.buffer).time(timestamp);
            sink(&self.own.clock, &self.buffer);
        }
        let mut fields = Fields::new(&mut self.buffer);
        fields.header(timestamp, "odom");
        fields.to.string("base_link");
        fields.pose(pose);
        fields.covariance(&[[0.0; 3]; 3]);
        fields.vector(vx, vy, 0.0);
        fields.vector(0.0, 0.0, omega);
        fields.covariance(&[[0.0; 3]; 3]);
        sink(&self.own.odom, &self.buffer);
        self.transform(timestamp, "odom", "base_link", pose, sink);
    }

    fn transform(&mut self, timestamp: i64, parent: &str, child: &str, pose: Pose, sink: &mut Sink<'_>) {
        let mut fields = Fields::new(&mut self.buffer);
        fields.to.count(1);
        fields.transform(timestamp, parent, child, pose);
        sink(&self.own.tf, &self.buffer);
    }
}

/// True if the translation of logs makes topics for ROS of its messages.
fn is_translated(channel: Channel) -> bool {
    has_standard(channel) || OWN.iter().any(|(own, _)| *own == channel)
}

/// `/map` of the map that the planner has, known since `timestamp`, µs since the UNIX epoch: 0 free, 100 occupied, -1
/// unknown.
#[must_use]
pub fn map(map: &Map, timestamp: i64) -> (Topic, Vec<u8>) {
    let mut buffer = Vec::new();
    let frame = map.frame();
    let mut fields = Fields::new(&mut buffer);
    fields.header(timestamp, "map");
    fields.time(timestamp);
    fields.to.f32(frame.resolution as f32);
    fields.to.count(frame.width);
    fields.to.count(frame.height);
    fields.pose(Pose { x: frame.x, y: frame.y, theta: 0.0 });
    fields.to.count(frame.width * frame.height);
    for cell in map.cells() {
        fields.to.i8(match cell {
            Cell::Free => 0,
            Cell::Occupied => 100,
            Cell::Unknown => -1,
        });
    }
    (Topic::new("/map", "nav_msgs/msg/OccupancyGrid", Quality::Latched), buffer)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cdr::Reader;
    use messages::lowlevel::{DataBattery, DataImu, DataPower, DataRanges, DataScan, DataVelocity, Reading};
    use messages::middlelevel::DataEstimate;
    use planner::map::Frame;

    fn outgoing(lidars: usize) -> Outgoing {
        let scene = RobotScene { name: "courier".into(), ..RobotScene::default() };
        let description = Description::default();
        let devices = Devices { lidars, imus: 1, batteries: 1 };
        Outgoing::new(Config { scene, odometry: OdometrySource::Drives, devices, simulated: true, description })
    }

    fn sent(outgoing: &mut Outgoing, message: impl Into<Message>, listeners: bool) -> Vec<(Topic, Vec<u8>)> {
        let (message, mut data, mut all) = (message.into(), Vec::new(), Vec::new());
        message.encode(&mut data).unwrap();
        outgoing.translate(&message.channel_name(), &data, listeners, &mut |topic, cdr| {
            all.push((topic.clone(), cdr.to_vec()));
        });
        all
    }

    fn names(sent: &[(Topic, Vec<u8>)]) -> Vec<&str> {
        sent.iter().map(|(topic, _)| &*topic.name).collect()
    }

    /// Frame, child and pose of a transform.
    fn transform(cdr: &[u8]) -> (String, String, [f64; 7]) {
        let mut reader = Reader::new(cdr).unwrap();
        assert_eq!((reader.u32(), reader.i32(), reader.u32().is_some()), (Some(1), Some(1), true));
        let parent = reader.string().unwrap().to_owned();
        let child = reader.string().unwrap().to_owned();
        (parent, child, reader.f64s().unwrap())
    }

    #[test]
    fn motion_and_estimate_become_odometry_and_the_two_transforms_of_navigation() {
        let mut outgoing = outgoing(1);
        let at = |timestamp, vx| DataVelocity { timestamp, vx, ..Default::default() };
        sent(&mut outgoing, at(1_000_000, 1.0), false);
        let moved = sent(&mut outgoing, at(1_500_000, 1.0), true);
        assert_eq!(names(&moved), ["/clock", "/odom", "/tf"]);
        let mut odom = Reader::new(&moved[1].1).unwrap();
        assert_eq!((odom.i32(), odom.u32(), odom.string()), (Some(1), Some(500_000_000), Some("odom")));
        assert_eq!((odom.string(), odom.f64()), (Some("base_link"), Some(0.5)));
        let (parent, child, pose) = transform(&moved[2].1);
        assert_eq!((&*parent, &*child, pose[0], pose[6]), ("odom", "base_link", 0.5, 1.0));

        let estimate = DataEstimate { timestamp: 1_500_000, x: 3.0, y: 4.0, ..Default::default() };
        let estimated = sent(&mut outgoing, estimate, true);
        assert_eq!(names(&estimated)[..2], ["/tf", "/amcl_pose"]);
        let (parent, child, pose) = transform(&estimated[0].1);
        assert_eq!((&*parent, &*child, pose[0], pose[1]), ("map", "odom", 2.5, 4.0));
    }

    #[test]
    fn sensors_have_their_topics_and_all_their_places_come_together_for_who_comes_later() {
        let mut outgoing = outgoing(2);
        let reading = |id, x| Reading { id, x, status: Reading::MEASURED, distance: 1.0, ..Default::default() };
        let ranges = |x| DataRanges { timestamp: 1, readings: vec![reading(1, x), reading(2, 0.5)] };
        let first = sent(&mut outgoing, ranges(0.1), true);
        assert_eq!(names(&first), ["/range/sonar_1", "/range/sonar_2", "/tf_static"]);
        let scan = |revolution| DataScan {
            timestamp: revolution,
            revolution,
            name: "top".into(),
            angle_step: 1.5,
            ranges: vec![1.0; 4],
            ..Default::default()
        };
        let second = sent(&mut outgoing, scan(1), true);
        assert_eq!(names(&second), ["/tf_static"]);
        assert_eq!(Reader::new(&second[0].1).unwrap().u32(), Some(3), "with those of the sonars");
        assert_eq!(names(&sent(&mut outgoing, scan(2), true)), ["/scan_top"]);
        assert!(names(&sent(&mut outgoing, scan(2_000_000), true)).iter().all(|name| *name == "/scan_top"));
        assert!(sent(&mut outgoing, scan(3_000_000), false).is_empty(), "nobody listens");
    }

    #[test]
    fn texts_and_errors_are_kept_also_while_nobody_listens() {
        let mut outgoing = outgoing(1);
        let text =
            messages::common::EventText { module: "planner".into(), text: "it drives".into(), ..Default::default() };
        let error = messages::common::Error { module: "planner".into(), ..Default::default() };
        for listeners in [false, true] {
            for kept in [sent(&mut outgoing, text.clone(), listeners), sent(&mut outgoing, error.clone(), listeners)] {
                let rosout = kept.iter().find(|(topic, _)| topic.name == "/rosout");
                assert_eq!(rosout.map(|(topic, _)| topic.quality), Some(Quality::History));
            }
        }
    }

    #[test]
    fn axes_become_joints_and_transforms_of_wheels() {
        let axes = messages::lowlevel::DataAxes::default();
        assert_eq!(names(&sent(&mut outgoing(0), axes, true)), ["/joint_states", "/tf"]);
    }

    #[test]
    fn inertial_units_and_batteries_have_their_topics_and_an_orientation_that_is_not_there_says_so() {
        let mut outgoing = outgoing(1);
        let imu = DataImu { name: "base".into(), rotation: [0.1, 0.2, 0.3], ..DataImu::default() };
        let told = sent(&mut outgoing, imu.clone(), true);
        assert_eq!((names(&told), told[0].0.quality), (vec!["/imu"], Quality::Sensor));
        let mut reader = Reader::new(&told[0].1).unwrap();
        assert_eq!((reader.i32(), reader.u32(), reader.string()), (Some(0), Some(0), Some("base_link")));
        let ([_, _, _, _], [first, ..]) = (reader.f64s().unwrap(), reader.f64s::<9>().unwrap());
        assert_eq!((first, reader.f64s()), (-1.0, Some([0.1, 0.2, 0.3])), "REP 145");
        let bad = DataImu { status: DataImu::FAULT, ..imu };
        assert!(sent(&mut outgoing, bad, true).is_empty());
        let battery = DataBattery { name: "pack".into(), charge: 0.5, charging: true, ..DataBattery::default() };
        let told = sent(&mut outgoing, battery, true);
        assert_eq!(names(&told), ["/battery_state"]);
        // Header, then seven numbers: the last is the share.
        assert_eq!(told[0].1[4 + 8 + 4 + 12 + 6 * 4..][..5], [0, 0, 0, 63, 1]);
    }

    #[test]
    fn what_is_not_for_ros_is_left_out() {
        let mut outgoing = outgoing(1);
        assert_eq!(names(&sent(&mut outgoing, DataPower::default(), true)), ["/advee/power", "/battery_state"]);
        let channels = Outgoing::channels();
        assert!(channels.contains(&"LL_DATA_SCAN") && channels.contains(&"LL_DATA_VELOCITY"));
        assert!(!channels.contains(&"LL_CMD_VELOCITY") && !channels.contains(&"LL_DATA_SDO"));
        outgoing.translate("NO_SUCH_CHANNEL", &[1, 2, 3], true, &mut |_, _| panic!());
        outgoing.translate("LL_DATA_VELOCITY", &[1, 2, 3], true, &mut |_, _| panic!());
    }

    #[test]
    fn a_map_is_an_occupancy_grid() {
        let frame = Frame { x: -1.0, y: -2.0, resolution: 0.5, width: 3, height: 2 };
        let mut drawn = Map::new(frame).unwrap();
        drawn.set(1, 0, Cell::Occupied);
        drawn.set(2, 1, Cell::Unknown);
        let (topic, cdr) = map(&drawn, 0);
        assert_eq!((&*topic.name, topic.quality), ("/map", Quality::Latched));
        assert_eq!(cdr[cdr.len() - 6..], [0, 100, 0, 0, 0, 255]);
    }
}
