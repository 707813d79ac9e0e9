"""Publisher of `/cmd_vel` for benches/ros2.rs, on unmodified ROS 2: `publisher.py DOMAIN`.

Each line of the input is a speed in m/s, which is published. Its answer is the time right before that, in ns of the
monotonic clock. The first line of the output is 0: the robot listens.
"""

import os
import sys
import time

os.environ["ROS_DOMAIN_ID"] = sys.argv[1]
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["FASTDDS_BUILTIN_TRANSPORTS"] = "UDPv4"
os.environ["RMW_IMPLEMENTATION"] = "rmw_fastrtps_cpp"

import rclpy
from geometry_msgs.msg import Twist

PATIENCE = 60.0

rclpy.init()
node = rclpy.create_node("bench")
publisher = node.create_publisher(Twist, "/cmd_vel", 1)
end = time.monotonic() + PATIENCE
while publisher.get_subscription_count() == 0:
    if time.monotonic() > end:
        sys.exit("nobody listens to /cmd_vel")
    time.sleep(0.05)
print(0, flush=True)
for line in sys.stdin:
    twist = Twist()
    twist.linear.x = float(line)
    at = time.monotonic_ns()
    publisher.publish(twist)
    print(at, flush=True)
