/* Least correction onto half-spaces n.u >= least (quadsafe_core.maths.projection)
 *
 * First by taking in the plane that cuts most, again and again; where that is not plain, one half-space after
 * the other, each a problem of one dimension less (Seidel): K^3 / 6 interval cuts at most.
 */
#ifndef QS_PROJECT_H
#define QS_PROJECT_H

#include "qs_numbers.h"

/* A bound missed by less than this share of its largest term counts as met; the sine below which two planes
 * are parallel; sin^2 or volume above which planes are exchanged; digits that a far point has cost. */
#define MET EITHER(1e-14, 2e-6)
#define PARALLEL EITHER(1e-14, 2e-6)
#define WIDE Q(1e-2)
#define FAR_POINT 4
enum { EXCHANGES = 8 };

/* A normal and how far the desired point is outside; a gap of 0 is no plane. */
typedef struct {
    qs_vec n;
    qs_real gap;
} plane;
typedef struct {
    qs_vec correction;
    plane first, second;
    int is_plain;
} exchange;
static const plane NO_PLANE = {{0, 0, 0}, 0};

static int is_cut(qs_vec u, qs_real reach, const qs_half_space_of *h) {
    return h->least - dot(h->n, u) > MET * (ABS(h->least) + reach_of(u) + reach);
}

static qs_real worst_cut(qs_vec u, const qs_half_space_of *h, int count) {
    qs_real worst = 0;
    for (int k = 0; k < count; ++k) worst = most_of(worst, h[k].least - dot(h[k].n, u));
    return worst;
}

/* Nearest to foot on foot + t direction; the better of two crossed ends, which may be one point. */
static int nearest_on_line(qs_vec *foot, qs_vec direction, qs_real reach, const qs_half_space_of *h,
                           int count) {
    qs_real low = -INF, high = INF;
    for (int k = 0; k < count; ++k) {
        qs_real slope = dot(h[k].n, direction), t = (h[k].least - dot(h[k].n, *foot)) / slope;
        if (ABS(slope) <= PARALLEL) {
            if (is_cut(*foot, reach, &h[k])) return 0;
        } else if (slope > 0) low = most_of(low, t);
        else high = least_of(high, t);
    }
    if (low <= high) {
        *foot = add(*foot, scale(least_of(most_of(0, low), high), direction));
        return 1;
    }
    qs_vec at_low = add(*foot, scale(low, direction)), at_high = add(*foot, scale(high, direction));
    qs_real cut_low = worst_cut(at_low, h, count), cut_high = worst_cut(at_high, h, count);
    reach += reach_of(*foot);
    *foot = cut_low <= cut_high ? at_low : at_high;
    return least_of(cut_low, cut_high) <= MET * (reach + reach_of(*foot));
}

/* The part of n within a plane, at unit length; the sine of their angle, 0 if they are parallel. */
static qs_real unit_within(qs_vec n_plane, qs_vec n, qs_vec *part) {
    *part = subtract(n, scale(dot(n_plane, n), n_plane));
    qs_real sine = norm(*part);
    if (sine <= PARALLEL) return 0;
    *part = scale(1 / sine, *part);
    /* Once more: between nearly parallel planes the first difference is mostly rounding. */
    *part = subtract(*part, scale(dot(n_plane, *part), n_plane));
    *part = scale(1 / norm(*part), *part);
    return sine;
}

/* Nearest to a point on the plane of the last half-space within those before it. */
static int nearest_on_plane(qs_vec *point, qs_vec desired, qs_real reach, const qs_half_space_of *h, int last) {
    qs_vec n = h[last].n, origin = add(desired, scale(h[last].least - dot(n, desired), n)), inward;
    *point = origin;
    for (int j = 0; j < last; ++j) {
        if (is_cut(*point, reach, &h[j])) {
            if (unit_within(n, h[j].n, &inward) == 0) return 0;
            *point = add(origin, scale((h[j].least - dot(h[j].n, origin)) / dot(h[j].n, inward), inward));
            if (!nearest_on_line(point, cross(n, inward), reach, h, j)) return 0;
        }
    }
    return 1;
}

