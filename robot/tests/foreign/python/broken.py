"""A module that breaks in every way that the helper has to catch: as it is told by its argument."""
import advee


class Broken(advee.Module):
    def __init__(self, args):
        super().__init__(args)
        self.how = args.how
        if self.how == "constructor":
            raise RuntimeError("in its constructor")
        self.every(0.01, self.on_tick)

    def on_tick(self):
        self.working()
        if self.how == "timer":
            raise RuntimeError("in a timer")
        if self.how == "device":
            self.fatal(0x8001, advee.Kind.DEVICE, "the device burns", advee.DEVICE + 3)

    def on_state(self, state):
        if self.how == "state" and state == advee.State.PAUSE:
            raise RuntimeError("on a command")


if __name__ == "__main__":
    parser = advee.arguments("broken")
    parser.add_argument("how")
    advee.run(Broken, parser.parse_args())
