/* The plant of the page "Try to crash it": vehicles as chains of four integrators under held snaps, among shapes,
 * each behind a shield of its own or none. Its distances are written for it, and share nothing with the shield's.
 * Functions of plain numbers, for JavaScript; c/page/shield_script.py compiles it.
 */
#include <math.h>
#include <stddef.h>

#include "quadsafe.h"

#define EXPORT(name) __attribute__((export_name(#name))) name

enum { VEHICLES = 2, PARTS = 5, POINTS = 128, STOP_PERIODS = 512 };
static const qs_real PERIOD = 0.01;       /* s, of control; a collision is looked for after each of its PARTS */
static const qs_real VELOCITY_POLE = 6.0; /* rad/s, three of them, as in quadsafe_env/vehicle/actions.py */

typedef struct {
    int kind;
    qs_real point[3], axes[3][3], half[3], radius; /* half: of a box; half[0] of a capsule, cylinder; offset */
} shape;

/* What JavaScript reads, and behind it what it does not. */
typedef struct {
    qs_real flat[4][3], wanted[3], snap[3], correction, clearance, nearest, certified;
    qs_shield shield;
} vehicle;

static qs_real numbers[16], points[POINTS][3], radius_of_vehicle;
static shape shapes[QS_MAX_OBSTACLES];
static qs_obstacle bodies[QS_MAX_OBSTACLES];
static int count;
static vehicle fleet[VEHICLES];

qs_real *EXPORT(input)(void) { return numbers; }
qs_real *EXPORT(report)(int i) { return fleet[i].flat[0]; }
qs_real *EXPORT(line)(void) { return points[0]; }

/* ---- shapes ---- */

void EXPORT(clear)(qs_real radius) { count = 0, radius_of_vehicle = radius; }

static qs_obstacle body_of(int kind) {
    const qs_real *n = numbers;
    if (kind == QS_SPHERE) return qs_sphere(n, n[3], NULL);
    if (kind == QS_CAPSULE) return qs_capsule(n, n + 3, n[6], NULL);
    if (kind == QS_CYLINDER) return qs_cylinder(n, n + 3, n[6], NULL);
    if (kind == QS_BOX) return qs_box(n, n + 3, n + 6, NULL);
    return qs_half_space(n, n[3]);
}

static void take_segment(shape *s, const qs_real *start, const qs_real *end) {
    qs_real along[3], length = 0;
    for (int i = 0; i < 3; ++i) along[i] = end[i] - start[i], length += along[i] * along[i];
    length = sqrt(length);
    for (int i = 0; i < 3; ++i) {
        s->point[i] = start[i] + along[i] / 2;
        s->axes[0][i] = length > 0 ? along[i] / length : i == 0;
    }
    s->half[0] = length / 2;
}

static shape shape_of(int kind) {
    const qs_real *n = numbers;
    shape s = {0};
    s.kind = kind, s.radius = kind == QS_SPHERE ? n[3] : n[6];
    if (kind == QS_CAPSULE || kind == QS_CYLINDER) take_segment(&s, n, n + 3);
    for (int i = 0; i < 3; ++i) {
        if (kind == QS_SPHERE || kind == QS_BOX) s.point[i] = n[i];
        if (kind == QS_HALF_SPACE) s.axes[0][i] = n[i];
        for (int axis = 0; kind == QS_BOX && axis < 3; ++axis) s.axes[axis][i] = n[6 + 3 * i + axis];
        if (kind == QS_BOX) s.half[i] = n[3 + i] / 2;
    }
    if (kind == QS_HALF_SPACE) s.half[0] = n[3];
    return s;
}

/* Take over a shape from the input; 0 where there is no place, or the shield refuses it. */
int EXPORT(add)(int kind) {
    if (count == QS_MAX_OBSTACLES) return 0;
    shapes[count] = shape_of(kind), bodies[count] = body_of(kind);
    bodies[count].radius += radius_of_vehicle;
    return bodies[count++].kind != QS_INVALID;
}

/* ---- distances ---- */

