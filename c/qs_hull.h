/* A whole stop in one hull (shields.backup.stop_hull)
 *
 * A stop is linear in its scaled state (v - w) h, a h^2, j h^3, with weights that are the same for every h. So
 * its control points are fixed combinations of these three vectors, and one plane may clear all of it.
 */
#ifndef QS_HULL_H
#define QS_HULL_H

#include "qs_arcs.h"

/* Of the position, three segments of five points; of the acceleration; of the jerk; of the snap. */
static const qs_real POSITION[13][3] = {
    {0, 0, 0}, {Q(1.0 / 4), 0, 0}, {Q(1.0 / 2), Q(1.0 / 12), 0}, {Q(3.0 / 4), Q(1.0 / 4), Q(1.0 / 24)},
    {Q(23.0 / 24), Q(5.0 / 12), Q(13.0 / 144)}, {Q(7.0 / 6), Q(7.0 / 12), Q(5.0 / 36)},
    {Q(4.0 / 3), Q(3.0 / 4), Q(7.0 / 36)}, {Q(17.0 / 12), Q(5.0 / 6), Q(2.0 / 9)},
    {Q(35.0 / 24), Q(7.0 / 8), Q(17.0 / 72)}, {Q(3.0 / 2), Q(11.0 / 12), Q(1.0 / 4)},
    {Q(3.0 / 2), Q(11.0 / 12), Q(1.0 / 4)}, {Q(3.0 / 2), Q(11.0 / 12), Q(1.0 / 4)},
    {Q(3.0 / 2), Q(11.0 / 12), Q(1.0 / 4)}};
static const qs_real ACCELERATION[7][3] = {
    {0, 1, 0}, {0, 1, Q(1.0 / 2)}, {Q(-1.0 / 2), 0, Q(1.0 / 12)}, {-1, -1, Q(-1.0 / 3)},
    {Q(-1.0 / 2), Q(-1.0 / 2), Q(-1.0 / 6)}, {0, 0, 0}, {0, 0, 0}};
static const qs_real JERK[2][3] = {{-1, -2, Q(-5.0 / 6)}, {1, 1, Q(1.0 / 3)}};
static const qs_real SNAP[3][3] = {{-1, -2, Q(-11.0 / 6)}, {2, 3, Q(7.0 / 6)}, {-1, -1, Q(-1.0 / 3)}};

typedef struct {
    qs_vec V, A, J;
    qs_real h;
} scaled_stop;
/* A snap that might be held for a period, from one state to another. */
typedef struct {
    const qs_state *x, *after;
    qs_vec snap;
    qs_real period;
} attempt;

static scaled_stop scaled(const qs_state *x, qs_real h) {
    scaled_stop s = {scale(h, x->v), scale(h * h, x->a), scale(h * h * h, x->j), h};
    return s;
}

static qs_vec weighted(const qs_real w[3], const scaled_stop *s) {
    return combined(combined(scale(w[0], s->V), w[1], s->A), w[2], s->J);
}

/* Of that the height. */
static qs_real height_of(const qs_real w[3], const scaled_stop *s) {
    return w[0] * s->V.z + w[1] * s->A.z + w[2] * s->J.z;
}

/* The least control point of the period along a normal, e in ascending powers. */
static qs_real least_over_period(const qs_real e[5]) {
    qs_real b1 = e[0] + e[1] / 4, b2 = e[0] + e[1] / 2 + e[2] / 6;
    qs_real b3 = e[0] + Q(0.75) * e[1] + e[2] / 2 + e[3] / 4;
    return least_of(least_of(least_of(least_of(e[0], b1), b2), b3), e[0] + e[1] + e[2] + e[3] + e[4]);
}

/* The least control point of a stop along a normal: e0 at its start, drift in every segment. */
static qs_real least_over_stop(qs_vec n, qs_real e0, qs_real drift, const scaled_stop *s) {
    qs_real V = dot(n, s->V), A = dot(n, s->A), J = dot(n, s->J), least = e0;
    /* At rest the last four are one point, which only the drift takes apart. */
    for (int i = 1; i < 13; i += i == 9 ? 3 : 1) {
        const qs_real *w = POSITION[i];
        least = least_of(least, e0 + Q(0.25) * i * drift + w[0] * V + w[1] * A + w[2] * J);
    }
    return least;
}

/* Whether the plane across n keeps the period and the stop after it away from a core that moves. */
static int plane_separates(const qs_obstacle *core, qs_vec n, const moving *m, const attempt *t,
                           const scaled_stop *s) {
    const qs_state *x = t->x;
    qs_vec gap = m->start;
    qs_real d = t->period, length = norm(n), drift = dot(n, m->drift);
    qs_real e[5] = {dot(n, gap), d * (dot(n, x->v) - drift), d * d / 2 * dot(n, x->a),
                    d * d * d / 6 * dot(n, x->j), d * d * d * d / 24 * dot(n, t->snap)};
    qs_real least = least_over_period(e);
    qs_real start = dot(n, gap) + dot(n, subtract(t->after->r, x->r)) - d * drift;
    least = least_of(least, least_over_stop(n, start, -s->h * drift, s));
    qs_real keep = raised(core, n, m->keep * length);
    /* What is behind a lead is beyond a plane to which the body does not come nearer. */
    int is_beyond = x->lag == 0 || (dot(n, own_gap(x, gap, m->drift)) >= keep && drift <= 0);
    return length > 0 && least >= keep && is_beyond;
}

