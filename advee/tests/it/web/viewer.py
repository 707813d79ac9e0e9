"""Independent viewer of the live endpoint: websockets for the wire, rosbags and mcap-ros2-support for the messages.
Reads commands from stdin, one JSON object per line, and answers each with one on stdout.

    ready                  answers once the endpoint is available
    watch SECONDS TOPICS FIELDS   subscribes to topics (empty: all); returns counts and values received in the time
    bad                    sends malformed and hostile input; returns the reactions
    crowd N                opens N viewers at once; returns the number accepted
    slow SECONDS           subscribes to all, reads nothing for a while; returns the age of the data received then
    status ORIGIN PROTOCOL   returns the HTTP status of a handshake
"""

import asyncio
import json
import socket
import struct
import sys
import time
from urllib.parse import urlsplit

import websockets
from mcap_ros2._dynamic import generate_dynamic
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

URL = sys.argv[1]
PROTOCOLS = ["foxglove.sdk.v1", "foxglove.websocket.v1"]


def decoders(channel):
    """Decoders of a message by two independent readers."""
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(channel["schema"], channel["schemaName"]))
    dynamic = generate_dynamic(channel["schemaName"], channel["schema"])[channel["schemaName"]]
    return lambda data: (store.deserialize_cdr(data, channel["schemaName"]), dynamic(data))


def value(message, path):
    for name in path.split("."):
        message = message[int(name)] if name.isdigit() else getattr(message, name)
    return message


class Viewer:
    def __init__(self, stream):
        self.stream, self.channels, self.status, self.info = stream, {}, [], None

    async def text(self, message):
        message = json.loads(message)
        if message["op"] == "serverInfo":
            self.info = message
        elif message["op"] == "advertise":
            self.channels.update({channel["id"]: channel for channel in message["channels"]})
        elif message["op"] == "status":
            self.status.append(message)
        else:
            raise ValueError(message)

    async def until(self, condition, seconds=5):
        end = time.monotonic() + seconds
        while not condition():
            message = await asyncio.wait_for(self.stream.recv(), end - time.monotonic())
            if isinstance(message, str):
                await self.text(message)

    async def subscribe(self, channels):
        wanted = [{"id": 1000 + channel, "channelId": channel} for channel in channels]
        await self.stream.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))


def connect(protocols=PROTOCOLS, **options):
    return websockets.connect(URL, subprotocols=protocols, max_size=None, compression=None, **options)


async def ready():
    return {}


async def watch(seconds, topics, fields, everything=False):
    """Decodes the topics with requested fields, or everything."""
    async with connect() as stream:
        viewer = Viewer(stream)
        decode, counts, first, got, times = {}, {}, {}, {}, []
        begin, asked = time.time(), set()
        end = begin + seconds
        while True:
            try:
                message = await asyncio.wait_for(stream.recv(), max(0.5, end - time.time()))
            except asyncio.TimeoutError:
                break
            if isinstance(message, str):
                await viewer.text(message)
                new = [i for i, c in viewer.channels.items() if i not in asked and (not topics or c["topic"] in topics)]
                asked.update(new)
                await viewer.subscribe(new)
                continue
            if message[0] == 2:
                times.append(struct.unpack_from("<Q", message, 1)[0])
                continue
            opcode, subscription, stamp = struct.unpack_from("<BIQ", message)
            assert opcode == 1
            if stamp / 1e9 > end:
                break
            assert stamp / 1e9 > begin - 60, "a log time of today"
            channel = viewer.channels[subscription - 1000]
            topic = channel["topic"]
            first.setdefault(topic, time.time() - begin)
            counts[topic] = counts.get(topic, 0) + 1
            if not everything and topic not in fields:
                continue
            if topic not in decode:
                assert channel["encoding"] == "cdr" and channel["schemaEncoding"] == "ros2msg"
                decode[topic] = decoders(channel)
            ours, theirs = decode[topic](message[13:])
            for path in fields.get(topic, []):
                pair = [value(message, path) for message in (ours, theirs)]
                assert pair[0] == pair[1] or pair[0] != pair[0], (topic, path, pair)
                got.setdefault(topic + ":" + path, []).append(pair[0].item() if hasattr(pair[0], "item") else pair[0])
        assert times == sorted(times)
        return {
            "info": viewer.info,
            "protocol": stream.subprotocol,
            "status": viewer.status,
            "counts": counts,
            "first": first,
            "values": got,
            "times": len(times),
            "schemas": {c["topic"]: c["schemaName"] for c in viewer.channels.values()},
        }


