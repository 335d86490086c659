/* Gains, the tube of declared errors, checks of settings (quadsafe_core.maths.feedback, shields.settings) */
#ifndef QS_SETTINGS_H
#define QS_SETTINGS_H

#include "qs_numbers.h"

/* Poles of the feedbacks onto a stop, to rest, out of a body, and of the easing, 1/s. */
#define TRACKING_POLE 30
#define BRAKING_POLE 3
#define RECOVERY_POLE 6
#define EASING_POLE 20
#define SPARED Q(0.75) /* of the margin, what may not be used up at the border */
#define MORE (1 + EITHER(1e-7, 1e-5)) /* than the sums: what is left where they end */
enum { POLES = 29, WEIGHTS = 15, CHUNK = 256, MOST_CHUNKS = 4096 };

/* Gains of y^(n) = -k.(y, ..., y^(n-1)), n of 3 or 4, with every pole of the sampled loop at exp(-p t): k is
 * c ((A - 1) + (1 - exp(-p t)))^n / t^n, c the flat output of the held chain (Ackermann's formula). */
static void held_gains(int n, qs_real pole, qs_real t, qs_real *k) {
    qs_real left = -OF_REAL(expm1)(-pole * t);
    k[0] = 1;
    k[1] = n == 4 ? Q(-1.5) * t : -t;
    k[2] = n == 4 ? Q(11.0 / 12.0) * (t * t) : t * t / 3;
    if (n == 4) k[3] = -(t * t * t) / 4;
    for (int turn = 0; turn < n; ++turn) {
        for (int j = n - 1; j >= 0; --j) {
            qs_real moved = left * k[j], factor = 1;
            for (int i = j - 1; i >= 0; --i) {
                factor *= t / (j - i);
                moved += factor * k[i];
            }
            k[j] = moved / t;
        }
    }
}

/* A (4, 4) and b of (r, v, a, j) over a period with the snap held. */
static void chain_over(qs_real t, qs_real A[4][4], qs_real b[4]) {
    for (int i = 0; i < 4; ++i) {
        qs_real power = 1;
        for (int j = 0; j < 4; ++j) {
            A[i][j] = j < i ? 0 : power;
            power = j < i ? 1 : power * t / (j - i + 1);
        }
        b[i] = power;
    }
}

/* a B of a row and a matrix. */
static void row_times(const qs_real a[4], qs_real B[4][4], qs_real out[4]) {
    for (int j = 0; j < 4; ++j) out[j] = a[0] * B[0][j] + a[1] * B[1][j] + a[2] * B[2][j] + a[3] * B[3][j];
}

static qs_real sizes(const qs_real a[4], const qs_real b[4]) {
    return ABS(a[0]) * b[0] + ABS(a[1]) * b[1] + ABS(a[2]) * b[2] + ABS(a[3]) * b[3];
}

/* A tube of errors around a stored stop: of the deviation, of the feedback; the error of the state. */
typedef struct {
    qs_real deviation[4], feedback, error[4], added[4], gains[4];
} tube_of_errors;

/* The error of the state that the shield works on, a delay ahead, or its lead; what a period adds. */
static void wrong_in(const qs_uncertainty *told, qs_real t, qs_real snap_max, tube_of_errors *tube) {
    qs_real A[4][4], b[4], lag = told->rotor_lag, ahead[4];
    qs_real off = told->snap + (told->gain > 0 ? told->gain * snap_max : 0);
    qs_real measured[5] = {told->position, told->velocity, told->acceleration, told->jerk, 0};
    chain_over(t, A, b);
    for (int i = 0; i < 4; ++i) {
        tube->added[i] = off * (b[i] + (i < 3 ? lag * b[i + 1] : 0));
        tube->error[i] = measured[i] + lag * measured[i + 1];
    }
    tube->added[0] += told->wind * (t * t / 2) + lag * told->wind * t;
    tube->added[1] += told->wind * t;
    for (int turn = 0; turn < told->delay; ++turn) {
        for (int i = 0; i < 4; ++i) ahead[i] = sizes(A[i], tube->error) + tube->added[i];
        memcpy(tube->error, ahead, sizeof ahead);
    }
}

