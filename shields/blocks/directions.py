"""Directions of a block along which a snap is uncut, by the arithmetic of ``shields.methods.halfspace``."""

from quadsafe_core.kernels.jit import inline_kernel
from quadsafe_core.kernels.lanes import LANES, I, U, lane_triple, store_triple
from quadsafe_core.kernels.vec3 import dot, norm, subtract
from quadsafe_core.maths.held_input import derivatives, lift_after, polynomial, state_after, stays_above
from shields.blocks.block import (
    ADMITTED,
    ALONG,
    CALM,
    CUT,
    FIRST,
    FOUND,
    LAST,
    SEEN,
    SET_VALUE,
    SNAP,
    VALUE,
    copy_lines,
    lane_flat,
    sphere_at,
)
from shields.chains.lower_bound import is_above, quick_lower4
from shields.chains.radial import LEAST_DISTANCE
from shields.filters.easing import REACH, above, flat_output
from shields.filters.sampled import ROUNDING, size_of_terms


@inline_kernel
def least_of(x, u_max):
    """``lower4`` of a bound of 0; a value of nan where that is not sure."""
    value, t_star = quick_lower4(x[0], x[1], x[2], x[3], u_max, 0.0)
    rises = (x[0] >= 0.0) & (x[1] >= 0.0) & (x[2] >= 0.0)
    return x[3] - 0.0 if rises else value, 0.0 if rises else t_star


@inline_kernel
def admission(y, distance, wish, sampling):
    """Whether an input along n is admitted as it is, the set value, and whether it is cut, off the border.

    The first look of ``shields.filters.sampled.required`` in its set; y is the chain, highest derivative first.
    Where neither is sure, both are False.
    """
    u_max, period, easing = sampling.u_max, sampling.period, sampling.easing
    x = above(y, distance)
    value, t_star = least_of(x, u_max)
    full = derivatives(4, x, u_max)
    p, lift = polynomial(full), lift_after(4, period)
    target, t = (1.0 - sampling.gamma) * value, max(t_star, period)
    most, slope = state_after(full, t), state_after((0.0, lift[0], lift[1], lift[2], lift[3]), t - period)
    noise = ROUNDING * size_of_terms(p, t)
    room, lack = most[3] - target, u_max - wish
    is_short = room + noise < lack * slope[3]
    needed = u_max - (room - 2.0 * noise) / slope[3]
    speed, bend = most[2] - lack * slope[2], most[1] - lack * slope[1]
    left = room - (lack * slope[3] + noise)
    rises = is_above(left, speed, bend, most[0] - lack * slope[0], u_max, t - period)
    level = target + ROUNDING * size_of_terms(p, period)
    keeps = stays_above(derivatives(4, x, wish), period, level)
    is_sure = (easing.feedback[0] * flat_output(x, period) > REACH * u_max) & (value >= 0.0)
    does = is_sure & ((wish >= u_max) | ((not is_short) & rises & keeps))
    return does, value, is_sure & (wish < u_max) & is_short & (needed + ROUNDING * abs(needed) > wish)


@inline_kernel
def along(block, i, n, settings):
    """``admission`` of the snap of lane i along n, away from the sphere that is looked at, and ``n·u``."""
    x, wish = lane_flat(block, i), dot(n, lane_triple(block, i + U(LANES * SNAP)))
    gap = subtract(x.r, lane_triple(block, i + U(LANES * SEEN)))
    y, radius = (dot(n, x.j), dot(n, x.a), dot(n, x.v), dot(n, gap)), block[i + U(LANES * (SEEN + 3))]
    does, value, is_cut = admission(y, (1 + settings.margin) * radius, wish, settings.sampling)
    return does, value, is_cut, wish


@inline_kernel
def look_along_sight(block, count, settings):
    """The sphere that is looked at along the line of sight."""
    for i in range(U(count)):
        gap = subtract(lane_triple(block, i), lane_triple(block, i + U(LANES * SEEN)))
        distance = norm(gap)
        length = distance if distance > 0.0 else 1.0
        n = (gap[0] / length, gap[1] / length, gap[2] / length)
        does, value, is_cut, wish = along(block, i, n, settings)
        radius, is_still = block[i + U(LANES * (SEEN + 3))], block[i + U(LANES * (SEEN + 7))] > 0.0
        is_far = (distance >= LEAST_DISTANCE) & (distance >= radius) & (radius > 0.0) & is_still
        block[i + U(LANES * CUT)] = 1.0 if is_cut & is_far else 0.0
        store_triple(block, i + U(LANES * FOUND), n)
        block[i + U(LANES * (FOUND + ALONG))] = wish
        block[i + U(LANES * (FOUND + ADMITTED))] = 1.0 if does & is_far else 0.0
        block[i + U(LANES * (FOUND + SET_VALUE))] = value


@inline_kernel
def look_along_last(block, count, settings):
    """The sphere that is looked at along the last direction, in the lanes where the line of sight is cut."""
    for i in range(U(count)):
        n, sight = lane_triple(block, i + U(LANES * (SEEN + 4))), lane_triple(block, i + U(LANES * FOUND))
        does, value, _, wish = along(block, i, n, settings)
        takes = does & (dot(n, n) > 0.0) & (block[i + U(LANES * CUT)] > 0.0)
        kept = (n[0] if takes else sight[0], n[1] if takes else sight[1], n[2] if takes else sight[2])
        store_triple(block, i + U(LANES * FOUND), kept)
        for line, new in ((ALONG, wish), (ADMITTED, 1.0), (SET_VALUE, value)):
            at = i + U(LANES * FOUND) + U(LANES) * U(line)
            block[at] = new if takes else block[at]


@inline_kernel
def note_sphere(block, count):
    """Rows whose snap is not admitted are not calm; the least value of the others."""
    for i in range(U(count)):
        is_absent = not block[i + U(LANES * (SEEN + 3))] > 0.0
        does, value = block[i + U(LANES * (FOUND + ADMITTED))] > 0.0, block[i + U(LANES * (FOUND + SET_VALUE))]
        before, calm = block[i + U(LANES * VALUE)], block[i + U(LANES * CALM)]
        block[i + U(LANES * VALUE)] = before if is_absent else min(before, value)
        block[i + U(LANES * CALM)] = calm if is_absent | does else 0.0


@inline_kernel
def is_any_cut(block, count):
    """Whether the line of sight is cut in one of the lanes."""
    cut = 0.0
    for i in range(U(count)):
        cut += block[i + U(LANES * CUT)]
    return cut > 0.0


@inline_kernel
def look_at_spheres(block, count, spheres, settings):
    """Direction and set value of each sphere; rows that one of them cuts are not calm."""
    for k in range(U(spheres)):
        copy_lines(block, sphere_at(k), U(LANES * SEEN), I(FIRST))
        look_along_sight(block, count, settings)
        if is_any_cut(block, count):
            look_along_last(block, count, settings)
        note_sphere(block, count)
        copy_lines(block, U(LANES * FOUND), sphere_at(k) + U(LANES * (FIRST - 4)), I(LAST))
