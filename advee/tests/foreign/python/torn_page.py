"""Module that corrupts its heartbeat page, while its loop and its announcements continue."""
import os

import advee


class TornPage(advee.Module):
    def __init__(self, args):
        super().__init__(args)
        path = os.environ.pop("ADVEE_BEATS")
        with open(path, "wb") as page:
            page.write(b"BEAT\x01\x00")
        self.beats = advee.Beats(None)
        self.every(0.1, self.working)


if __name__ == "__main__":
    advee.run(TornPage, advee.arguments("torn_page").parse_args())
