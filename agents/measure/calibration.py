"""The command ``calibrate``: measure a plant, write what to declare of it, and draw how it was measured."""

import re
import sys
from importlib.metadata import version
from typing import Any

from agents.experiment.command_line import Calibrate
from agents.experiment.program import called
from agents.measure.calibration_figure import draw
from quadsafe_env.plants import make_plant
from quadsafe_env.plants.plant import ADAPTERS
from shields.calibration.calibrate import Calibration, calibrate
from shields.settings.uncertainty_file import write_uncertainty


def calibrated(command: Calibrate) -> tuple[str, bool]:
    """Measure, write and draw; what to print, and whether a shield can be told of the plant.

    Raises:
        TypeError, ValueError: for a plant that is not installed, and as ``make_plant`` and
            ``shields.calibrate``.
        OSError: if the files cannot be written.
    """
    plant = _plant(command)
    found = calibrate(
        plant,
        speed=command.speed,
        period=command.period,
        flights=command.flights,
        seconds=command.seconds,
        factor=command.factor,
        seed=command.seed,
    )
    name = re.sub(r"[^\w.]+", "-", "_".join([command.plant, *map(str, command.options.values())]))
    file, picture = command.out / f"{name}.json", command.out / f"{name}.png"
    write_uncertainty(file, found.uncertainty, {**_made_by(command, plant), **found.facts()})
    draw(found, name, picture)
    return f"{found}\n{file}\n{picture}", _is_good(found)


def _plant(command: Calibrate) -> Any:
    try:
        return make_plant(command.plant, **command.options)
    # crazyflow's, where scipy came before its setting.
    except (ImportError, RuntimeError) as error:
        raise ValueError(str(error)) from error


def _is_good(found: Calibration) -> bool:
    return not found.refusal and found.beyond == 0


def _made_by(command: Calibrate, plant: Any) -> dict[str, Any]:
    """Of what, with what, and how it is made again."""
    package = ADAPTERS[command.plant].package
    words = [word for word in sys.argv[1:] if word != "calibrate"]
    return {
        "plant": plant.identity(),
        "packages": {name: version(name) for name in (package, "quadsafe")},
        "command": " ".join([called(), "calibrate", *words]),
    }