/* What is bounded, from the deviation at the start of a period: control points of r, v, a, j, then feedback. */
static void weights_of(qs_real t, qs_real state[WEIGHTS][4], qs_real snap[WEIGHTS]) {
    static const int binomial[5][5] = {{1}, {1, 1}, {1, 2, 1}, {1, 3, 3, 1}, {1, 4, 6, 4, 1}};
    int row = 0;
    for (int derivative = 0; derivative < 4; ++derivative) {
        int degree = 4 - derivative;
        for (int i = 0; i <= degree; ++i, ++row) {
            qs_real power = 1;
            snap[row] = 0;
            for (int m = 0; m < 4; ++m) state[row][m] = 0;
            for (int m = 0; m <= i; ++m) {
                qs_real w = (qs_real)binomial[i][m] / binomial[degree][m] * power;
                *(derivative + m < 4 ? &state[row][derivative + m] : &snap[row]) = w;
                power *= t / (m + 1);
            }
        }
    }
    snap[row] = 1;
    for (int m = 0; m < 4; ++m) state[row][m] = 0;
}

/* Whether feedback has taken a deviation, F^n, down to nothing. */
static int has_decayed(qs_real F[4][4], qs_real t) {
    qs_real scaled_by[4] = {1, t, t * t, t * t * t};
    for (int i = 0; i < 4; ++i) {
        qs_real sum = 0;
        for (int j = 0; j < 4; ++j) sum += ABS(F[i][j]) * scaled_by[i] / scaled_by[j];
        if (!(sum <= EITHER(1e-9, 1e-5))) return 0;
    }
    return 1;
}

/* The widths of a tube: the largest of their control points, and what a period adds; the jerk behind a lag. */
static void take_sides(tube_of_errors *tube, const qs_real most[WEIGHTS], qs_real lag, qs_real t) {
    static const int first[5] = {0, 5, 9, 12, 14};
    for (int i = 0; i < 4; ++i) {
        tube->deviation[i] = 0;
        for (int row = first[i]; row < first[i + 1]; ++row)
            tube->deviation[i] = most_of(tube->deviation[i], most[row] * MORE);
        tube->deviation[i] += tube->added[i] + (i == 3 ? lag * tube->added[3] / t : 0);
    }
    tube->feedback = most[WEIGHTS - 1] * MORE;
}

/* The tube with every pole of the feedback there; 0 if it does not settle. */
static int tube_at(qs_real pole, qs_real t, qs_real lag, tube_of_errors *tube) {
    qs_real A[4][4], b[4], F[4][4], power[4][4], next[4], seen[WEIGHTS][4], snap[WEIGHTS], most[WEIGHTS];
    qs_real summed[WEIGHTS], of_noise;
    int row;
    held_gains(4, pole, t, tube->gains);
    chain_over(t, A, b);
    weights_of(t, seen, snap);
    of_noise = sizes(tube->gains, tube->error);
    for (int i = 0; i < 4; ++i)
        for (int j = 0; j < 4; ++j) F[i][j] = A[i][j] - b[i] * tube->gains[j], power[i][j] = i == j;
    for (row = 0; row < WEIGHTS; ++row) {
        most[row] = sizes(seen[row], tube->error); /* the period without feedback begins with the error */
        summed[row] = ABS(snap[row]) * of_noise;
        for (int j = 0; j < 4; ++j) seen[row][j] -= snap[row] * tube->gains[j];
    }
    for (int n = 0; n % CHUNK || !has_decayed(power, t); ++n) {
        if (n >= CHUNK * MOST_CHUNKS) return 0;
        for (row = 0; row < WEIGHTS; ++row) {
            qs_real *w = seen[row], of_added = sizes(w, tube->added);
            row_times(w, A, next);
            most[row] = most_of(most[row], summed[row] + (sizes(next, tube->error) + of_added));
            summed[row] += of_added + ABS(w[0] * b[0] + w[1] * b[1] + w[2] * b[2] + w[3] * b[3]) * of_noise;
            row_times(w, F, next);
            memcpy(w, next, sizeof next);
        }
        for (int i = 0; i < 4; ++i) {
            row_times(power[i], F, next);
            memcpy(power[i], next, sizeof next);
        }
    }
    take_sides(tube, most, lag, t);
    return 1;
}

