/* What comes in is anything; what comes out is a code and a finite snap. Run under sanitizers: fuzz ROUNDS SEED. */
#include "../../c/quadsafe.h"

#include <float.h>
#include <limits.h>
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MOST ((qs_real)(sizeof(qs_real) == 4 ? FLT_MAX : DBL_MAX))
#define LEAST ((qs_real)(sizeof(qs_real) == 4 ? FLT_MIN : DBL_MIN))

static uint64_t word;

static uint32_t next(void)
{
    word = word * 6364136223846793005u + 1442695040888963407u;
    return (uint32_t)(word >> 33);
}

static int below(int n) { return (int)(next() % (unsigned)n); }
static qs_real unit(void) { return (qs_real)next() / (qs_real)2147483648.0; }

/* A number of an ordinary size, or sometimes any. */
static qs_real number(int is_wild)
{
    static const double wild[] = {0, -0.0, 1, -1, 1e-3, 1e6, -1e6, 1e18, -1e18, 1e29, -1e29, 1e31};
    if (!is_wild || below(3))
        return (2 * unit() - 1) * (qs_real)pow(10, below(4) - 1);
    switch (below(8)) {
    case 0:
        return (qs_real)NAN;
    case 1:
        return below(2) ? (qs_real)INFINITY : -(qs_real)INFINITY;
    case 2:
        return below(2) ? MOST : -MOST;
    case 3:
        return LEAST / (qs_real)(1 << below(20));
    case 4:
        return LEAST * (2 * unit() - 1);
    default:
        return (qs_real)wild[below((int)(sizeof wild / sizeof *wild))];
    }
}

static void numbers(qs_real *x, int count, int is_wild)
{
    for (int i = 0; i < count; ++i)
        x[i] = number(is_wild);
}

static qs_real points[8][3];

static qs_obstacle any_obstacle(int is_wild)
{
    qs_real a[3], b[3], c[9], v[3], r = number(is_wild);
    qs_obstacle raw;
    numbers(a, 3, is_wild), numbers(b, 3, is_wild), numbers(c, 9, is_wild), numbers(v, 3, is_wild);
    r = is_wild ? r : (qs_real)fabs((double)r) / 10;
    const qs_real *moves = below(2) ? v : NULL;
    switch (below(is_wild ? 8 : 6)) {
    case 0:
        return qs_sphere(below(9) ? a : NULL, r, moves);
    case 1:
        return qs_capsule(a, below(9) ? b : a, r, moves);
    case 2:
        return qs_cylinder(a, below(9) ? b : a, r, moves);
    case 3:
        for (int i = 0; i < 3 && !is_wild; ++i)
            b[i] = (qs_real)fabs((double)b[i]);
        return qs_box(a, b, is_wild && below(2) ? c : NULL, moves);
    case 4:
        return qs_half_space(b, r - 3);
    case 5:
        return qs_hull((const qs_real(*)[3])points, is_wild ? below(10) - 1 : 8, r, moves);
    default:
        for (size_t i = 0; i < sizeof raw; ++i)
            ((unsigned char *)&raw)[i] = (unsigned char)next();
        raw.points = NULL; /* what a pointer points at nobody can check */
        raw.kind = below(12) - 2;
        return raw;
    }
}

static void fail(const char *what, int round)
{
    printf("%s in round %d\n", what, round);
    exit(1);
}

static void check(int code, const qs_answer *a, int count, int round)
{
    if (code < QS_DONE || code > QS_TOO_LARGE)
        fail("no code", round);
    for (int i = 0; i < 3; ++i)
        if (!(fabs((double)a->snap[i]) <= (double)MOST))
            fail("no finite snap", round);
    if (a->obstacle < -1 || (a->obstacle >= count && a->obstacle >= 0))
        fail("no such obstacle", round);
    if (isnan(a->value) || isnan(a->correction))
        fail("no number", round);
    if (code != QS_DONE && (a->certified || !a->fallback))
        fail("a certificate beside a code", round);
}

