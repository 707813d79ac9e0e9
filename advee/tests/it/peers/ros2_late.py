"""A participant of unmodified ROS 2 (rclpy on Fast DDS) that comes while the robot runs: `ros2_late.py DOMAIN`. Prints
the time from its creation until it has what lasts, s."""

import os
import sys
import time

os.environ["ROS_DOMAIN_ID"] = sys.argv[1]
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["FASTDDS_BUILTIN_TRANSPORTS"] = "UDPv4"
os.environ["RMW_IMPLEMENTATION"] = "rmw_fastrtps_cpp"

import rclpy
from nav_msgs.msg import OccupancyGrid
from rclpy.qos import DurabilityPolicy, QoSProfile
from tf2_msgs.msg import TFMessage

LASTING = {"/map": OccupancyGrid, "/tf_static": TFMessage}

begin = time.monotonic()
rclpy.init()
node = rclpy.create_node("late")
qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
got = {}
for topic, kind in LASTING.items():
    node.create_subscription(kind, topic, lambda message, topic=topic: got.setdefault(topic, message), qos)
while len(got) < len(LASTING):
    rclpy.spin_once(node, timeout_sec=0.1)
print(round(time.monotonic() - begin, 3), flush=True)
node.destroy_node()
rclpy.shutdown()