/* The narrowest and cheapest tube that leaves half of snap, jerk and thrust; 0 if there is none. */
static int best_tube(const qs_uncertainty *told, qs_real t, const qs_limits *limits, tube_of_errors *best) {
    qs_real least = INF, pole = 2,
            way = least_of(limits->gravity - limits->thrust_min, limits->thrust_max - limits->gravity);
    tube_of_errors tube = {{0}, 0, {0}, {0}, {0}};
    wrong_in(told, t, limits->snap_max, &tube);
    for (int i = 0; i < POLES; ++i, pole *= Q(1.15)) {
        if (!tube_at(pole, t, told->rotor_lag, &tube)) continue;
        qs_real of_jerk = limits->jerk_max < INF ? tube.deviation[3] / limits->jerk_max : 0;
        qs_real share =
            most_of(most_of(tube.feedback / limits->stop_snap_max, of_jerk), tube.deviation[2] / way);
        qs_real cost = tube.deviation[0] + Q(0.1) * share;
        if (share <= Q(0.5) && cost < least) least = cost, *best = tube;
    }
    return least < INF;
}

static int is_positive(qs_real x) { return 0 < x && x < INF; }
static int is_bound(qs_real x) { return 0 <= x && x < TOO_FAR; }

static int is_uncertain(const qs_uncertainty *told) {
    return told->position > 0 || told->velocity > 0 || told->acceleration > 0 || told->jerk > 0 ||
           told->snap > 0 || told->gain > 0 || told->wind > 0 || told->delay > 0 || told->losses ||
           told->rotor_lag > 0;
}

static int checked_settings(const qs_settings *s) {
    const qs_uncertainty *u = &s->uncertainty;
    if (!(is_positive(s->snap_max) && s->reserve >= 1 && s->reserve < INF && is_positive(s->alpha) &&
          0 <= s->margin && s->margin < INF && 0 <= s->specific_thrust_min && s->jerk_max > 0 &&
          is_positive(s->gravity) && s->specific_thrust_min < s->gravity &&
          s->gravity < s->specific_thrust_max && s->held_snap_max >= s->snap_max * s->reserve &&
          s->snap_max * s->reserve < TOO_FAR))
        return QS_BAD_SETTINGS;
    int is_told = is_bound(u->position) && is_bound(u->velocity) && is_bound(u->acceleration) &&
                  is_bound(u->jerk) && is_bound(u->snap) && is_bound(u->gain) && u->gain < 1 &&
                  is_bound(u->wind) && is_bound(u->rotor_lag);
    return is_told && u->delay >= 0 && u->delay <= QS_MAX_DELAY ? QS_DONE : QS_BAD_UNCERTAINTY;
}

/* What half-spaces and stops count on, so that a vehicle in the tube around them keeps to the settings. */
static int take_tube(const qs_settings *s, qs_real period, qs_rules *rules) {
    const qs_uncertainty *told = &s->uncertainty;
    qs_limits *limits = &rules->limits;
    tube_of_errors tube = {{0}, 0, {0}, {0}, {0}};
    rules->has_tube = is_uncertain(told);
    if (!rules->has_tube) return QS_DONE;
    if (period < Q(1e-4)) return QS_BAD_PERIOD;
    /* Where an error is a share of any snap whatever, no snap is too long. */
    if (told->gain > 0 && limits->snap_max == INF) limits->snap_max = rules->input_max;
    if (!best_tube(told, period, limits, &tube)) return QS_BAD_UNCERTAINTY;
    limits->stop_snap_max -= tube.feedback, limits->jerk_max -= tube.deviation[3];
    limits->thrust_min += tube.deviation[2], limits->thrust_max -= tube.deviation[2];
    memcpy(rules->tracking, tube.gains, sizeof tube.gains);
    rules->tube = tube.deviation[0], rules->estimate = tube.deviation[0] + tube.error[0];
    return QS_DONE;
}

#endif
