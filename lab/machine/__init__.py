"""Virtual machines of the lab: kernels and file systems, start, output."""


class LabError(Exception):
    """The reason why the lab cannot run, in one line: what, where, what helps."""
