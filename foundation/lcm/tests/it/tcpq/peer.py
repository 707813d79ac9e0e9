"""A TCPQ client on the official Python package: commands on stdin, a line each, answered by `done`; what it receives
is `got CHANNEL SIZE SHA1`."""

import hashlib
import select
import sys

import lcm


def say(*words):
    print(*words, flush=True)


def payload(size):
    return bytes((7 * i + (i >> 8)) & 255 for i in range(size))


def got(channel, data):
    say("got", channel, len(data), hashlib.sha1(data).hexdigest())


bus = lcm.LCM(sys.argv[1])
subscriptions = {}
say("ready")
while True:
    readable, _, _ = select.select([bus.fileno(), sys.stdin], [], [])
    if bus.fileno() in readable:
        bus.handle()
        continue
    command = sys.stdin.readline().split()
    if not command:
        break
    if command[0] == "subscribe":
        subscriptions[command[1]] = bus.subscribe(command[1], got)
    elif command[0] == "unsubscribe":
        bus.unsubscribe(subscriptions.pop(command[1]))
    elif command[0] == "publish":
        bus.publish(command[1], payload(int(command[2])))
    say("done")
