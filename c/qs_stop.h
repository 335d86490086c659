/* Flat states and the stored stop (shields.chains.flat_state, shields.backup.stored_stop)
 *
 *     s = -(v - w)/h^3 - 2a/h^2 - 11j/(6h)
 *
 * at the start of each of three segments h is dead-beat on (v, a, j): the vehicle then rests in the frame w.
 * Behind a lag T the chain of the snap is that of the lead (r + T v, v + T a, a + T j, j + T s).
 */
#ifndef QS_STOP_H
#define QS_STOP_H

#include "qs_numbers.h"

enum { SEGMENTS = 3, LENGTHS = 13 };
#define ALMOST Q(1e-4) /* of a period: what is less has been flown, but for rounding */
/* Segment lengths that are tried, 0.1 * 1.25^k s. */
static const qs_real LENGTH[LENGTHS] = {
    Q(0.1), Q(0.1 * 1.25), Q(0.1 * 1.5625), Q(0.1 * 1.953125), Q(0.1 * 2.44140625), Q(0.1 * 3.0517578125),
    Q(0.1 * 3.814697265625), Q(0.1 * 4.76837158203125), Q(0.1 * 5.9604644775390625),
    Q(0.1 * 7.450580596923828125), Q(0.1 * 9.31322574615478515625), Q(0.1 * 11.6415321826934814453125),
    Q(0.1 * 14.551915228366851806640625)};

/* exp(-theta) sum of theta^i/i! k/(k + i). */
static qs_real lag_share(int k, qs_real theta) {
    qs_real total = 1, power = 1;
    for (int i = 1; i < 64 && power > EITHER(1e-17, 1e-8) * total; ++i) {
        power *= theta / i;
        total += power * k / (k + i);
    }
    return OF_REAL(exp)(-theta) * total;
}

/* How much of the k-fold integral of a lagged signal is new, k = 0 ... 4. */
static void new_shares(qs_real t, qs_real lag, qs_real n[5]) {
    qs_real ratio = t / lag;
    if (ratio < 4) {
        n[4] = ratio / 5 * lag_share(5, ratio);
        n[3] = ratio / 4 * (1 - n[4]);
        n[2] = ratio / 3 * (1 - n[3]);
        n[1] = ratio / 2 * (1 - n[2]);
        n[0] = ratio * (1 - n[1]);
        return;
    }
    n[0] = 1 - OF_REAL(exp)(-ratio);
    for (int k = 1; k < 5; ++k) n[k] = 1 - k * n[k - 1] / ratio;
}

/* The vehicle after its lead has flown the snap for t. */
static void follow(qs_state *x, qs_vec snap, qs_real t) {
    qs_real n[5];
    new_shares(t, x->lag, n);
    qs_real n0 = n[0], old = 1 - n0, n1 = n[1] * t, n2 = n[2] * t * t / 2, n3 = n[3] * cubed(t) / 6;
    x->own_j = combined(combined(scale(old, x->own_j), n0, x->j), n1, snap);
    x->own_a = combined(combined(combined(scale(old, x->own_a), n0, x->a), n1, x->j), n2, snap);
    qs_vec r = combined(combined(combined(scale(old, x->own_r), n0, x->r), n1, x->v), n2, x->a);
    x->own_r = combined(combined(r, n3, x->j), n[4] * squared(t * t) / 24, snap);
}

/* Fly the snap for t, (9) in each axis; a lead with what is behind. */
static void fly_on(qs_state *x, qs_vec snap, qs_real t) {
    qs_real half = t * t / 2, sixth = cubed(t) / 6;
    if (x->lag > 0) follow(x, snap, t);
    x->r = combined(combined(combined(x->r, t, x->v), half, x->a), sixth, x->j);
    x->r = combined(x->r, squared(t * t) / 24, snap);
    x->v = combined(combined(combined(x->v, t, x->a), half, x->j), sixth, snap);
    x->a = combined(combined(x->a, t, x->j), half, snap);
    x->j = combined(x->j, t, snap);
}

/* In place of a vehicle whose lagged snap is s its lead. */
static void take_lead(qs_state *x, qs_vec s, qs_real lag) {
    x->own_r = x->r, x->own_a = x->a, x->own_j = x->j, x->lag = lag;
    x->r = combined(x->r, lag, x->v), x->v = combined(x->v, lag, x->a);
    x->a = combined(x->a, lag, x->j), x->j = combined(x->j, lag, s);
}

/* Where a vehicle is relative to a body, whose centre for the lead x is farther on by the lag. */
static qs_vec own_gap(const qs_state *x, qs_vec gap, qs_vec velocity) {
    return x->lag > 0 ? combined(add(gap, subtract(x->own_r, x->r)), x->lag, velocity) : gap;
}

