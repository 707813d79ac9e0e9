#!/usr/bin/env python3
"""Runs outside, as a person with a browser. Pairs by the code, takes control, holds to drive, sees the speed in the view, lets
go, sees it stand.

The robot's clock is the emulated processor's, and its rate varies. Time is therefore taken from the robot's messages, and
a hold that was lost because this machine was busy is started again, as a person would.
"""

import http.client
import importlib.util
import json
import os
import socket
import subprocess
import sys
import time

SHARE = os.environ["LAB_SHARE"]
ADDRESS, PORT = os.environ["LAB_WEB"].split(":")
HOST = f"robot.lab:{PORT}"
ORIGIN = f"http://{HOST}"
SPEED, STEERING = 0.3, 0.0
DRIVEN_S = 3.0
PRESSES_MAX = 20
# Of wall time.
LIMIT_S = 150


def told(name, text):
    """Writes a file of the share atomically."""
    with open(f"{SHARE}/{name}.new", "w", encoding="utf-8") as f:
        f.write(text)
    os.rename(f"{SHARE}/{name}.new", f"{SHARE}/{name}")


def code():
    """The operator's code, once the guest has written it; None if the guest's check is skipped."""
    for _ in range(6000):
        if os.path.exists(f"{SHARE}/code"):
            with open(f"{SHARE}/code", encoding="utf-8") as f:
                return json.loads(f.readline())["operator"]
        if os.path.exists(f"{SHARE}/debs/skip"):
            return None
        time.sleep(0.1)
    raise SystemExit("no code came")


def ask(method, path, body=None, headers=None):
    connection = http.client.HTTPConnection(ADDRESS, int(PORT), timeout=30)
    content = None if body is None else json.dumps(body)
    sent = {"Host": HOST, "Origin": ORIGIN, "Content-Type": "application/json", **(headers or {})}
    connection.request(method, path, content, sent)
    answer = connection.getresponse()
    return answer, answer.read()


def pair(eight_digits):
    """The session's cookie."""
    answer, body = ask("GET", "/api/me")
    assert json.loads(body)["role"] == "nobody", body
    answer, body = ask("GET", "/api/logs")
    assert answer.status == 401, f"logs without being paired: {answer.status}"
    answer, body = ask("POST", "/api/pair", {"code": "00000000", "name": "stranger"})
    assert answer.status == 403, f"a wrong code: {answer.status}"
    answer, body = ask("POST", "/api/pair", {"code": eight_digits, "name": "lab"})
    assert answer.status == 200 and json.loads(body)["role"] == "operator", (answer.status, body)
    return answer.getheader("Set-Cookie").split(";")[0]


def connected(path, cookie):
    """A WebSocket as the page uses it."""
    from websockets.sync.client import connect

    there = socket.create_connection((ADDRESS, int(PORT)), timeout=30)
    return connect(f"ws://{HOST}{path}", sock=there, origin=ORIGIN, additional_headers={"Cookie": cookie}, max_size=None)


def heard(connection, timeout=30):
    return json.loads(connection.recv(timeout=timeout))


class Driver:
    """The driver; `now` is the robot's clock, s."""

    def __init__(self, view, command):
        self.view, self.command = view, command
        self.until = time.monotonic() + LIMIT_S
        self.hold = self.seq = 0

    def look(self):
        """The next update of the motion: (robot's time, motion)."""
        while time.monotonic() < self.until:
            part = heard(self.view)
            motion = part["motion"]["value"] if part["part"] == "drive" else None
            if motion:
                return motion["timestamp"] * 1e-6, motion
        raise SystemExit("not done in time")

    def say(self, **command):
        self.command.send(json.dumps(command))

    def news(self):
        """The answers of the server so far."""
        while True:
            try:
                yield heard(self.command, timeout=0)
            except TimeoutError:
                return

    def answered(self, kind):
        while time.monotonic() < self.until:
            answer = heard(self.command)
            if answer["type"] == kind:
                return answer
            assert answer["type"] != "refused", answer
        raise SystemExit(f"no {kind}")

    def drive(self):
        """Holds for some seconds of the robot's time; returns the highest speed."""
        fastest, driven, last = 0.0, 0.0, None
        self.hold += 1
        while driven < DRIVEN_S:
            now, motion = self.look()
            fastest = max(fastest, motion["speed"] or 0.0)
            driven += now - last if last else 0.0
            last = now
            for answer in self.news():
                if answer["type"] == "ended":
                    print(f"hold {answer['hold']} ended: {answer['why']}")
                    self.hold += 1
                    last = None
                assert answer["type"] != "refused", answer
            assert self.hold <= PRESSES_MAX, "each hold is lost"
            self.seq += 1
            self.say(type="drive", hold=self.hold, seq=self.seq, t=now * 1e3, speed=SPEED, steering=STEERING)
        return fastest

    def let_go(self):
        """Time until it is seen to stand still, by the robot's clock."""
        self.seq += 1
        self.say(type="zero", hold=self.hold, seq=self.seq)
        begun = None
        while True:
            now, motion = self.look()
            begun = begun or now
            if abs(motion["speed"] or 0.0) < 0.01 and motion["speed_target"] == 0:
                return now - begun


def skip(why):
    """The guest's check reports why it is skipped."""
    os.makedirs(f"{SHARE}/debs", exist_ok=True)
    told("debs/skip", why + "\n")
    told("debs/done", "")


def main():
    if not importlib.util.find_spec("websockets"):
        skip("websockets is missing on the machine that the lab runs on: tools/venv")
        return 0
    if subprocess.run([os.path.join(os.path.dirname(os.path.abspath(__file__)), "package_debs.sh")], check=False).returncode:
        return 1
    digits = code()
    if digits is None:
        return 0
    cookie = pair(digits)
    print("paired as an operator")
    with connected("/ws/view", cookie) as view, connected("/ws/command", cookie) as command:
        driver = Driver(view, command)
        welcome = driver.answered("welcome")
        driver.say(**{"type": "take", "id": 1, "from": None})
        while not driver.answered("authority")["yours"]:
            pass
        print(f"in control, as {welcome['name']}")
        fastest = driver.drive()
        stood = driver.let_go()
    text = f"driven from outside at {fastest:.2f} m/s, in {driver.hold} presses; let go, it stood after {stood:.2f} s"
    print(text)
    told("driven", text + "\n")
    assert fastest > 0.8 * SPEED, f"{fastest} m/s is not what was asked for"
    return 0


if __name__ == "__main__":
    sys.exit(main())
