"""An uncertainty by the name of its file, in a shield and in a wrapper, and the sentences for what is none."""

import gymnasium
import pytest

import quadsafe_env  # noqa: F401
from shields import Shield, ShieldWrapper

GOOD = '{"uncertainty": {"snap": 2.0, "wind": 0.1}, "measured": {"period": 0.01}}'


@pytest.fixture
def file(tmp_path):
    """A function that writes a file and gives its name."""

    def write(text):
        path = tmp_path / "told.json"
        path.write_text(text)
        return str(path)

    return write


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("{", "uncertainty must be a file of JSON, got "),
        ("[1]", "must be a mapping with 'uncertainty', a mapping, got "),
        ('{"uncertainty": 3}', "must be a mapping with 'uncertainty', a mapping, got "),
        ('{"uncertainty": {}, "how": {}}', "must be one of 'uncertainty', 'measured', got 'how'"),
        ('{"uncertainty": {"winds": 1}}', r"a field of uncertainty in .* must be one of 'position'.*'winds'"),
        ('{"uncertainty": {"wind": NaN}}', "uncertainty.wind must be a finite number >= 0, got nan"),
        ('{"uncertainty": {"wind": Infinity}}', "uncertainty.wind must be a finite number >= 0, got inf"),
    ],
)
def test_a_file_that_is_none_is_a_sentence(file, text, sentence):
    with pytest.raises(ValueError, match=sentence):
        Shield(uncertainty=file(text))


def test_a_file_that_is_not_there_is_a_sentence(tmp_path):
    with pytest.raises(ValueError, match=r"uncertainty must be a file that can be read, got '.*none\.json'"):
        Shield(uncertainty=str(tmp_path / "none.json"))
    with pytest.raises(TypeError, match=r"or a file ending in \.json, got 'told\.yml'"):
        Shield(uncertainty="told.yml")


def test_a_wrapper_takes_a_file_and_its_spec_keeps_the_name(file):
    name = file(GOOD)
    env = ShieldWrapper(gymnasium.make("QuadSafe/Avoid-v0"), uncertainty=name, inner_loop="measured")
    told = env.shield.settings["uncertainty"]
    assert told["wind"] == 0.1 and told["snap"] == 2.0
    again = gymnasium.make(env.spec)
    assert again.shield.settings == env.shield.settings


def test_a_wrapper_takes_what_was_measured_of_the_plant():
    env = gymnasium.make("QuadSafe/Avoid-v0")
    with pytest.raises(
        TypeError, match=r"env must have a plant with uncertainty\(\) for uncertainty='plant', got Q"
    ):
        ShieldWrapper(env, uncertainty="plant")

    pytest.importorskip("mujoco")
    shielded = ShieldWrapper(gymnasium.make("QuadSafe/Avoid-v0", plant="mujoco"), uncertainty="plant")
    told, measured = shielded.shield.settings["uncertainty"], shielded.unwrapped.plant.uncertainty()
    assert measured and {name: told[name] for name in measured} == measured
