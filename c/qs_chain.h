/* The chain y'''' = u above a bound (shields.chains.lower_bound, shields.filters.sampled)
 *
 *     g_4(x) = min over t >= 0 of [flow(x, u_max, t)]_4 - bound                                          (8)
 *     G(U) >= (1 - gamma) g_4(x)      G: the same, with U held for a period and u_max ever after
 *
 * A state x is (x_1, ..., x_4) = (y''', y'', y', y). The speed is a cubic in t; with s = t + B it is
 * s^3 + X s = +-Y, and of its roots the isolated one, m, is found from the bits of X and Y.
 */
#ifndef QS_CHAIN_H
#define QS_CHAIN_H

#include "qs_numbers.h"

typedef struct {
    qs_real least, value;
    int is_admissible;
} required;

#ifdef QS_FLOAT
typedef int32_t bits_t;
#define OCTAVE Q(8388608.0)
#define ONE (127 * OCTAVE)
#else
typedef int64_t bits_t;
#define OCTAVE 4503599627370496.0
#define ONE (1023 * OCTAVE)
#endif
/* Asymptotes of m, of the roots of m^3 + X m = Y, in octaves. */
#define CUBE_ABOVE (ONE * 2 / 3 + Q(0.2299) * OCTAVE)
#define ROOT_ABOVE (ONE / 2 + Q(0.1557) * OCTAVE)
#define CUBE_BELOW (ONE * 2 / 3 - Q(0.1695) * OCTAVE)
#define RATIO_BELOW (ONE - Q(0.8526) * OCTAVE)
#define TINY (ONE - 100 * OCTAVE)
/* Choices closer than this share of m are left to the careful way. */
#define DOUBT Q(2e-3)

static qs_real bits_of(qs_real x) {
    bits_t i;
    memcpy(&i, &x, sizeof i);
    return (qs_real)i;
}

static qs_real of_bits(qs_real bits) {
    bits_t i = (bits_t)bits;
    qs_real x;
    memcpy(&x, &i, sizeof x);
    return x;
}

static qs_real larger(qs_real a, qs_real b) { return a > b ? a : b; }
static qs_real smaller(qs_real a, qs_real b) { return a < b ? a : b; }

/* The positive root of m^3 + X m = Y to within 5e-5: the nearer asymptote, one step of Halley, one of Newton. */
static qs_real isolated(qs_real X, qs_real Y) {
    qs_real x = bits_of(ABS(X)), y = bits_of(Y), cube = y * Q(1.0 / 3.0);
    qs_real above = larger(cube + CUBE_ABOVE, x / 2 + ROOT_ABOVE);
    qs_real below = smaller(cube + CUBE_BELOW, y - x + RATIO_BELOW);
    qs_real m = of_bits(larger(X < 0 ? above : below, TINY)), m2 = m * m;
    m = (m2 * (m * (3 * m2 - X) + 6 * Y) + X * Y) / (m2 * (6 * m2 + 3 * X) + X * X + 3 * Y * m);
    m2 = m * m;
    return (2 * m * m2 + Y) / (3 * m2 + X);
}

typedef struct {
    qs_real t;
    int is_largest, is_sure;
} stationary;

/* The stationary time that may be t_star, whether it may be higher than now, and whether that is sure. */
static stationary stationary_of(qs_real x1, qs_real x2, qs_real x3, qs_real u_max) {
    qs_real inverse = 1 / u_max, B = x1 * inverse, C = 2 * x2 * inverse, D = 3 * x3 * inverse;
    qs_real X = 3 * (C - B * B), R = B * (B * B - Q(1.5) * C) + D;
    qs_real tie = FOUR_EPS * (ABS(B) * (B * B + Q(1.5) * ABS(C)) + ABS(D));
    qs_real m = isolated(X, 2 * ABS(R)), first = COPYSIGN(m, tie - R) - B;
    qs_real square = Q(-0.75) * m * m - X;
    stationary s;
    s.is_largest = first < 0 && tie < R && square > 0;
    qs_real t = s.is_largest ? m / 2 + SQRT(square) - B : first;
    s.is_sure = smaller(ABS(first), ABS(t)) > DOUBT * m && ABS(square) > DOUBT * m * m;
    s.is_sure = s.is_sure && m > EITHER(1e-25, 1e-7) && u_max > EITHER(1e-200, 1e-25);
    qs_real bend = 3 * (t + B), slope = (bend + 3 * B) * t + 3 * C;
    qs_real speed = ((t + 3 * B) * t + 3 * C) * t + 2 * D;
    qs_real step = speed * slope / (slope * slope - speed * bend);
    s.is_sure = s.is_sure && ABS(step) <= DOUBT * smaller(ABS(t), m);
    s.t = t - step;
    return s;
}

