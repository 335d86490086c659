/* Recovery (shields.backup.recovery): the way out of a body, at a bounded speed, by the nearest exit */
#ifndef QS_RECOVERY_H
#define QS_RECOVERY_H

#include "qs_arcs.h"

#define RECOVERY_SPEED 1 /* relative to the body that is left, m/s */
#define STRIDE Q(1e-3)   /* where there is no formula a way out is stepped along, m */
enum { STRIDES = 256, AXES = 6 };
static const qs_vec AXIS[AXES] = {{0, 0, 1}, {1, 0, 0}, {0, 1, 0}, {-1, 0, 0}, {0, -1, 0}, {0, 0, -1}};

/* How far a ray goes from a gap until it is out of a body; INF if it does not get there. */
static qs_real length_out_of(const qs_obstacle *core, qs_vec gap, qs_vec way, qs_real keep) {
    if (!core) {
        qs_real along = dot(gap, way), inside = keep * keep - dot(gap, gap);
        return inside > 0 ? SQRT(along * along + inside) - along : 0;
    }
    qs_real far = 0;
    for (int i = 0; i < STRIDES; ++i) {
        qs_real depth = keep - distance_from(core, combined(gap, far, way));
        if (depth <= 0) return far;
        far += most_of(depth, STRIDE); /* no way out is shorter than the depth */
    }
    return INF;
}

/* How far a ray goes until it is out of every body with its margin: each turn is the last, or leaves one. */
static qs_real length_of_way(qs_vec point, qs_vec way, const bodies *all, qs_real margin) {
    qs_real far = 0;
    for (int turn = 0; turn < all->count; ++turn) {
        qs_real begin = far;
        for (int k = 0; k < all->count; ++k) {
            const qs_obstacle *core = core_of(all, k);
            if (is_there(core, all->keep[k])) {
                qs_vec gap = subtract(combined(point, far, way), all->center[k]);
                far += length_out_of(core, gap, way, widened(core, all->keep[k], margin));
            }
        }
        if (far == begin || far == INF) break;
    }
    return far;
}

static void take_shorter(qs_vec way, qs_vec point, const bodies *all, qs_real margin, qs_real *shortest,
                         qs_vec *best) {
    qs_real length = length_of_way(point, way, all, margin);
    if (length < *shortest) *shortest = length, *best = way;
}

/* Direction of the shortest way out that is tried, 0 where none is one; the deepest body, -1 for none. */
static int nearest_exit(qs_vec point, const bodies *all, qs_real margin, qs_vec *best) {
    qs_vec away = NOTHING, way;
    qs_real shortest = INF, depth = 0;
    int deepest = -1;
    *best = NOTHING;
    for (int k = 0; k < all->count; ++k) {
        const qs_obstacle *core = core_of(all, k);
        qs_vec gap = subtract(point, all->center[k]);
        qs_real keep = widened(core, all->keep[k], margin), distance = look_at(core, gap, &way);
        if (!is_there(core, all->keep[k]) || !(distance < keep)) continue;
        away = add(away, outward(core, gap));
        if (keep - distance > depth) deepest = k, depth = keep - distance;
        take_shorter(way, point, all, margin, &shortest, best);
    }
    if (deepest >= 0) {
        from_center(away, &way);
        take_shorter(way, point, all, margin, &shortest, best);
        for (int i = 0; i < AXES; ++i) take_shorter(AXIS[i], point, all, margin, &shortest, best);
    }
    return deepest;
}

/* The snap that leaves the bodies, and whether the vehicle has to: inside one, and in the shell that a stop
 * keeps around it unless it is coming nearer. */
static int recovery_snap(qs_shield *shield, const bodies *all, qs_answer *fact, qs_vec *u) {
    const qs_state *x = &shield->last;
    const qs_rules *rules = &shield->rules;
    qs_vec way;
    int k = nearest_exit(x->r, all, rules->margin, &way);
    *u = NOTHING;
    if (k < 0) return 0;
    const qs_obstacle *core = core_of(all, k);
    qs_vec gap = subtract(x->r, all->center[k]), drift = all->body[k].velocity;
    qs_real bare = rules->has_tube ? all->keep[k] - rules->tube : all->keep[k];
    if (!(distance_from(core, gap) < bare || dot(outward(core, gap), subtract(x->v, drift)) >= 0)) return 0;
    fact->obstacle = k;
    *u = braking(subtract(x->v, combined(drift, RECOVERY_SPEED, way)), x->a, x->j, rules->recovery);
    *u = within_ball(*u, rules->limits.snap_max);
    return 1;
}

static int is_within(qs_vec r, const bodies *all) {
    for (int k = 0; k < all->count; ++k) {
        const qs_obstacle *core = core_of(all, k);
        qs_vec gap = subtract(r, all->center[k]);
        if (is_there(core, all->keep[k]) && distance_from(core, gap) < all->keep[k]) return 1;
    }
    return 0;
}

#endif
