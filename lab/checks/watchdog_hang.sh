#!/bin/sh
# advee up and its watchdog hang: the machine resets.
set -eu
. "$LAB_SOURCE/lab/checks/lib.sh"
. lab/checks/watchdog.sh
start "Software Watchdog"
sleep 6
kill -STOP $up $(watchdog)
echo "now the machine resets"
sleep 20
