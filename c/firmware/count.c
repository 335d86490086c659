/* Instructions of qs_filter over attacked flights, on the target: one line "spheres calls mean most violated" each.
 * In float those of qs_prepare too, at 50 Hz: one line for errors, pushes, a lag in an interval, jitter,
 * both of these. */
#include "board.h"
#include "quadsafe.h"

#include <math.h>

#define PERIODS 1500
#define PERIOD ((qs_real)0.01)
#define MOST 10

static unsigned long seed = 1;

/* Uniform in (-1, 1). */
static qs_real chance(void)
{
    seed = (1664525ul * seed + 1013904223ul) & 0xFFFFFFFFul;
    return (qs_real)(long)(seed >> 8) / (qs_real)8388608 - 1;
}

static qs_real distance(const qs_real *at, const qs_obstacle *body)
{
    const qs_real x = at[0] - body->center.x, y = at[1] - body->center.y, z = at[2] - body->center.z;
    return (qs_real)sqrt(x * x + y * y + z * z) - body->radius;
}

/* The chain over a period under a held snap. */
static void fly(qs_real flat[4][3], const qs_real snap[3])
{
    for (int i = 0; i < 3; ++i) {
        const qs_real v = flat[1][i], a = flat[2][i], j = flat[3][i], s = snap[i], t = PERIOD;
        flat[0][i] += t * (v + t / 2 * (a + t / 3 * (j + t / 4 * s)));
        flat[1][i] += t * (a + t / 2 * (j + t / 3 * s));
        flat[2][i] += t * (j + t / 2 * s);
        flat[3][i] += t * s;
    }
}

/* Full speed at the nearest body, and every third second random snaps. */
static void attack(int period, const qs_real flat[4][3], const qs_obstacle *bodies, int count, qs_real snap[3])
{
    const qs_obstacle *near = bodies;
    for (int k = 1; k < count; ++k)
        if (distance(flat[0], &bodies[k]) < distance(flat[0], near))
            near = &bodies[k];
    const qs_real to[3] = {near->center.x - flat[0][0], near->center.y - flat[0][1], near->center.z - flat[0][2]};
    const qs_real length = (qs_real)sqrt(to[0] * to[0] + to[1] * to[1] + to[2] * to[2]);
    for (int i = 0; i < 3; ++i) {
        const qs_real pull = 216 * (2 * to[i] / length - flat[1][i]) - 108 * flat[2][i] - 18 * flat[3][i];
        snap[i] = period / 100 % 3 == 2 ? 300 * chance() : pull;
    }
}

static void say_number(unsigned number)
{
    char text[12];
    int place = 11;
    text[place] = 0;
    do {
        text[--place] = (char)('0' + number % 10);
        number /= 10;
    } while (number > 0);
    board_say(text + place);
    board_say(" ");
}

static int flight(int count)
{
    static qs_shield shield;
    qs_settings settings;
    qs_obstacle bodies[MOST];
    qs_real flat[4][3] = {{0}};
    unsigned most = 0, violated = 0;
    unsigned long total = 0;
    qs_defaults(&settings);
    if (qs_init(&shield, &settings) != QS_DONE)
        return 1;
    for (int k = 0; k < count; ++k) {
        /* Around the start at 1.5 m, the golden angle apart. */
        const qs_real height = (2 * (qs_real)k + 1) / (qs_real)count - 1, turn = (qs_real)2.399963 * (qs_real)k;
        const qs_real wide = (qs_real)(1.5 * sqrt(1 - height * height));
        const qs_real center[3] = {wide * (qs_real)cos(turn), wide * (qs_real)sin(turn), (qs_real)1.5 * height};
        bodies[k] = qs_sphere(center, (qs_real)0.3, 0);
    }
    for (int period = 0; period < PERIODS; ++period) {
        qs_real snap[3];
        qs_answer answer;
        attack(period, (const qs_real(*)[3])flat, bodies, count, snap);
        const unsigned before = board_ticks();
        const int code = qs_filter(&shield, (const qs_real(*)[3])flat, bodies, count, snap, PERIOD, &answer);
        const unsigned used = board_instructions(before, board_ticks());
        if (code != QS_DONE)
            return 2;
        total += used;
        most = used > most ? used : most;
        fly(flat, answer.snap);
        for (int k = 0; k < count; ++k)
            violated += distance(flat[0], &bodies[k]) < 0;
    }
    say_number((unsigned)count);
    say_number(PERIODS);
    say_number((unsigned)(total / PERIODS));
    say_number(most);
    say_number(violated);
    board_say("\n");
    return violated > 0 ? 3 : 0;
}

static unsigned prepared(const qs_settings *settings)
{
    static qs_shield shield;
    qs_init(&shield, settings);
    const unsigned before = board_ticks();
    const int code = qs_prepare(&shield, (qs_real)0.02);
    const unsigned used = board_instructions(before, board_ticks());
    return code == QS_DONE ? used : 0;
}

static void prepare(void)
{
    qs_settings told[5];
    for (int i = 0; i < 5; ++i)
        qs_defaults(&told[i]);
    told[0].uncertainty.position = (qs_real)0.004;
    told[1].uncertainty.impulse = (qs_real)0.3, told[1].uncertainty.impulse_gap = 1;
    told[2].uncertainty.rotor_lag = (qs_real)0.036, told[2].uncertainty.rotor_lag_most = (qs_real)0.039;
    told[3].uncertainty.jitter = told[4].uncertainty.jitter = (qs_real)0.1;
    told[4].uncertainty.rotor_lag = (qs_real)0.036, told[4].uncertainty.rotor_lag_most = (qs_real)0.038;
    for (int i = 0; i < 5; ++i)
        say_number(prepared(&told[i]));
    board_say("\n");
}

int main(void)
{
    const int counts[] = {1, 4, 10};
    int failed = 0;
    for (int i = 0; i < 3; ++i)
        failed = failed ? failed : flight(counts[i]);
    if (sizeof(qs_real) == sizeof(float))
        prepare();
    return failed;
}