/* Whatever the magnitudes. */
static lowest careful_lower4(qs_real x1, qs_real x2, qs_real x3, qs_real x4, qs_real u_max) {
    qs_real p[4] = {u_max / 24, x1 / 6, x2 / 2, x3};
    roots found_at = cubic_roots(u_max / 6, x1 / 2, x2, x3);
    lowest found = {0, 0};
    found = better(p, found_at.t[0], found);
    found = better(p, found_at.t[2], found);
    found.value = x4 + found.value;
    return found;
}

static lowest lower4(qs_real x1, qs_real x2, qs_real x3, qs_real x4, qs_real u_max) {
    lowest found = {x4, 0};
    if (x1 >= 0 && x2 >= 0 && x3 >= 0) return found;
    stationary s = stationary_of(x1, x2, x3, u_max);
    qs_real a = u_max * Q(1.0 / 24.0), b = x1 * Q(1.0 / 6.0), c = x2 / 2;
    qs_real rise = (((a * s.t + b) * s.t + c) * s.t + x3) * s.t;
    int is_now = s.t < 0 || (s.is_largest && rise > 0);
    found.value = x4 + (is_now ? 0 : smaller(rise, 0));
    if (!(s.is_sure && ABS(found.value) <= LARGEST)) return careful_lower4(x1, x2, x3, x4, u_max);
    found.time = is_now ? 0 : s.t;
    return found;
}

/* ---- a held input: y holds the derivatives of x_4 from the fourth down ---- */

/* Error of a value in units of its largest terms. */
#define ROUNDING EITHER(4e-15, 2e-6)
/* Down to this share of its largest terms a negative g_4 counts as 0: states drift that far. */
#define DRIFT EITHER(1e-12, 2e-6)
/* From far below Newton gains a factor 4/3 a step where the time of the least x_4 jumps. */
enum { ITERATIONS = 60, ROUNDS = 10 };

typedef struct {
    qs_real y[5], p[5];
    qs_real period, u_max;
} chain;

static void derivatives(const qs_real x[4], qs_real u, qs_real y[5]) {
    y[0] = u, y[1] = x[0], y[2] = x[1], y[3] = x[2], y[4] = x[3];
}

static void polynomial(const qs_real y[5], qs_real p[5]) {
    p[0] = y[0] * Q(1.0 / 24.0), p[1] = y[1] * Q(1.0 / 6.0), p[2] = y[2] / 2, p[3] = y[3], p[4] = y[4];
}

/* From the derivatives and their polynomial. */
static void state_after(const qs_real y[5], const qs_real p[5], qs_real t, qs_real x[4]) {
    x[0] = y[1] + t * y[0];
    x[1] = y[2] + t * (y[1] + t * (y[0] / 2));
    x[2] = y[3] + t * (y[2] + t * (y[1] / 2 + t * (4 * p[0])));
    x[3] = y[4] + t * (y[3] + t * (p[2] + t * (p[1] + t * p[0])));
}

/* How much of every coordinate after a period is due to one unit of the input held for it. */
static void lift_after(qs_real period, qs_real y[5]) {
    qs_real a = Q(1.0 / 24.0);
    y[0] = 0;
    y[1] = period * (24 * a);
    y[2] = period * (period * (12 * a));
    y[3] = period * (period * (period * (4 * a)));
    y[4] = period * (period * (period * (period * a)));
}

