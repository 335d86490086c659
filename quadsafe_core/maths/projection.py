"""Least correction onto half-spaces in three dimensions.

    minimise ‖u − u_des‖²   subject to   n_i · u ≥ b_i,   i = 1 … K

Mostly a few planes matter, at a wide angle: then the plane that cuts most is taken in, and another one left
out if the answer would be pulled onto it, until no plane cuts. That takes one scan for each active one.

Otherwise the half-spaces are taken in one at a time. Where one cuts off the optimum of those before it, the
new optimum lies on its plane: a problem of one dimension less over the half-spaces before it, which goes on
to a line and there to an interval (Seidel, 1991). The work is bounded by K³/6 interval cuts whatever the
rounding does, so there is no iteration limit; typically a few K suffice.
"""

import math
import sys

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quadsafe_core.checks import argument_rows, shaped_array
from quadsafe_core.kernels.borrow import borrowed
from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.vec3 import add, cross, dot, norm, scale, subtract, vector

# A bound missed by less than this fraction of its largest term counts as met.
ROUNDING = 1e-14
# Below this sine of their angle two planes count as parallel: their line is too far away to be told.
PARALLEL = 1e-14
# Planes are exchanged in closed form while sin² of their angle, or the volume of their normals, is above this.
WIDE = 1e-2
EXCHANGES = 8
# A normal and how far the desired point is outside.
NO_PLANE = ((0.0, 0.0, 0.0), 0.0)
# A desired point this many times farther out than the answer has cost it digits.
FAR = 4.0
# Public functions accept normals whose length is 1 to this.
UNIT_TOLERANCE = 1e-12
LARGEST = sys.float_info.max


@inline_kernel
def _reach(u):
    return abs(u[0]) + abs(u[1]) + abs(u[2])


@inline_kernel
def _is_cut(u, reach, normal, offset):
    """Whether ``normal · u ≥ offset`` fails by more than rounding among numbers up to ``reach``."""
    return offset - dot(normal, u) > ROUNDING * (abs(offset) + _reach(u) + reach)


@kernel
def _worst_cut(u, normals, offsets, count):
    worst = 0.0
    for k in range(count):
        worst = max(worst, offsets[k] - dot(vector(normals[k]), u))
    return worst


@kernel
def _where_limits_touch(at_low, at_high, reach, normals, offsets, count):
    """The better of two crossed ends of an interval, which may be one point seen through rounding."""
    cut_low = _worst_cut(at_low, normals, offsets, count)
    cut_high = _worst_cut(at_high, normals, offsets, count)
    point = at_low if cut_low <= cut_high else at_high
    return point, min(cut_low, cut_high) <= ROUNDING * (reach + _reach(point))


@kernel
def _nearest_on_line(foot, direction, reach, normals, offsets, count):
    """Nearest to ``foot`` on ``foot + t direction`` within the first ``count`` half-spaces."""
    low, high = -math.inf, math.inf
    for k in range(count):
        normal = vector(normals[k])
        slope = dot(normal, direction)
        if abs(slope) <= PARALLEL:
            if _is_cut(foot, reach, normal, offsets[k]):
                return foot, False
        elif slope > 0.0:
            low = max(low, (offsets[k] - dot(normal, foot)) / slope)
        else:
            high = min(high, (offsets[k] - dot(normal, foot)) / slope)
    if low <= high:
        return add(foot, scale(min(max(0.0, low), high), direction)), True
    at_low, at_high = add(foot, scale(low, direction)), add(foot, scale(high, direction))
    return _where_limits_touch(at_low, at_high, reach + _reach(foot), normals, offsets, count)


@inline_kernel
def _unit_within(n_plane, normal):
    """The part of ``normal`` within a plane, at unit length, and its length before."""
    part = subtract(normal, scale(dot(n_plane, normal), n_plane))
    sine = norm(part)
    if sine <= PARALLEL:
        return part, 0.0
    part = scale(1.0 / sine, part)
    # Once more: between nearly parallel planes the first difference is mostly rounding.
    part = subtract(part, scale(dot(n_plane, part), n_plane))
    return scale(1.0 / norm(part), part), sine


