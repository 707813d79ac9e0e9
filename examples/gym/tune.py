#!/usr/bin/env python3
"""Tunes a steering law of six numbers by the cross-entropy method, and compares it with the untuned one on other goals.

    pip install gymnasium numpy
    tune.py [--generations N] [--population N] [--goals N] [--world NAME] [--seed N]

The law steers towards the goal and away from what the sonars measure, slows down before it, and backs out for a while
when the guard permits no way ahead. Each candidate drives to the same goals; the best quarter of a generation gives the
mean and the spread of the next one.
"""
import argparse
import time

import numpy as np

from advee_gym import AdveeEnv

NAMES = ("speed, m/s", "steering by bearing", "steering by echoes", "echoes count up to, m", "slows before, m",
         "backs out for, s")
LOW = np.array([0.1, 0.2, 0.0, 0.5, 0.2, 0.5])
HIGH = np.array([0.8, 3.0, 2.0, 3.0, 3.0, 6.0])
ELITE = 0.25
SPREAD_MIN = 0.02       # of the range: the search never stands still


class Law:
    """From state to action; remembers until when it backs out."""

    def __init__(self, parameters, robot):
        self.speed, self.turn, self.avoid, self.reach, self.slow, self.back = parameters
        self.steering, self.back_until = robot["steering"] if robot["steers"] else robot["rotation"], 0.0
        self.sonar_reach = robot["sonar_reach"]
        directions = np.array(robot["sonar_directions"])
        self.left, self.right = (np.abs(directions - side) < 1.1 for side in (0.9, -0.9))
        self.ahead = np.abs(directions) < 0.6

    def __call__(self, seen):
        distances = np.array([{2: distance, 1: self.sonar_reach}.get(status) or 0.0
                              for distance, status in zip(seen["sonars"], seen["sonar_status"])])
        near = np.clip(1.0 - distances / self.reach, 0.0, 1.0)
        wanted = self.turn * (seen["goal"]["bearing"] or 0.0)
        wanted += self.avoid * (near[self.right].sum() - near[self.left].sum())
        steering = np.clip(wanted, -self.steering, self.steering)
        if (seen["guard"] or {"forward": 0.0})["forward"] < 0.03 and seen["time"] >= self.back_until:
            self.back_until = seen["time"] + self.back
        if seen["time"] < self.back_until:
            return np.array([-0.3, -steering])
        room = distances[self.ahead].min(initial=self.sonar_reach)
        return np.array([self.speed * np.clip(room / self.slow, 0.2, 1.0), steering])


def drive(env, parameters, seed):
    """An episode: the sum of its rewards, whether the goal was reached, and its duration in s."""
    _, info = env.reset(options={"seed": int(seed)})
    law, total, over = Law(parameters, env.robot), 0.0, False
    while not over:
        _, reward, terminated, truncated, info = env.step(law(info["state"]["observation"]))
        total, over = total + reward, terminated or truncated
    state = info["state"]
    return total, state["info"]["end"] == "reached", state["observation"]["time"]


def score(env, parameters, seeds):
    """Mean reward, number of goals reached, and mean duration of the episodes in s."""
    totals, reached, times = zip(*(drive(env, parameters, seed) for seed in seeds))
    return np.mean(totals), sum(reached), np.mean(times)


def main():
    parser = argparse.ArgumentParser(description="Tunes a steering law.")
    parser.add_argument("--generations", type=int, default=6)
    parser.add_argument("--population", type=int, default=12)
    parser.add_argument("--goals", type=int, default=4, help="goals that each candidate drives to")
    parser.add_argument("--tests", type=int, default=12, help="other goals, for the comparison")
    parser.add_argument("--world", default="hall")
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    random = np.random.default_rng(args.seed)
    env = AdveeEnv(world=args.world, people=0, episode_s=60.0)
    begun, virtual = time.monotonic(), 0.0
    training, tests = range(args.goals), range(1000, 1000 + args.tests)
    mean, spread = (LOW + HIGH) / 2, (HIGH - LOW) / 4
    untuned = mean
    for generation in range(1, args.generations + 1):
        candidates = np.clip(random.normal(mean, spread, (args.population, len(mean))), LOW, HIGH)
        # The mean is a candidate, too: what was found is not lost.
        candidates[0] = mean
        scores = []
        for candidate in candidates:
            total, reached, seconds = score(env, candidate, training)
            scores.append((total, reached))
            virtual += seconds * args.goals
        order = np.argsort([-total for total, _ in scores])
        elite = candidates[order[:max(2, int(ELITE * args.population))]]
        mean, spread = elite.mean(axis=0), np.maximum(elite.std(axis=0), SPREAD_MIN * (HIGH - LOW))
        total, reached = scores[order[0]]
        print(f"generation {generation}: best {total:6.2f}, {reached} of {args.goals} goals reached", flush=True)
    took = time.monotonic() - begun
    print(f"{virtual:.0f} s of driving in {took:.0f} s, {virtual / took:.0f} times real time, without the starts")
    for name, before, after in zip(NAMES, untuned, mean):
        print(f"  {name:24} {before:6.2f} -> {after:6.2f}")
    for name, parameters in ("before", untuned), ("after", mean):
        total, reached, seconds = score(env, parameters, tests)
        print(f"{name:6} {total:6.2f}, {reached} of {args.tests} other goals reached, {seconds:.0f} s each")
    env.close()


if __name__ == "__main__":
    main()
