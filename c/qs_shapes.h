/* Shapes (quadsafe_core.shapes): a core, relative to its centre, grown by a ball
 *
 *     h(n) = max n.p over p of the core       n.(r - c) >= rho + h(n)  implies  dist(r, core) >= rho     (V1)
 *
 * In a world of spheres alone core is NULL, as it is in Python: the same bits need the same way.
 */
#ifndef QS_SHAPES_H
#define QS_SHAPES_H

#include "qs_numbers.h"

/* The margin of a body that may be as thin as the vehicle is a share of this, m. */
#define MARGIN_LENGTH Q(0.5)
#define LEAST_SQUARED EITHER(1e-150, 1e-18) /* the squares of shorter vectors lose digits, m */
#define UPRIGHT EITHER(1e-12, 1e-6) /* against the way that a body comes, a plane may lean by rounding */
/* How often a plane is turned towards the nearest point of a core; a bound on the rounds of a hull. */
enum { PLANE_ROUNDS = 3, HULL_ROUNDS = 100 };

static int is_there(const qs_obstacle *core, qs_real radius) {
    return radius > 0 || (core && core->kind > QS_SPHERE);
}

/* The distance to keep with a share of a margin on top. */
static qs_real widened(const qs_obstacle *core, qs_real radius, qs_real share) {
    return !core || core->kind == QS_SPHERE ? (1 + share) * radius : radius + share * MARGIN_LENGTH;
}

static qs_vec in_axes(const qs_obstacle *core, qs_vec x) {
    return vec(dot(core->axes[0], x), dot(core->axes[1], x), dot(core->axes[2], x));
}

static qs_vec from_axes(const qs_obstacle *core, qs_vec y) {
    const qs_vec *e = core->axes;
    return vec(e[0].x * y.x + e[1].x * y.y + e[2].x * y.z, e[0].y * y.x + e[1].y * y.y + e[2].y * y.z,
               e[0].z * y.x + e[1].z * y.y + e[2].z * y.z);
}

/* x along the first axis of a core, its distance from that line, and the unit vector across to it. */
static qs_real about_axis(const qs_obstacle *core, qs_vec x, qs_real *radius, qs_vec *across) {
    qs_vec e = core->axes[0];
    qs_real t = dot(e, x);
    qs_vec b = vec(x.x - t * e.x, x.y - t * e.y, x.z - t * e.z);
    /* Once more: of an x close to the line rounding leaves a part along it. */
    qs_real s = dot(e, b);
    b = vec(b.x - s * e.x, b.y - s * e.y, b.z - s * e.z);
    *radius = norm(b), *across = core->axes[1];
    if (*radius < LEAST_SQUARED) *radius = 0;
    else *across = over(b, *radius);
    return t;
}

/* ---- hulls: the rounds of Gilbert, Johnson and Keerthi for one point ---- */

static qs_vec vertex_of(const qs_obstacle *core, int i) {
    return subtract(from3(core->points[i]), core->center);
}

/* The vertex that is farthest along n, the first of equals. */
static qs_vec highest_vertex(const qs_obstacle *core, qs_vec n) {
    qs_vec best = vertex_of(core, 0);
    qs_real height = -INF;
    for (int i = 0; i < core->count; ++i) {
        qs_vec p = vertex_of(core, i);
        if (dot(n, p) > height) best = p, height = dot(n, p);
    }
    return best;
}

/* The point nearest to x so far, of the simplex of some vertices. */
typedef struct {
    qs_vec q, a, b, c;
    int count;
} face;

/* Whether p is nearer to x than q: |x - q|^2 - |x - p|^2 > 0, without the squares. */
static int is_nearer(qs_vec p, qs_vec q, qs_vec x) {
    return dot(subtract(p, q), add(subtract(x, p), subtract(x, q))) > 0;
}

static void take_face(face *f, qs_vec q, qs_vec a, qs_vec b, qs_vec c, int count) {
    f->q = q, f->a = a, f->b = b, f->c = c, f->count = count;
}

/* The edge from w to a, if it has a point nearer to x than the best face has. */
static void look_at_edge(face *best, qs_vec w, qs_vec a, qs_vec x) {
    qs_vec u = subtract(a, w);
    qs_real square = dot(u, u), t = dot(subtract(x, w), u);
    if (!(t > 0)) return;
    qs_vec q = t >= square ? a : combined(w, t / square, u);
    if (is_nearer(q, best->q, x)) take_face(best, q, w, a, a, 2);
}

