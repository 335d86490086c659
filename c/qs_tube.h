/* The tube around a stored stop that holds every declared error (shields.settings.tube, seldom, jitter)
 *
 *     e+ = F e - b k.n + D,   F = A - b k'        over a period; n: the error of the estimate, D: what is added
 *
 * A row of weights w sees of what was added m periods ago w F^m: in the worst case its sizes add up. These are
 * visited from the last period that counts to the first, so that the largest from some time on is known there.
 * Under jitter the steps are quarters of the shortest period, and F is exp(L t) with what that leaves out.
 */
#ifndef QS_TUBE_H
#define QS_TUBE_H

#include "qs_stop.h"

#define MORE (1 + EITHER(1e-7, 1e-5)) /* than the sums: what is left where they end */
#define DECAYED EITHER(1e-9, 1e-5)
enum { POLES = 29, CHUNK = 256, MOST_CHUNKS = 4096, BLOCK = 32, GRID = 4, PARTS = 64, JUMPS = 4, LEVELS = 16 };

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

/* ---- matrices (4, 4) ---- */

static qs_real dot4(const qs_real a[4], const qs_real b[4]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3];
}

static qs_real sizes(const qs_real a[4], const qs_real b[4]) {
    return ABS(a[0]) * b[0] + ABS(a[1]) * b[1] + ABS(a[2]) * b[2] + ABS(a[3]) * b[3];
}

/* a B of a row and a matrix. */
static void row_times(const qs_real a[4], qs_real B[4][4], qs_real out[4]) {
    for (int j = 0; j < 4; ++j) out[j] = a[0] * B[0][j] + a[1] * B[1][j] + a[2] * B[2][j] + a[3] * B[3][j];
}

/* A becomes A B; both may be one. */
static void multiply(qs_real A[4][4], qs_real B[4][4]) {
    qs_real out[4][4];
    for (int i = 0; i < 4; ++i) row_times(A[i], B, out[i]);
    memcpy(A, out, sizeof out);
}

/* s A + d 1 */
static void scaled_and_shifted(qs_real A[4][4], qs_real s, qs_real d, qs_real out[4][4]) {
    for (int i = 0; i < 4; ++i)
        for (int j = 0; j < 4; ++j) out[i][j] = s * A[i][j] + (i == j ? d : 0);
}

static void power_of(qs_real A[4][4], int n, qs_real out[4][4]) {
    qs_real square[4][4];
    memcpy(square, A, sizeof square);
    scaled_and_shifted(A, 0, 1, out);
    for (; n > 0; n /= 2) {
        if (n % 2) multiply(out, square);
        multiply(square, square);
    }
}

/* The largest sum of sizes in a row, in units in which t is 1. */
static qs_real norm_over(qs_real A[4][4], qs_real t) {
    qs_real unit[4] = {1, t, t * t, t * t * t}, most = 0;
    for (int i = 0; i < 4; ++i) {
        qs_real sum = 0;
        for (int j = 0; j < 4; ++j) sum += ABS(A[i][j]) * unit[i] / unit[j];
        if (!(sum < INF)) return INF;
        most = most_of(most, sum);
    }
    return most;
}

/* exp(L t), by scaling and squaring. */
static void exponential(qs_real L[4][4], qs_real t, qs_real out[4][4]) {
    qs_real small[4][4], size = t * norm_over(L, t), share = t;
    int halvings = 0;
    for (; size > Q(1.0 / 16.0) && halvings < 64; size /= 2, share /= 2) ++halvings;
    scaled_and_shifted(L, share, 0, small);
    scaled_and_shifted(L, 0, 1, out);
    for (int i = 13; i > 0; --i) {
        multiply(out, small);
        scaled_and_shifted(out, Q(1) / i, 1, out);
    }
    for (; halvings > 0; --halvings) multiply(out, out);
}

/* The logarithm over t of a loop whose poles are all at exp(-p t): 1 + x with x^4 = 0, times that. */
static void logarithm(qs_real F[4][4], qs_real pole, qs_real t, qs_real out[4][4]) {
    qs_real x[4][4], power[4][4];
    scaled_and_shifted(F, OF_REAL(exp)(pole * t), -1, x);
    scaled_and_shifted(x, 1 / t, -pole, out);
    memcpy(power, x, sizeof power);
    for (int n = 2; n < 4; ++n) {
        multiply(power, x);
        for (int i = 0; i < 4; ++i)
            for (int j = 0; j < 4; ++j) out[i][j] += (n == 2 ? -power[i][j] : power[i][j]) / (n * t);
    }
}

