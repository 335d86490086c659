"""Any file goes in by one call: our JSON there and back, and errors that say what is wrong with which entry."""

import json
import subprocess
import sys

import pytest

from quadsafe_core.shapes import Box, Capsule, Cylinder, Ellipsoid, HalfSpace, Hull, Sphere
from quadsafe_env import load_obstacles

TURNED = ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
ONE_OF_EACH = [
    Sphere((1, 2, 3), 0.5),
    Capsule((0, 0, 0), (0, 0, 1), 0.2, velocity=(0.1, 0, 0)),
    Cylinder((0, 0, 0), (0, 1, 1), 0.2),
    Box((0, 0, 1), (1, 2, 3), TURNED),
    Hull([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], radius=0.1),
    Ellipsoid((0, 0, 0), (1, 2, 3)),
    HalfSpace((0, 0, 1), -1.0),
]


@pytest.fixture
def written(tmp_path):
    """A function that writes a file, and gives its path."""

    def write(text, name="room.json"):
        (tmp_path / name).write_text(text, encoding="utf-8")
        return tmp_path / name

    return write


@pytest.mark.parametrize("around", [lambda shapes: shapes, lambda shapes: {"obstacles": shapes}])
def test_shapes_of_all_kinds_come_back_from_json(written, around):
    file = written(json.dumps(around([shape.as_dict() for shape in ONE_OF_EACH])))
    found = load_obstacles(file)
    assert found == ONE_OF_EACH and found.grown == 0.0
    assert load_obstacles(str(file)) == ONE_OF_EACH


def test_a_row_of_numbers_is_a_sphere(written):
    assert load_obstacles(written("[[1, 2, 3, 0.5]]")) == [Sphere((1, 2, 3), 0.5)]
    assert load_obstacles(written("[]")) == []


@pytest.mark.parametrize(
    ("text", "kind", "words"),
    [
        ("{", ValueError, r"^room\.json: Expecting"),
        ("3", TypeError, r"^room\.json: obstacles must be a list"),
        ('{"walls": []}', ValueError, r"key 'obstacles' and no other, got \['walls'\]"),
        ('{"obstacles": [], "goal": 1}', ValueError, r"got \['goal', 'obstacles'\]"),
        ('{"obstacles": [], "obstacles": [[0, 0, 0, 1]]}', ValueError, "each key once, got 'obstacles' twice"),
        ('[{"shape": "sphere", "center": [0, 0, 0], "radius": 1, "radius": 2}]', ValueError, "'radius' twice"),
        ("[[0, 0, 0, 1], [0, 0, 0]]", TypeError, r"obstacles\[1\] must be a shape, a mapping or a row"),
        ("[[0, 0, NaN, 1]]", ValueError, r"obstacles\[0\]\.center must be finite"),
        ('[{"shape": "cone"}]', ValueError, r"obstacles\[0\]\.shape must be one of"),
    ],
)
def test_what_json_cannot_say_is_refused_by_name(written, text, kind, words):
    with pytest.raises(kind, match=words):
        load_obstacles(written(text))


def test_other_files_are_refused(written, tmp_path):
    with pytest.raises(FileNotFoundError, match=r"path must be a file, got .*none\.json"):
        load_obstacles(tmp_path / "none.json")
    with pytest.raises(FileNotFoundError, match="path must be a file"):
        load_obstacles(tmp_path)
    with pytest.raises(TypeError, match=r"^path must be the path of a file, got 5$"):
        load_obstacles(5)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"path must end in one of \.json, .*\.off, got '\.dae'"):
        load_obstacles(written("", "room.dae"))
    with pytest.raises(ValueError, match=r"scale and concavity are of triangle meshes, got 0\.001 and 0\.05"):
        load_obstacles(written("[]"), scale=0.001)


@pytest.mark.parametrize(("name", "package"), [("a.xml", "mujoco"), ("a.urdf", "mujoco"), ("a.stl", "trimesh")])
def test_a_missing_package_is_named_with_the_command_that_installs_it(written, monkeypatch, name, package):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(ImportError, match=rf"^{package} .*pip install 'quadsafe\[maps\]'"):
        load_obstacles(written("", name))
    assert load_obstacles(written("[[0, 0, 0, 1]]")) == [Sphere((0, 0, 0), 1)]


def test_the_readers_are_imported_only_for_their_files():
    code = "import sys, quadsafe_env; print({'mujoco', 'coacd', 'trimesh'} & set(sys.modules))"
    outcome = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert outcome.stdout.strip() == "set()"
