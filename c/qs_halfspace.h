/* Half-spaces of snaps (shields.methods.halfspace, nearest_snap)
 *
 * Along a fixed unit vector n, y = n.(r - c) is an exact chain of n.u. Every period n is chosen anew among the
 * last n, the line of sight and the direction of closest approach, as the one in the invariant set of which the
 * least correction is needed. The desired snap is projected onto the half-spaces that it is outside of.
 */
#ifndef QS_HALFSPACE_H
#define QS_HALFSPACE_H

#include "qs_arcs.h"
#include "qs_chain.h"
#include "qs_project.h"

#define HORIZON 2 /* beyond this the straight prediction says nothing, s */

typedef struct {
    qs_vec n;
    qs_real least, value;
    int is_admissible;
} demand;
/* What to keep of a body: a distance, its margin, NULL among spheres alone, and its core. */
typedef struct {
    qs_real distance, margin;
    const qs_real *spare;
    const qs_obstacle *core;
} kept;

static qs_state relative_to(const qs_state *x, qs_vec center, qs_vec velocity) {
    qs_vec own = combined(subtract(x->own_r, center), x->lag, velocity);
    qs_state y = {subtract(x->r, center), subtract(x->v, velocity), x->a, x->j, own, NOTHING, NOTHING, x->lag};
    return y;
}

static kept kept_of(const bodies *all, int k, qs_real share) {
    const qs_obstacle *core = core_of(all, k);
    qs_real distance = widened(core, all->keep[k], share);
    kept keep = {distance, distance - all->keep[k], NULL, core};
    return keep;
}

/* The least n.u, from the wanted one up, that keeps the distance along n from the centre of x; n has to keep it
 * for the vehicle behind a lead too (Theorem L3). */
static demand demand_along(qs_vec n, const qs_state *x, qs_vec wanted, const kept *keep,
                           const qs_rules *rules) {
    n = facing(keep->core, n);
    qs_real y[4] = {dot(n, x->j), dot(n, x->a), dot(n, x->v), dot(n, x->r)};
    qs_real distance = raised(keep->core, n, keep->distance), own = dot(n, x->own_r) - distance;
    required r = eased(y, distance, keep->core ? &keep->margin : NULL, dot(n, wanted), rules);
    demand d = {n, r.least, r.value, r.is_admissible};
    if (x->lag > 0) d.value = least_of(d.value, own), d.is_admissible = d.is_admissible && own >= 0;
    return d;
}

/* How far the wanted snap is outside the half-space. */
static qs_real excess(const demand *d, qs_vec wanted) { return most_of(0, d->least - dot(d->n, wanted)); }

/* The demand to prefer: in its set, then with less correction; the first of equals. */
static demand preferred(demand first, demand second, qs_vec wanted) {
    if (first.is_admissible != second.is_admissible) return first.is_admissible ? first : second;
    if (first.is_admissible) return excess(&second, wanted) < excess(&first, wanted) ? second : first;
    return second.value > first.value ? second : first;
}

/* The point of closest approach to 0 of a straight flight from r; the present point at rest. */
static qs_vec closest_approach(qs_vec r, qs_vec v) {
    qs_real speed = dot(v, v);
    return combined(r, speed > 0 ? least_of(HORIZON, most_of(0, -dot(r, v) / speed)) : 0, v);
}

/* From the core to the point of its closest approach, any length. */
static qs_vec way_past(const qs_obstacle *core, const qs_state *x) {
    qs_vec nearest = nearest_point(core, x->r), point = x->r, n;
    if (!core) return closest_approach(x->r, x->v);
    for (int turn = 0; turn < PLANE_ROUNDS; ++turn) {
        point = add(nearest, closest_approach(subtract(x->r, nearest), x->v));
        nearest = nearest_point(core, point);
    }
    look_at(core, point, &n);
    return n;
}

/* The preferred half-space that keeps the distance; sight: away from the core, last: 0 for none. */
static demand distance_demand(const qs_state *x, qs_vec sight, qs_vec last, qs_vec wanted, const kept *keep,
                              const qs_rules *rules) {
    demand d = demand_along(sight, x, wanted, keep, rules);
    if (d.is_admissible && excess(&d, wanted) == 0) return d;
    if (dot(last, last) > 0) {
        d = preferred(d, demand_along(last, x, wanted, keep, rules), wanted);
        if (d.is_admissible && excess(&d, wanted) == 0) return d;
    }
    qs_vec ahead = way_past(keep->core, x);
    qs_real length = norm(ahead);
    if (length > 0) d = preferred(d, demand_along(scale(1 / length, ahead), x, wanted, keep, rules), wanted);
    return d;
}

