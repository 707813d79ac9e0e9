"""Module that fails in every way that the helper must handle, selected by its argument."""
import threading
import time

import advee


class Broken(advee.Module):
    def __init__(self, args):
        super().__init__(args)
        self.how, self.hangs = args.how, False
        if self.how == "constructor":
            raise RuntimeError("in its constructor")
        self.every(0.01, self.on_tick)
        if self.how == "worker":
            threading.Thread(target=self.work, daemon=True).start()

    def on_tick(self):
        self.working()
        if self.how == "timer":
            raise RuntimeError("in a timer")
        if self.how == "device":
            self.fatal(0x8001, advee.Kind.DEVICE, "the device burns", advee.DEVICE + 3)

    def on_state(self, state):
        if self.how == "state" and state == advee.State.PAUSE:
            raise RuntimeError("on a command")
        self.hangs = state == advee.State.PAUSE

    def work(self):
        """Sends heartbeats except in PAUSE, where it waits for an event that never comes."""
        beat = self.beats.thread("worker")
        while True:
            if not self.hangs:
                beat()
            time.sleep(0.01)


if __name__ == "__main__":
    parser = advee.arguments("broken")
    parser.add_argument("how")
    advee.run(Broken, parser.parse_args())
