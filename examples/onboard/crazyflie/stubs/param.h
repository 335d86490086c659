#pragma once
#define PARAM_UINT8 8
#define PARAM_FLOAT 6
#define PARAM_GROUP_START(name) const void *const param_##name[] = {
#define PARAM_ADD(type, name, address) (address),
#define PARAM_GROUP_STOP(name) };