/* Sum of the sizes of the terms of x_4(t). */
static qs_real size_of_terms(const qs_real p[5], qs_real t) {
    return (((ABS(p[0]) * t + ABS(p[1])) * t + ABS(p[2])) * t + ABS(p[3])) * t + ABS(p[4]);
}

/* Whether the Bernstein coefficients of the speed allow it to turn from negative to positive. */
static int may_dip(const qs_real y[5], qs_real period) {
    qs_real a = y[2] * period / 3, b = y[1] * period * period / 6, c = y[0] * period * period * period / 6;
    qs_real first = y[3] + a, second = y[3] + 2 * a + b, third = y[3] + 3 * a + 3 * b + c;
    return (y[3] < 0 && most_of(most_of(first, second), third) > 0) ||
           (first < 0 && most_of(second, third) > 0) || (second < 0 && third > 0);
}

/* Whether the Bernstein coefficients of x_4 over a period, but the last, are at or above a level. */
static int stays_above(const qs_real y[5], qs_real period, qs_real level) {
    qs_real p[5];
    polynomial(y, p);
    qs_real a = period / 4 * p[3], b = period * period * p[2] * Q(1.0 / 6.0),
            c = period / 4 * period * period * p[1];
    return y[4] + least_of(least_of(least_of(0, a), 2 * a + b), 3 * (a + b) + c) >= level;
}

/* Least x_4 over the period but its end. */
static lowest lowest_in_period(const qs_real y[5], const qs_real p[5], qs_real period) {
    lowest found = {y[4], 0};
    if (!may_dip(y, period)) return found;
    qs_real size;
    roots found_at = cubic_roots(4 * p[0], 3 * p[1], 2 * p[2], p[3]);
    for (int i = 0; i < 3; ++i) {
        qs_real t = found_at.t[i];
        if (0 < t && t < period) {
            qs_real value = evaluate(p, t, &size);
            if (value <= found.value) found.value = value, found.time = t;
        }
    }
    return found;
}

/* w(t), the slope of x_4(t) over U. */
static qs_real weight(qs_real t, qs_real period) {
    qs_real held = least_of(t, period), rest = most_of(t - period, 0);
    return held * (t + rest) * (t * t + rest * rest) / 24;
}

/* Whether no x_4 before, after or at the time t of the state is below 0. */
static int is_above(qs_real x4, qs_real x3, qs_real x2, qs_real x1, qs_real u_max, qs_real t) {
    if (!(x4 >= 0)) return 0;
    int is_late = t > 0 || x3 < 0;
    qs_real early = x2 / 2 - t * (4 * x1 - u_max * t) * Q(1.0 / 24.0);
    if (2 * x1 >= u_max * t && is_late) return early >= 0 && 4 * early * x4 >= x3 * x3;
    qs_real unit = u_max > 0 ? u_max : 1;
    qs_real least = 2 * x1 >= u_max * t ? early : x2 / 2 - x1 * x1 / (6 * unit);
    if (is_late) return least >= 0 && 4 * least * x4 >= x3 * x3;
    /* Where it rises, the bracket is below 0 up to this time only. */
    qs_real ahead = 2 * (SQRT(most_of(x1 * x1 - 3 * u_max * x2, 0)) - x1) / unit;
    return least >= 0 || (u_max != 0 && x4 + ahead * (x3 + least * ahead) >= 0);
}

/* ---- the sampled filter ---- */

/* Newton for the input and the time at which its tail touches the target; whether that is certain.
 * No admissible input lies between lowest and the answer, certain or not. */
