"""Triangle meshes: the grown parts cover every point of the surface, and what is open stays open."""

import json

import numpy as np
import pytest

from quadsafe_core.shapes import Hull
from quadsafe_env import load_obstacles

trimesh = pytest.importorskip("trimesh", reason="reads triangle meshes: pip install 'quadsafe[maps]'")
pytest.importorskip("coacd", reason="takes triangle meshes apart: pip install 'quadsafe[maps]'")


def torus():
    return trimesh.creation.torus(1.0, 0.3, major_sections=24, minor_sections=12)


def doorway():
    """A wall 6 m long, 3 m high and 0.2 m thick with a doorway of 1 m by 2 m, in one piece."""
    outline = [(-3, 0), (-0.5, 0), (-0.5, 2), (0.5, 2), (0.5, 0), (3, 0), (3, 3), (-3, 3)]
    corners = np.array([(x, y, z) for y in (-0.1, 0.1) for x, z in outline])
    front = [(0, 1, 2), (0, 2, 7), (7, 2, 3), (7, 3, 6), (3, 5, 6), (3, 4, 5)]
    sides = [(i, j, k) for i in range(8) for j, k in (((i + 1) % 8 + 8, (i + 1) % 8), (i + 8, (i + 1) % 8 + 8))]
    return trimesh.Trimesh(corners, [*front, *(tuple(8 + i for i in face[::-1]) for face in front), *sides])


def two_boxes():
    return trimesh.util.concatenate(
        [trimesh.creation.box(extents, trimesh.transformations.translation_matrix(at))
         for extents, at in (((1, 2, 3), (0, 0, 0)), ((10, 0.2, 3), (0, 5, 0)))]
    )  # fmt: skip


def hollow():
    """A closed room 6 m wide with walls of 0.5 m."""
    inside = trimesh.creation.box((5, 5, 2))
    inside.invert()
    return trimesh.util.concatenate([trimesh.creation.box((6, 6, 3)), inside])


def distance(shapes, points):
    return np.min([shape.distance(points) for shape in shapes], axis=0)


def on_surface(mesh, count=20_000):
    return trimesh.sample.sample_surface(mesh, count, seed=0)[0]


@pytest.mark.parametrize("suffix", ["stl", "obj", "ply", "off"])
def test_two_boxes_are_two_hulls(tmp_path, suffix):
    mesh = two_boxes()
    mesh.export(tmp_path / f"room.{suffix}")
    shapes = load_obstacles(tmp_path / f"room.{suffix}")
    assert [len(shape.points) for shape in shapes] == [8, 8]
    # The files keep numbers in single precision.
    assert (distance(shapes, on_surface(mesh)) <= 1e-6).all()
    points = np.random.default_rng(0).uniform(-6, 6, (1000, 3))
    exact = [Hull(piece.vertices) for piece in mesh.split()]
    np.testing.assert_allclose(distance(shapes, points), distance(exact, points), atol=1e-4)


@pytest.fixture(scope="module")
def ring(tmp_path_factory):
    """The parts of the torus."""
    file = tmp_path_factory.mktemp("ring") / "ring.stl"
    torus().export(file)
    return load_obstacles(file)


def test_the_parts_of_a_torus_cover_it_only_once_they_are_grown(ring):
    check_cover(torus(), ring)


def test_the_parts_of_a_wall_cover_it_only_once_they_are_grown(tmp_path):
    doorway().export(tmp_path / "door.stl")
    check_cover(doorway(), load_obstacles(tmp_path / "door.stl"))


def check_cover(mesh, shapes):
    assert len(shapes) > 1 and {shape.radius for shape in shapes} == {shapes.grown}
    points = np.vstack([on_surface(mesh), mesh.vertices])
    assert (distance(shapes, points) <= 1e-7).all()
    outside = distance([Hull(shape.points) for shape in shapes], points)
    assert 0.0 < outside.max() <= shapes.grown < 2e-3


def test_the_hole_of_a_torus_stays_open(ring):
    along = np.linspace(-1, 1, 50)[:, None] * [0, 0, 1]
    assert distance(ring, along).min() > 0.6
    assert Hull(torus().vertices).distance(along).min() < 0.0


def test_a_doorway_stays_open(tmp_path):
    doorway().export(tmp_path / "door.obj")
    shapes = load_obstacles(tmp_path / "door.obj")
    through = np.array([(0.0, y, z) for y in np.linspace(-1, 1, 20) for z in (0.5, 1.0, 1.4)])
    assert distance(shapes, through).min() > 0.45


