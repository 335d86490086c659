"""What ``import shields`` offers, and what it leaves alone."""

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
        "late = ('scipy.optimize', 'matplotlib', 'torch', 'shields.composite', 'shields.braking')\n"
        "assert not [name for name in late if name in sys.modules]\n"
        "shields.BoxSet\n"
        "assert 'shields.composite' in sys.modules and 'scipy.optimize' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
