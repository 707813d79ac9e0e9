#!/bin/sh
# A critical module is dead and cannot be started: the machine resets.
set -eu
. "$LAB_SOURCE/lab/checks/lib.sh"
. lab/checks/watchdog.sh
start "i6300ESB timer"
sleep 6
rm "$HOME/module"
kill -KILL "$(module)"
expect "ModuleUnstartable"
echo "now the machine resets"
sleep 20