static int one_after_the_other(qs_vec *u, const qs_half_space_of *h, int count) {
    qs_vec desired = *u;
    qs_real reach = reach_of(desired);
    for (int i = 0; i < count; ++i)
        if (is_cut(*u, reach, &h[i]) && !nearest_on_plane(u, desired, reach, h, i)) return 0;
    return 1;
}

/* Taking in a second plane. */
static exchange on_two(plane a, plane b) {
    qs_real cosine = dot(a.n, b.n), sine2 = 1 - cosine * cosine;
    qs_real weight1 = a.gap - cosine * b.gap, weight2 = b.gap - cosine * a.gap;
    exchange e = {scale(b.gap, b.n), b, NO_PLANE, weight1 <= 0};
    if (weight1 <= 0 || sine2 <= WIDE) return e;
    e.correction = add(scale(weight1 / sine2, a.n), scale(weight2 / sine2, b.n));
    e.first = a, e.second = b, e.is_plain = weight2 > 0;
    return e;
}

/* Taking in a third plane. */
static exchange on_three(plane a, plane b, plane c) {
    qs_vec n23 = cross(b.n, c.n), n31 = cross(c.n, a.n), n12 = cross(a.n, b.n);
    qs_real volume = dot(a.n, n23), share = 1 / volume, weight1 = ABSENT, weight2 = ABSENT;
    exchange e = {a.n, a, b, 1};
    if (ABS(volume) > WIDE) {
        e.correction = scale(share, add(add(scale(a.gap, n23), scale(b.gap, n31)), scale(c.gap, n12)));
        if (dot(n12, e.correction) * share > 0)
            weight1 = dot(n23, e.correction) * share, weight2 = dot(n31, e.correction) * share;
    }
    if (weight1 > 0 && weight2 > 0) return e;
    e = on_two(weight1 < weight2 ? b : a, c);
    e.is_plain = e.is_plain && !isnan(weight1);
    return e;
}

static exchange exchanged(plane first, plane second, plane third) {
    exchange e = {scale(third.gap, third.n), third, NO_PLANE, 1};
    if (first.gap == 0) return e;
    return second.gap == 0 ? on_two(first, third) : on_three(first, second, third);
}

/* The plane that cuts u most, or -1. */
static int most_cut(qs_vec u, qs_real reach, const qs_half_space_of *h, int count) {
    int found = -1;
    qs_real most = 0, slack = MET * (reach_of(u) + reach);
    for (int k = 0; k < count; ++k) {
        qs_real gap = h[k].least - dot(h[k].n, u);
        if (gap > most && gap - MET * ABS(h[k].least) - slack > 0) found = k, most = gap;
    }
    return found;
}

/* Nearest point to u in the half-spaces, in its place; 0 if there is none. A least of -INF does not count. */
static int project(qs_vec *u, const qs_half_space_of *h, int count) {
    qs_vec desired = *u, point = *u;
    qs_real reach = reach_of(desired);
    exchange e = {desired, NO_PLANE, NO_PLANE, 1};
    int is_solved = 0;
    for (int turn = 0; turn < EXCHANGES; ++turn) {
        int k = most_cut(point, reach, h, count);
        is_solved = k < 0;
        if (is_solved) break;
        plane third = {h[k].n, h[k].least - dot(h[k].n, desired)};
        e = exchanged(e.first, e.second, third);
        if (!e.is_plain) break;
        point = add(desired, e.correction);
    }
    if (!is_solved) point = desired, is_solved = one_after_the_other(&point, h, count);
    /* The rounding was that of a far point; from close by the same planes are met more sharply. */
    if (is_solved && reach > FAR_POINT * reach_of(point)) is_solved = one_after_the_other(&point, h, count);
    *u = point;
    return is_solved && reach_of(point) <= LARGEST;
}

#endif