@kernel
def _nearest_on_plane(desired, reach, normals, offsets, last):
    """Nearest to ``desired`` on the plane ``last`` within the half-spaces before it."""
    n_last = vector(normals[last])
    origin = add(desired, scale(offsets[last] - dot(n_last, desired), n_last))
    point = origin
    for j in range(last):
        normal = vector(normals[j])
        if _is_cut(point, reach, normal, offsets[j]):
            inward, sine = _unit_within(n_last, normal)
            if sine == 0.0:
                return point, False
            step = (offsets[j] - dot(normal, origin)) / dot(normal, inward)
            foot = add(origin, scale(step, inward))
            point, is_feasible = _nearest_on_line(foot, cross(n_last, inward), reach, normals, offsets, j)
            if not is_feasible:
                return point, False
    return point, True


@kernel
def _nearest(desired, normals, offsets, count):
    """Nearest to ``desired`` within the first ``count`` half-spaces, to rounding of ``desired``."""
    point, is_feasible = desired, True
    reach = _reach(desired)
    for i in range(count):
        if _is_cut(point, reach, vector(normals[i]), offsets[i]):
            point, is_feasible = _nearest_on_plane(desired, reach, normals, offsets, i)
            if not is_feasible:
                break
    return point, is_feasible


@inline_kernel
def _on_two(first, second):
    """Correction that takes in a second plane, the planes that it is pushed off, and whether that is plain."""
    (n1, gap1), (n2, gap2) = first, second
    cosine = dot(n1, n2)
    sine2 = 1.0 - cosine * cosine
    weight1, weight2 = gap1 - cosine * gap2, gap2 - cosine * gap1
    if weight1 <= 0.0 or sine2 <= WIDE:
        return scale(gap2, n2), second, NO_PLANE, weight1 <= 0.0
    correction = add(scale(weight1 / sine2, n1), scale(weight2 / sine2, n2))
    return correction, first, second, weight2 > 0.0


@inline_kernel
def _on_three(first, second, third):
    """Correction onto three planes, and its weights of the first two, nan where it is not plain."""
    (n1, gap1), (n2, gap2), (n3, gap3) = first, second, third
    n23, n31, n12 = cross(n2, n3), cross(n3, n1), cross(n1, n2)
    volume = dot(n1, n23)
    if abs(volume) <= WIDE:
        return n1, math.nan, math.nan
    share = 1.0 / volume
    correction = scale(share, add(add(scale(gap1, n23), scale(gap2, n31)), scale(gap3, n12)))
    weight1, weight2, weight3 = dot(n23, correction), dot(n31, correction), dot(n12, correction)
    if weight3 * share <= 0.0:
        return n1, math.nan, math.nan
    return correction, weight1 * share, weight2 * share


@kernel
def _exchanged(first, second, third):
    """Correction that takes in a third plane, the planes that it is pushed off, and whether that is plain."""
    if first[1] == 0.0:
        return scale(third[1], third[0]), third, NO_PLANE, True
    if second[1] == 0.0:
        return _on_two(first, third)
    correction, weight1, weight2 = _on_three(first, second, third)
    if weight1 > 0.0 and weight2 > 0.0:
        return correction, first, second, True
    correction, first, second, is_plain = _on_two(second if weight1 < weight2 else first, third)
    return correction, first, second, is_plain and not math.isnan(weight1)


@kernel
def project(desired, normals, offsets, count):
    """Nearest point to ``desired`` in the first ``count`` half-spaces, and whether there is a finite one.

    First by taking in the plane that cuts most, again and again: a point is the nearest one if it is in every
    half-space and pushed off the planes that it is on only. Where that is not plain, one plane after the other.
    """
    normals, offsets = borrowed(normals), borrowed(offsets)
    point, reach = desired, _reach(desired)
    first = second = NO_PLANE
    is_solved = False
    for _ in range(EXCHANGES):
        # Written out, as a call with two arrays takes longer than the scan.
        found, most, slack = -1, 0.0, ROUNDING * (_reach(point) + reach)
        for k in range(count):
            gap = offsets[k] - (normals[k, 0] * point[0] + normals[k, 1] * point[1] + normals[k, 2] * point[2])
            if gap > most and gap - ROUNDING * abs(offsets[k]) - slack > 0.0:
                found, most = k, gap
        is_solved = found < 0
        if is_solved:
            break
        normal = (normals[found, 0], normals[found, 1], normals[found, 2])
        third = (normal, offsets[found] - dot(normal, desired))
        correction, first, second, is_plain = _exchanged(first, second, third)
        if not is_plain:
            break
        point = add(desired, correction)
    if not is_solved:
        point, is_solved = _nearest(desired, normals, offsets, count)
    if is_solved and reach > FAR * _reach(point):
        # The rounding was that of a far ``desired``; from close by the same planes are met more sharply.
        point, is_solved = _nearest(point, normals, offsets, count)
    return point[0], point[1], point[2], is_solved and _reach(point) <= LARGEST


