"""Unmodified ROS 2 hears all reliable topics of the robot at their full rate: `ros2_long.py DOMAIN SECONDS`, also for
an hour, beside a robot that is called courier. Lost samples are gaps in the numbers of their writers, which come with
each sample. In the middle, and of a longer time in the middle of each minute, a further participant comes
(ros2_late.py), waits for what lasts, and goes.

Prints a line of JSON: the number of samples, of those lost, and of those that came twice or too late, in all and of
each topic, of which also the longest time without a sample, s; what the middleware reports as lost, that before its
first sample of a topic included; the times until the further participants had what lasts, s. It ends when SECONDS have
passed and the last of them has it; the test bounds the time.
"""

import json
import pathlib
import subprocess
import sys
import time

from ros2_listen import Listener  # first: it sets the domain

import rclpy


class Topic:
    """Samples of a topic."""

    def __init__(self):
        self.count = self.lost = self.again = 0
        self.number = None
        self.longest, self.at = 0.0, time.monotonic()

    def take(self, number):
        self.look()
        self.count += 1
        if self.number is None or number > self.number:
            self.lost += 0 if self.number is None else number - self.number - 1
            self.number = number
        else:
            self.again += 1

    def look(self):
        now = time.monotonic()
        self.longest, self.at = max(self.longest, now - self.at), now

    def report(self):
        self.look()
        return {"count": self.count, "lost": self.lost, "again": self.again, "longest_s": round(self.longest, 3)}


class Counter(Listener):
    def __init__(self):
        super().__init__()
        self.topics = {}

    def wants(self, reliable):
        return reliable

    def on_topic(self, topic, kind, reliable):
        self.topics[topic] = Topic()

    def on_message(self, topic, message, data, info):
        self.topics[topic].take(info["publication_sequence_number"])


class Joins:
    """Further participants, one after the other."""

    def __init__(self, begin, seconds):
        count = max(1, int(seconds / 60))
        self.due = [begin + seconds * (number + 0.5) / count for number in range(count)]
        self.late = None
        self.took = []

    def go_on(self):
        """False when the last one is gone."""
        if self.late is None and self.due and self.due[0] <= time.monotonic():
            self.due.pop(0)
            program = [sys.executable, str(pathlib.Path(__file__).with_name("ros2_late.py")), sys.argv[1]]
            self.late = subprocess.Popen(program, stdout=subprocess.PIPE, text=True)
        elif self.late is not None and self.late.poll() is not None:
            self.took.append(float(self.late.stdout.read()))
            self.late = None
        return self.late is not None or bool(self.due)

    def end(self):
        if self.late is not None:
            self.late.kill()


def main():
    seconds = float(sys.argv[2])
    rclpy.init()
    counter = Counter()
    # The time begins when there is something to be heard.
    while "/odom" not in counter.topics or counter.topics["/odom"].count == 0:
        counter.wait()
    begin = time.monotonic()
    joins = Joins(begin, seconds)
    try:
        while joins.go_on() or time.monotonic() < begin + seconds:
            counter.wait()
    finally:
        joins.end()
    topics = {name: topic.report() for name, topic in sorted(counter.topics.items())}
    total = {what: sum(topic[what] for topic in topics.values()) for what in ["count", "lost", "again"]}
    said = {"seconds": round(time.monotonic() - begin, 1), **total, "reported": counter.reported, "joins": joins.took}
    print(json.dumps({**said, "topics": topics}), flush=True)
    counter.destroy_node()
    rclpy.shutdown()


main()