static qs_real touching(const chain *c, qs_real t_star, qs_real target, qs_real lowest, qs_real highest,
                        int *is_certain) {
    qs_real lift[5], rise[5], most[4], slope[4], u = lowest, t = most_of(t_star, c->period);
    lift_after(c->period, lift);
    polynomial(lift, rise);
    *is_certain = 1;
    for (int round = 0; round < ROUNDS; ++round) {
        qs_real u_before = u, t_before = t;
        state_after(c->y, c->p, t, most);
        state_after(lift, rise, t - c->period, slope);
        qs_real noise = ROUNDING * size_of_terms(c->p, t), room = most[3] - target;
        if (room + noise < (c->u_max - u) * slope[3]) {
            u = c->u_max - (room - 2 * noise) / slope[3];
            u += ROUNDING * ABS(u);
            if (u >= highest) return highest;
        }
        qs_real lack = c->u_max - u, speed = most[2] - lack * slope[2], bend = most[1] - lack * slope[1];
        room -= lack * slope[3] + noise;
        if (is_above(room, speed, bend, most[0] - lack * slope[0], c->u_max, t - c->period)) return u;
        if (!(bend > 0)) break;
        t = most_of(c->period, t - speed / bend);
        if (t == t_before && u == u_before) break; /* every further round would be this one */
    }
    *is_certain = 0;
    return u;
}

/* A bound on the input from times t, 2t, 4t, ... as long as they raise it. */
static qs_real needed_later(const chain *c, qs_real t, qs_real target) {
    qs_real best = -INF, size;
    for (int i = 0; i < ITERATIONS; ++i) {
        qs_real value = evaluate(c->p, t, &size);
        qs_real needed = c->u_max - (value - target + ROUNDING * size) / weight(t, c->period);
        if (!(needed > best)) break;
        best = needed;
        t = 2 * t;
    }
    return best;
}

/* Rise of U that lifts x_4(t) by what is missing and a rounding. */
static qs_real rise_to(const chain *c, qs_real t, qs_real u, qs_real missing) {
    if (missing <= 0) return 0;
    return (missing + ROUNDING * size_of_terms(c->p, t)) / weight(t, c->period) + ROUNDING * ABS(u);
}

/* The input itself where dip and tail reach their targets, otherwise Newton's next; u_max ends a dip. */
static qs_real newton(const chain *c, qs_real u, qs_real dip_target, qs_real tail_target) {
    qs_real y[5], p[5], end[4];
    memcpy(y, c->y, sizeof y);
    y[0] = u;
    polynomial(y, p);
    lowest dip = lowest_in_period(y, p, c->period);
    state_after(y, p, c->period, end);
    lowest tail = lower4(end[0], end[1], end[2], end[3], c->u_max);
    qs_real dip_rise = rise_to(c, dip.time, u, dip_target - dip.value);
    qs_real tail_rise = rise_to(c, c->period + tail.time, u, tail_target - tail.value);
    return most_of(u + tail_rise, least_of(u + dip_rise, c->u_max));
}

static qs_real least_input(const chain *c, qs_real t, qs_real dip_target, qs_real tail_target, qs_real u,
                           qs_real highest) {
    for (int k = 0; k < ITERATIONS; ++k) {
        qs_real last = u;
        u = newton(c, u, dip_target, tail_target);
        if (u == last) return u;
        if (k == 0) u = most_of(u, needed_later(c, t, tail_target));
        if (!(u < highest)) break;
    }
    return highest;
}

/* Least held input from the wanted one up that the filter admits, g_4, and whether x is in the set. */
static required required4(const qs_real x[4], qs_real bound, qs_real wanted, qs_real gamma,
                          const qs_rules *rules) {
    qs_real above[4] = {x[0], x[1], x[2], x[3] - bound}, drift = DRIFT * (ABS(x[3]) + ABS(bound));
    chain c;
    c.period = rules->period, c.u_max = rules->u_max;
    derivatives(above, c.u_max, c.y);
    polynomial(c.y, c.p);
    lowest g = lower4(above[0], above[1], above[2], above[3], c.u_max);
    required found = {wanted, g.value, 0};
    found.is_admissible = g.value >= -(drift + DRIFT * size_of_terms(c.p, g.time));
    qs_real decayed = (1 - gamma) * g.value, dip_target = g.value >= 0 ? decayed : g.value;
    qs_real tail_target = found.is_admissible ? dip_target : decayed;
    qs_real highest = found.is_admissible ? c.u_max : rules->input_max;
    if (wanted >= highest) return found;
    int is_certain;
    qs_real u = touching(&c, g.time, tail_target, wanted, highest, &is_certain);
    qs_real noise = ROUNDING * size_of_terms(c.p, c.period), held[5];
    derivatives(above, u, held);
    if (!(is_certain && (u == highest || stays_above(held, c.period, dip_target + noise))))
        u = least_input(&c, most_of(g.time, c.period), dip_target, tail_target, u, highest);
    found.least = u;
    return found;
}

