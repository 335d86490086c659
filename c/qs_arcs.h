/* Arcs under a held snap (shields.backup.arcs)
 *
 * An arc is cut into pieces. A piece is clear of a body when a plane separates the body from its control points
 * (Bernstein form), whose hull contains it: nothing is missed between samples. An arc of a lead has one point
 * more: the vehicle behind it where the piece begins.
 */
#ifndef QS_ARCS_H
#define QS_ARCS_H

#include "qs_shapes.h"
#include "qs_stop.h"

/* The bodies of one call; keep: the distances. */
typedef struct {
    int count, are_spheres;
    const qs_obstacle *body;
    const qs_vec *center;
    const qs_real *keep;
} bodies;
typedef struct {
    qs_vec b[6];
    int count;
} points;
typedef struct {
    qs_vec start, drift; /* of the centre over the piece */
    qs_real keep;
} moving;

enum { MOST_PIECES = 128, MORE_ROUNDS = 40, REST_ROUNDS = 100 };
enum { CLEAR, UNSURE, HIT };
#define SHORTEST_PIECE Q(0.02)

static const qs_obstacle *core_of(const bodies *all, int k) { return all->are_spheres ? NULL : &all->body[k]; }

static void take_points(points *p, const qs_state *x, qs_vec snap, qs_real d) {
    qs_vec r = x->r, c1 = scale(d, x->v), c2 = scale(d * d / 2, x->a), c3 = scale(cubed(d) / 6, x->j);
    p->b[0] = r, p->b[1] = combined(r, Q(0.25), c1);
    p->b[2] = combined(combined(r, Q(0.5), c1), Q(1.0 / 6.0), c2);
    p->b[3] = combined(combined(combined(r, Q(0.75), c1), Q(0.5), c2), Q(0.25), c3);
    p->b[4] = combined(add(add(add(r, c1), c2), c3), squared(d * d) / 24, snap);
    p->count = x->lag > 0 ? 6 : 5;
}

/* Whether n.(b_i - c_i) >= rho |n| + h(n) for all points. */
static int is_separated(const qs_obstacle *core, qs_vec n, const points *p, const moving *m) {
    qs_real length = norm(n), least = raised(core, n, m->keep * length);
    /* Through the centre there is no direction, and what has overflowed is not clear either. */
    if (!(core ? length > 0 : length >= m->keep)) return 0;
    for (int i = 0; i < 5; ++i)
        if (!(dot(n, subtract(p->b[i], combined(m->start, (qs_real)i / 4, m->drift))) >= least)) return 0;
    return p->count == 5 || dot(n, subtract(p->b[5], m->start)) >= least;
}

/* The point of a straight line from start to end that is nearest to the origin. */
static qs_vec nearest_on_chord(qs_vec start, qs_vec end) {
    qs_vec chord = subtract(end, start);
    qs_real square = dot(chord, chord), share = square > 0 ? -dot(start, chord) / square : 0;
    return combined(start, least_of(most_of(share, 0), 1), chord);
}

/* Whether a plane separates: across the way to the nearest point of the chord, turned towards that of the core
 * a few times, or to the middle. */
static int piece_clears(const qs_obstacle *core, const points *p, const moving *m) {
    qs_vec start = subtract(p->b[p->count == 6 ? 5 : 0], m->start);
    qs_vec end = subtract(p->b[4], add(m->start, m->drift));
    qs_vec nearest = nearest_point(core, start),
           middle = subtract(p->b[2], combined(m->start, Q(0.5), m->drift));
    if (!core)
        return is_separated(core, nearest_on_chord(start, end), p, m) || is_separated(core, middle, p, m);
    for (int turn = 0; turn < PLANE_ROUNDS + MORE_ROUNDS * (p->count - 5); ++turn) {
        qs_vec way = nearest_on_chord(subtract(start, nearest), subtract(end, nearest));
        if (p->count == 6 && norm(way) <= m->keep)
            return 0; /* the hull comes no less near, so no plane will do */
        if (is_separated(core, facing(core, way), p, m)) return 1;
        nearest = nearest_point(core, add(nearest, way));
    }
    return is_separated(core, facing(core, subtract(middle, nearest_point(core, middle))), p, m);
}

/* Specific thrust |a + g e3| over a piece: CLEAR, UNSURE, or HIT if its end is outside of the band. */
static int look_at_thrust(const qs_state *x, qs_vec snap, qs_real d, const qs_limits *limits) {
    qs_vec lift = vec(0, 0, limits->gravity), b0 = add(x->a, lift), b1 = add(combined(x->a, d / 2, x->j), lift);
    qs_vec b2 = add(combined(combined(x->a, d, x->j), d * d / 2, snap), lift), own = add(x->own_a, lift);
    qs_real length = norm(b1), least = limits->thrust_min * length, most = squared(limits->thrust_max);
    int keeps = length >= limits->thrust_min && dot(b1, b0) >= least && dot(b1, b2) >= least;
    keeps = keeps && (x->lag == 0 || (dot(b1, own) >= least && dot(own, own) <= most));
    if (keeps && most_of(most_of(dot(b0, b0), dot(b1, b1)), dot(b2, b2)) <= most) return CLEAR;
    return norm(b2) < limits->thrust_min || norm(b2) > limits->thrust_max ? HIT : UNSURE;
}

