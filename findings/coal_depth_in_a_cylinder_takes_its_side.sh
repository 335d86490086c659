#!/usr/bin/env bash
# coal 3.0.3: how deep a point or a small ball is in a cylinder is measured to its side only, never to a flat end, so a
# vehicle that has entered a disc or a low pillar from above is told of a way out that is many times too long, sideways.
# Seen: a sphere of radius 0 at 0.1 m below the top of a cylinder of radius 0.3 m and length 1.4 m, on its axis:
# distance -0.3 m, and 0 for a normal; the shortest way out is 0.1 m, straight up. A box of the same size is right.
set -u
folder=$(mktemp -d) && trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/env" && "$folder/env/bin/pip" install --quiet "coal==3.0.3" "numpy==2.4.6" || exit 2
"$folder/env/bin/python" - <<'PYTHON'
import coal
import numpy as np


def depth(shape):
    point, here, there = coal.Sphere(0.0), coal.Transform3s(), coal.Transform3s()
    there.setTranslation(np.array([0.0, 0.0, 0.6]))
    found = coal.DistanceResult()
    least = coal.distance(point, there, shape, here, coal.DistanceRequest(), found)
    return least, np.round(np.array(found.normal), 3).tolist()


cylinder, box = depth(coal.Cylinder(0.3, 1.4)), depth(coal.Box(0.6, 0.6, 1.4))
print("cylinder", cylinder, "box", box)
is_sideways = abs(cylinder[0] + 0.3) < 1e-6 and abs(cylinder[1][2]) < 1e-6
raise SystemExit(0 if is_sideways and abs(box[0] + 0.1) < 1e-6 else 1)
PYTHON
