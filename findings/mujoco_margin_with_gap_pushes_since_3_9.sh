#!/usr/bin/env bash
# mujoco 4.0.0 (since 3.9.0): a geom with margin = gap, how a model up to 3.8 asked for contacts that are told of and
# do not push, now pushes from the whole margin away. The file loads as before, without a warning.
# Seen: a ball of 0.1 m without gravity, 0.5 m above a plane with margin="1" gap="1": one contact in both; 3.8.1 leaves
# the ball at rest, 4.0.0 throws it off at 1,250 m/s².
set -u
folder=$(mktemp -d) && trap 'rm -rf "$folder"' EXIT
for version in 3.8.1 4.0.0; do
  python3 -m venv "$folder/$version" && "$folder/$version/bin/pip" install --quiet "mujoco==$version" "numpy==2.4.6" || exit 2
done
cat > "$folder/look.py" <<'PYTHON'
import mujoco

MODEL = """
<mujoco>
  <option gravity="0 0 0"/>
  <worldbody>
    <geom type="plane" size="5 5 1" margin="1" gap="1"/>
    <body pos="0 0 0.6"><freejoint/><geom size="0.1" mass="1"/></body>
  </worldbody>
</mujoco>
"""
model = mujoco.MjModel.from_xml_string(MODEL)
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
print(mujoco.__version__, "contacts", data.ncon, "acceleration", round(float(data.qacc[2])))
PYTHON
old=$("$folder/3.8.1/bin/python" "$folder/look.py") && new=$("$folder/4.0.0/bin/python" "$folder/look.py") || exit 1
printf '%s\n%s\n' "$old" "$new"
[ "$old" = "3.8.1 contacts 1 acceleration 0" ] && [ "$new" = "4.0.0 contacts 1 acceleration 1250" ]
