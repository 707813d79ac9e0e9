"""A node of unmodified ROS 2 (rclpy on Fast DDS) that hears all topics of the robot, as `ros2 bag record --all` does.
The first argument of the program that imports it is the domain."""

import importlib
import os
import sys

os.environ["ROS_DOMAIN_ID"] = sys.argv[1]
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["FASTDDS_BUILTIN_TRANSPORTS"] = "UDPv4"
os.environ["RMW_IMPLEMENTATION"] = "rmw_fastrtps_cpp"

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

ROBOT = "courier"


class Listener(Node):
    """Subscribes with the qualities that the robot offers, and so deep that no sample is lost on this side."""

    def __init__(self):
        super().__init__("listener")
        self.heard = {}
        # Samples that the middleware reports as lost.
        self.reported = 0
        self.create_timer(0.2, self.discover)
        self.runner = SingleThreadedExecutor()
        self.runner.add_node(self)

    def wait(self):
        """Handles what comes next, within some time."""
        self.runner.spin_once(timeout_sec=0.1)

    def discover(self):
        for topic, kinds in self.get_topic_names_and_types():
            if topic not in self.heard and "/_action/" not in topic:
                offered = [one for one in self.get_publishers_info_by_topic(topic) if one.node_name == ROBOT]
                if offered:
                    self.hear(topic, kinds[0], offered[0])

    def hear(self, topic, kind, offered):
        self.heard[topic] = kind
        quality = offered.qos_profile
        reliable = quality.reliability == ReliabilityPolicy.RELIABLE
        if not self.wants(reliable):
            return
        package, _, name = kind.split("/")
        try:
            message = getattr(importlib.import_module(package + ".msg"), name)
        except ModuleNotFoundError:
            return  # of a type that is not installed
        qos = QoSProfile(depth=1000, reliability=quality.reliability, durability=quality.durability)
        robot = bytes(offered.endpoint_gid[:12])

        def on_message(data, info):
            # Other nodes publish there too.
            if topic != "/rosout" or info["publisher_gid"]["data"][:12] == robot:
                self.on_message(topic, message, data, info)

        events = SubscriptionEventCallbacks(message_lost=self.on_lost)
        self.on_topic(topic, kind, reliable)
        self.create_subscription(message, topic, on_message, qos, raw=True, event_callbacks=events)

    def on_lost(self, event):
        self.reported += event.total_count_change

    def wants(self, reliable):
        """True if a topic of this quality is to be heard."""
        return True

    def on_topic(self, topic, kind, reliable):
        """A topic of the robot is heard from now on."""

    def on_message(self, topic, message, data, info):
        """A message of this class, as CDR."""
