"""MJCF and URDF: the shapes are where MuJoCo's own distances see its geoms, and what is no shape is named."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from quadsafe_core.shapes import Box, Capsule, Cylinder, Ellipsoid, HalfSpace, Hull, Sphere
from quadsafe_env import load_obstacles

mujoco = pytest.importorskip("mujoco", reason="reads MJCF and URDF: pip install 'quadsafe[maps]'")

# A room with what makes MJCF hard to read: classes, units and orders of angles, frames in frames, ends in place
# of poses, an include, a mesh beside its origin, copies, a fitted primitive, and what cannot collide.
ROOM = """
<mujoco>
  <compiler angle="radian" eulerseq="XYZ"/>
  <default>
    <geom size="0.3 0.2 0.1"/>
    <default class="pillar"><geom type="cylinder" size="0.2 0.6"/></default>
    <default class="seen"><geom contype="0" conaffinity="0"/></default>
  </default>
  <asset>
    <mesh name="wedge" vertex="1 0 0  3 0 0  1 2 0  1 0 1  1.2 0.2 0.1" scale="1 -0.5 2"/>
  </asset>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 0.1" pos="0 0 -1" euler="0.1 0.2 0.3"/>
    <geom name="ball" type="sphere"/>
    <body pos="1 2 0" euler="0.4 0.5 0.6">
      <geom name="seen" class="seen"/>
      <geom name="box" type="box" pos="0.5 0 0" quat="0.9 0.1 0.3 0.2"/>
      <frame pos="0 0 1" euler="1 0 0">
        <body pos="0 1 0"><geom name="pillar" class="pillar" axisangle="1 1 0 0.7"/></body>
      </frame>
      <geom name="egg" type="ellipsoid" pos="0 -1 0" zaxis="1 2 3"/>
    </body>
    <geom name="rail" type="capsule" fromto="-1 -1 0  -2 -1 1" size="0.05"/>
    <geom name="wedge" type="mesh" mesh="wedge" pos="-3 0 0" euler="0.3 0 0.2"/>
    <replicate count="3" offset="0 0.5 0">
      <geom name="post" type="capsule" size="0.05 0.4" pos="3 0 0"/>
    </replicate>
    <geom name="fitted" type="box" mesh="wedge" pos="0 -4 0"/>
    <include file="parts/annex.xml"/>
  </worldbody>
  <contact><pair geom1="box" geom2="hidden"/></contact>
</mujoco>
"""
ANNEX = """<mujocoinclude><geom name="hidden" class="seen" type="box" pos="0 0 4"/></mujocoinclude>"""

# Links in a chain of fixed joints, of which one is turned; a mesh by the address that ROS gives it.
ROBOT = """
<robot name="gate">
  <link name="base"><visual><geometry><mesh filename="package://hall/none.dae"/></geometry></visual>
    <collision><origin xyz="1 0 0.5" rpy="0.1 0.2 0.3"/><geometry><box size="1 2 3"/></geometry></collision>
  </link>
  <joint name="a" type="fixed">
    <origin xyz="0 2 0" rpy="0.4 0.5 0.6"/><parent link="base"/><child link="arm"/>
  </joint>
  <link name="arm">
    <collision><origin xyz="0 0 1"/><geometry><cylinder radius="0.1" length="2"/></geometry></collision>
    <collision><geometry><sphere radius="0.3"/></geometry></collision></link>
  <joint name="b" type="fixed"><origin xyz="0 0 2"/><parent link="arm"/><child link="tip"/></joint>
  <link name="tip">
    <collision><geometry><mesh filename="package://hall/meshes/tip.obj" scale="1 2 3"/></geometry></collision>
  </link>
</robot>
"""
TIP = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"


PROBE = 1e-3


@pytest.fixture
def hall(tmp_path):
    """A function that writes files into a folder, and gives the path of the first."""

    def write(files):
        for name, text in files.items():
            file = tmp_path / "hall" / name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text, encoding="utf-8")
        return tmp_path / "hall" / next(iter(files))

    return write


def with_probe(file):
    """MuJoCo's own model of a file, with a small ball that can be put anywhere."""
    spec = mujoco.MjSpec.from_file(str(file))
    probe = spec.worldbody.add_body(name="probe", mocap=True)
    probe.add_geom(name="probe", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[PROBE, 0, 0])
    model = spec.compile()
    return model, mujoco.MjData(model)


