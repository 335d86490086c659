"""Polynomial arcs of a vehicle under a held snap, and whether they keep clear between samples too.

An arc is cut into pieces. A piece is clear of a body when a plane separates the body from the control
points (Bernstein form) of the piece, whose convex hull contains it: nothing is missed between samples. The
same test on the acceleration keeps the specific thrust ‖r̈ + g e3‖ at its floor or above; below its ceiling it
is where the control points are. An arc of a lead has one point more: the vehicle behind it where the piece
begins, in whose hull with the piece it stays.
"""

from quadsafe_core.kernels.choice import entry_at, same_without
from quadsafe_core.kernels.jit import inline_kernel, kernel
from quadsafe_core.kernels.vec3 import add, combined, dot, norm, scale, subtract, vector
from quadsafe_core.shapes.distance import nearest_point
from shields.chains.flat_state import Flat, behind_of, flown, own_gap  # noqa: F401 - Flat was imported from here before
from shields.interface.bodies import (
    ROUNDS,
    UPRIGHT,
    core_stays_away,
    distance_from,
    facing,
    is_there,
    nearest_to,
    raised,
)
from shields.interface.records import ThrustBand  # noqa: F401 - it was imported from here before

# A piece that may not be clear is halved until it is one of so many of its arc, or shorter, s, than twice that:
# the hull of the control points is then within a millimetre of the path.
MOST_PIECES = 128
SHORTEST_PIECE = 0.02
# The hull of a piece and the vehicle behind it gets no shorter with the piece: its plane is turned more often.
MORE_ROUNDS = 40
# A rest beside a long edge may take many.
REST_ROUNDS = 100
# What a look at an arc finds.
CLEAR, UNSURE, HIT = range(3)


@kernel
def position_points(x, snap, d):
    """Bernstein control points of the position over a piece of length d."""
    c1, c2, c3 = scale(d, x.v), scale(d * d / 2, x.a), scale(d**3 / 6, x.j)
    b1 = combined(x.r, 1 / 4, c1)
    b2 = combined(combined(x.r, 1 / 2, c1), 1 / 6, c2)
    b3 = combined(combined(combined(x.r, 3 / 4, c1), 1 / 2, c2), 1 / 4, c3)
    b4 = combined(add(add(add(x.r, c1), c2), c3), d**4 / 24, snap)
    return (x.r, b1, b2, b3, b4)


@inline_kernel
def acceleration_points(x, snap, d):
    """Bernstein control points of the acceleration over a piece of length d."""
    return (x.a, combined(x.a, d / 2, x.j), combined(combined(x.a, d, x.j), d * d / 2, snap))


@same_without
def with_own_position(points, behind, velocity):
    """The control points of a position, and the vehicle behind it, seen as they are from a body that moves."""
    own = combined(behind.r, behind.lag, velocity)
    return (points[0], points[1], points[2], points[3], points[4], own)


@same_without
def with_own_acceleration(points, behind):
    """The control points of an acceleration, and that of the vehicle behind it."""
    return (points[0], points[1], points[2], behind.a)


@kernel
def is_separated(core, n, length, points, center, drift, radius):
    """Whether ``n·(b_i − c_i) ≥ ρ ‖n‖ + h(n)`` for five control points; the centre moves by drift in all.

    A sixth is a point where the piece begins.
    """
    # Through the centre there is no direction, and what has overflowed is not clear either.
    if not (length >= radius if core is None else length > 0.0):
        return False
    least = raised(core, n, radius * length)
    for i in range(5):
        gap = subtract(points[i], combined(center, i / 4, drift))
        if not dot(n, gap) >= least:
            return False
    for i in range(5, len(points)):
        if not dot(n, subtract(points[i], center)) >= least:
            return False
    return True


@inline_kernel
def first_of(points):
    """Where a piece begins: the vehicle, where it is behind."""
    return points[5 * (len(points) - 5)]


@inline_kernel
def nearest_on_chord(start, end):
    """The point of a straight line from start to end that is nearest to the origin."""
    chord = subtract(end, start)
    square = dot(chord, chord)
    share = -dot(start, chord) / square if square > 0.0 else 0.0
    return combined(start, min(max(share, 0.0), 1.0), chord)


@kernel
def piece_clears_core(core, points, center, drift, radius):
    """``piece_clears`` of a core of more than a point: the plane is turned towards its nearest point."""
    start, end = subtract(first_of(points), center), subtract(points[4], add(center, drift))
    nearest = nearest_point(core[0], core[1], start)
    for _ in range(ROUNDS + MORE_ROUNDS * (len(points) - 5)):
        way = nearest_on_chord(subtract(start, nearest), subtract(end, nearest))
        if len(points) > 5 and norm(way) <= radius:
            # The hull comes no less near, so no plane will do.
            return False
        n = facing(core, way)
        if is_separated(core, n, norm(n), points, center, drift, radius):
            return True
        nearest = nearest_point(core[0], core[1], add(nearest, way))
    middle = subtract(points[2], combined(center, 0.5, drift))
    n = facing(core, subtract(middle, nearest_point(core[0], core[1], middle)))
    return is_separated(core, n, norm(n), points, center, drift, radius)


@kernel
def piece_clears(core, points, center, drift, radius):
    """Whether a plane separates: across the way to the nearest point of the chord, or to the middle."""
    if core is not None:
        return piece_clears_core(core, points, center, drift, radius)
    n = nearest_on_chord(subtract(first_of(points), center), subtract(points[4], add(center, drift)))
    if is_separated(core, n, norm(n), points, center, drift, radius):
        return True
    middle = subtract(points[2], combined(center, 0.5, drift))
    return is_separated(core, middle, norm(middle), points, center, drift, radius)


