/* The certificate (shields.backup.certificate)
 *
 * Each body alone has an invariant set, but the intersection of such sets is not invariant. So a snap is flown
 * only together with a proof that the vehicle can still stop: every arc of the stop is checked against bodies,
 * thrust and jerk, and after it a ray test keeps moving bodies away from the resting vehicle for ever.
 */
#ifndef QS_CERTIFICATE_H
#define QS_CERTIFICATE_H

#include "qs_hull.h"

enum { ACCEPTED, BLENDED, STOPPED, ASTRAY, UNCERTIFIED };
/* What is a rounding too much or too little is left to the arcs. */
#define LESS (1 - EITHER(1e-12, 1e-6))

static int keeps_band(const qs_state *x, qs_vec snap, qs_real t, const qs_limits *limits) {
    qs_vec a = combined(combined(x->a, t, x->j), t / 2 * t, snap), thrust = add(a, vec(0, 0, limits->gravity));
    qs_real square = dot(thrust, thrust), least = limits->thrust_min;
    return square >= LESS * ABS(least) * least && LESS * square <= squared(limits->thrust_max);
}

/* Whether points of a stop keep the limits, whatever the bodies are; x becomes the state where it ends. */
static int stop_keeps_limits(qs_state *x, qs_vec frame, qs_real h, const qs_limits *limits) {
    for (int segment = 0; segment < SEGMENTS; ++segment) {
        qs_vec snap = dead_beat_snap(x, frame, h);
        for (int i = 1; i < 8; ++i)
            if (!keeps_band(x, snap, (qs_real)i / 8 * h, limits)) return 0;
        fly_on(x, snap, h);
        if (!(keeps_band(x, snap, 0, limits) && norm(snap) <= limits->stop_snap_max &&
              norm(x->j) <= limits->jerk_max))
            return 0;
    }
    return 1;
}

/* Whether the stop of segment length h from x at time start keeps every limit. */
static int stop_is_clear(const qs_state *begin, qs_real start, qs_vec frame, qs_real h, const bodies *all,
                         const qs_limits *limits) {
    qs_state x = *begin;
    x.lag = 0;
    if (!stop_keeps_limits(&x, frame, h, limits) || !rest_is_clear(x.r, frame, start + SEGMENTS * h, all))
        return 0;
    x = *begin;
    for (int segment = 0; segment < SEGMENTS; ++segment) {
        qs_vec snap = dead_beat_snap(&x, frame, h);
        if (look_at_arc(&x, snap, start + segment * h, h, all, limits) != CLEAR) return 0;
        fly_on(&x, snap, h);
    }
    return own_rest_is_clear(&x, frame, start + SEGMENTS * h, all);
}

/* A segment length in the order in which they are tried, the first one once; -1 for that a second time. */
static int choice_at(int turn, int first) { return turn == 0 ? first : turn - 1 == first ? -1 : turn - 1; }

/* Number of a segment length whose stop keeps every limit; -1 if none does. */
static int clear_length(const qs_state *x, qs_real start, qs_vec frame, int first, qs_real period,
                        const bodies *all, const qs_limits *limits) {
    for (int turn = 0; turn < 1 + LENGTHS; ++turn) {
        int choice = choice_at(turn, first);
        if (choice >= 0 && stop_is_clear(x, start, frame, length_of(choice, period), all, limits))
            return choice;
    }
    return -1;
}

/* The same by the quick test, for the period and the stop after it. */
static int length_clear_at_once(int first, const attempt *t, const bodies *all, const qs_limits *limits) {
    for (int turn = 0; turn < 1 + LENGTHS; ++turn) {
        int choice = choice_at(turn, first);
        if (choice >= 0) {
            scaled_stop s = scaled(t->after, length_of(choice, t->period));
            if (keeps_limits(t, &s, limits) && bodies_are_clear(t, &s, all, 0)) return choice;
        }
    }
    return -1;
}

/* The segment length of a stop from x at time start that keeps every limit, and its frame: at rest in the world,
 * or else with one of the moving bodies; -1 without one. */
static int found_stop(int first, const qs_state *x, qs_real start, qs_real period, const bodies *all,
                      const qs_limits *limits, qs_vec *frame) {
    for (int k = -1; k < all->count; ++k) {
        *frame = k < 0 ? NOTHING : all->body[k].velocity;
        if (k >= 0 && (is_same(*frame, NOTHING) || !is_there(core_of(all, k), all->keep[k]))) continue;
        int choice = clear_length(x, start, *frame, first, period, all, limits);
        if (choice >= 0) return choice;
    }
    return -1;
}

/* Whether the stored stop, from the start of its segment, keeps clear of the bodies of now. */
static int look_at_stored_stop(const qs_stop *stop, qs_real period, const bodies *all) {
    qs_state x = stop->begin;
    qs_real start = -elapsed(stop, period), h = length_now(stop, period);
    int found = CLEAR;
    for (int segment = 0; segment < stop->segments_left; ++segment) {
        qs_vec snap = dead_beat_snap(&x, stop->frame, h);
        int arc = look_at_arc(&x, snap, start, h, all, NULL);
        found = arc > found ? arc : found;
        fly_on(&x, snap, h);
        start += h;
    }
    int rests = rest_is_clear(x.r, stop->frame, start, all) && own_rest_is_clear(&x, stop->frame, start, all);
    return rests ? found : HIT;
}