static qs_vec within_ball(qs_vec u, qs_real radius) {
    qs_real length = norm(u);
    return length <= radius ? u : scale(radius / length, u);
}

static qs_vec braking(qs_vec v, qs_vec a, qs_vec j, const qs_real k[3]) {
    return vec(-(k[0] * v.x + k[1] * a.x + k[2] * j.x), -(k[0] * v.y + k[1] * a.y + k[2] * j.y),
               -(k[0] * v.z + k[1] * a.z + k[2] * j.z));
}

static qs_vec dead_beat_snap(const qs_state *x, qs_vec frame, qs_real h) {
    qs_vec slow = combined(scale(-2 / squared(h), x->a), -11 / (6 * h), x->j);
    return combined(slow, -1 / cubed(h), subtract(x->v, frame));
}

/* Whole control periods in a segment length, and how long that is. */
static qs_real periods_in(int choice, qs_real period) { return most_of(1, RINT(LENGTH[choice] / period)); }
static qs_real length_of(int choice, qs_real period) { return periods_in(choice, period) * period; }

/* The same of the segment that is flown; at rest each period is one. */
static qs_real periods_now(const qs_stop *stop, qs_real period) {
    return stop->segments_left > 0 ? periods_in(stop->choice, period) : 1;
}
static qs_real length_now(const qs_stop *stop, qs_real period) { return periods_now(stop, period) * period; }
static qs_real elapsed(const qs_stop *stop, qs_real period) {
    return (periods_now(stop, period) - (qs_real)stop->periods_left) * period;
}

static void begin_segment(qs_stop *stop, const qs_state *x, qs_real period) {
    stop->begin = *x;
    if (stop->segments_left == 0) stop->begin.v = stop->frame, stop->begin.a = stop->begin.j = NOTHING;
    stop->periods_left = (float)periods_now(stop, period);
}

static void write_stop(qs_stop *stop, const qs_state *x, qs_vec frame, int choice, qs_real period) {
    stop->is_stored = 1, stop->choice = choice, stop->segments_left = SEGMENTS, stop->frame = frame;
    begin_segment(stop, x, period);
}

static qs_vec held_snap(const qs_stop *stop, qs_real period) {
    return stop->segments_left ? dead_beat_snap(&stop->begin, stop->frame, length_now(stop, period)) : NOTHING;
}

/* Where the stored stop has the vehicle now. */
static qs_state reference(const qs_stop *stop, qs_real period) {
    qs_state begin = stop->begin;
    begin.lag = 0;
    fly_on(&begin, held_snap(stop, period), elapsed(stop, period));
    return begin;
}

/* Move the stored stop on by so many periods, or back within its segment. */
static void shift_stop(qs_stop *stop, qs_real period, qs_real count) {
    stop->periods_left = (float)((qs_real)stop->periods_left - count);
    while ((qs_real)stop->periods_left <= ALMOST) {
        qs_real left = (qs_real)stop->periods_left < -ALMOST ? (qs_real)stop->periods_left : 0;
        qs_state x = stop->begin;
        fly_on(&x, held_snap(stop, period), length_now(stop, period));
        stop->segments_left -= stop->segments_left > 0;
        begin_segment(stop, &x, period);
        stop->periods_left = (float)((qs_real)stop->periods_left + left);
    }
}

/* Snap that brings the vehicle back onto the stored stop. */
static qs_vec feedback(const qs_stop *stop, const qs_state *x, const qs_rules *rules) {
    const qs_real *k = rules->tracking;
    qs_state ref = reference(stop, rules->period);
    qs_vec u = combined(scale(k[0], subtract(ref.r, x->r)), k[1], subtract(ref.v, x->v));
    return combined(combined(u, k[2], subtract(ref.a, x->a)), k[3], subtract(ref.j, x->j));
}

/* The snap of the stored stop, in the mean of the next period if its segment ends within that. */
static qs_vec mean_snap(const qs_stop *stop, qs_real period) {
    qs_vec held = held_snap(stop, period), after = NOTHING;
    qs_real share = (qs_real)stop->periods_left, h = length_now(stop, period);
    if (share >= 1 - ALMOST) return held;
    qs_state end = stop->begin;
    fly_on(&end, held, h);
    if (stop->segments_left > 1) after = dead_beat_snap(&end, stop->frame, h);
    return combined(scale(1 - share, after), share, held);
}

/* Snap of the stored stop with its feedback, cut off at the largest that is flown. */
static qs_vec tracking_snap(const qs_stop *stop, const qs_state *x, const qs_rules *rules) {
    qs_vec u = combined(mean_snap(stop, rules->period), 1, feedback(stop, x, rules));
    return within_ball(u, rules->limits.snap_max);
}

#endif
