#!/usr/bin/env python3
"""The simulated robot as a Gymnasium environment, in virtual time and without its planner (docs/other-planners.md).

    pip install gymnasium numpy

    env = AdveeEnv(world="empty", people=0)
    observation, info = env.reset(seed=1)
    observation, reward, terminated, truncated, info = env.step(env.action_space.sample())

An episode is a drive to a goal. The action goes to the robot as a planner's command does, at priority 0 and 20 Hz: it
is slowed by the guard, and refused or stopped as any other. The program is `advee`: argument `program`, else $ADVEE,
else the one in the PATH, else the one that this checkout has built.
"""
import json
import os
import pathlib
import shutil
import subprocess

import gymnasium
import numpy as np

ROOT = pathlib.Path(__file__).resolve().parents[2]
PROTOCOL = 1
FAR_M = 100.0       # beyond it distances are clipped


class AdveeError(RuntimeError):
    """A request was refused, or the program has ended."""


def program_path():
    """Path of the program advee."""
    built = [str(ROOT / "target" / profile / "advee") for profile in ("release", "quick", "debug")]
    found = os.environ.get("ADVEE") or shutil.which("advee") or next(filter(os.path.exists, built), None)
    if not found:
        raise AdveeError("no program advee: set ADVEE, or build it: cargo build --release -p advee")
    return found