/* ---- easing: how a vehicle comes to rest at the border, (E1) and (E2) ---- */

/* In units of u_max: how far below 0 a z_i may be by errors; where the law is asked, and where it alone is;
 * the least input at the border. Of the margin around a radius, the share that may be used up there. */
#define SLACK Q(0.1)
#define REACH 20
#define BORDER 1
#define LET_GO Q(-0.2)
#define SHARE Q(0.25)
#define BORDER_ROUNDING EITHER(1e-9, 1e-6)

/* (E1) */
static qs_real easing_input(const qs_real x[4], const qs_rules *rules) {
    const qs_real *k = rules->easing;
    return -(k[0] * x[3] + k[1] * x[2] + k[2] * x[1] + k[3] * x[0]);
}

/* c.x of the chain held for t. */
static qs_real flat_output(const qs_real x[4], qs_real t) {
    return x[3] - t * (Q(1.5) * x[2] - t * (Q(11.0 / 12.0) * x[1] - t / 4 * x[0]));
}

/* Whether z_0, ..., z_3 of (E2) are within these bounds. */
static int is_in_cone(const qs_real x[4], qs_real least, qs_real most, const qs_rules *rules) {
    qs_real t = rules->period, share = t / rules->easing_left, y[4];
    memcpy(y, x, sizeof y);
    for (int i = 0; i < 4; ++i) {
        qs_real z = rules->easing[0] * flat_output(y, t);
        if (!(least <= z && z <= most)) return 0;
        y[3] = y[3] + share * (y[2] + t / 2 * (y[1] + t / 3 * y[0]));
        y[2] = y[2] + share * (y[1] + t / 2 * y[0]);
        y[1] = y[1] + share * y[0];
    }
    return 1;
}

/* A vehicle that all but rests at the border: the law of the easing, and in the set. */
static required at_the_border(const qs_real x[4], const qs_real above[4], qs_real distance,
                              const qs_real *spare, qs_real wish, const qs_rules *rules) {
    qs_real law = least_of(easing_input(above, rules), rules->u_max);
    qs_real kept =
        spare ? distance - SHARE * *spare - BORDER_ROUNDING : rules->easing_within * distance - BORDER_ROUNDING;
    qs_real wanted = most_of(most_of(wish, law), LET_GO * rules->u_max);
    required found = required4(x, kept, wanted, 1, rules);
    found.value -= distance - kept;
    return found;
}

/* required4 that lets a slow vehicle come to rest at the border; spare: NULL in a world of spheres alone. */
static required eased(const qs_real x[4], qs_real distance, const qs_real *spare, qs_real wish,
                      const qs_rules *rules) {
    qs_real above[4] = {x[0], x[1], x[2], x[3] - distance}, u_max = rules->u_max;
    int is_near = rules->easing[0] * flat_output(above, rules->period) <= REACH * u_max;
    if (is_near && is_in_cone(above, -SLACK * u_max, BORDER * u_max, rules)) {
        required found = at_the_border(x, above, distance, spare, wish, rules);
        if (found.is_admissible) return found;
    }
    required found = required4(x, distance, wish, rules->gamma, rules);
    if (is_near && found.is_admissible) {
        qs_real law = easing_input(above, rules);
        if (found.least < law && law <= u_max && is_in_cone(above, -SLACK * u_max, REACH * u_max, rules))
            found.least = law;
    }
    return found;
}

#endif