static qs_real dot(const qs_real a[3], const qs_real b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* Of what lies q outside of each pair of faces. */
static qs_real off_faces(const qs_real q[3], int faces) {
    qs_real out = 0, most = q[0];
    for (int i = 0; i < faces; ++i) {
        most = fmax(most, q[i]);
        out += fmax(q[i], 0) * fmax(q[i], 0);
    }
    return most > 0 ? sqrt(out) : most;
}

/* Signed, m, of a point from a shape. */
qs_real EXPORT(distance)(int k, qs_real x, qs_real y, qs_real z) {
    const shape *s = &shapes[k];
    const qs_real r[3] = {x, y, z}, gap[3] = {x - s->point[0], y - s->point[1], z - s->point[2]};
    qs_real across[3], q[3], along = dot(gap, s->axes[0]);
    if (s->kind == QS_SPHERE) return sqrt(dot(gap, gap)) - s->radius;
    if (s->kind == QS_HALF_SPACE) return dot(s->axes[0], r) - s->half[0];
    if (s->kind == QS_BOX) {
        for (int i = 0; i < 3; ++i) q[i] = fabs(dot(gap, s->axes[i])) - s->half[i];
        return off_faces(q, 3);
    }
    for (int i = 0; i < 3; ++i) across[i] = gap[i] - along * s->axes[0][i];
    q[0] = fabs(along) - s->half[0], q[1] = sqrt(dot(across, across));
    if (s->kind == QS_CAPSULE) return hypot(fmax(q[0], 0), q[1]) - s->radius;
    q[1] -= s->radius;
    return off_faces(q, 2);
}

static void measure(vehicle *x) {
    for (int k = 0; k < count; ++k) {
        qs_real gap = distance(k, x->flat[0][0], x->flat[0][1], x->flat[0][2]) - radius_of_vehicle;
        if (gap < x->clearance) x->clearance = gap, x->nearest = k;
    }
}

/* ---- vehicles ---- */

static void fly(qs_real flat[4][3], const qs_real s[3], qs_real t) {
    for (int i = 0; i < 3; ++i) {
        qs_real v = flat[1][i], a = flat[2][i], j = flat[3][i];
        flat[0][i] += t * (v + t / 2 * (a + t / 3 * (j + t / 4 * s[i])));
        flat[1][i] += t * (a + t / 2 * (j + t / 3 * s[i]));
        flat[2][i] += t * (j + t / 2 * s[i]);
        flat[3][i] += t * s[i];
    }
}

/* The shield of a vehicle begins anew. */
void EXPORT(forget)(int i) {
    qs_settings settings;
    qs_defaults(&settings);
    qs_init(&fleet[i].shield, &settings);
    fleet[i].certified = 0;
}

/* Put a vehicle down at rest. */
void EXPORT(place)(int i, qs_real x, qs_real y, qs_real z) {
    static const vehicle none = {0};
    fleet[i] = none;
    fleet[i].flat[0][0] = x, fleet[i].flat[0][1] = y, fleet[i].flat[0][2] = z;
    fleet[i].clearance = INFINITY;
    measure(&fleet[i]);
    forget(i);
}

/* Put a vehicle where another is, with its memory. */
void EXPORT(join)(int i, int other) { fleet[i] = fleet[other]; }

/* One control period with a velocity command; 1 if the vehicle was in a shape after any part of it. */
int EXPORT(step)(int i, qs_real vx, qs_real vy, qs_real vz, int is_shielded) {
    vehicle *x = &fleet[i];
    const qs_real command[3] = {vx, vy, vz}, p = VELOCITY_POLE;
    for (int n = 0; n < 3; ++n) {
        x->wanted[n] = p * (p * (p * (command[n] - x->flat[1][n]) - 3 * x->flat[2][n]) - 3 * x->flat[3][n]);
        x->snap[n] = x->wanted[n];
    }
    x->correction = 0, x->clearance = INFINITY;
    if (is_shielded) {
        qs_answer answer;
        qs_filter(&x->shield, (const qs_real(*)[3])x->flat, bodies, count, x->wanted, PERIOD, &answer);
        for (int n = 0; n < 3; ++n) x->snap[n] = answer.snap[n];
        x->correction = answer.correction, x->certified = answer.certified;
    }
    for (int part = 0; part < PARTS; ++part) {
        fly(x->flat, x->snap, PERIOD / PARTS);
        measure(x);
    }
    return x->clearance < 0;
}

static int is_at_rest(const vehicle *x) {
    return dot(x->flat[1], x->flat[1]) < 1e-4 && dot(x->flat[2], x->flat[2]) < 1e-2;
}

/* The points of the stop that a shield has stored; how many. A copy of it flies it: told of a count of shapes that
 * there cannot be, it answers with the stop and the feedback onto it.
 */
int EXPORT(stop)(int i) {
    vehicle x = fleet[i];
    qs_answer answer;
    int n = 0, every = STOP_PERIODS / POINTS;
    for (int period = 0; period < STOP_PERIODS; ++period) {
        if (period % every == 0) {
            for (int axis = 0; axis < 3; ++axis) points[n][axis] = x.flat[0][axis];
            ++n;
        }
        qs_filter(&x.shield, (const qs_real(*)[3])x.flat, bodies, -1, x.wanted, PERIOD, &answer);
        if (!answer.stopped) return 0;
        fly(x.flat, answer.snap, PERIOD);
        if (n > 1 && is_at_rest(&x)) return n;
    }
    return n;
}
