#!/usr/bin/env bash
# mujoco 4.0.0: after mj_step the contacts in mjData are those of the position at the start of the step, while qpos is
# that of its end. Whoever counts collisions after each step misses the one that has just begun, and a loop that stops
# there ends one step inside, without a contact on record; mj_kinematics and mj_collision bring them up to date.
# Seen: a ball that moves 4 cm a step without gravity, at a wall: after the step that ends 2 cm inside there are 0
# contacts, after mj_kinematics and mj_collision 1.
set -u
folder=$(mktemp -d) && trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv" && "$folder/venv/bin/pip" install --quiet "mujoco==4.0.0" "numpy==2.4.6" || exit 2
cat > "$folder/look.py" <<'PYTHON'
import mujoco

MODEL = """
<mujoco>
  <option gravity="0 0 0" timestep="0.01"/>
  <worldbody>
    <geom name="wall" type="box" size="0.5 2 2" pos="1.5 0 0"/>
    <body><freejoint/><geom name="ball" size="0.1" mass="1"/></body>
  </worldbody>
</mujoco>
"""
model = mujoco.MjModel.from_xml_string(MODEL)
data = mujoco.MjData(model)
data.qpos[0], data.qvel[0] = 0.88, 4.0
mujoco.mj_step(model, data)
inside = data.qpos[0] + 0.1 - 1.0
after_step = data.ncon
mujoco.mj_kinematics(model, data)
mujoco.mj_collision(model, data)
print(mujoco.__version__, f"inside {inside:.2f} m", "contacts", after_step, "then", data.ncon)
PYTHON
found=$("$folder/venv/bin/python" "$folder/look.py") || exit 1
printf '%s\n' "$found"
[ "$found" = "4.0.0 inside 0.02 m contacts 0 then 1" ]