/* What the stored stop is worth: STOPPED, ASTRAY if it may not be clear by enough, else UNCERTIFIED. It is given
 * up only where a point of it lies in a body, or where feedback cannot bring the vehicle back. */
static int standing(const qs_shield *shield, const bodies *all) {
    const qs_rules *rules = &shield->rules;
    bodies stored = *all, bare = *all;
    stored.keep = shield->stored, bare.keep = shield->bare;
    if (!shield->stop.is_stored ||
        !(norm(feedback(&shield->stop, &shield->last, rules)) <= rules->limits.stop_snap_max))
        return UNCERTIFIED;
    if (look_at_stored_stop(&shield->stop, rules->period, &stored) == CLEAR) return STOPPED;
    return look_at_stored_stop(&shield->stop, rules->period, &bare) == HIT ? UNCERTIFIED : ASTRAY;
}

/* The jerk of a state, the larger one of a lead's and the vehicle's behind it. */
static qs_real most_jerk(const qs_state *x) {
    return x->lag > 0 ? most_of(norm(x->j), norm(x->own_j)) : norm(x->j);
}

/* Whether the snap may be flown for a period, by the quick test with the segment length of the stored stop; the
 * stop after it is then stored. */
static int accept_at_once(qs_shield *shield, qs_vec snap, const bodies *all) {
    const qs_rules *rules = &shield->rules;
    const qs_state *x = &shield->last;
    qs_stop *stop = &shield->stop;
    /* The jerk of a period is largest at one of its ends. */
    if (!(norm(snap) <= rules->limits.snap_max && most_jerk(x) <= rules->limits.jerk_max)) return 0;
    qs_state after = *x;
    fly_on(&after, snap, rules->period);
    attempt t = {x, &after, snap, rules->period};
    scaled_stop s = scaled(&after, length_of(stop->choice, rules->period));
    if (!(keeps_limits(&t, &s, &rules->limits) && bodies_are_clear(&t, &s, all, Q(0.5) * rules->margin)))
        return 0;
    write_stop(stop, &after, NOTHING, stop->choice, rules->period);
    return 1;
}

/* Whether the snap may be flown for a period: the period keeps every limit, and so does a stop after it. */
static int accept(qs_shield *shield, qs_vec snap, const bodies *all, const qs_limits *limits) {
    const qs_state *x = &shield->last;
    qs_real period = shield->rules.period;
    if (!(norm(snap) <= limits->snap_max)) return 0;
    qs_state after = *x;
    fly_on(&after, snap, period);
    attempt t = {x, &after, snap, period};
    qs_vec frame = NOTHING;
    int choice = length_clear_at_once(shield->stop.choice, &t, all, limits);
    if (choice < 0) {
        if (!(norm(after.j) <= limits->jerk_max)) return 0;
        choice = found_stop(shield->stop.choice, &after, period, period, all, limits, &frame);
        if (choice < 0 || look_at_arc(x, snap, 0, period, all, limits) != CLEAR) return 0;
    }
    write_stop(&shield->stop, &after, frame, choice, period);
    return 1;
}

/* The wanted snap if it can be certified, else a part of the way to it from the stored stop, else that stop. */
static qs_vec certified_snap(qs_shield *shield, qs_vec wanted, int is_wanted, const bodies *all,
                             const qs_limits *limits, int *kind) {
    const qs_state *x = &shield->last;
    qs_real period = shield->rules.period;
    bodies ahead = *all;
    ahead.keep = shield->ahead;
    /* The tests look at the jerk where an arc ends: where one begins, it was in its limits or is so now. */
    int begins_within = most_jerk(x) <= limits->jerk_max;
    *kind = ACCEPTED;
    if (begins_within && is_wanted && accept(shield, wanted, &ahead, limits)) return wanted;
    *kind = standing(shield, all);
    if (*kind != STOPPED && begins_within) {
        qs_vec frame;
        int choice = found_stop(shield->stop.choice, x, 0, period, &ahead, limits, &frame);
        if (choice >= 0) write_stop(&shield->stop, x, frame, choice, period), *kind = STOPPED;
    }
    shield->stop.is_stored = shield->stop.is_stored && *kind != UNCERTIFIED;
    if (*kind == UNCERTIFIED) return NOTHING;
    qs_vec back = tracking_snap(&shield->stop, x, &shield->rules);
    /* Off a stop that counts, errors alone may take the jerk that is seen over a stop's. */
    for (int i = 0; i < 2 && is_wanted && (begins_within || *kind == STOPPED); ++i) {
        qs_vec blend = combined(back, i == 0 ? Q(0.5) : Q(0.25), subtract(wanted, back));
        if (accept(shield, blend, &ahead, limits)) {
            *kind = BLENDED;
            return blend;
        }
    }
    shift_stop(&shield->stop, period, 1);
    return back;
}

#endif
