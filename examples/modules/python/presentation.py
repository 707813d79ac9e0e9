#!/usr/bin/env python3
"""Plays presentations: shows a text, sentence by sentence, in a given time.

    presentation.py
    advee action present text="Good morning. My name is Advee." seconds=6

A module in Python that offers an action: docs/highlevel.md. The sentences are lines on its standard error, which its
watchdog prints and sends on CM_EVENT_TEXT; of a display or a voice the calls would be the same.
"""
import re
import sys
import time

import actions
import advee

RATE = 15.0             # characters that people read in a second
SECONDS = 0.1, 600.0    # limits of the parameter
TICK = 0.1              # s


class Presentation(actions.Performer):
    def __init__(self, args):
        super().__init__(args)
        self.action, self.sentences, self.shown, self.begun, self.seconds = None, [], 0, 0.0, 0.0
        self.offer("present", self.on_present, self.on_cancel)
        self.every(TICK, self.on_tick)

    def on_present(self, action):
        if self.action is not None:
            raise actions.Rejected(f"{self.action.id} is played")
        text = " ".join(action.text("text").split())
        if not text:
            raise actions.Rejected("the text is empty")
        self.seconds = action.number("seconds", *SECONDS, default=min(max(2.0, len(text) / RATE), SECONDS[1]))
        self.sentences, self.shown = re.split(r"(?<=[.!?]) ", text), 0
        self.action, self.begun = action, time.monotonic()
        self.play()

    def on_cancel(self, action):
        self.action = None
        action.cancelled(f"after {self.shown} of {len(self.sentences)} sentences")

    def on_tick(self):
        self.working()
        if self.action is not None:
            self.play()

    def play(self):
        share = (time.monotonic() - self.begun) / self.seconds
        due = min(int(share * len(self.sentences)) + 1, len(self.sentences))
        for sentence in self.sentences[self.shown:due]:
            print(f"<6>{sentence}", file=sys.stderr, flush=True)
        self.shown = due
        if share < 1.0:
            self.action.run(share, self.sentences[due - 1])
        else:
            done, self.action = self.action, None
            done.succeed(f"{due} sentences in {self.seconds:g} s")


if __name__ == "__main__":
    advee.run(Presentation, advee.arguments("presentation", "Plays presentations.").parse_args())
