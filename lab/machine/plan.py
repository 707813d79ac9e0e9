"""lab.toml: the machines, and the checks that run in them."""

import dataclasses
import os
import tomllib

from . import LabError


@dataclasses.dataclass
class Machine:
    """A virtual machine; lab.toml describes the keys."""

    name: str
    kernel: str = "std"
    modules: list = dataclasses.field(default_factory=list)
    built: dict = dataclasses.field(default_factory=dict)
    qemu: list = dataclasses.field(default_factory=list)
    parameters: str = ""
    memory: int = 768
    processors: int = 1
    ns_per_instruction: int = 2
    skip_idle: bool = False
    network: bool = False
    debian: list = dataclasses.field(default_factory=list)
    init: str = ""


@dataclasses.dataclass
class Check:
    """A script of lab/checks, with its settings."""

    name: str
    machine: str
    script: str
    says: str
    limit: int = 60
    short: bool = False
    outside: str = ""
    reset: bool = False


def load(path):
    """(machines by name, checks in their order)."""
    try:
        with open(path, "rb") as f:
            told = tomllib.load(f)
        told_of = told["machine"]
        machines = {name: Machine(name, **told_of.get(keys.pop("like", name)) | keys) for name, keys in told_of.items()}
        checks = [Check(**keys) for keys in told["check"]]
    except (OSError, tomllib.TOMLDecodeError, TypeError, KeyError) as error:
        raise LabError(f"{path}: {error}") from None
    names = [check.name for check in checks]
    for check in checks:
        if names.count(check.name) > 1:
            raise LabError(f"{path}: two checks are named {check.name}")
        if check.machine not in machines:
            raise LabError(f"{path}: {check.name}: there is no machine {check.machine}")
        for script in filter(None, (check.script, check.outside)):
            if not os.access(os.path.join(os.path.dirname(path), "checks", script), os.X_OK):
                raise LabError(f"{path}: {check.name}: checks/{script} is no executable file")
    for machine in machines.values():
        instruction = machine.ns_per_instruction
        if instruction & (instruction - 1):
            raise LabError(f"{path}: {machine.name}: ns_per_instruction is a power of two")
    return machines, checks
