/* Plays golden.h through the exported half: every bit of control, estimate and covariance must be Python's. */
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "golden.h"
#include "ortilo.h"

static uint64_t hash(const double *values, size_t count) {
    uint64_t found = UINT64_C(1469598103934665603);
    for (size_t i = 0; i < count; i++) {
        uint64_t word;
        memcpy(&word, &values[i], sizeof word);
        found = (found ^ word) * UINT64_C(1099511628211);
    }
    return found;
}

int main(void) {
    static ortilo half, resumed;
    static ortilo_inputs inputs;
    static ortilo_outputs outputs, again;
    int differ = 0, stopped = 0;
    ortilo_init(&half, NULL);
    for (int k = 0; k < TICKS; k++) {
        memcpy(&inputs, golden_inputs[k], sizeof inputs);
        if (k == TICKS / 2) { /* a copy of the state is all that is needed to go on */
            ortilo_init(&resumed, NULL);
            resumed.state = half.state;
        }
        stopped += ortilo_tick(&half, &inputs, &outputs);
        if (k >= TICKS / 2) {
            ortilo_tick(&resumed, &inputs, &again);
            differ += memcmp(&outputs, &again, sizeof outputs) != 0;
        }
        differ += memcmp(outputs.control, golden_control[k], sizeof outputs.control) != 0 ||
                  memcmp(outputs.estimate, golden_estimate[k], sizeof outputs.estimate) != 0 ||
                  hash(outputs.covariance, sizeof outputs.covariance / sizeof(double)) != golden_covariance[k];
    }
    printf("%d of %d ticks differ\n", differ, TICKS);
    if (stopped != 0) printf("functions stopped %d times: is ORTILO_ROOM too small?\n", stopped);
    return differ != 0;
}
