"""One body as a shield sees it: a core that moves at constant velocity, to be kept at a distance.

Along a fixed unit vector n the core reaches to its support height h(n) = max n·p, p from its centre c on, and

    n·(r − c) ≥ ρ + h(n)    implies    dist(r, core) ≥ ρ                                              (V1)

A sphere is the core of one point: h = 0. In worlds of spheres alone ``core`` is None, and nothing of this is
compiled. A half-space has one direction only, its normal. Positions ``gap`` are relative to the centre.
"""

from typing import NamedTuple

from quadsafe_core.kernels.borrow import one_row
from quadsafe_core.kernels.choice import none_without
from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.vec3 import add, combined, dot, norm, subtract
from quadsafe_core.shapes.cores import CORE, HALF_SPACE, SPHERE, Cores, cores_of
from quadsafe_core.shapes.distance import nearest_point, signed_distance
from quadsafe_core.shapes.support import support_height
from shields.chains.radial import line_of_sight
from shields.interface.records import Bodies, MovingBodies, velocity_row

# The margin of a sphere is a share of its radius. That of another body, which may be as thin as the vehicle, is
# the same share of this, m.
MARGIN_LENGTH = 0.5
CORE_SIZE = CORE.itemsize
# How often a plane is turned towards the nearest point of a core.
ROUNDS = 3
# Of positions of 1 m and of their size, m.
ROUNDING, ROUNDING_SHARE = 1e-9, 1e-14
# Against the way that a body comes, a plane may lean by rounding.
UPRIGHT = 1e-12


class Kept(NamedTuple):
    """What to keep of a body: a distance, m; its margin, m, None among spheres alone; its ``Core``."""

    distance: float
    spare: float | None
    core: tuple | None


@inline_kernel
def rounding_at(r, gap):
    """What rounding may do to a distance seen from r, ``gap`` from the centre, m."""
    size = abs(r[0]) + abs(r[1]) + abs(r[2]) + abs(gap[0]) + abs(gap[1]) + abs(gap[2])
    return ROUNDING + ROUNDING_SHARE * size


@kernel
def are_cores_of(cores, n, k):
    """Whether the bytes behind N worlds of K bodies are as many as they must be at least."""
    if cores is None:
        return True
    return cores.shape[0] >= n * k * CORE_SIZE


@none_without
def unpacked(cores, n, k):
    """The cores of N worlds of K bodies in the bytes of ``Obstacles``."""
    return cores_of(cores, n, k)


@none_without
def cores_of_row(cores, i):
    """The cores of world i."""
    return Cores(cores.core[i], cores.numbers)


@none_without
def cores_as_one_row(cores):
    """The cores of one world as those of a batch of one."""
    return Cores(one_row(cores.core), cores.numbers)


@inline_kernel
def bodies_of_row(i, bodies):
    """The bodies of row i, with their radii as the distances to keep."""
    velocity = bodies.velocity[velocity_row(i, bodies.velocity)]
    return MovingBodies(bodies.center[i], velocity, bodies.radius[i], cores_of_row(bodies.cores, i))


@inline_kernel
def as_one_row(bodies):
    """The bodies of one vehicle as those of a batch of one."""
    center, velocity, keep_out = one_row(bodies.center), one_row(bodies.velocity), one_row(bodies.keep_out)
    return Bodies(center, velocity, keep_out, cores_as_one_row(bodies.cores))


@inline_kernel
def is_there(core, radius):
    """Whether there is a body: a sphere of radius 0 is none."""
    if core is None:
        return radius > 0.0
    kind = core[0]["kind"]
    return kind > SPHERE or (kind == SPHERE and radius > 0.0)


@inline_kernel
def widened(core, radius, share):
    """The distance to keep with a share of a margin on top, m."""
    if core is None or core[0]["kind"] == SPHERE:
        return (1 + share) * radius
    return radius + share * MARGIN_LENGTH


@none_without
def spare_of(core, radius, share):
    """A share of the margin, m; None among spheres alone, where it is a factor."""
    return widened(core, radius, share) - radius


@inline_kernel
def raised(core, n, distance):
    """ρ + h(n), which n·(r − c) has to reach; for n of length ‖n‖ both are so many times larger."""
    if core is None:
        return distance
    return distance + support_height(core[0], core[1], n)


@inline_kernel
def facing(core, n):
    """A direction that the body allows: n, or the unit normal of a half-space, which has no other."""
    if core is None or core[0]["kind"] != HALF_SPACE:
        return n
    axes = core[0]["axes"]
    return (axes[0, 0], axes[0, 1], axes[0, 2])


@inline_kernel
def look_at(core, gap):
    """Distance from the core, m, negative inside, and the unit vector away from it."""
    if core is None:
        distance, n, _ = line_of_sight(gap)
        return distance, n
    return signed_distance(core[0], core[1], gap)


@inline_kernel
def nearest_to(core, gap):
    """The point of the core that is nearest, relative to its centre."""
    if core is None:
        return (0.0, 0.0, 0.0)
    return nearest_point(core[0], core[1], gap)


@inline_kernel
def outward(core, gap):
    """A direction away from the core, of any length."""
    if core is None:
        return gap
    return signed_distance(core[0], core[1], gap)[1]


@inline_kernel
def distance_from(core, gap):
    """Distance from the core, m, negative inside."""
    if core is None:
        return norm(gap)
    return signed_distance(core[0], core[1], gap)[0]


@kernel
def core_stays_away(core, gap, closing, keep):
    """Whether a point that moves on from ``gap`` along ``closing`` keeps that distance from the core for ever.

    The plane stands across the way from the core to the ray, and does not lean against it: n·gap ≥ ρ‖n‖ + h(n)
    and n·closing ≥ 0 are enough.
    """
    speed, nearest = dot(closing, closing), nearest_point(core[0], core[1], gap)
    if not speed > 0.0:
        return distance_from(core, gap) >= keep
    for _ in range(ROUNDS):
        way = subtract(gap, nearest)
        way = combined(way, max(0.0, -dot(way, closing) / speed), closing)
        n = facing(core, combined(way, -min(dot(way, closing), 0.0) / speed, closing))
        length = norm(n)
        is_upright = dot(n, closing) >= -UPRIGHT * length * norm(closing)
        if is_upright and length > 0.0 and dot(n, gap) >= raised(core, n, keep * length):
            return True
        nearest = nearest_point(core[0], core[1], add(nearest, way))
    return False