class Process:
    """A running `advee gym`: requests and answers as Python objects."""

    def __init__(self, program=None, config=None, arguments=()):
        config = config or ROOT / "conf" / "advee"
        line = [program or program_path(), "gym", "--config", str(config), *arguments]
        self._process = subprocess.Popen(line, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        self._interrupted = False

    def ask(self, request):
        """Sends a request and returns its answer; AdveeError if it is refused, or after an interrupted one: its answer
        would be taken for that of the next."""
        if self._interrupted:
            raise AdveeError("a request was interrupted before its answer came: make a new environment")
        try:
            text = json.dumps(request, allow_nan=False).encode()
        except ValueError as error:
            raise AdveeError(f"a request has finite numbers only: {error}") from error
        self._interrupted = True
        try:
            self._process.stdin.write(text + b"\n")
            self._process.stdin.flush()
            line = self._process.stdout.readline()
        except (BrokenPipeError, ValueError) as error:
            self._interrupted = False
            raise AdveeError(f"advee gym has ended: {error}") from error
        self._interrupted = False
        if not line:
            raise AdveeError(f"advee gym has ended with {self._process.wait()}; its error is on the terminal")
        answer = json.loads(line)
        if "error" in answer:
            raise AdveeError(answer["error"])
        return answer

    def close(self):
        """Ends the program; its exit code."""
        if not self._process.stdin.closed:
            try:
                self._process.stdin.close()
            except BrokenPipeError:
                pass  # it has ended before it read the last request
            self._process.stdout.close()
        return self._process.wait()


class AdveeEnv(gymnasium.Env):
    """Drive to a goal.

    Action: speed in m/s, and the steering angle in rad of a robot that steers, else the rotation in rad/s.

    Observation, in this order: goal forward and left in m, its distance in m, sine and cosine of its direction; speed
    forward in m/s, rotation in rad/s, steering angle in rad; bounds of the guard forward and backward in m/s; standard
    deviation of the position in m and of the heading in rad; the sonars in m; the sectors of the lidars in m. What is
    unknown is not free: a sonar or a sector without a measurement is 0. A sonar that received no echo is at its reach.

    Reward: the progress in m, less 0.05 for each second, less 10 for a contact in which the robot moved, plus 10 at the
    goal. Its parts are in info["reward"], and all that the program has answered is in info["state"].
    """

    metadata = {"render_modes": []}

    def __init__(self, world=None, people=None, step_s=0.2, episode_s=120.0, tolerance_m=0.5, program=None, config=None,
                 arguments=()):
        """`world` is a name in conf/worlds; `arguments` are further ones of `advee gym`."""
        self._process = Process(program, config, arguments)
        self.robot = robot = self._process.ask({"robot": {}})["robot"]
        if robot["protocol"] != PROTOCOL:
            self.close()
            raise AdveeError(f"advee gym has protocol {robot['protocol']}, not {PROTOCOL}")
        self._step_s = step_s
        self._reset = {"seconds": episode_s, "tolerance": tolerance_m}
        self._reset.update({key: value for key, value in (("world", world), ("people", people)) if value is not None})
        turn = robot["steering"] if robot["steers"] else robot["rotation"]
        self._highest = np.array([robot["speed"], turn])
        highest = self._highest.astype(np.float32)
        self.action_space = gymnasium.spaces.Box(-highest, highest, dtype=np.float32)
        speed, rotation, reach = robot["speed_max"], robot["rotation"], robot["sonar_reach"]
        low = [-FAR_M, -FAR_M, 0, -1, -1, -2 * speed, -2 * rotation, -np.pi, 0, 0, 0, 0]
        high = [FAR_M, FAR_M, FAR_M, 1, 1, 2 * speed, 2 * rotation, np.pi, FAR_M, FAR_M, FAR_M, FAR_M]
        low += [0] * (robot["sonars"] + robot["sectors"])
        high += [reach] * robot["sonars"] + [FAR_M] * robot["sectors"]
        self.observation_space = gymnasium.spaces.Box(np.float32(low), np.float32(high), dtype=np.float32)

    def reset(self, *, seed=None, options=None):
        """Begins an episode. `options` are keys of the request `reset`: goal, start, world, people, seconds."""
        super().reset(seed=seed)
        request = {**self._reset, "seed": int(self.np_random.integers(2**53)), **(options or {})}
        state = self._process.ask({"reset": request})
        return self._observed(state["observation"]), {"reward": state["reward"], "state": state}

    def step(self, action):
        """Drives for a while."""
        # Of 64 bits: rounded to 32, the highest value may be beyond the robot's limit, which would stop it.
        action = np.asarray(action, dtype=np.float64)
        speed, turn = (float(value) for value in np.clip(action, -self._highest, self._highest))
        turning = "steering" if self.robot["steers"] else "omega"
        state = self._process.ask({"step": {"v": speed, turning: turn, "seconds": self._step_s}})
        parts = state["reward"]
        reward = parts["progress"] - 0.05 * parts["time"] - 10.0 * parts["contact"]
        reward += 10.0 * (state["info"]["end"] == "reached")
        info = {"reward": parts, "state": state}
        return self._observed(state["observation"]), reward, state["terminated"], state["truncated"], info

    def close(self):
        """Ends the program."""
        self._process.close()

    def _observed(self, seen):
        goal, velocity, guard, estimate = (seen[key] for key in ("goal", "velocity", "guard", "estimate"))
        guard = guard or {"forward": 0.0, "backward": 0.0}
        reach = self.robot["sonar_reach"]
        # Before the first message of a sonar there is no list.
        sonars = [{2: distance, 1: reach}.get(status) or 0.0
                  for distance, status in zip(seen["sonars"], seen["sonar_status"])]
        sonars += [0.0] * (self.robot["sonars"] - len(sonars))
        bearing = goal["bearing"] or 0.0
        # An unknown pose may be anywhere.
        deviations = (estimate[key] for key in ("sd_x", "sd_y", "sd_theta"))
        sd_x, sd_y, sd_theta = (FAR_M if value is None else value for value in deviations)
        values = [goal["x"], goal["y"], goal["distance"], np.sin(bearing), np.cos(bearing),
                  velocity["vx"], velocity["omega"], velocity["steering"], guard["forward"], guard["backward"],
                  np.hypot(sd_x, sd_y), sd_theta, *sonars, *seen["lidar"]]
        values = np.array([0.0 if value is None else value for value in values], dtype=np.float32)
        return np.clip(values, self.observation_space.low, self.observation_space.high)
