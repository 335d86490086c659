"""Solids that touch stay apart, what is open stays so, hollows go with what is around them."""

import itertools

import numpy as np
import pytest

trimesh = pytest.importorskip("trimesh", reason="reads triangle meshes: pip install 'quadsafe[maps]'")

from quadsafe_env.maps.pieces import pieces_of  # noqa: E402


def pieces(mesh, folder, suffix):
    mesh.export(folder / f"mesh.{suffix}")
    return pieces_of(folder / f"mesh.{suffix}", 1.0)


def box(low, high):
    return trimesh.creation.box(bounds=[low, high])


TOUCHING = {
    "an edge": [box((0, 0, 0), (1, 1, 1)), box((1, 1, 0), (2, 2, 1))],
    "a side": [box((0, 0, 0), (1, 1, 1)), box((1, 0, 0), (2, 1, 1))],
    "a corner": [box((0, 0, 0), (1, 1, 1)), box((1, 1, 1), (2, 2, 2))],
    "eight around a corner": [
        box(low, np.add(low, 1)) for low in itertools.product((0, 1), repeat=3)
    ],
    "a floor and walls": [
        box((-5, -4, -0.2), (5, 4, 0)),
        box((-5, -4, 0), (5, -3.8, 3)),
        box((-5, 3.8, 0), (5, 4, 3)),
        box((-5, -4, 0), (-4.8, 4, 3)),
        box((4.8, -4, 0), (5, 4, 3)),
    ],
}  # fmt: skip


@pytest.mark.parametrize("suffix", ["stl", "off"])
@pytest.mark.parametrize("boxes", TOUCHING.values(), ids=TOUCHING)
def test_solids_that_touch_stay_apart(tmp_path, boxes, suffix):
    turn = trimesh.transformations.random_rotation_matrix(np.random.default_rng(0).random(3))
    for move in (np.eye(4), turn):
        found = pieces(trimesh.util.concatenate(boxes).apply_transform(move), tmp_path, suffix)
        assert all(piece.is_watertight for piece in found)
        assert sorted(piece.volume for piece in found) == pytest.approx(
            sorted(one.volume for one in boxes), rel=1e-5
        )


def test_an_open_side_is_not_closed(tmp_path):
    shelf = box((0, 0, 0), (1, 1, 1))
    (piece,) = pieces(trimesh.Trimesh(shelf.vertices, shelf.faces[:-2]), tmp_path, "stl")
    assert len(piece.faces) == 10 and not piece.is_watertight


def test_no_triangle_is_lost(tmp_path):
    mesh = trimesh.creation.torus(1.0, 0.3, major_sections=12, minor_sections=6)
    loose = trimesh.Trimesh(mesh.vertices, mesh.faces[::3])
    found = pieces(loose, tmp_path, "ply")
    assert len(found) > 1 and sum(len(piece.faces) for piece in found) == len(loose.faces)


def test_a_hollow_is_of_one_piece_with_what_is_around_it(tmp_path):
    inside, outside = box((1, 1, 1), (2, 2, 2)), box((0, 0, 0), (3, 3, 3))
    assert len(pieces(trimesh.util.concatenate([outside, inside]), tmp_path, "stl")) == 2
    inside.invert()
    (room,) = pieces(trimesh.util.concatenate([outside, inside]), tmp_path, "stl")
    assert room.volume == pytest.approx(26.0)