/* Solve x = c + C x, C >= 0, into c, and spoil C; 0 unless its spectral radius is below 1: pivots are positive
 * then. */
static int is_settled(qs_real C[5][5], qs_real c[5]) {
    for (int i = 0; i < 5; ++i)
        for (int j = 0; j < 5; ++j) C[i][j] = (i == j) - C[i][j];
    for (int k = 0; k < 5; ++k) {
        if (!(C[k][k] > 0)) return 0;
        for (int i = 0; i < 5; ++i) {
            qs_real share = i == k ? 0 : C[i][k] / C[k][k];
            for (int j = 0; j < 5; ++j) C[i][j] -= share * C[k][j];
            c[i] -= share * c[k];
        }
    }
    for (int i = 0; i < 5; ++i) c[i] /= C[i][i];
    return 1;
}

/* ---- what is wrong in flight, bounds for (r, v, a, j) ---- */

typedef struct {
    qs_real period, shortest, longest;
    int has_jitter;
    qs_real lag, slowest, spread, drift; /* of an interval: the most, how far it is off, the snap that makes */
    qs_real error[4], added[4], held[4]; /* of the state that is worked on; by every period, by a snap of 1 */
    qs_real push[2][4];                  /* that comes as a period ends, or as it begins */
    int apart;                           /* periods between two of them, less than 1 for none at all */
    qs_real kick[4], within[4];          /* what a jump of the snap at the wrong time has made of it, and makes */
    int jumps;                           /* before a stop begins */
} wrongs;

static int whole_part(qs_real x) { return (int)least_of(x, CHUNK * MOST_CHUNKS); }

/* What pushes, and answers flown for too long or too short, make of the prediction over the delay. */
static void add_seldom_ahead(const qs_uncertainty *told, wrongs *m) {
    qs_real A[4][4], b[4], ahead = told->delay * m->longest, dv = told->impulse;
    chain_over(ahead, A, b);
    for (int i = 0; i < 4; ++i) m->error[i] += told->delay * sizes(A[i], m->kick);
    if (dv == 0) return;
    int count = 1 + whole_part(ahead / told->impulse_gap);
    m->error[0] += count * ((m->lag + ahead) * dv), m->error[1] += count * dv;
}

/* The lag that the shield counts with, in an interval the one that is off by the least share. */
static qs_real told_lag(const qs_uncertainty *told) {
    qs_real least = told->rotor_lag, most = told->rotor_lag_most;
    return most > least ? 2 * least * most / (least + most) : least;
}

/* Of the state that the shield works on, a delay ahead, or its lead, if no snap is longer than snap_max. */
static void wrong_in(const qs_uncertainty *told, qs_real t, qs_real snap_max, wrongs *m) {
    qs_real A[4][4], b[4], lag = told_lag(told), e = told->jitter, dv = told->impulse, ahead[4];
    qs_real least = told->rotor_lag, most = most_of(least, told->rotor_lag_most), longest = t * (1 + e);
    qs_real off = told->snap + (told->gain > 0 ? told->gain * snap_max : 0);
    qs_real jump = e > 0 ? 2 * (snap_max + off) * t : 0;
    qs_real measured[5] = {told->position, told->velocity, told->acceleration, told->jerk, 0};
    m->period = t, m->shortest = t * (1 - e), m->longest = longest, m->has_jitter = longest > t;
    m->lag = lag, m->slowest = most, m->spread = most > least ? (most - least) / (most + least) : 0;
    m->drift = m->spread > 0 ? 2 * m->spread * (snap_max + off) : 0, m->jumps = 1 + told->delay;
    chain_over(longest, A, b);
    for (int i = 0; i < 4; ++i) {
        m->held[i] = b[i] + (i < 3 ? lag * b[i + 1] : 0);
        m->added[i] = off * m->held[i];
        m->error[i] = measured[i] + lag * measured[i + 1];
        m->within[i] = jump * (Q(0.25) + e) * (i < 3 ? b[i + 1] : 1);
        m->kick[i] = i < 3 ? m->within[i] : jump * (e + ALMOST);
        m->push[0][i] = m->push[1][i] = i == 0 ? lag * dv : i == 1 ? dv : 0;
    }
    m->push[1][0] += longest * dv;
    m->apart = dv > 0 ? whole_part(told->impulse_gap / longest * (1 + EITHER(1e-12, 1e-6))) : 1;
    m->added[0] += told->wind * (longest * longest / 2) + lag * told->wind * longest;
    m->added[1] += told->wind * longest;
    for (int turn = 0; turn < told->delay; ++turn) {
        for (int i = 0; i < 4; ++i) ahead[i] = sizes(A[i], m->error) + m->added[i] + m->drift * m->held[i];
        memcpy(m->error, ahead, sizeof ahead);
    }
    if (told->delay > 0) add_seldom_ahead(told, m);
}