static void any_settings(qs_settings *s, int round)
{
    qs_defaults(s);
    if (round % 16 == 1) {
        s->held_snap_max = 700, s->jerk_max = 60, s->specific_thrust_min = 3, s->specific_thrust_max = 18;
    } else if (round % 16 == 2)
        numbers((qs_real *)s, 9, 1); /* nine numbers in a row */
    else if (round % 64 == 3)
        s->uncertainty.delay = below(9) - 2, s->uncertainty.position = number(1), s->uncertainty.rotor_lag = unit() / 20;
    else if (round % 64 == 4)
        s->uncertainty.losses = 1, s->uncertainty.gain = number(1);
    else if (round % 64 == 5)
        s->uncertainty.impulse = number(1), s->uncertainty.impulse_gap = number(1);
    else if (round % 64 == 6)
        s->uncertainty.rotor_lag = unit() / 20, s->uncertainty.rotor_lag_most = below(2) ? unit() / 20 : number(1);
    else if (round % 64 == 8)
        s->uncertainty.rotor_lag = unit() / 20,
        s->uncertainty.rotor_lag_most = (1 + unit() / 16) * s->uncertainty.rotor_lag;
    if (round % 64 == 7 || round % 64 == 8) { /* short periods take long */
        s->uncertainty.jitter = below(2) ? unit() / 8 : number(1);
        if (s->uncertainty.jitter > (qs_real)0.2 && s->uncertainty.jitter < 1)
            s->uncertainty.jitter = 1;
    }
}

static void fly(qs_shield *shield, int round, int is_wild)
{
    static const int counts[] = {-1, INT_MIN, INT_MAX, QS_MAX_OBSTACLES + 1};
    static qs_obstacle bodies[QS_MAX_OBSTACLES];
    int count = below(QS_MAX_OBSTACLES + 1);
    qs_real flat[4][3], snap[3], period = is_wild && !below(4) ? number(1) : (1 + 20 * unit()) / 400;
    qs_answer answer;
    for (int k = 0; k < count; ++k)
        bodies[k] = any_obstacle(is_wild && !below(4));
    numbers(&flat[0][0], 12, is_wild && below(2));
    for (int step = 0; step < 6; ++step) {
        int wrong = is_wild && !below(8), told = wrong ? counts[below(4)] : count;
        numbers(snap, 3, is_wild);
        int held = below(8) ? qs_held_for(shield, (qs_real)0.9 * period) : qs_held_for(shield, number(1));
        if (held != QS_DONE && held != QS_BAD_SETTINGS && held != QS_BAD_TIME)
            fail("no code of a time", round);
        int code = qs_filter(shield, is_wild && !below(30) ? NULL : (const qs_real(*)[3])flat,
                             is_wild && !below(30) ? NULL : bodies, told, is_wild && !below(30) ? NULL : snap, period,
                             &answer);
        check(code, &answer, count, round);
        if (wrong && code == QS_DONE)
            fail("a count out of range is done", round);
        if (!below(4))
            qs_backup(shield, below(9) ? answer.snap : NULL);
        for (int i = 0; i < 3; ++i) { /* as it was, but for a body of its own */
            flat[0][i] += period * flat[1][i], flat[1][i] += period * flat[2][i];
            flat[2][i] += period * flat[3][i], flat[3][i] += period * answer.snap[i];
            if (is_wild && !below(20))
                flat[below(4)][i] = number(1);
        }
    }
}

static void map(int round)
{
    qs_real state[20], flat[4][3], snap[3], wrench[4];
    qs_body body = {(qs_real)0.5, {(qs_real)0.01, (qs_real)0.01, (qs_real)0.02}, (qs_real)9.81};
    numbers(state, 20, 1), numbers(snap, 3, 1);
    if (!below(3))
        body.inertia[below(3)] = number(1);
    int codes[2] = {qs_flat_state(state, &body, flat), qs_wrench_from_snap(state, snap, number(1), &body, wrench)};
    if (codes[0] != QS_DONE && codes[0] != QS_BAD_STATE)
        fail("no code of the flat map", round);
    if (qs_flat_state(NULL, &body, flat) != QS_BAD_POINTER || qs_wrench_from_snap(state, snap, 0, NULL, wrench) == 0)
        fail("NULL is done", round);
}

int main(int argc, char **argv)
{
    static qs_shield shield;
    qs_settings settings;
    qs_answer answer;
    int rounds = argc > 1 ? atoi(argv[1]) : 1000;
    word = argc > 2 ? (uint64_t)atoi(argv[2]) : 1;
    if (qs_init(NULL, NULL) != QS_BAD_POINTER || qs_filter(&shield, NULL, NULL, 0, NULL, 1, &answer) != QS_BAD_SETTINGS)
        fail("NULL is done", 0);
    qs_backup(NULL, NULL);
    if (qs_held_for(NULL, 1) != QS_BAD_POINTER || qs_held_for(&shield, 1) != QS_BAD_SETTINGS)
        fail("NULL is done", 0);
    for (int round = 0; round < rounds; ++round) {
        numbers(&points[0][0], 24, !below(8));
        any_settings(&settings, round);
        qs_init(&shield, &settings);
        fly(&shield, round, round % 3 != 0);
        map(round);
    }
    printf("%d rounds\n", rounds);
    return 0;
}
