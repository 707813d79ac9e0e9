"""Reads a log with independent readers, `mcap`, `mcap-ros2-support` and `rosbags`: `read_log.py FILE...`, the files of
a run in order; prints JSON: for each topic the number of messages found by each reader, and some values."""
import json
import sys
from pathlib import Path

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.rosbag2.storage_mcap import McapReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

result = {"files": [], "mcap": {}, "ros2": {}, "rosbags": {}, "last": {}}
for path in sys.argv[1:]:
    with open(path, "rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        result["files"].append(
            {
                "profile": reader.get_header().profile,
                "chunks": len(summary.chunk_indexes),
                "messages": summary.statistics.message_count,
                "attachments": sorted(a.name for a in reader.iter_attachments()),
                "metadata": sorted(m.name for m in reader.iter_metadata()),
            }
        )
        for _, channel, _ in reader.iter_messages():
            result["mcap"][channel.topic] = result["mcap"].get(channel.topic, 0) + 1
        cdr = [c.topic for c in summary.channels.values() if c.message_encoding == "cdr"]
        for _, channel, _, message in reader.iter_decoded_messages(topics=cdr):
            result["ros2"][channel.topic] = result["ros2"].get(channel.topic, 0) + 1
            if channel.topic in ("/LL_DATA_ODO", "/LL_DATA_POWER"):
                fields = message.__slots__
                result["last"][channel.topic] = {f: getattr(message, f) for f in fields if f != "channels"}

    # rosbags expects a bag to be a folder with metadata of ROS 2; its reader of single files needs none.
    bag = McapReader(Path(path))
    bag.open()
    store = get_typestore(Stores.EMPTY)
    known = [c for c in bag.connections if c.topic.startswith("/")]
    for connection in known:
        store.register(
            {k: v for k, v in get_types_from_msg(connection.msgdef.data, connection.msgtype).items() if k not in store.types}
        )
    for connection, _, data in bag.messages(known):
        store.deserialize_cdr(data, connection.msgtype)
        result["rosbags"][connection.topic] = result["rosbags"].get(connection.topic, 0) + 1
    bag.close()
json.dump(result, sys.stdout)
