"""Every row of a batch: in blocks of sixteen where that can be, else one by one."""

from quadsafe_core.kernels.jit import kernel
from quadsafe_core.kernels.lanes import LANES
from shields.blocks.block import CALM, block_for, fill
from shields.blocks.calm import look_at_block, store_calm
from shields.interface.row_checks import DONE
from shields.methods.sampled_row import sampled_row

# Fewer rows than this are done one by one.
FEW = 3


@kernel
def rows_in_blocks(measured, remembered, settings, answers):
    """``sampled_row`` of every row, sixteen at a time; the first code that is not ``DONE``."""
    n, spheres, code = measured.flat.shape[0], measured.bodies.radius.shape[1], DONE
    block = block_for(spheres)
    for first in range(0, n, LANES):
        count = min(LANES, n - first)
        if count >= FEW:
            fill(block, first, count, measured, remembered, settings.flight.period)
            look_at_block(block, count, spheres, settings)
        else:
            block[LANES * CALM : LANES * CALM + count] = 0.0
        for i in range(count):
            if block[LANES * CALM + i] > 0.0:
                store_calm(i, first + i, block, remembered, answers, settings.flight.period)
            elif code == DONE:
                code = sampled_row(first + i, measured, remembered, settings, answers)
    return code


@kernel
def rows_one_by_one(measured, remembered, settings, answers):
    """``sampled_row`` of every row; the first code that is not ``DONE``."""
    code = DONE
    for i in range(measured.flat.shape[0]):
        if code == DONE:
            code = sampled_row(i, measured, remembered, settings, answers)
    return code


@kernel
def sampled_rows(cores, closing, authority, measured, remembered, settings, answers):
    """``sampled_row`` of every row; in blocks where there are spheres only, and no limits but of a flight."""
    # One condition each, or none would be dropped where it is compiled.
    if cores is None:  # noqa: SIM102
        if closing is None:  # noqa: SIM102
            if authority is None:
                return rows_in_blocks(measured, remembered, settings, answers)
    return rows_one_by_one(measured, remembered, settings, answers)