/* Choose the half-spaces; whether one asks for a correction, and whether x is outside all bodies. */
static int choose_directions(qs_shield *shield, qs_vec wanted, const bodies *all, qs_answer *fact,
                             int *is_outside) {
    int cuts = 0;
    *is_outside = 1;
    for (int k = 0; k < all->count; ++k) {
        kept keep = kept_of(all, k, shield->rules.margin);
        qs_state y = relative_to(&shield->last, all->center[k], all->body[k].velocity);
        qs_vec sight;
        if (!is_there(keep.core, all->keep[k])) continue;
        qs_real distance = look_at(keep.core, y.r, &sight);
        demand d = distance_demand(&y, sight, shield->chosen[k].n, wanted, &keep, &shield->rules);
        shield->chosen[k].n = d.n, shield->chosen[k].least = d.least;
        fact->value = least_of(fact->value, d.value);
        cuts |= excess(&d, wanted) > 0;
        *is_outside &= distance >= all->keep[k];
    }
    return cuts;
}

/* Enter the half-spaces of the bodies that u is outside of; whether there was one. is_chosen: they are those that
 * were chosen for u. most: the largest correction asked for so far. */
static int cut(qs_shield *shield, qs_vec u, int is_chosen, const bodies *all, qs_answer *fact, qs_real *most) {
    int cuts = is_chosen;
    for (int k = 0; k < all->count; ++k) {
        qs_half_space_of *entered = &shield->entered[k];
        kept keep = kept_of(all, k, shield->rules.margin);
        if (!is_there(keep.core, all->keep[k]) || entered->least != -INF) continue;
        demand d = {shield->chosen[k].n, shield->chosen[k].least, 0, 1};
        if (!is_chosen) {
            qs_state y = relative_to(&shield->last, all->center[k], all->body[k].velocity);
            d = demand_along(d.n, &y, u, &keep, &shield->rules);
        }
        qs_real correction = excess(&d, u);
        if (!(correction > 0)) continue;
        cuts = 1, entered->n = d.n, entered->least = d.least;
        fact->reserve = most_of(fact->reserve, d.least);
        if (correction > *most) fact->obstacle = k;
        *most = most_of(*most, correction);
    }
    return cuts;
}

/* A snap of the same half-spaces within the ball, on the way from u to the one nearest to none. */
static qs_vec shortened(qs_vec u, const qs_half_space_of *planes, int count, qs_real snap_max) {
    qs_vec least = NOTHING;
    if (norm(u) <= snap_max || !project(&least, planes, count) || !(norm(least) <= snap_max)) return u;
    qs_vec way = subtract(u, least);
    qs_real a = dot(way, way), b = dot(way, least), c = dot(least, least) - snap_max * snap_max;
    return combined(least, JUST_INSIDE * most_of((SQRT(most_of(b * b - a * c, 0)) - b) / a, 0), way);
}

/* The nearest snap to the wanted one in every half-space and the ball; 0 if there is none. */
static int nearest_snap(qs_shield *shield, qs_vec wanted, int is_chosen, const bodies *all, qs_answer *fact,
                        qs_vec *u) {
    qs_real most = 0, snap_max = shield->rules.limits.snap_max;
    for (int k = 0; k < all->count; ++k) shield->entered[k].n = NOTHING, shield->entered[k].least = -INF;
    *u = wanted = within_ball(wanted, snap_max);
    int is_feasible = 1, cuts = cut(shield, wanted, is_chosen, all, fact, &most);
    /* Each turn but the first has entered one more. */
    for (int turn = 0; turn <= all->count && cuts && is_feasible; ++turn) {
        *u = wanted;
        is_feasible = project(u, shield->entered, all->count);
        *u = shortened(*u, shield->entered, all->count, snap_max);
        cuts = cut(shield, *u, 0, all, fact, &most);
    }
    return is_feasible;
}

#endif
