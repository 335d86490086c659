/* What the app takes of the Crazyflie firmware's headers, so that it compiles without them. */
#pragma once
#include <stdint.h>
typedef uint32_t TickType_t;
#define M2T(ms) ((TickType_t)(ms))
