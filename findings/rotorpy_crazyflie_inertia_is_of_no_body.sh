#!/usr/bin/env bash
# rotorpy 3.0.0: the moments of inertia of its Crazyflie are those of no rigid body: the largest is greater than the sum
# of the others, Izz = 2.89e-5 > Ixx + Iyy = 2.865e-5 kg m². It flies with them without a word; a simulator that checks
# a body when it is built refuses the same numbers.
# Seen: the sum less Izz is negative for the Crazyflie, positive for the Hummingbird; mujoco 4.0.0 with these as
# diaginertia raises "inertia must satisfy A + B >= C; use 'balanceinertia' to fix".
set -u
folder=$(mktemp -d) && trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv" && "$folder/venv/bin/pip" install --quiet "rotorpy==3.0.0" "mujoco==4.0.0" || exit 2
cat > "$folder/look.py" <<'PYTHON'
import mujoco
from rotorpy.vehicles import crazyflie_params, hummingbird_params

for name, vehicle in (("crazyflie", crazyflie_params), ("hummingbird", hummingbird_params)):
    p = vehicle.quad_params
    x, y, z = p["Ixx"], p["Iyy"], p["Izz"]
    body = f'<body><freejoint/><inertial pos="0 0 0" mass="{p["mass"]}" diaginertia="{x} {y} {z}"/></body>'
    try:
        mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
        answer = "loads"
    except ValueError as error:
        answer = "is refused" if "A + B >= C" in str(error) else str(error)
    print(name, "sum less Izz", "negative" if x + y < z else "positive", "mujoco", answer)
PYTHON
found=$("$folder/venv/bin/python" "$folder/look.py") || exit 1
printf '%s\n' "$found"
[ "$found" = "crazyflie sum less Izz negative mujoco is refused
hummingbird sum less Izz positive mujoco loads" ]