/* The triangle of w, a and b, if its inside has one. */
static void look_at_triangle(face *best, qs_vec w, qs_vec a, qs_vec b, qs_vec x) {
    qs_vec u = subtract(a, w), v = subtract(b, w), y = subtract(x, w), swap = u;
    if (dot(v, v) > dot(u, u)) u = v, v = swap;
    qs_real square = dot(u, u), part = dot(v, u) / square;
    qs_vec across = combined(v, -part, u);
    qs_real width = dot(across, across), s = dot(y, across) / width, t = dot(y, u) / square - s * part;
    if (!(square > 0 && width > 0 && s > 0 && t > 0 && s + t < 1)) return;
    qs_vec q = add(w, add(scale(t, u), scale(s, v)));
    if (is_nearer(q, best->q, x)) take_face(best, q, w, a, b, 3);
}

/* In place of a face the one nearest to x of its simplex with w, with w. */
static void take_nearest_face(face *f, qs_vec w, qs_vec x) {
    face old = *f;
    take_face(f, w, w, w, w, 1);
    look_at_edge(f, w, old.a, x);
    if (old.count > 1) {
        look_at_edge(f, w, old.b, x);
        look_at_triangle(f, w, old.a, old.b, x);
    }
    if (old.count > 2) {
        look_at_edge(f, w, old.c, x);
        look_at_triangle(f, w, old.a, old.c, x);
        look_at_triangle(f, w, old.b, old.c, x);
    }
}

/* The point of a hull nearest to x, and x itself within. */
static qs_vec nearest_of_hull(const qs_obstacle *core, qs_vec x) {
    qs_vec q = highest_vertex(core, x);
    face f = {q, q, q, q, 1};
    for (int turn = 0; turn < HULL_ROUNDS; ++turn) {
        qs_vec p = subtract(x, q), w = highest_vertex(core, p);
        if (dot(p, subtract(w, q)) <= EITHER(1e-15, 1e-6) * norm(p) * core->half[0]) break;
        take_nearest_face(&f, w, x);
        if (!is_nearer(f.q, q, x)) break;
        q = f.q;
    }
    /* Unless a plane across the way separates them, x is within. */
    qs_vec p = subtract(x, q);
    qs_real beyond = dot(p, subtract(highest_vertex(core, p), q));
    return beyond <= EITHER(1e-9, 1e-4) * norm(p) * core->half[0] ? q : x;
}

/* ---- what is asked of a core ---- */

/* h(n); 0 for a half-space, which is asked along its normal only. */
static qs_real support_height(const qs_obstacle *core, qs_vec n) {
    const qs_real *l = core->half;
    qs_vec y = in_axes(core, n);
    switch (core->kind) {
    case QS_CAPSULE:
    case QS_CYLINDER: return l[0] * ABS(y.x) + l[1] * norm(cross(core->axes[0], n));
    case QS_BOX: return l[0] * ABS(y.x) + l[1] * ABS(y.y) + l[2] * ABS(y.z);
    case QS_HULL: return dot(highest_vertex(core, n), n);
    default: return 0;
    }
}

static qs_real clamp(qs_real x, qs_real most) { return least_of(most_of(x, -most), most); }

static qs_vec nearest_of_box(const qs_obstacle *core, qs_vec x) {
    const qs_real *l = core->half;
    qs_vec y = in_axes(core, x);
    if (ABS(y.x) <= l[0] && ABS(y.y) <= l[1] && ABS(y.z) <= l[2]) return x;
    return from_axes(core, vec(clamp(y.x, l[0]), clamp(y.y, l[1]), clamp(y.z, l[2])));
}

static qs_vec nearest_of_round(const qs_obstacle *core, qs_vec x) {
    qs_vec u;
    qs_real r, t = about_axis(core, x, &r, &u);
    if (ABS(t) <= core->half[0] && r <= core->half[1]) return x;
    return combined(scale(clamp(t, core->half[0]), core->axes[0]), least_of(r, core->half[1]), u);
}

/* The point of a core nearest to x, and x itself within. */
static qs_vec nearest_point(const qs_obstacle *core, qs_vec x) {
    switch (core ? core->kind : QS_SPHERE) {
    case QS_CAPSULE:
    case QS_CYLINDER: return nearest_of_round(core, x);
    case QS_BOX: return nearest_of_box(core, x);
    case QS_HULL: return nearest_of_hull(core, x);
    case QS_HALF_SPACE: return combined(x, -most_of(dot(core->axes[0], x), 0), core->axes[0]);
    default: return NOTHING;
    }
}

