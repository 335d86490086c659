/* The shield as an app layer of the Crazyflie firmware, at 100 Hz. It compiles against stubs/; it has not flown.
 *
 * The pilot asks for a velocity by the parameters shield.vx, vy, vz. The answer is flown as body rates and thrust:
 * over a period the snap gives the jerk, and that the rates with which the thrust turns. What the firmware's rate
 * loop leaves of it has to be measured first and told (settings.uncertainty): the numbers here are those of a
 * simulated Crazyflie, docs/plants.md.
 */
#include <math.h>
#include <string.h>

#include "FreeRTOS.h"
#include "app.h"
#include "commander.h"
#include "log.h"
#include "param.h"
#include "stabilizer_types.h"
#include "task.h"

#include "quadsafe.h"

#define PERIOD_MS 10
#define PERIOD (0.001f * PERIOD_MS)
#define POLE 6.0f
#define DEGREES 57.29578f
/* Newtons of all rotors at the thrust command 65535. */
#define FULL_THRUST 0.6f
#define PRIORITY 3

static const qs_body body = {0.027f, {1.4e-5f, 1.4e-5f, 2.2e-5f}, 9.81f};
/* A pillar and a ball; a map of your own comes here. */
static const float pillar[2][3] = {{1.0f, 0.0f, 0.0f}, {1.0f, 0.0f, 2.0f}}, ball[3] = {0.0f, 1.0f, 1.0f};

static float wanted[3];
static uint8_t is_on, is_certified;
static qs_shield shield;
static struct {
    logVarId_t position[3], velocity[3], quaternion[4], gyro[3];
} ids;

static void find_variables(void)
{
    static char *const positions[] = {"x", "y", "z"}, *const velocities[] = {"vx", "vy", "vz"};
    static char *const quaternions[] = {"qx", "qy", "qz", "qw"};
    for (int i = 0; i < 3; ++i) {
        ids.position[i] = logGetVarId("stateEstimate", positions[i]);
        ids.velocity[i] = logGetVarId("stateEstimate", velocities[i]);
        ids.gyro[i] = logGetVarId("gyro", positions[i]);
    }
    for (int i = 0; i < 4; ++i)
        ids.quaternion[i] = logGetVarId("stateEstimate", quaternions[i]);
}

/* The 18 numbers of the rigid body; thrust and its rate are what was commanded. */
static void read_state(float state[20])
{
    float q[4];
    for (int i = 0; i < 3; ++i) {
        state[i] = logGetFloat(ids.position[i]);
        state[3 + i] = logGetFloat(ids.velocity[i]);
        state[15 + i] = logGetFloat(ids.gyro[i]) / DEGREES;
    }
    for (int i = 0; i < 4; ++i)
        q[i] = logGetFloat(ids.quaternion[i]);
    const float x = q[0], y = q[1], z = q[2], w = q[3];
    const float rows[9] = {
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    };
    memcpy(state + 6, rows, sizeof rows);
}

/* Fly a wrench for a period; the firmware's pitch turns the other way round. */
static void command(float state[20], const float wrench[4])
{
    const float *omega = state + 15, *inertia = body.inertia;
    setpoint_t setpoint;
    float rates[3];
    for (int i = 0; i < 3; ++i) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        const float turn = (wrench[1 + i] - (inertia[k] - inertia[j]) * omega[j] * omega[k]) / inertia[i];
        rates[i] = (omega[i] + PERIOD * turn) * DEGREES;
    }
    state[18] += PERIOD * (state[19] + 0.5f * PERIOD * wrench[0]);
    state[19] += PERIOD * wrench[0];
    memset(&setpoint, 0, sizeof setpoint);
    setpoint.mode.roll = setpoint.mode.pitch = setpoint.mode.yaw = modeVelocity;
    setpoint.attitudeRate.roll = rates[0];
    setpoint.attitudeRate.pitch = -rates[1];
    setpoint.attitudeRate.yaw = 0.0f;
    setpoint.thrust = 65535.0f * state[18] / FULL_THRUST;
    commanderSetSetpoint(&setpoint, PRIORITY);
}

static int begin(void)
{
    qs_settings settings;
    qs_defaults(&settings);
    settings.uncertainty.rotor_lag = 0.0375f;
    settings.uncertainty.snap = 1.5f;
    settings.uncertainty.wind = 0.45f;
    return qs_init(&shield, &settings);
}

void appMain(void)
{
    const qs_obstacle obstacles[] = {
        qs_capsule(pillar[0], pillar[1], 0.25f, NULL),
        qs_sphere(ball, 0.4f, NULL),
    };
    float state[20] = {0}, flat[4][3], snap[3], wrench[4];
    TickType_t wake = xTaskGetTickCount();
    qs_answer answer;
    find_variables();
    state[18] = body.mass * body.gravity;
    if (begin() != QS_DONE)
        return;
    for (;;) {
        vTaskDelayUntil(&wake, M2T(PERIOD_MS));
        if (!is_on)
            continue;
        read_state(state);
        if (qs_flat_state(state, &body, flat) != QS_DONE)
            continue;
        for (int i = 0; i < 3; ++i)
            snap[i] = POLE * POLE * POLE * (wanted[i] - flat[1][i]) - 3 * POLE * POLE * flat[2][i] - 3 * POLE * flat[3][i];
        /* Whatever it returns, the answer is one to fly: with an error it is the stored stop. */
        qs_filter(&shield, (const float(*)[3])flat, obstacles, 2, snap, PERIOD, &answer);
        is_certified = (uint8_t)answer.certified;
        if (qs_wrench_from_snap(state, answer.snap, 0.0f, &body, wrench) == QS_DONE)
            command(state, wrench);
    }
}

PARAM_GROUP_START(shield)
PARAM_ADD(PARAM_UINT8, on, &is_on)
PARAM_ADD(PARAM_FLOAT, vx, &wanted[0])
PARAM_ADD(PARAM_FLOAT, vy, &wanted[1])
PARAM_ADD(PARAM_FLOAT, vz, &wanted[2])
PARAM_GROUP_STOP(shield)

LOG_GROUP_START(shield)
LOG_ADD(LOG_UINT8, certified, &is_certified)
LOG_GROUP_STOP(shield)
