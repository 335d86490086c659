"""What ``import shields`` offers, and what it leaves alone."""

import importlib
import subprocess
import sys

import pytest

import shields


@pytest.mark.interpreted
def test_every_public_name_is_there():
    for name in shields.__all__:
        assert getattr(shields, name).__name__ == name
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        shields.nothing  # noqa: B018


def test_importing_shields_imports_neither_solvers_nor_plotting_nor_the_theory():
    code = (
        "import sys, shields\n"
        "late = ('scipy.optimize', 'matplotlib', 'torch', 'shields.chains.composite', 'shields.composite')\n"
        "assert not [name for name in late if name in sys.modules]\n"
        "shields.BoxSet\n"
        "assert 'shields.chains.composite' in sys.modules and 'scipy.optimize' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("shields.integrator", "shields.chains.integrator"),
        ("shields.corners", "shields.chains.maximality"),
        ("shields.certificate", "shields.backup.certificate"),
        ("quadsafe_env.flatness", "quadsafe_env.vehicle.flatness"),
        ("quadsafe_core.vec3", "quadsafe_core.kernels.vec3"),
    ],
)
def test_a_module_that_moved_is_the_same_one_under_its_old_path(old, new):
    package, _, name = old.rpartition(".")
    code = (
        f"import importlib, sys, {package}\n"
        f"import {old} as old\n"
        f"from {package} import {name} as found\n"
        f"assert old is found is importlib.import_module({new!r})\n"
        f"assert old.__spec__.name == old.__name__ == {new!r}\n"
        "importlib.reload(old)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.interpreted
@pytest.mark.parametrize(
    ("path", "names"),
    [
        ("shields.arcs", "Flat flown ThrustBand"),
        ("shields.box_held", "sampled_box_input sampled_box_value"),
        ("shields.braking", "BrakingSet"),
        ("shields.certificate", "NOTHING SEGMENTS dead_beat_snap FlightLimits"),
        ("shields.composite", "BoxSet LowerSet"),
        ("shields.halfspace", "Sampling distance_demand excess"),
        ("shields.integrator", "flow lower_value upper_value"),
        ("shields.radial", "radial_state radial_snap"),
        ("shields.sampled", "sampled_input sampled_value"),
        ("shields.tangency", "lower_input upper_input"),
        ("shields.uncertainty", "Uncertainty predicted_error tube_at tube_of"),
        ("quadsafe_env.dynamics", "derivative step"),
        ("quadsafe_env.flatness", "flat_state snap_from_wrench wrench_from_snap"),
        ("quadsafe_env.params", "QuadrotorParams"),
        ("quadsafe_env.state", "ATTITUDE OMEGA THRUST"),
    ],
)
def test_what_the_docs_ever_imported_is_still_where_they_said(path, names):
    module = importlib.import_module(path)
    for name in names.split():
        assert hasattr(module, name), name


def test_what_never_was_there_is_not_found():
    with pytest.raises(ModuleNotFoundError, match=r"shields\.nothing"):
        importlib.import_module("shields.nothing")
