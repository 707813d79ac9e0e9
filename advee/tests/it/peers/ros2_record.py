"""Unmodified ROS 2 records what the robot publishes: `ros2_record.py DOMAIN FILE COUNT TOPIC...`, until there are COUNT
messages of each of the topics. Each one is read by its type as well. Prints a line of JSON: messages by topic.

Everything waits for what it needs; the test bounds the time.
"""

import json
import sys

from ros2_listen import Listener  # first: it sets the domain

import rclpy
from rclpy.serialization import deserialize_message
from ros2_bag import Bag


class Recorder(Listener):
    def __init__(self, path):
        super().__init__()
        self.bag = Bag(path)

    def on_topic(self, topic, kind, reliable):
        self.bag.add(topic, kind, reliable)

    def on_message(self, topic, message, data, info):
        deserialize_message(data, message)
        sequence, sent = info["publication_sequence_number"], info["source_timestamp"]
        self.bag.write(topic, data, info["received_timestamp"], sent, sequence)


rclpy.init()
recorder = Recorder(sys.argv[2])
while not recorder.bag.has(int(sys.argv[3]), sys.argv[4:]):
    recorder.wait()
recorder.bag.close()
print(json.dumps({"counts": recorder.bag.counts, "reported": recorder.reported}), flush=True)
recorder.destroy_node()
rclpy.shutdown()