def distances(model, data, name, points):
    """Signed distance of points from a geom as MuJoCo has it, m."""
    geom, probe = model.geom(name).id, model.geom("probe").id
    out = []
    for point in points:
        data.mocap_pos[0] = point
        mujoco.mj_kinematics(model, data)
        out.append(mujoco.mj_geomDistance(model, data, geom, probe, 100.0, None) + PROBE)
    return np.array(out)


def scene(body, rest=""):
    return f"<mujoco><worldbody>{body}</worldbody>{rest}</mujoco>"


def test_geoms_of_all_kinds_are_where_mujoco_measures_them(hall):
    file = hall({"room.xml": ROOM, "parts/annex.xml": ANNEX})
    kinds = {
        "floor": HalfSpace,
        "ball": Sphere,
        "rail": Capsule,
        "wedge": Hull,
        "post0": Capsule,
        "post1": Capsule,
    }
    kinds |= {"post2": Capsule, "fitted": Box, "hidden": Box, "box": Box, "egg": Ellipsoid, "pillar": Cylinder}
    shapes = load_obstacles(file)
    assert [type(shape) for shape in shapes] == list(kinds.values())
    model, data = with_probe(file)
    rng = np.random.default_rng(0)
    for name, shape in zip(kinds, shapes, strict=True):
        points = rng.uniform(-5, 5, (200, 3))
        points = np.vstack([points, shape.nearest(points) + rng.normal(scale=0.1, size=(200, 3))])
        measured = distances(model, data, name, points)
        assert (measured < 0).any() and (measured > 0).sum() > 100
        # MuJoCo iterates distances of meshes and ellipsoids, and depths in these to some 1e-4 only.
        allowed = np.where((measured < 0) & isinstance(shape, Ellipsoid), 1e-3, 1e-6)
        assert (np.abs(shape.distance(points) - measured) < allowed).all(), name


def test_the_hull_of_a_mesh_is_grown_by_no_more_than_single_precision(hall):
    corners = np.array([[1, 0, 0], [3, 0, 0], [1, 2, 0], [1, 0, 1]]) * [1, -0.5, 2]
    turned = corners @ Rotation.from_euler("xyz", [0.3, 0, 0.2]).as_matrix().T + [-3, 0, 0]
    shapes = load_obstacles(hall({"room.xml": ROOM, "parts/annex.xml": ANNEX}))
    (hull,) = [shape for shape in shapes if isinstance(shape, Hull)]
    assert len(hull.points) == 4 and 0.0 < hull.radius == shapes.grown < 1e-6
    assert (hull.distance(turned) <= 0.0).all()
    assert (Hull(hull.points).distance(turned) < hull.radius).all()


def test_collisions_of_a_chain_of_links_are_where_roll_pitch_and_yaw_put_them(hall):
    box, rod, ball, tip = load_obstacles(hall({"urdf/gate.urdf": ROBOT, "meshes/tip.obj": TIP}))
    first, arm = (Rotation.from_euler("xyz", angles) for angles in ([0.1, 0.2, 0.3], [0.4, 0.5, 0.6]))
    points = np.random.default_rng(1).uniform(-4, 4, (500, 3))
    aside = np.array([0, 2, 0])
    wanted = (
        Box((1, 0, 0.5), (1, 2, 3), first),
        Cylinder((0, 2, 0), arm.apply([0, 0, 2]) + aside, 0.1),
        Sphere((0, 2, 0), 0.3),
        Hull(arm.apply([[0, 0, 2], [1, 0, 2], [0, 2, 2], [0, 0, 5]]) + aside),
    )
    for found, shape in zip((box, rod, ball, tip), wanted, strict=True):
        assert type(found) is type(shape)
        np.testing.assert_allclose(found.distance(points), shape.distance(points), atol=1e-6)