NONSENSE = [
    "", "{", "null", "[]", "7", '{"op":7}', '{"op":"hello"}', '{"op":"subscribe"}', '{"op":"subscribe","subscriptions":{}}',
    '{"op":"subscribe","subscriptions":[{"id":-1,"channelId":0}]}', '{"op":"subscribe","subscriptions":[{"id":1,"channelId":4000000000}]}',
    '{"op":"unsubscribe","subscriptionIds":[123456]}', "[" * 5000, '{"op":"\\ud800"}', "\x00", b"", b"\x00", b"\x09\x01", b"\xff" * 60000,
]
NOT_GRANTED = [
    '{"op":"advertise","channels":[{"id":1,"topic":"LL_CMD_MOTION","encoding":"cdr","schemaName":"x"}]}',
    '{"op":"unadvertise","channelIds":[1]}', '{"op":"setParameters","parameters":[]}', '{"op":"getParameters","parameterNames":[]}',
    '{"op":"subscribeConnectionGraph"}', '{"op":"fetchAsset","uri":"file:///etc/passwd","requestId":1}',
    b"\x01\x01\x00\x00\x00drive", b"\x02\x01\x00\x00\x00call", b"\x03play",
]


async def bad():
    answered = []
    async with connect() as stream:
        viewer = Viewer(stream)
        await viewer.until(lambda: viewer.channels)
        for message in NONSENSE + NOT_GRANTED:
            before = len(viewer.status)
            await stream.send(message)
            await viewer.until(lambda: len(viewer.status) > before)
            answered.append(viewer.status[-1]["message"])
        # It is served all the same.
        await viewer.subscribe(list(viewer.channels)[:1])
    closed = {}
    for name, message in [("long text", "x" * 70_000), ("long binary", b"x" * 200_000)]:
        async with connect() as stream:
            viewer = Viewer(stream)
            await viewer.until(lambda: viewer.info)
            await stream.send(message)
            closed[name] = await gone(stream)
    async with connect() as stream:
        viewer = Viewer(stream)
        await viewer.until(lambda: viewer.info)
        try:
            for _ in range(150):
                await stream.send("{")
        except websockets.ConnectionClosed:
            pass
        closed["only nonsense"] = await gone(stream)
    # A frame that RFC 6455 does not define, and a text with broken UTF-8.
    for name, raw in [("reserved opcode", b"\x83\x80\0\0\0\0"), ("not masked", b"\x81\x01x"), ("not UTF-8", b"\x81\x81\0\0\0\0\xff")]:
        async with connect() as stream:
            viewer = Viewer(stream)
            await viewer.until(lambda: viewer.info)
            stream.transport.write(raw)
            closed[name] = await gone(stream)
    # A client that disconnects without a close frame.
    async with connect() as stream:
        viewer = Viewer(stream)
        await viewer.until(lambda: viewer.info)
        stream.transport.abort()
    return {"answers": answered, "closed": closed}


async def gone(stream):
    try:
        while True:
            await asyncio.wait_for(stream.recv(), 10)
    except websockets.ConnectionClosed as closed:
        return closed.rcvd.code if closed.rcvd else 0


async def crowd(count):
    streams, refused = [], []
    for _ in range(count):
        try:
            streams.append(await connect())
        except websockets.InvalidStatus as error:
            refused.append(error.response.status_code)
    for stream in streams:
        await stream.close()
    return {"in": len(streams), "refused": refused}


async def slow(seconds):
    line = socket.socket()
    line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 32 << 10)
    line.connect((urlsplit(URL).hostname, urlsplit(URL).port))
    line.setblocking(False)
    async with connect(sock=line, max_queue=1) as stream:
        viewer = Viewer(stream)
        await viewer.until(lambda: len(viewer.channels) > 10)
        await viewer.subscribe(viewer.channels)
        stream.transport.pause_reading()
        await asyncio.sleep(seconds)
        stream.transport.resume_reading()
        # The data in the socket buffers is old; new data follows it.
        end, youngest, count = time.monotonic() + 3, 1e9, 0
        while time.monotonic() < end:
            message = await asyncio.wait_for(stream.recv(), 5)
            if not isinstance(message, str) and message[0] == 1:
                count += 1
                youngest = min(youngest, time.time() - struct.unpack_from("<BIQ", message)[2] / 1e9)
        return {"youngest": youngest, "count": count}


async def status(origin, protocol):
    try:
        async with connect([protocol] if protocol else None, origin=origin):
            return {"status": 101}
    except websockets.InvalidStatus as error:
        return {"status": error.response.status_code}


async def main():
    commands = {"ready": ready, "watch": watch, "bad": bad, "crowd": crowd, "slow": slow, "status": status}
    loop = asyncio.get_running_loop()
    while line := await loop.run_in_executor(None, sys.stdin.readline):
        command, *arguments = json.loads(line)
        print(json.dumps(await commands[command](*arguments), default=str), flush=True)


asyncio.run(main())
