/* Numbers in the precision of qs_real, three-vectors, and real roots (quadsafe_core.maths.polynomials). */
#ifndef QS_NUMBERS_H
#define QS_NUMBERS_H

#include "quadsafe.h"

#include <float.h>
#include <math.h>
#include <stdint.h>
#include <string.h>

/* A number that is no whole one, in the precision of qs_real, and one that differs between the two. */
#define Q(x) ((qs_real)(x))
#ifdef QS_FLOAT
#define EITHER(in_double, in_float) ((qs_real)in_float)
#define OF_REAL(function) function##f
#define LARGEST FLT_MAX
#else
#define EITHER(in_double, in_float) ((qs_real)in_double)
#define OF_REAL(function) function
#define LARGEST DBL_MAX
#endif
#define SQRT OF_REAL(sqrt)
#define ABS OF_REAL(fabs)
#define RINT OF_REAL(rint)
#define COPYSIGN OF_REAL(copysign)
#define INF ((qs_real)INFINITY)
#define ABSENT ((qs_real)NAN)
#define FOUR_EPS EITHER(8.9e-16, 4.8e-7) /* four times the distance from 1 to the next number */
#define TOO_FAR EITHER(1e30, 1e6)        /* SI: the sixth power of what is asked about fits a number */
#define LEAST_DISTANCE Q(1e-6)           /* m: nearer to a centre the direction from it is world z */
#define JUST_INSIDE (1 - EITHER(1e-12, 1e-6))

/* Python's min and max: the first of equals, and of what cannot be compared. */
static qs_real least_of(qs_real a, qs_real b) { return b < a ? b : a; }
static qs_real most_of(qs_real a, qs_real b) { return b > a ? b : a; }
static qs_real cubed(qs_real a) { return a * (a * a); }
static qs_real squared(qs_real a) { return a * a; }

