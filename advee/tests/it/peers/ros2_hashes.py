"""Unmodified ROS 2 (rclpy on Fast DDS) judges the hashes of types that the robot announces.

`ros2_hashes.py DOMAIN TOPIC...`: the topics are those that the robot has at least, as DDS names them. Each type of the
robot's topics, requests and answers gets an endpoint of rclpy as well, and the hashes of both are compared. Prints a
line of JSON. Everything waits for what it needs; the test bounds the time.
"""

import importlib
import json
import os
import sys

os.environ["ROS_DOMAIN_ID"] = sys.argv[1]
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["FASTDDS_BUILTIN_TRANSPORTS"] = "UDPv4"
os.environ["RMW_IMPLEMENTATION"] = "rmw_fastrtps_cpp"

import rclpy
from rclpy.action import ActionServer

ROBOT, JUDGE = "courier", "judge"
NEEDED = set(sys.argv[2:])


class Judge:
    def __init__(self):
        rclpy.init()
        self.node = rclpy.create_node(JUDGE)
        self.made = {}

    def endpoints(self):
        """Each endpoint that is known: participant, name of the node, topic and type in DDS, and the type's hash."""
        for topic, _ in self.node.get_topic_names_and_types(no_demangle=True):
            for known in (self.node.get_publishers_info_by_topic, self.node.get_subscriptions_info_by_topic):
                for one in known(topic, no_mangle=True):
                    participant = bytes(one.endpoint_gid[:12])
                    yield participant, one.node_name, topic, one.topic_type, str(one.topic_type_hash)

    def compare(self):
        """The robot's topics, and of each of its types the hashes by the robot and by rclpy."""
        endpoints = list(self.endpoints())
        # The topic of the graph belongs to a participant, and not to its node.
        names = {participant: node for participant, node, *_ in endpoints if node in (ROBOT, JUDGE)}
        topics, hashes = set(), {}
        for participant, _, topic, kind, digest in endpoints:
            name = names.get(participant)
            hashes.setdefault(kind, {ROBOT: set(), JUDGE: set(), None: set()})[name].add(digest)
            if name == ROBOT:
                topics.add(topic)
        pairs = {kind: (sorted(by[ROBOT]), sorted(by[JUDGE])) for kind, by in hashes.items()}
        return topics, {kind: pair for kind, pair in pairs.items() if pair[0]}

    def make(self, kind):
        """An endpoint of rclpy that has this type, as `std_srvs::srv::dds_::SetBool_Request_`."""
        package, folder, _, name = kind.removesuffix("_").split("::")
        name = name.split("_")[0]
        if (package, name) in self.made or kind.startswith("rmw_dds_common::"):
            return
        one = getattr(importlib.import_module(f"{package}.{folder}"), name)
        topic = f"/reference/{package}/{name}"
        self.made[package, name] = {
            "msg": lambda: self.node.create_publisher(one, topic, 1),
            "srv": lambda: self.node.create_service(one, topic, lambda _, answer: answer),
            "action": lambda: ActionServer(self.node, one, topic, lambda goal: None),
        }[folder]()

    def judge(self):
        topics, pairs = set(), {}
        while not (NEEDED <= topics and all(reference for _, reference in pairs.values())):
            rclpy.spin_once(self.node, timeout_sec=0.2)
            topics, pairs = self.compare()
            for kind in pairs:
                self.make(kind)
        differ = {kind: pair for kind, pair in pairs.items() if pair[0] != pair[1] or "INVALID" in pair[0]}
        return {"topics": sorted(topics), "types": len(pairs), "differ": differ}


judge = Judge()
print(json.dumps(judge.judge()), flush=True)
judge.node.destroy_node()
rclpy.shutdown()
