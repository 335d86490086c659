/* A loop on board, on the host: a pilot that flies straight at a wall and a pillar, and the shield between.
 *
 *     cc -std=c99 -O2 -ffp-contract=off -Ic examples/onboard/loop.c c/quadsafe.c -lm -o onboard && ./onboard
 */
#include <math.h>
#include <stdio.h>

#include "quadsafe.h"

#define PERIOD ((qs_real)0.01)
enum { COUNT = 2, STEPS = 1000 };

/* The pilot: towards (5, 0, 1), through whatever is in the way. */
static void wish(const qs_real flat[4][3], qs_real snap[3]) {
    static const qs_real goal[3] = {5, 0, 1};
    for (int i = 0; i < 3; ++i)
        snap[i] = 60 * (goal[i] - flat[0][i]) - 90 * flat[1][i] - 45 * flat[2][i] - 12 * flat[3][i];
}

/* The plant: what it has measured and the snap that it flies; here it is the exact chain. */
static void fly(qs_real flat[4][3], const qs_real snap[3], qs_real t) {
    for (int i = 0; i < 3; ++i) {
        flat[0][i] += t * (flat[1][i] + t / 2 * (flat[2][i] + t / 3 * (flat[3][i] + t / 4 * snap[i])));
        flat[1][i] += t * (flat[2][i] + t / 2 * (flat[3][i] + t / 3 * snap[i]));
        flat[2][i] += t * (flat[3][i] + t / 2 * snap[i]), flat[3][i] += t * snap[i];
    }
}

int main(void) {
    static const qs_real into_free_space[3] = {-1, 0, 0}, foot[3] = {2, 0, 0}, top[3] = {2, 0, 3};
    static qs_shield shield; /* the memory is the caller's */
    qs_real flat[4][3] = {{0, (qs_real)0.05, 1}}, snap[3], nearest = 9;
    qs_settings settings;
    qs_answer answer;
    int interventions = 0;
    qs_defaults(&settings);
    qs_obstacle obstacles[COUNT] = {qs_half_space(into_free_space, -4), qs_capsule(foot, top, (qs_real)0.4, NULL)};
    if (qs_init(&shield, &settings) != QS_DONE || qs_prepare(&shield, PERIOD) != QS_DONE)
        return 1;
    for (int step = 0; step < STEPS; ++step) {
        wish((const qs_real(*)[3])flat, snap);
        qs_filter(&shield, (const qs_real(*)[3])flat, obstacles, COUNT, snap, PERIOD, &answer);
        fly(flat, answer.snap, PERIOD); /* with any code the answer may be flown */
        double pillar = hypot((double)flat[0][0] - 2, (double)flat[0][1]) - 0.4, wall = 4 - (double)flat[0][0];
        nearest = (qs_real)fmin((double)nearest, fmin(pillar, wall));
        interventions += answer.intervened;
    }
    printf("%d of %d snaps changed, never nearer than %.4f m, at rest at x = %.3f\n", interventions, STEPS,
           (double)nearest, (double)flat[0][0]);
    return nearest > 0 ? 0 : 1;
}