/* Whether one plane keeps period and stop away: across the way to where a straight flight to the end of the stop
 * comes nearest, turned towards the nearest point of a core a few times. */
static int one_plane_does(const qs_obstacle *core, const moving *m, qs_vec at_rest, const attempt *t,
                          const scaled_stop *s) {
    qs_vec begin = own_gap(t->x, m->start, m->drift);
    if (plane_separates(core, facing(core, nearest_on_chord(begin, at_rest)), m, t, s)) return 1;
    if (!core) return 0;
    qs_vec nearest = nearest_point(core, begin);
    for (int turn = 0; turn < PLANE_ROUNDS; ++turn) {
        qs_vec n = nearest_on_chord(subtract(begin, nearest), subtract(at_rest, nearest));
        if (plane_separates(core, facing(core, n), m, t, s)) return 1;
        nearest = nearest_point(core, add(nearest, n));
    }
    return 0;
}

/* Whether a body that moves on from a resting vehicle never comes nearer than that. */
static int moves_away(const qs_obstacle *core, qs_vec gap, qs_vec velocity, qs_real keep) {
    if (core) return stays_away(core, gap, scale(-1, velocity), keep);
    qs_real speed = dot(velocity, velocity), ahead = speed > 0 ? most_of(0, dot(gap, velocity) / speed) : 0;
    return norm(combined(gap, -ahead, velocity)) >= keep;
}

/* Whether one plane for each body keeps period and stop away, with a share of the margin. */
static int bodies_are_clear(const attempt *t, const scaled_stop *s, const bodies *all, qs_real share) {
    qs_vec end = add(t->after->r, weighted(POSITION[12], s));
    qs_real duration = t->period + SEGMENTS * s->h;
    for (int k = 0; k < all->count; ++k) {
        const qs_obstacle *core = core_of(all, k);
        moving m = {subtract(t->x->r, all->center[k]), all->body[k].velocity,
                    widened(core, all->keep[k], share)};
        if (!is_there(core, all->keep[k])) continue;
        qs_vec at_rest = combined(subtract(end, all->center[k]), -duration, m.drift);
        if (!one_plane_does(core, &m, at_rest, t, s)) return 0;
        if (!is_same(m.drift, NOTHING) && !moves_away(core, at_rest, m.drift, m.keep)) return 0;
    }
    return 1;
}

/* Whether the snaps of the stop, and the jerk at the end of every segment, are short enough. */
static int keeps_snap_and_jerk(const qs_state *after, const scaled_stop *s, const qs_limits *limits) {
    qs_real h3 = s->h * s->h * s->h;
    for (int i = 0; i < SEGMENTS; ++i)
        if (!(norm(weighted(SNAP[i], s)) <= limits->stop_snap_max * h3 * s->h)) return 0;
    if (limits->jerk_max == INF) return 1;
    qs_real most = most_of(norm(weighted(JERK[0], s)), norm(weighted(JERK[1], s)));
    return most <= limits->jerk_max * h3 && norm(after->j) <= limits->jerk_max;
}

/* Whether a level plane keeps the specific thrust above the floor, a ball keeps it below the ceiling. */
static int keeps_thrust(const attempt *t, const scaled_stop *s, const qs_limits *limits) {
    const qs_state *x = t->x;
    qs_vec up = vec(0, 0, limits->gravity), middle = combined(x->a, t->period / 2, x->j),
           own = add(x->own_a, up);
    qs_real least = least_of(least_of(x->a.z, middle.z), t->after->a.z), square = 1 / (s->h * s->h);
    for (int i = 1; i < 7; ++i) least = least_of(least, square * height_of(ACCELERATION[i], s));
    if (!(least + limits->gravity >= limits->thrust_min)) return 0;
    if (x->lag > 0 && !(own.z >= limits->thrust_min && norm(own) <= limits->thrust_max)) return 0;
    if (limits->thrust_max == INF) return 1;
    qs_real most = most_of(most_of(norm(add(x->a, up)), norm(add(middle, up))), norm(add(t->after->a, up)));
    for (int i = 1; i < 7; ++i) most = most_of(most, norm(combined(up, square, weighted(ACCELERATION[i], s))));
    return most <= limits->thrust_max;
}

static int keeps_limits(const attempt *t, const scaled_stop *s, const qs_limits *limits) {
    return keeps_snap_and_jerk(t->after, s, limits) && keeps_thrust(t, s, limits);
}

#endif
