"""The example that draws a room."""

import runpy

from house import ROOT

from quadsafe_core.shapes import shapes_from


def test_the_room_has_every_shape_and_is_flown_through():
    names = runpy.run_path(str(ROOT / "examples" / "room_picture.py"))
    kinds = {shape.name for shape in shapes_from(names["obstacles"]())}
    # Its bounds are the half-spaces.
    assert kinds == {"sphere", "capsule", "cylinder", "box", "hull", "ellipsoid"}
    env = names["room"](64)
    assert names["fly"](env) > 0.05
    assert env.render().shape == (64, 64, 3)
