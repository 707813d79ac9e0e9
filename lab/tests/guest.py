#!/usr/bin/env python3
"""Replaces QEMU in the tests: reads the settings from the initial file system, and runs the checks on this machine."""

import os
import re
import subprocess
import sys

with open(sys.argv[sys.argv.index("-initrd") + 1], "rb") as f:
    settings = dict(re.findall(r"^([A-Z_]+)='(.*)'$", f.read().decode(errors="replace"), re.M))
console = re.search(r"file,id=console,path=(\S+)", " ".join(sys.argv)).group(1)
with open(console, "w", encoding="utf-8") as f:
    print("its console", file=f)
for check in settings["CHECKS"].split():
    name, script = check.split(":")
    print(f"\n{settings['TOKEN']} begin {name}", flush=True)
    # By this a check finds its machine, to end it.
    environment = {**os.environ, "GUEST": str(os.getpid()), "CONSOLE": console}
    # Processes in a machine end with it.
    command = ["setpriv", "--pdeathsig", "KILL", f"{settings['SOURCE']}/lab/checks/{script}"]
    status = subprocess.run(command, env=environment, check=False).returncode
    print(f"\n{settings['TOKEN']} end {status}", flush=True)
sys.exit(3)