/* Whether a piece of an arc keeps clear; HIT if its end, a point of the arc itself, does not. */
static int look_at_piece(const qs_state *x, qs_vec snap, qs_real start, qs_real d, int piece, const bodies *all,
                         const qs_limits *limits) {
    qs_state y = *x;
    fly_on(&y, snap, piece * d);
    int thrust = limits ? look_at_thrust(&y, snap, d, limits) : CLEAR;
    if (thrust != CLEAR) return thrust;
    points p;
    take_points(&p, &y, snap, d);
    for (int k = 0; k < all->count; ++k) {
        const qs_obstacle *core = core_of(all, k);
        qs_vec velocity = all->body[k].velocity;
        moving m = {combined(all->center[k], start + piece * d, velocity), scale(d, velocity), all->keep[k]};
        p.b[5] = combined(y.own_r, y.lag, velocity);
        if (is_there(core, m.keep) && !piece_clears(core, &p, &m)) {
            qs_real gap = distance_from(core, subtract(p.b[4], add(m.start, m.drift)));
            return gap < m.keep ? HIT : UNSURE;
        }
    }
    return CLEAR;
}

/* The same of an arc, in pieces as short as they must be; without limits of any thrust. */
static int look_at_arc(const qs_state *x, qs_vec snap, qs_real start, qs_real duration, const bodies *all,
                       const qs_limits *limits) {
    int piece = 0, pieces = 1;
    for (int turn = 0; piece < pieces && turn < 2 * MOST_PIECES; ++turn) {
        int found = look_at_piece(x, snap, start, duration / pieces, piece, all, limits);
        if (found == CLEAR) {
            ++piece;
            while (pieces > 1 && piece % 2 == 0) piece /= 2, pieces /= 2;
        } else if (found == UNSURE && duration >= 2 * pieces * SHORTEST_PIECE && pieces < MOST_PIECES)
            piece *= 2, pieces *= 2;
        else return found;
    }
    return piece < pieces ? UNSURE : CLEAR;
}

/* Whether a vehicle that moves on at a velocity from time start keeps clear for ever. */
static int rest_is_clear(qs_vec r, qs_vec v, qs_real start, const bodies *all) {
    for (int k = 0; k < all->count; ++k) {
        const qs_obstacle *core = core_of(all, k);
        qs_vec drift = all->body[k].velocity, gap = subtract(r, combined(all->center[k], start, drift));
        if (is_there(core, all->keep[k]) && !stays_away(core, gap, subtract(v, drift), all->keep[k])) return 0;
    }
    return 1;
}

/* Whether a plane keeps the core on its far side of a point, and of one that moves on from a gap. */
static int ray_and_point_are_clear(const qs_obstacle *core, qs_vec gap, qs_vec own, qs_vec closing,
                                   qs_real keep) {
    qs_real speed = dot(closing, closing);
    qs_vec nearest = nearest_point(core, gap);
    for (int turn = 0; turn < REST_ROUNDS; ++turn) {
        qs_vec way = nearest_on_chord(subtract(own, nearest), subtract(gap, nearest));
        if (norm(way) <= keep) return 0; /* they are no farther apart, so no plane will do */
        qs_real lean = speed > 0 ? least_of(dot(way, closing), 0) / speed : 0;
        qs_vec n = facing(core, combined(way, -lean, closing));
        qs_real length = norm(n);
        int is_upright = dot(n, closing) >= -UPRIGHT * length * norm(closing);
        if (is_upright && length > 0 && least_of(dot(n, gap), dot(n, own)) >= raised(core, n, keep * length))
            return 1;
        nearest = nearest_point(core, add(nearest, way));
    }
    return 0;
}

/* rest_is_clear of the vehicle behind a lead, which moves on at frame. */
static int own_rest_is_clear(const qs_state *x, qs_vec frame, qs_real start, const bodies *all) {
    for (int k = 0; x->lag > 0 && k < all->count; ++k) {
        const qs_obstacle *core = core_of(all, k);
        qs_vec drift = all->body[k].velocity, gap = subtract(x->r, combined(all->center[k], start, drift));
        qs_vec own = own_gap(x, gap, drift), closing = subtract(frame, drift);
        if (is_there(core, all->keep[k]) && !ray_and_point_are_clear(core, gap, own, closing, all->keep[k]))
            return 0;
    }
    return 1;
}

#endif
