/* What controller_ortilo.c needs of the Crazyflie firmware's stabilizer_types.h and controller.h, by the same names. */
#pragma once
#include <stdbool.h>
#include <stdint.h>
#define RATE_MAIN_LOOP 1000
typedef union {
    struct {
        float x, y, z;
    };
    float axis[3];
} Axis3f;
typedef struct {
    float roll, pitch, yaw;
} attitude_t;
typedef struct {
    attitude_t attitude;
} state_t;
typedef struct {
    Axis3f acc, gyro;
} sensorData_t;
typedef struct {
    int unused;
} setpoint_t;
typedef enum { controlModeLegacy, controlModeForceTorque, controlModeForce } control_mode_t;
typedef struct {
    float thrustSi, torqueX, torqueY, torqueZ;
    control_mode_t controlMode;
} control_t;
typedef uint32_t stabilizerStep_t;
void controllerOutOfTreeInit(void);
bool controllerOutOfTreeTest(void);
void controllerOutOfTree(control_t *control, const setpoint_t *setpoint, const sensorData_t *sensors,
                         const state_t *state, const stabilizerStep_t step);