@kernel
def project_batch(desired, normals, offsets, out, feasible):
    """Rows of ``project``; nan where there is no point."""
    desired, normals, offsets = borrowed(desired), borrowed(normals), borrowed(offsets)
    for i in range(desired.shape[0]):
        x, y, z, feasible[i] = project(vector(desired[i]), normals[i], offsets[i], offsets.shape[1])
        out[i, 0], out[i, 1], out[i, 2] = (x, y, z) if feasible[i] else (math.nan, math.nan, math.nan)


@inline_kernel
def _is_usable(desired, normals, offsets):
    """Whether all is finite, and every normal of unit length."""
    if not abs(desired[0]) + abs(desired[1]) + abs(desired[2]) <= LARGEST:
        return False
    for k in range(offsets.shape[0]):
        normal = (normals[k, 0], normals[k, 1], normals[k, 2])
        if not (abs(offsets[k]) <= LARGEST and abs(norm(normal) - 1.0) <= UNIT_TOLERANCE):
            return False
    return True


@kernel
def project_usable(desired, normals, offsets, out, feasible):
    """``project_batch`` of rows that need no further look; False, and nothing said, if one does."""
    for i in range(desired.shape[0]):
        if not _is_usable(desired[i], normals[i], offsets[i]):
            return False
    project_batch(desired, normals, offsets, out, feasible)
    return True


def _projected_as_given(desired, normals, offsets) -> tuple[NDArray[np.float64], NDArray[np.bool_]] | None:
    """The answer to float64 arrays in C order that belong together, and None for anything else."""
    given = desired, normals, offsets
    if not all(type(x) is np.ndarray and x.dtype == np.float64 and x.flags.c_contiguous for x in given):
        return None
    leading, shape = desired.shape[:-1], normals.shape
    if desired.shape[-1:] != (3,) or shape != (*offsets.shape, 3) or offsets.shape[:-1] != leading:
        return None
    if leading == ():
        desired, normals, offsets = desired[None], normals[None], offsets[None]
    elif len(leading) > 1:
        return None
    out, feasible = np.empty(desired.shape), np.empty(len(desired), dtype=np.bool_)
    if not project_usable(desired, normals, offsets, out, feasible):
        return None
    return (out, feasible) if leading else (out[0], feasible.reshape(()))


def project_onto_halfspaces(
    desired: ArrayLike, normals: ArrayLike, offsets: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Nearest point to ``desired`` in the intersection of K half-spaces ``normals · u ≥ offsets``.

    Every bound is met to rounding of its largest term. Infeasible also counts what only a point some 1e14
    times farther away than the planes could meet (normals opposed to within 1e-14).

    Args:
        desired: (…, 3) u_des, any unit.
        normals: (…, K, 3) unit vectors into the half-spaces; any finite rows for absent half-spaces.
        offsets: (…, K) b, in the unit of ``desired``; −inf for an absent half-space.

    Returns:
        (…, 3) the nearest point, nan where there is none, and (…) whether there is one.

    Raises:
        ValueError: for wrong shapes, non-finite numbers, an offset of nan or +inf, or a normal that is not
            of unit length to 1e-12.
    """
    found = _projected_as_given(desired, normals, offsets)
    if found is not None:
        return found
    count = shaped_array("normals", normals, ("K", 3)).shape[-2]
    # The least float stands for "absent", so that everything is finite.
    offsets = np.maximum(shaped_array("offsets", offsets, (count,)), -LARGEST)
    (wish, normal, offset), leading = argument_rows(
        desired=(desired, (3,)), normals=(normals, (count, 3)), offsets=(offsets, (count,))
    )
    is_unit = np.abs(np.linalg.norm(normal, axis=-1) - 1.0) <= UNIT_TOLERANCE
    if not (is_unit | (offset == -LARGEST)).all():
        wrong = np.linalg.norm(normal, axis=-1)[~is_unit][0]
        raise ValueError(f"normals must be unit vectors, got one of length {wrong:.17g}")
    out, feasible = np.empty_like(wish), np.empty(len(wish), dtype=np.bool_)
    project_batch(wish, normal, offset, out, feasible)
    return out.reshape(*leading, 3), feasible.reshape(leading)