static qs_vec vec(qs_real x, qs_real y, qs_real z) {
    qs_vec a = {x, y, z};
    return a;
}
static qs_vec from3(const qs_real a[3]) { return vec(a[0], a[1], a[2]); }
static void write3(qs_real to[3], qs_vec a) { to[0] = a.x, to[1] = a.y, to[2] = a.z; }
static qs_vec add(qs_vec a, qs_vec b) { return vec(a.x + b.x, a.y + b.y, a.z + b.z); }
static qs_vec subtract(qs_vec a, qs_vec b) { return vec(a.x - b.x, a.y - b.y, a.z - b.z); }
static qs_vec scale(qs_real s, qs_vec a) { return vec(s * a.x, s * a.y, s * a.z); }
static qs_vec over(qs_vec a, qs_real s) { return vec(a.x / s, a.y / s, a.z / s); }
/* a + s b */
static qs_vec combined(qs_vec a, qs_real s, qs_vec b) {
    return vec(a.x + s * b.x, a.y + s * b.y, a.z + s * b.z);
}
static qs_real dot(qs_vec a, qs_vec b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
static qs_real norm(qs_vec a) { return SQRT(dot(a, a)); }
static qs_vec cross(qs_vec a, qs_vec b) {
    return vec(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}
static int is_same(qs_vec a, qs_vec b) { return a.x == b.x && a.y == b.y && a.z == b.z; }
static int is_below(qs_vec a, qs_real most) { return ABS(a.x) < most && ABS(a.y) < most && ABS(a.z) < most; }
static int is_finite(qs_vec a) { return is_below(a, INF); }
static qs_real reach_of(qs_vec a) { return ABS(a.x) + ABS(a.y) + ABS(a.z); }
static const qs_vec NOTHING = {0, 0, 0};
static const qs_vec UP = {0, 0, 1};

/* ---- roots: real ones, ascending, NaN for absent ones ---- */

typedef struct {
    qs_real t[3];
} roots;
typedef struct {
    qs_real value, time;
} lowest;

static roots roots_of(qs_real low, qs_real high) {
    roots r = {{low, high, ABSENT}};
    return r;
}

/* Of a t^2 + b t + c; a may be 0. */
static roots quadratic_roots(qs_real a, qs_real b, qs_real c) {
    qs_real half = -(b / 2), size = squared(half) + ABS(a * c);
    if (half == 0 && (a == 0 || c == 0)) return a == 0 ? roots_of(ABSENT, ABSENT) : roots_of(0, 0);
    qs_real discriminant = squared(half) - a * c;
    if (discriminant < -FOUR_EPS * size) return roots_of(ABSENT, ABSENT);
    qs_real z = half + COPYSIGN(SQRT(most_of(discriminant, 0)), half), near = c / z;
    if (a == 0) return roots_of(near, ABSENT);
    /* A root beyond the range of numbers becomes the largest, so that it is never lost. */
    qs_real far = least_of(most_of(z / a, -LARGEST), LARGEST);
    return roots_of(least_of(near, far), most_of(near, far));
}

/* The real root of s^3 + 3 P s + 2 R that is never one of a close pair, by Cardano and Viete. */
static qs_real isolated_root(qs_real P, qs_real R) {
    qs_real discriminant = R * R + cubed(P);
    if (discriminant < 0) {
        qs_real w = SQRT(-P), cosine = least_of(ABS(R) / (w * w * w), 1);
        return COPYSIGN(2 * w * OF_REAL(cos)(OF_REAL(acos)(cosine) / 3), -R);
    }
    qs_real w = OF_REAL(cbrt)(ABS(R) + SQRT(discriminant));
    if (w == 0) return 0;
    qs_real v = P / w;
    return COPYSIGN(P < 0 ? w - v : 2 * ABS(R) / (w * w + P + v * v), -R);
}

/* Three roots ascending, from one and an ascending pair that may be absent. */
static roots inserted(qs_real root, roots two) {
    qs_real low = two.t[0], high = two.t[1];
    if (!(low <= high)) return roots_of(root, ABSENT);
    roots r = {{least_of(root, low), most_of(low, least_of(root, high)), most_of(root, high)}};
    return r;
}

/* Of a t^3 + b t^2 + c t + d; a may be 0. */
static roots cubic_roots(qs_real a, qs_real b, qs_real c, qs_real d) {
    if (a == 0) return quadratic_roots(b, c, d);
    qs_real B = b / (3 * a), C = c / (3 * a), D = d / (2 * a), P = C - B * B;
    qs_real s = isolated_root(P, B * B * B - Q(1.5) * B * C + D), root = s - B;
    if (s * B > 0 && ABS(B) > ABS(s) / 2) {
        /* s - B cancels, the other two roots do not: the third follows from the product of all. */
        qs_real product = B * B + s * B + (s * s + 3 * P);
        return inserted(-2 * D / product, quadratic_roots(1, 2 * B + s, product));
    }
    if (P > 0) return roots_of(root, ABSENT);
    if (root == 0) {
        roots none = {{0, 0, 0}};
        return none;
    }
    /* What remains is divided from the low end: this keeps roots that are small against this one. */
    return inserted(root, quadratic_roots(-a * root, c + d / root, d));
}

/* p[0] t^4 + ... + p[4] and the sum of the sizes of its terms. */
static qs_real evaluate(const qs_real p[5], qs_real t, qs_real *size) {
    qs_real value = p[0];
    *size = ABS(p[0]);
    for (int i = 1; i < 5; ++i) {
        value = value * t + p[i];
        *size = *size * ABS(t) + ABS(p[i]);
    }
    return value;
}

/* The lower of a rise so far and that of p[0] t^4 + ... + p[3] t; within rounding the later time counts. */
static lowest better(const qs_real p[4], qs_real t, lowest found) {
    qs_real rise = 0, size = 0;
    if (!(t > 0)) return found;
    for (int i = 0; i < 4; ++i) {
        rise = (rise + p[i]) * t;
        size = (size + ABS(p[i])) * t;
    }
    if (rise <= found.value + FOUR_EPS * size) found.value = least_of(rise, found.value), found.time = t;
    return found;
}

#endif
