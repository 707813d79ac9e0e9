"""Eclipse Cyclone DDS beside the robot, with types of ROS 2: reads `/odom` and the transforms, and sends a goal.

Prints a line of JSON. Everything waits for what it needs; the test bounds the time.
"""

import json
import sys
import time
from dataclasses import dataclass

from cyclone import LATCHED, Header, Time, reader, writer
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float64, sequence
from cyclonedds.util import duration


@dataclass
class Vector3(IdlStruct, typename="geometry_msgs.msg.dds_.Vector3_"):
    x: float64
    y: float64
    z: float64


@dataclass
class Quaternion(IdlStruct, typename="geometry_msgs.msg.dds_.Quaternion_"):
    x: float64
    y: float64
    z: float64
    w: float64


@dataclass
class Transform(IdlStruct, typename="geometry_msgs.msg.dds_.Transform_"):
    translation: Vector3
    rotation: Quaternion


@dataclass
class TransformStamped(IdlStruct, typename="geometry_msgs.msg.dds_.TransformStamped_"):
    header: Header
    child_frame_id: str
    transform: Transform


@dataclass
class TFMessage(IdlStruct, typename="tf2_msgs.msg.dds_.TFMessage_"):
    transforms: sequence[TransformStamped]


@dataclass
class Pose(IdlStruct, typename="geometry_msgs.msg.dds_.Pose_"):
    position: Vector3
    orientation: Quaternion


@dataclass
class PoseStamped(IdlStruct, typename="geometry_msgs.msg.dds_.PoseStamped_"):
    header: Header
    pose: Pose


tf = reader("rt/tf", TFMessage)
static = reader("rt/tf_static", TFMessage, LATCHED)
goal = writer("rt/goal_pose", PoseStamped)

links = {}
while not {("map", "odom"), ("odom", "base_link"), ("base_link", "lidar_top")} <= links.keys():
    for message in [*tf.take(100), *static.take(10)]:
        for link in message.transforms:
            at = link.transform
            turn = at.rotation
            links[link.header.frame_id, link.child_frame_id] = [at.translation.x, at.translation.y, turn.z, turn.w]
    time.sleep(0.02)

while not goal.get_matched_subscriptions():
    time.sleep(0.02)
x, y = float(sys.argv[2]), float(sys.argv[3])
stamp = Time(sec=int(time.time()), nanosec=0)
for frame in ["odom", "map"]:
    pose = Pose(position=Vector3(x=x, y=y, z=0.0), orientation=Quaternion(x=0.0, y=0.0, z=0.0, w=1.0))
    goal.write(PoseStamped(header=Header(stamp=stamp, frame_id=frame), pose=pose))
goal.wait_for_acks(duration(seconds=10))
print(json.dumps({"links": {"/".join(link): place for link, place in links.items()}}), flush=True)
