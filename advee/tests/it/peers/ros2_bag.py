"""A recording as `ros2 bag record` makes it: an MCAP file of the profile `ros2`, with all messages as they came."""

from mcap.writer import CompressionType, Writer


class Bag:
    def __init__(self, path):
        self.file = open(path, "wb")
        self.writer = Writer(self.file, compression=CompressionType.NONE)
        self.writer.start(profile="ros2", library="a peer of the tests")
        self.channels = {}
        self.counts = {}

    def add(self, topic, kind, reliable):
        quality = {"offered_qos_profiles": f"- reliability: {'reliable' if reliable else 'best_effort'}\n"}
        schema = self.writer.register_schema(kind, "ros2msg", b"")
        self.channels[topic] = self.writer.register_channel(topic, "cdr", schema, quality)
        self.counts[topic] = 0

    def write(self, topic, data, received, sent, sequence=0):
        self.writer.add_message(self.channels[topic], received, data, sent, sequence)
        self.counts[topic] += 1

    def has(self, count, topics):
        return all(self.counts.get(topic, 0) >= count for topic in topics)

    def close(self):
        self.writer.finish()
        self.file.close()