/* ---- sums ---- */

/* The largest sizes of a row from a time on, in periods: no time before has less. */
typedef struct {
    int until;
    qs_real each[4];
} level;

/* A loop with its feedback, over a step; what is not it under jitter. */
typedef struct {
    qs_real gains[4], of_noise;
    qs_real F[4][4], period[4][4]; /* and over a period, under jitter the shortest */
    int steps, periods; /* until a deviation has decayed */
    int segment, last;  /* periods between jumps of a stop, the last of them */
    qs_real A[4][4], b[4];
    qs_real between[4][4], off[4][4]; /* between two steps; from the loop over a period, whatever its length */
    qs_real b_short[4], every[4], begun[4]; /* what every period adds, and what the first begins with */
    qs_real own[5];                         /* what the deviation and the feedback add by themselves */
    level levels[LEVELS];                   /* of one row, on the way back */
    int count, below;                       /* the last of them; which sizes were less there than later */
} loop;

/* Steps of t until nothing is left of a deviation; 0 if that takes too long. */
static int steps_of(qs_real F[4][4], qs_real t) {
    qs_real leap[4][4], power[4][4];
    power_of(F, CHUNK, leap);
    scaled_and_shifted(F, 0, 1, power);
    for (int chunk = 0; chunk < MOST_CHUNKS; ++chunk) {
        if (norm_over(power, t) <= DECAYED) return chunk * CHUNK;
        multiply(power, leap);
    }
    return 0;
}

/* off: bounds of |A - b k' - exp(L t)| over all lengths of a period, with what may lie between those tried. */
static void take_mismatch(qs_real L[4][4], const wrongs *m, loop *l) {
    qs_real A[4][4], b[4], near[4][4], last[4][4], apart[4][4] = {{0}};
    for (int n = 0; n <= PARTS; ++n) {
        qs_real t = n < PARTS ? m->shortest + n * ((m->longest - m->shortest) / PARTS) : m->longest;
        chain_over(t, A, b);
        exponential(L, t, near);
        for (int i = 0; i < 4; ++i)
            for (int j = 0; j < 4; ++j) {
                qs_real off = ABS(A[i][j] - b[i] * l->gains[j] - near[i][j]);
                l->off[i][j] = n > 0 ? most_of(l->off[i][j], off) : off;
                if (n > 0) apart[i][j] = most_of(apart[i][j], ABS(off - last[i][j]));
                last[i][j] = off;
            }
    }
    for (int i = 0; i < 4; ++i)
        for (int j = 0; j < 4; ++j) l->off[i][j] += apart[i][j];
}

/* From the loop over a period that of a quarter of the shortest. */
static void take_short_steps(qs_real pole, const wrongs *m, loop *l) {
    qs_real L[4][4], A[4][4], b[4], step = m->shortest / GRID;
    logarithm(l->F, pole, m->period, L);
    take_mismatch(L, m, l);
    exponential(L, step, l->F);
    for (int i = 0; i < 4; ++i)
        for (int j = 0; j < 4; ++j) L[i][j] = ABS(L[i][j]);
    exponential(L, step, l->between);
    scaled_and_shifted(l->between, 1, -1, l->between);
    chain_over(m->shortest, A, l->b_short);
    chain_over(m->longest, A, b);
    for (int i = 0; i < 4; ++i) {
        l->every[i] = m->added[i] + l->of_noise * (b[i] - l->b_short[i]);
        l->begun[i] = sizes(A[i], m->error) + m->added[i];
    }
}

