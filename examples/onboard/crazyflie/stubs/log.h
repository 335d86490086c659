#pragma once
#include <stdint.h>
typedef uint16_t logVarId_t;
logVarId_t logGetVarId(char *group, char *name);
float logGetFloat(logVarId_t id);
#define LOG_UINT8 1
#define LOG_GROUP_START(name) const void *const log_##name[] = {
#define LOG_ADD(type, name, address) (address),
#define LOG_GROUP_STOP(name) };