def test_the_inside_of_a_closed_room_stays_open(tmp_path):
    hollow().export(tmp_path / "room.stl")
    shapes = load_obstacles(tmp_path / "room.stl", concavity=0.1)
    assert (distance(shapes, on_surface(hollow())) <= 1e-6).all()
    assert distance(shapes, [(0, 0, 0)]) > 0.9
    assert distance(shapes, [(2.75, 0, 0)]) < 0.0


def test_loose_triangles_are_covered(tmp_path):
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (5, 0, 0), (6, 0, 0), (5, 1, 1)]
    sheets = trimesh.Trimesh(corners, [(0, 1, 2), (0, 2, 3), (4, 5, 6)])
    sheets.export(tmp_path / "sheets.ply")
    shapes = load_obstacles(tmp_path / "sheets.ply")
    assert (distance(shapes, on_surface(sheets)) <= 1e-6).all()
    assert distance(shapes, [(0.5, 0.5, 0.1), (3, 0, 0)]) == pytest.approx([0.1, 2], abs=0.02)


def test_a_mesh_in_millimetres_is_told_so(tmp_path):
    doorway().apply_scale(1000.0).export(tmp_path / "door.stl")
    shapes = load_obstacles(tmp_path / "door.stl", scale=1e-3)
    assert (distance(shapes, on_surface(doorway())) <= 1e-6).all()
    assert distance(shapes, [(0, 1, 2.5)]) == pytest.approx(0.9, abs=1e-2)


def test_a_finer_concavity_leaves_less_hollow_space_filled(tmp_path):
    trimesh.creation.torus(1.0, 0.3, major_sections=16, minor_sections=8).export(tmp_path / "ring.stl")
    coarse, fine = (load_obstacles(tmp_path / "ring.stl", concavity=value) for value in (0.3, 0.1))
    assert len(coarse) < len(fine)
    assert distance(coarse, [(0, 0, 0)]) < distance(fine, [(0, 0, 0)])


def test_corners_with_several_textures_do_not_tear_a_piece_apart(tmp_path):
    box = trimesh.creation.box()
    corners = "".join(f"v {x} {y} {z}\n" for x, y, z in box.vertices)
    textures = "".join(f"vt {i / 40} 0\n" for i in range(36))
    faces = "".join(
        f"f {a + 1}/{3 * i + 1} {b + 1}/{3 * i + 2} {c + 1}/{3 * i + 3}\n"
        for i, (a, b, c) in enumerate(box.faces)
    )
    (tmp_path / "box.obj").write_text(f"mtllib ../none.mtl\n{corners}{textures}{faces}")
    (hull,) = load_obstacles(tmp_path / "box.obj")
    assert len(hull.points) == 8 and hull.radius < 1e-6


def test_a_map_of_a_mesh_can_be_kept_as_json(tmp_path):
    doorway().export(tmp_path / "door.stl")
    shapes = load_obstacles(tmp_path / "door.stl")
    (tmp_path / "door.json").write_text(json.dumps([shape.as_dict() for shape in shapes]))
    assert load_obstacles(tmp_path / "door.json") == shapes


def test_a_mesh_whose_outside_would_be_solid_is_refused(tmp_path):
    mesh = trimesh.creation.box((1, 2, 3))
    mesh.invert()
    mesh.export(tmp_path / "room.stl")
    with pytest.raises(ValueError, match=r"^room\.stl: triangles must face away .* got a mesh of -6 m³"):
        load_obstacles(tmp_path / "room.stl")


@pytest.mark.parametrize(
    ("text", "settings", "words"),
    [
        ("", {}, "^room.off: "),
        ("OFF\n3 0 0\n0 0 0\n1 0 0\n0 1 0\n", {}, "a mesh must have triangles, got none"),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 nan 0\n3 0 1 2\n", {}, "vertices must be finite"),
        ("OFF\n", {"scale": 0.0}, "scale must be a finite number > 0, got 0"),
        ("OFF\n", {"concavity": 0.001}, "concavity must be from 0.01 to 1.0, got 0.001"),
    ],
)
def test_what_is_no_mesh_is_refused(tmp_path, text, settings, words):
    (tmp_path / "room.off").write_text(text)
    with pytest.raises(ValueError, match=words):
        load_obstacles(tmp_path / "room.off", **settings)