static int loop_at(qs_real pole, const wrongs *m, loop *l) {
    int in_period = m->has_jitter ? GRID : 1;
    memset(l, 0, sizeof *l);
    held_gains(4, pole, m->period, l->gains);
    chain_over(m->period, l->A, l->b);
    l->of_noise = sizes(l->gains, m->error);
    for (int i = 0; i < 4; ++i)
        for (int j = 0; j < 4; ++j) l->F[i][j] = l->A[i][j] - l->b[i] * l->gains[j];
    if (m->has_jitter) take_short_steps(pole, m, l);
    l->steps = steps_of(l->F, m->shortest / in_period);
    power_of(l->F, in_period, l->period);
    l->periods = l->steps / in_period;
    l->segment = whole_part(most_of(1, Q(0.1) / m->longest * (1 + EITHER(1e-9, 1e-6))));
    l->last = (l->periods - 1) / l->segment;
    if (l->last > JUMPS - 1) l->last = JUMPS - 1;
    return l->steps > 0;
}

/* w F^i for a block of i from begin on. */
static void look_back(const qs_real w[4], loop *l, int begin, qs_real seen[BLOCK][4]) {
    qs_real power[4][4];
    power_of(l->F, begin, power);
    row_times(w, power, seen[0]);
    for (int i = 1; i < BLOCK; ++i) row_times(seen[i - 1], l->F, seen[i]);
}

/* Where, on the way back, a size of a row begins to be less than it is later, that is noted: elsewhere a row is
 * its own largest from there on. Where there is no room left the latest is lost, and the one before goes on. */
static void note_level(loop *l, int ago, int below, const qs_real each[4]) {
    if (below & ~l->below) {
        level *noted = &l->levels[++l->count % LEVELS];
        noted->until = ago;
        memcpy(noted->each, each, sizeof noted->each);
        l->levels[(l->count + 1) % LEVELS].until = l->periods;
    }
    l->below = below;
}

/* How a row sees a unit of snap in one period so much later, and the level there: that, and its sums with all
 * before it, with those faded by as many powers of one share, and with these times their number. */
typedef struct {
    int ago, level;
    qs_real g[4], seen, sum, faded, ramp;
} trail;

static void go_on(trail *x, loop *l, const wrongs *m, qs_real left) {
    qs_real size[4] = {ABS(x->g[0]), ABS(x->g[1]), ABS(x->g[2]), ABS(x->g[3])}, next[4];
    if (m->has_jitter) {
        row_times(size, l->between, next);
        if (l->levels[x->level % LEVELS].until < x->ago) --x->level;
        for (int i = 0; i < 4; ++i) size[i] = most_of(size[i] + next[i], l->levels[x->level % LEVELS].each[i]);
    }
    ++x->ago, x->seen = dot4(size, m->held);
    x->sum += x->seen, x->faded = left * x->faded + x->seen, x->ramp = left * x->ramp + x->faded;
    row_times(x->g, l->period, next);
    memcpy(x->g, next, sizeof next);
}

/* What a lag that is off makes of a row, for a drift of 1: of what there is as a stop begins, which fades with
 * the lag, and of the stop's jumps. A jump makes the least of (t/lag) exp(-t/slowest) and its peak: that is the
 * first less what it has above the peak, from one period to another. all: of a unit in every period. */