@inline_kernel
def piece_keeps_thrust(points, band):
    """Whether the specific thrust r̈ + g e3 keeps to the band over the piece.

    A plane separates it from the ball of the floor; the ball of the ceiling holds its control points.
    """
    lift = (0.0, 0.0, band.gravity)
    b0, b1, b2 = add(points[0], lift), add(points[1], lift), add(points[2], lift)
    length = norm(b1)
    least = band.least * length
    if not (length >= band.least and dot(b1, b0) >= least and dot(b1, b2) >= least):
        return False
    for i in range(3, len(points)):
        own = add(points[i], lift)
        if not (dot(b1, own) >= least and dot(own, own) <= band.most * band.most):
            return False
    return max(dot(b0, b0), dot(b1, b1), dot(b2, b2)) <= band.most * band.most


@inline_kernel
def thrust_leaves(acceleration, band):
    """Whether an acceleration of the arc itself is outside of the band."""
    thrust = norm(add(acceleration, (0.0, 0.0, band.gravity)))
    return thrust < band.least or thrust > band.most


@kernel
def look_at_piece(x, snap, start, d, piece, bodies, band):
    """Whether a piece of the arc, of length d, keeps clear of the bodies and to the band.

    ``CLEAR``; ``HIT`` if its end, a point of the arc itself, does not; else ``UNSURE``.
    """
    y = flown(x, snap, piece * d)
    behind = behind_of(y)
    accelerations = with_own_acceleration(acceleration_points(y, snap, d), behind)
    if not piece_keeps_thrust(accelerations, band):
        return HIT if thrust_leaves(accelerations[2], band) else UNSURE
    points = position_points(y, snap, d)
    for k in range(bodies.keep_out.shape[0]):
        core, keep_out = entry_at(bodies.cores, k), bodies.keep_out[k]
        if is_there(core, keep_out):
            velocity = vector(bodies.velocity[k])
            center = combined(vector(bodies.center[k]), start + piece * d, velocity)
            drift = scale(d, velocity)
            if not piece_clears(core, with_own_position(points, behind, velocity), center, drift, keep_out):
                gap = distance_from(core, subtract(points[4], add(center, drift)))
                return HIT if gap < keep_out else UNSURE
    return CLEAR


@kernel
def look_at_arc(x, snap, start, duration, bodies, band):
    """The same for the snap held from ``start`` for ``duration``, in pieces as short as they must be."""
    piece, pieces = 0, 1
    while piece < pieces:
        found = look_at_piece(x, snap, start, duration / pieces, piece, bodies, band)
        if found == CLEAR:
            piece += 1
            while pieces > 1 and piece % 2 == 0:
                piece, pieces = piece // 2, pieces // 2
        elif found == UNSURE and duration >= 2 * pieces * SHORTEST_PIECE and pieces < MOST_PIECES:
            piece, pieces = 2 * piece, 2 * pieces
        else:
            return found
    return CLEAR


@kernel
def arc_is_clear(x, snap, start, duration, bodies, band):
    """Whether the snap held from ``start`` for ``duration`` is sure to keep clear, and to the band."""
    return look_at_arc(x, snap, start, duration, bodies, band) == CLEAR


@inline_kernel
def stays_away(core, gap, closing, keep_out):
    """Whether a point that moves on from ``gap`` along ``closing`` keeps that distance for ever."""
    if core is not None:
        return core_stays_away(core, gap, closing, keep_out)
    speed = dot(closing, closing)
    if speed > 0.0:
        gap = combined(gap, max(0.0, -dot(gap, closing) / speed), closing)
    return norm(gap) >= keep_out


@kernel
def rest_is_clear(x, start, bodies):
    """Whether a vehicle that moves on at its velocity from time ``start`` keeps clear for ever."""
    for k in range(bodies.keep_out.shape[0]):
        core, drift = entry_at(bodies.cores, k), vector(bodies.velocity[k])
        if is_there(core, bodies.keep_out[k]):
            gap = subtract(x.r, combined(vector(bodies.center[k]), start, drift))
            if not stays_away(core, gap, subtract(x.v, drift), bodies.keep_out[k]):
                return False
    return True


@kernel
def ray_and_point_are_clear(core, gap, own, closing, keep):
    """Whether a plane keeps the core on its far side of a point, and of one that moves on from ``gap``."""
    speed, nearest = dot(closing, closing), nearest_to(core, gap)
    for _ in range(REST_ROUNDS):
        way = nearest_on_chord(subtract(own, nearest), subtract(gap, nearest))
        if norm(way) <= keep:
            # They are no farther apart, so no plane will do.
            return False
        lean = min(dot(way, closing), 0.0) / speed if speed > 0.0 else 0.0
        n = facing(core, combined(way, -lean, closing))
        length = norm(n)
        is_upright = dot(n, closing) >= -UPRIGHT * length * norm(closing)
        least = raised(core, n, keep * length)
        if is_upright and length > 0.0 and min(dot(n, gap), dot(n, own)) >= least:
            return True
        nearest = nearest_to(core, add(nearest, way))
    return False


@kernel
def own_rest_is_clear(behind, x, frame, start, bodies):
    """``rest_is_clear`` of the vehicle behind a lead x, which moves on at ``frame``; True of none."""
    if behind is None:
        return True
    for k in range(bodies.keep_out.shape[0]):
        core, drift = entry_at(bodies.cores, k), vector(bodies.velocity[k])
        if is_there(core, bodies.keep_out[k]):
            gap = subtract(x.r, combined(vector(bodies.center[k]), start, drift))
            own = own_gap(behind, x, gap, drift)
            if not ray_and_point_are_clear(core, gap, own, subtract(frame, drift), bodies.keep_out[k]):
                return False
    return True
