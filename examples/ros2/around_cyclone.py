#!/usr/bin/env python3
"""The same as around.py without ROS, by Eclipse Cyclone DDS alone: `around_cyclone.py [LENGTH_M WIDTH_M]`.

    target/release/advee up --sim --goal none --config conf/courier --set ros2.enabled=true --set ros2.commands=true
    python3 examples/ros2/around_cyclone.py

Requires `pip install cyclonedds`. The types are those of ROS 2 with the names that they have in DDS, and so are the
names of the topics: `rt/odom` is /odom. The domain is ROS_DOMAIN_ID. The interface is loopback, which Cyclone DDS does
not take by itself; for a robot in the network set CYCLONEDDS_URI.
"""

import os
import sys
import time
from dataclasses import dataclass, field

LOOPBACK = """
<CycloneDDS><Domain id="any">
  <General>
    <Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces><AllowMulticast>false</AllowMulticast>
  </General>
  <Discovery><ParticipantIndex>auto</ParticipantIndex><Peers><Peer address="127.0.0.1"/></Peers></Discovery>
</Domain></CycloneDDS>
"""
os.environ.setdefault("CYCLONEDDS_URI", LOOPBACK)

from circuit import PERIOD, SCAN_MAX, Circuit, ahead, heading
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, float32, float64, int32, sequence, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration


@dataclass
class Time(IdlStruct, typename="builtin_interfaces.msg.dds_.Time_"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs.msg.dds_.Header_"):
    stamp: Time
    frame_id: str


@dataclass
class Vector3(IdlStruct, typename="geometry_msgs.msg.dds_.Vector3_"):
    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0


@dataclass
class Quaternion(IdlStruct, typename="geometry_msgs.msg.dds_.Quaternion_"):
    x: float64
    y: float64
    z: float64
    w: float64


@dataclass
class Pose(IdlStruct, typename="geometry_msgs.msg.dds_.Pose_"):
    position: Vector3
    orientation: Quaternion


@dataclass
class PoseWithCovariance(IdlStruct, typename="geometry_msgs.msg.dds_.PoseWithCovariance_"):
    pose: Pose
    covariance: array[float64, 36]


@dataclass
class Twist(IdlStruct, typename="geometry_msgs.msg.dds_.Twist_"):
    linear: Vector3 = field(default_factory=Vector3)
    angular: Vector3 = field(default_factory=Vector3)


@dataclass
class TwistWithCovariance(IdlStruct, typename="geometry_msgs.msg.dds_.TwistWithCovariance_"):
    twist: Twist
    covariance: array[float64, 36]


@dataclass
class Odometry(IdlStruct, typename="nav_msgs.msg.dds_.Odometry_"):
    header: Header
    child_frame_id: str
    pose: PoseWithCovariance
    twist: TwistWithCovariance


@dataclass
class LaserScan(IdlStruct, typename="sensor_msgs.msg.dds_.LaserScan_"):
    header: Header
    angle_min: float32
    angle_max: float32
    angle_increment: float32
    time_increment: float32
    scan_time: float32
    range_min: float32
    range_max: float32
    ranges: sequence[float32]
    intensities: sequence[float32]


LAST = Policy.History.KeepLast(1)
RELIABLE = Qos(Policy.Reliability.Reliable(duration(milliseconds=100)), LAST)
SENSOR = Qos(Policy.Reliability.BestEffort, LAST)


def main():
    length, width = map(float, sys.argv[1:]) if len(sys.argv) == 3 else (5.0, 4.0)
    participant = DomainParticipant(int(os.environ.get("ROS_DOMAIN_ID", "0")))
    odometry = DataReader(participant, Topic(participant, "rt/odom", Odometry), qos=RELIABLE)
    scans = DataReader(participant, Topic(participant, "rt/scan", LaserScan), qos=SENSOR)
    commands = DataWriter(participant, Topic(participant, "rt/cmd_vel", Twist), qos=RELIABLE)
    circuit = pose = free = scanned = None
    try:
        while True:
            for odom in odometry.take():
                at = odom.pose.pose
                pose = (at.position.x, at.position.y, heading(at.orientation))
            for scan in scans.take():
                free = ahead(scan.ranges, scan.angle_min, scan.angle_increment, scan.range_min)
                scanned = time.monotonic()
            if pose is not None and free is not None and commands.get_matched_subscriptions():
                circuit = circuit or Circuit(length, width, pose, lambda line: print(line, flush=True))
                is_new = time.monotonic() - scanned < SCAN_MAX
                speed, rotation = circuit.step(pose, free if is_new else None)
                commands.write(Twist(Vector3(x=speed), Vector3(z=rotation)))
            time.sleep(PERIOD)
    except KeyboardInterrupt:
        pass
    finally:
        commands.write(Twist())
        commands.wait_for_acks(duration(seconds=1))


if __name__ == "__main__":
    main()