static qs_real most_behind_lag(const qs_real w[4], loop *l, const wrongs *m, qs_real *all) {
    qs_real left = OF_REAL(exp)(-m->shortest / m->slowest), fading = OF_REAL(exp)(-m->shortest / m->lag);
    qs_real peak = m->slowest / (m->longest * Q(2.718281828459045)), power = 1, powers[2] = {0, 0};
    qs_real begun = 0, most = 0, jumped[JUMPS] = {0};
    int from[2] = {l->periods, l->periods};
    trail now = {0, l->count, {w[0], w[1], w[2], w[3]}, 0, 0, 0, 0}, late[2] = {now, now};
    for (int n = 0; n < l->periods; ++n, power *= left) {
        int is_above = (n + 1) * power > peak, edge = from[0] < l->periods;
        if (is_above != edge && from[edge] == l->periods) from[edge] = n, powers[edge] = power;
    }
    for (int n = 0; n < l->periods; ++n) {
        go_on(&now, l, m, left);
        qs_real value = now.ramp;
        for (int i = 0; i < 2; ++i) {
            if (n < from[i]) continue;
            go_on(&late[i], l, m, left);
            qs_real over = powers[i] * (late[i].ramp + from[i] * late[i].faded) - peak * late[i].sum;
            value += i ? over : -over;
        }
        begun = fading * begun + now.seen, most = most_of(most, begun);
        for (int i = 0; i <= l->last && i * l->segment <= n; ++i) jumped[i] = most_of(jumped[i], value);
    }
    qs_real sum = jumped[l->last]; /* two jumps come a period apart */
    for (int i = 0; i <= l->last; ++i) sum += jumped[i];
    *all = now.sum;
    return most + m->longest / m->lag * sum;
}

/* What a row of weights comes to where every period is as long as it should be. */
static qs_real most_over_periods(const qs_real w[4], loop *l, const wrongs *m, qs_real all[5]) {
    qs_real seen[BLOCK][4], next[4], most = -INF, push = 0, pushed = 0;
    for (int begin = l->steps - BLOCK; begin >= 0; begin -= BLOCK) {
        look_back(w, l, begin, seen);
        for (int i = BLOCK - 1; i >= 0; --i) {
            qs_real *g = seen[i], of_added = sizes(g, m->added);
            row_times(g, l->A, next);
            most = most_of(of_added + ABS(dot4(g, l->b)) * l->of_noise + most, sizes(next, m->error) + of_added);
            push = most_of(push, most_of(ABS(dot4(g, m->push[0])), ABS(dot4(g, m->push[1]))));
            if ((begin + i) % m->apart == 0) pushed += push;
        }
    }
    if (m->spread > 0) most += m->drift * most_behind_lag(w, l, m, &all[4]);
    return most + pushed;
}

/* The same of periods of any length; all: what a unit of deviation, and behind a lag of snap, in every period
 * comes to. */
static qs_real most_under_jitter(const qs_real w[4], loop *l, const wrongs *m, qs_real all[5]) {
    qs_real seen[BLOCK][4], more[4], each[4] = {0}, back = 0, push = 0, most = 0;
    l->levels[0] = (level){l->periods, {0}}, l->count = l->below = 0;
    for (int begin = l->steps - BLOCK; begin >= 0; begin -= BLOCK) {
        look_back(w, l, begin, seen);
        for (int i = BLOCK - 1; i >= 0; --i) {
            qs_real *g = seen[i], size[4] = {ABS(g[0]), ABS(g[1]), ABS(g[2]), ABS(g[3])};
            row_times(size, l->between, more);
            for (int n = 0; n < 4; ++n) each[n] = most_of(each[n], size[n] + more[n]);
            back = most_of(back, ABS(dot4(g, l->b_short)) + dot4(more, l->b_short));
            for (int n = 0; n < 2; ++n) push = most_of(push, ABS(dot4(g, m->push[n])) + dot4(more, m->push[n]));
            if (i % GRID) continue;
            int ago = (begin + i) / GRID, jump = ago / l->segment, below = 0;
            for (int n = 0; n < 4; ++n) all[n] += each[n], below |= (size[n] + more[n] < each[n]) << n;
            note_level(l, ago, below, each);
            most += l->of_noise * back;
            if (ago % m->apart == 0) most += push;
            if (ago % l->segment == 0 && jump <= l->last)
                most += (jump == l->last ? 1 + m->jumps : 1) * dot4(each, m->kick);
        }
    }
    if (m->spread > 0) most += m->drift * most_behind_lag(w, l, m, &all[4]);
    return most + dot4(all, l->every) + dot4(each, l->begun);
}

/* ---- the tube ---- */

/* A tube of errors around a stored stop: of the deviation, of the feedback. */
typedef struct {
    qs_real deviation[4], feedback, gains[4];
} tube_of_errors;

