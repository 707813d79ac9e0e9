"""Decodes CDR with two independent readers, rosbags and mcap-ros2-support, from the ros2msg text alone.

stdin: one line of JSON per message, {"name", "text", "cdr" (hexadecimal)}. stdout: one line each, [of rosbags, of mcap]:
structs as lists of [name, value], numbers that JSON cannot represent as texts. Last line: {"jazzy": [...], "humble":
[...]}, the types of standard packages whose definition differs from that edition of ROS 2.
"""

import json
import math
import sys

from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

factory = DecoderFactory()
editions = {"jazzy": get_typestore(Stores.ROS2_JAZZY), "humble": get_typestore(Stores.ROS2_HUMBLE)}
differing = {edition: set() for edition in editions}


def plain(value, store=None):
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, (bytes, memoryview)):
        value = list(value)
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if isinstance(value, list):
        return [plain(element, store) for element in value]
    if isinstance(value, (bool, int, float, str)):
        return value
    names = [name for name, _ in store.fielddefs[value.__msgtype__][1]] if store else value.__slots__
    return [[name, plain(getattr(value, name), store)] for name in names]


def prepare(name, text):
    types = get_types_from_msg(text, name)
    for edition, store in editions.items():
        for ty, definition in types.items():
            if ty in store.fielddefs:
                if store.fielddefs[ty] != definition:
                    differing[edition].add(ty)
            elif ty.split("/")[0].endswith(("_msgs", "_interfaces")) and not ty.startswith("lcm_"):
                differing[edition].add(ty)
    store = get_typestore(Stores.EMPTY)
    store.register(types)
    schema = Schema(id=len(known) + 1, data=text.encode(), encoding="ros2msg", name=name)
    return store, factory.decoder_for("cdr", schema)


known = {}
for line in sys.stdin:
    message = json.loads(line)
    name, text, cdr = message["name"], message["text"], bytes.fromhex(message["cdr"])
    if (name, text) not in known:
        known[name, text] = prepare(name, text)
    store, decode = known[name, text]
    print(json.dumps([plain(store.deserialize_cdr(cdr, name), store), plain(decode(cdr))], allow_nan=False))
print(json.dumps({edition: sorted(types) for edition, types in differing.items()}))