def test_a_hull_keeps_the_corners_that_a_mesh_may_do_without(hall):
    circle = [(np.cos(t), np.sin(t), z) for t in np.linspace(0, 6, 20) for z in (0, 1)]
    mesh = f'<asset><mesh name="m" maxhullvert="6" vertex="{" ".join(map(str, np.ravel(circle)))}"/></asset>'
    (hull,) = load_obstacles(hall({"a.xml": scene('<geom type="mesh" mesh="m"/>', mesh)}))
    assert len(hull.points) == 40
    assert (hull.distance(circle) <= 0.0).all()


def test_a_plane_is_without_end_whatever_size_it_is_drawn_with(hall):
    (floor,) = load_obstacles(hall({"a.xml": scene('<geom type="plane" size="1 1 1" pos="0 0 2"/>')}))
    assert floor == HalfSpace((0, 0, 1), 2.0)


FIELD = '<asset><hfield name="h" nrow="2" ncol="2" size="1 1 1 1"/></asset>'
FLAT = '<asset><mesh name="m" vertex="0 0 0 1 0 0 1 1 0 0 1 0"/></asset>'
SOLID = '<asset><mesh name="m" vertex="0 0 0 1 0 0 0 1 0 0 0 1" face="0 2 1 0 1 3 1 2 3 2 0 3"/></asset>'
CLOTH = '<flexcomp name="net" type="grid" count="3 3 1" spacing="1 1 1" dim="2"><pin id="0"/></flexcomp>'
MOVED = '<body name="q"><joint name="hinge"/><geom size="1"/><body><geom name="w" size="1"/></body></body>'
CARRIED = '<body name="q" mocap="true"><body name="z"><geom size="1"/></body></body>'


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (scene('<geom name="hill" type="hfield" hfield="h"/>', FIELD), "geom 'hill' of body 'world' .*HFIELD"),
        (scene('<geom name="bolt" type="sdf" mesh="m"/>', SOLID), "geom 'bolt' of body 'world' .*mjGEOM_SDF"),
        (scene(MOVED), "geom 0 without a name of body 'q' must stand still, got it moved by joint 'hinge'"),
        (scene(CARRIED), "geom 0 without a name of body 'z' must stand still, got it on mocap body 'q'"),
        (scene(CLOTH), "flex 'net' bends"),
        (scene('<geom type="mesh" mesh="m"/>', FLAT), "^a.xml: .*'m'"),
        (scene('<geom size="1" contype="0" conaffinity="0"/>'), "must have a geom that can collide, got none"),
        (scene('<geom size="1" color="red"/>'), "unrecognized attribute: 'color'"),
        ("<sdf/>", "Unrecognized XML model type: 'sdf'"),
        ("<mujoco>", "^a.xml: XML parse error"),
        (
            ROBOT.replace('name="b" type="fixed"', 'name="b" type="prismatic"'),
            "body 'tip' .*moved by joint 'b'",
        ),
        (
            ROBOT.replace("hall/meshes", "shed/meshes"),
            "mesh 'package://shed/meshes/tip.obj' must be in a folder 'shed'",
        ),
        (ROBOT.replace("tip.obj", "none.obj"), "opening file '.*none.obj'"),
        (ROBOT.replace('sphere radius="0.3"', 'cone radius="0.3"'), "geometry specification not found"),
    ],
)
def test_what_is_no_shape_is_refused_by_name(hall, text, words):
    with pytest.raises(ValueError, match=words) as caught:
        load_obstacles(hall({"a.xml": text, "meshes/tip.obj": TIP}))
    assert "\n" not in str(caught.value)


def test_a_body_that_moves_and_cannot_collide_is_no_obstacle(hall):
    moving = MOVED.replace("<geom", '<geom contype="0" conaffinity="0"')
    assert load_obstacles(hall({"a.xml": scene('<geom size="1"/>' + moving)})) == [Sphere((0, 0, 0), 1)]


def test_entities_are_not_expanded(hall):
    text = '<!DOCTYPE mujoco [<!ENTITY one "1">]>' + scene('<geom size="&one;"/>')
    with pytest.raises(ValueError, match="bad format in attribute 'size'"):
        load_obstacles(hall({"a.xml": text}))
    assert load_obstacles(hall({"a.xml": text.replace("&one;", "1")})) == [Sphere((0, 0, 0), 1)]
