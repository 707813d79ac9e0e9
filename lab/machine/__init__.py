"""Virtual machines of the lab: what they boot, how they start, what they say."""


class LabError(Exception):
    """Why the lab cannot do what it was asked, in one line: what, where, what helps."""