/* What a row comes to, with its weight of the snap, after the period without feedback. */
static qs_real most_later(const qs_real w[4], qs_real of_snap, loop *l, const wrongs *m, qs_real all[5]) {
    memset(all, 0, 5 * sizeof *all);
    qs_real most = m->has_jitter ? most_under_jitter(w, l, m, all) : most_over_periods(w, l, m, all);
    return ABS(of_snap) * l->of_noise + most + (dot4(all, l->own) + all[4] * l->own[4]);
}

/* What the bounds themselves add to all of them: under jitter the deviation, behind a lag that is not known the
 * feedback, which moves the snap for ever; 0 if they grow without end. */
static int is_closed(loop *l, const wrongs *m) {
    qs_real most[5] = {0}, all[5], C[5][5] = {{0}}, w[4];
    for (int i = m->has_jitter ? 0 : 4; i < (m->spread > 0 ? 5 : 4); ++i) {
        for (int j = 0; j < 4; ++j) w[j] = i < 4 ? i == j : -l->gains[j];
        most[i] = most_later(w, i == 4, l, m, all);
        row_times(all, l->off, C[i]);
        C[i][4] = 2 * m->spread * all[4];
    }
    if (!is_settled(C, most)) return 0;
    for (int i = 0; i < 4; ++i) l->own[i] = dot4(l->off[i], most);
    l->own[4] = 2 * m->spread * most[4];
    return 1;
}

/* A control point of r, v, a or j over t: its weights of the state, and of the snap, which is returned. */
static qs_real control_point(int order, int i, qs_real t, qs_real w[4]) {
    qs_real weight = 1;
    memset(w, 0, 4 * sizeof *w);
    for (int m = 0; order + m < 4; ++m) {
        w[order + m] = weight;
        weight *= t / (m + 1) * (i - m) / (4 - order - m);
    }
    return weight;
}

/* The tube with every pole of the feedback there; 0 if it does not settle. */
static int tube_at(qs_real pole, const wrongs *m, tube_of_errors *tube) {
    qs_real w[4], all[5];
    loop l;
    if (!loop_at(pole, m, &l) || !is_closed(&l, m)) return 0;
    for (int order = 0; order < 4; ++order) {
        qs_real side = 0;
        for (int i = 0; i <= 4 - order; ++i) {
            qs_real of_snap = control_point(order, i, m->longest, w);
            side = most_of(side, sizes(w, m->error)); /* the period without feedback begins with the error */
            for (int j = 0; j < 4; ++j) w[j] -= of_snap * l.gains[j];
            side = most_of(side, most_later(w, of_snap, &l, m, all));
        }
        tube->deviation[order] = side * MORE + m->added[order] + m->drift * m->held[order] + m->within[order];
    }
    for (int j = 0; j < 4; ++j) w[j] = -l.gains[j];
    tube->feedback = most_later(w, 1, &l, m, all) * MORE;
    /* The vehicle's jerk is that of its lead, less the snap behind the lag. */
    tube->deviation[3] += m->lag * (m->added[3] / m->longest + (m->spread > 0 ? tube->feedback : 0));
    memcpy(tube->gains, l.gains, sizeof l.gains);
    return 1;
}

/* The narrowest and cheapest tube that leaves half of snap, jerk and thrust; 0 if there is none. */
static int best_tube(const wrongs *m, const qs_limits *limits, tube_of_errors *best) {
    qs_real least = INF, pole = 2,
            way = least_of(limits->gravity - limits->thrust_min, limits->thrust_max - limits->gravity);
    tube_of_errors tube;
    for (int i = 0; i < POLES; ++i, pole *= Q(1.15)) {
        if (!tube_at(pole, m, &tube)) continue;
        qs_real of_jerk = limits->jerk_max < INF ? tube.deviation[3] / limits->jerk_max : 0;
        qs_real share =
            most_of(most_of(tube.feedback / limits->stop_snap_max, of_jerk), tube.deviation[2] / way);
        qs_real cost = tube.deviation[0] + Q(0.1) * share;
        if (share <= Q(0.5) && cost < least) least = cost, *best = tube;
    }
    return least < INF;
}

#endif
