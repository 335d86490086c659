"""The shape of the house: rooms, files and functions keep their sizes, nothing imports in a circle."""

import pytest
import sources
from house import ROOT

PACKAGES = ("quadsafe", "quadsafe_core", "quadsafe_env", "shields", "agents")
RULES = (
    sources.crowded_folders,
    sources.long_files,
    sources.long_functions,
    sources.many_arguments,
    sources.circles,
)


def held(rule, package):
    return pytest.param(rule, package, id=f"{rule.__name__}-{package}")


@pytest.mark.parametrize(
    ("rule", "package"),
    [*(held(rule, package) for rule in RULES for package in PACKAGES), held(sources.tall_chains, "shields")],
)
def test_the_house_keeps_its_shape(rule, package):
    assert rule(ROOT / package) == []


def test_the_picture_of_the_house_has_the_words_of_its_rooms():
    drawn = sources.rooms_in((ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8"))
    assert sorted(drawn) == sorted(line for package in PACKAGES for line in sources.room_lines(ROOT / package))


@pytest.fixture
def package(tmp_path):
    """A function that writes files of a made-up package, and gives its folder."""

    def write(files):
        for name, text in {"__init__.py": '"""A house."""\n', **files}.items():
            file = tmp_path / "made" / name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text)
        return tmp_path / "made"

    return write


def test_a_thirteenth_module_in_a_folder_is_noticed(package):
    full = {f"room/file_{i}.py": "" for i in range(12)}
    assert sources.crowded_folders(package({"room/__init__.py": "", **full})) == []
    (crowded,) = sources.crowded_folders(package({"room/file_12.py": ""}))
    assert crowded.endswith("made/room: 13 modules")


def test_a_line_too_many_in_a_file_is_noticed(package):
    assert sources.long_files(package({"file.py": "x = 1\n" * 300})) == []
    (long,) = sources.long_files(package({"room/file.py": "x = 1\n" * 301}))
    assert long.endswith("made/room/file.py: 301 lines")


def test_a_line_too_many_in_a_method_is_noticed(package):
    method = "class A:\n    def f(self):\n" + '        """Long.\n\n        Words.\n        """\n'
    assert sources.long_functions(package({"file.py": method + "        x = 1\n" * 40})) == []
    (long,) = sources.long_functions(package({"file.py": method + "        x = 1\n" * 41}))
    assert long.endswith("made/file.py::f: 41 lines")


@pytest.mark.parametrize(
    ("arguments", "count"),
    [
        ("a, b, c, d, e, f, g", 0),
        ("self, a, b, c, d, e, f, g", 0),
        ("a, *, b, c, d, e, f, g, h", 0),
        ("a, b, c, d, e, f, g, h=1", 8),
        ("a, b, c, d, e, f, /, g, h", 8),
    ],
)
def test_an_eighth_positional_argument_is_noticed(package, arguments, count):
    found = sources.many_arguments(package({"file.py": f"def f({arguments}): ...\n"}))
    assert [line.partition(": ")[2] for line in found] == ([f"{count} positional arguments"] if count else [])


@pytest.mark.parametrize(
    ("low", "is_circle"),
    [
        ("from made import high", True),
        ("import made.high", True),
        ("from made.high import x", True),
        ("def f():\n    from made.high import x", True),
        ("def f():\n    def g():\n        import made.high", True),
        ("if TYPE_CHECKING:\n    from made.high import x", False),
        ("from elsewhere import high", False),
    ],
)
def test_a_circle_is_noticed(package, low, is_circle):
    house = package({"room/__init__.py": "", "room/low.py": low, "high.py": "from made.room import low"})
    assert bool(sources.circles(house)) == is_circle


def test_a_tenth_floor_is_noticed(package):
    floors = {f"floor_{i}.py": f"from made.floor_{i - 1} import x" for i in range(1, 9)}
    shown = {"__init__.py": "from made.floor_8 import x", "floor_0.py": ""}
    assert sources.tall_chains(package({**floors, **shown})) == []
    lazy = package({"floor_9.py": "def f():\n    import made.floor_8"})
    assert sources.tall_chains(lazy) == []
    (chain,) = sources.tall_chains(package({"floor_9.py": "from made import floor_8"}))
    assert chain.startswith("made.floor_9 -> made.floor_8 -> ") and chain.endswith("made.floor_0")


def test_a_room_is_drawn_with_the_first_line_of_its_docstring(package):
    rooms = {"b/__init__.py": '"""Bees.\n\nMany.\n"""', "a/__init__.py": '"""Ants."""', "c.py": ""}
    lines = sources.room_lines(package(rooms))
    assert lines == ["made/  A house.", "  a/  Ants.", "  b/  Bees."]
    picture = ["A picture:", "", *lines[::-1], "", "    not/  a room", "and/or  not"]
    assert sources.rooms_in("\n".join(picture)) == lines[::-1]