static qs_real from_center(qs_vec x, qs_vec *n) {
    qs_real R = norm(x);
    *n = R < LEAST_DISTANCE ? UP : over(x, R);
    return R;
}

static qs_real from_round(const qs_obstacle *core, qs_vec x, qs_vec *n) {
    qs_vec u;
    qs_real r, t = about_axis(core, x, &r, &u);
    qs_real end = ABS(t) - core->half[0], side = r - core->half[1], d = SQRT(end * end + side * side);
    qs_vec e = scale(COPYSIGN(1, t), core->axes[0]);
    if (end > 0 && side > 0 && d > LEAST_SQUARED) {
        *n = combined(scale(end / d, e), side / d, u);
        return d;
    }
    *n = end > side ? e : u;
    return end > side ? end : side;
}

static qs_real from_box(const qs_obstacle *core, qs_vec x, qs_vec *n) {
    qs_vec y = in_axes(core, x);
    qs_real a = ABS(y.x) - core->half[0], b = ABS(y.y) - core->half[1], c = ABS(y.z) - core->half[2];
    qs_vec out = vec(most_of(a, 0), most_of(b, 0), most_of(c, 0));
    qs_real d = norm(out);
    if (d < LEAST_SQUARED) {
        d = most_of(most_of(a, b), c);
        out = a == d ? vec(1, 0, 0) : b == d ? vec(0, 1, 0) : UP;
    } else out = over(out, d);
    *n = from_axes(core, vec(COPYSIGN(out.x, y.x), COPYSIGN(out.y, y.y), COPYSIGN(out.z, y.z)));
    return d;
}

/* Within a hull, of which no facets are known, the distance is 0 and away is from its middle. */
static qs_real from_hull(const qs_obstacle *core, qs_vec x, qs_vec *n) {
    qs_vec away = subtract(x, nearest_of_hull(core, x));
    qs_real d = norm(away);
    if (d <= EITHER(1e-14, 1e-6) * core->half[0] || d < LEAST_SQUARED) {
        from_center(x, n);
        return 0;
    }
    *n = over(away, d);
    return d;
}

/* Distance from a core, negative inside, and the unit vector away from it. */
static qs_real look_at(const qs_obstacle *core, qs_vec x, qs_vec *n) {
    switch (core ? core->kind : QS_SPHERE) {
    case QS_CAPSULE:
    case QS_CYLINDER: return from_round(core, x, n);
    case QS_BOX: return from_box(core, x, n);
    case QS_HULL: return from_hull(core, x, n);
    case QS_HALF_SPACE: *n = core->axes[0]; return dot(*n, x);
    default: return from_center(x, n);
    }
}

static qs_real distance_from(const qs_obstacle *core, qs_vec gap) {
    qs_vec n;
    return look_at(core, gap, &n);
}

/* A direction away from a core, of any length. */
static qs_vec outward(const qs_obstacle *core, qs_vec gap) {
    qs_vec n = gap;
    if (core) look_at(core, gap, &n);
    return n;
}

/* A direction that the body allows: a half-space has its normal alone. */
static qs_vec facing(const qs_obstacle *core, qs_vec n) {
    return core && core->kind == QS_HALF_SPACE ? core->axes[0] : n;
}

/* rho + h(n) of (V1). */
static qs_real raised(const qs_obstacle *core, qs_vec n, qs_real distance) {
    return core ? distance + support_height(core, n) : distance;
}

/* Whether a point that moves on from a gap along a velocity keeps that distance for ever. A plane stands across
 * the way from the core to the ray, and does not lean against it. */
static int stays_away(const qs_obstacle *core, qs_vec gap, qs_vec closing, qs_real keep) {
    qs_real speed = dot(closing, closing);
    if (!core && speed > 0) gap = combined(gap, most_of(0, -dot(gap, closing) / speed), closing);
    if (!core || !(speed > 0)) return distance_from(core, gap) >= keep;
    qs_vec nearest = nearest_point(core, gap);
    for (int turn = 0; turn < PLANE_ROUNDS; ++turn) {
        qs_vec way = subtract(gap, nearest);
        way = combined(way, most_of(0, -dot(way, closing) / speed), closing);
        qs_vec n = facing(core, combined(way, -least_of(dot(way, closing), 0) / speed, closing));
        qs_real length = norm(n);
        int is_upright = dot(n, closing) >= -UPRIGHT * length * norm(closing);
        if (is_upright && length > 0 && dot(n, gap) >= raised(core, n, keep * length)) return 1;
        nearest = nearest_point(core, add(nearest, way));
    }
    return 0;
}

#endif
