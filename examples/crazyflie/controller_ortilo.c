/* An exported onboard half as an out-of-tree controller of the Crazyflie's firmware, with CONFIG_CONTROLLER_OOT.
 *
 *     ortilo export nominal_imu_uwb --target cortex-m4 --out half
 *
 * Put the folder beside this file in an app-layer project and add half/ortilo.c and half/ortilo_elements.o to its Kbuild.
 * It is a skeleton: export your own vehicle's scenario first, with its anchors, and say there what your ranging deck
 * tells. Nobody has flown it.
 */
#include <string.h>

#include "controller.h"
#include "ortilo.h"

#define RADIANS (3.14159265358979f / 180.0f)
#define RATE 30 /* ticks a second, of the scenario */
#define G 9.81f

/* The newest ranges of your deck: fill in distances [m], in the order of the room, and return how many there are. */
int ortilo_ranges(double *ranges, double *there);

static ortilo half;
static ortilo_inputs inputs;
static ortilo_outputs outputs;
static int64_t tick;

void controllerOutOfTreeInit(void) {
    ortilo_init(&half, NULL);
    tick = 0;
}

bool controllerOutOfTreeTest(void) { return true; }

void controllerOutOfTree(control_t *control, const setpoint_t *setpoint, const sensorData_t *sensors,
                         const state_t *state, const stabilizerStep_t step) {
    (void)setpoint; /* the half flies the path that was exported */
    if ((int64_t)step * RATE / RATE_MAIN_LOOP >= tick) {
        memset(&inputs, 0, sizeof inputs);
        inputs.imu.arrived = 1.0;
        inputs.imu.stamp = (double)tick / RATE;
        inputs.imu.angles[0] = state->attitude.roll * RADIANS;
        inputs.imu.angles[1] = -state->attitude.pitch * RADIANS; /* the firmware's pitch is positive nose up */
        inputs.imu.angles[2] = state->attitude.yaw * RADIANS;
        for (int i = 0; i < 3; i++) {
            inputs.imu.rates[i] = sensors->gyro.axis[i] * RADIANS;
            inputs.imu.force[i] = sensors->acc.axis[i] * G;
        }
        inputs.uwb.arrived = ortilo_ranges(inputs.uwb.ranges, inputs.uwb.there) > 0;
        inputs.uwb.stamp = (double)tick / RATE;
        ortilo_tick(&half, &inputs, &outputs); /* 0; else functions had to stop: your failsafe's time */
        tick++;
    }
    control->controlMode = controlModeForceTorque;
    control->thrustSi = (float)outputs.control[0];
    control->torqueX = (float)outputs.control[1];
    control->torqueY = (float)outputs.control[2];
    control->torqueZ = (float)outputs.control[3];
}
