#pragma once
#include <stdint.h>
typedef struct {
    uint32_t timestamp;
    float roll, pitch, yaw;
} attitude_t;
typedef struct {
    uint32_t timestamp;
    float x, y, z;
} point_t;
typedef point_t velocity_t;
typedef enum { modeDisable = 0, modeAbs, modeVelocity } stab_mode_t;
typedef struct {
    uint32_t timestamp;
    attitude_t attitude, attitudeRate;
    float thrust;
    point_t position;
    velocity_t velocity;
    struct {
        stab_mode_t x, y, z, roll, pitch, yaw, quat;
    } mode;
} setpoint_t;
