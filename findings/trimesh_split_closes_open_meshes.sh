#!/usr/bin/env bash
# trimesh 5.2.0: split(only_watertight=False), which is to give the connected pieces as they are, fills holes of one or
# two triangles in them: repair=True, the default, works also where nothing is discarded. The open side of a low-polygon
# room or shelf is gone.
# Seen: a box without one of its sides, 10 triangles, comes back with 12 and watertight; with repair=False it has 10.
set -u
folder=$(mktemp -d) && trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/env" && "$folder/env/bin/pip" install --quiet "trimesh==5.2.0" "numpy==2.4.6" "scipy==1.17.1" "networkx==3.6.1" || exit 2
"$folder/env/bin/python" - <<'PYTHON'
import trimesh

box = trimesh.creation.box()
shelf = trimesh.Trimesh(box.vertices, box.faces[:-2])
(piece,) = shelf.split(only_watertight=False)
(as_it_is,) = shelf.split(only_watertight=False, repair=False)
counts = len(shelf.faces), len(piece.faces), len(as_it_is.faces)
print(trimesh.__version__, "triangles", counts[0], "split", counts[1], "without repair", counts[2])
raise SystemExit(0 if counts == (10, 12, 10) and piece.is_watertight and not shelf.is_watertight else 1)
PYTHON
