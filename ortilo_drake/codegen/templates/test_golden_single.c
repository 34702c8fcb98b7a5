/* Plays golden.h through the exported half: its estimate must be that of doubles within 1 mm and 0.1 degree. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "golden.h"
#include "ortilo.h"

static float largest(const float *values, const uint32_t *wanted, int from, int to) {
    float found = 0.0f;
    for (int i = from; i < to; i++) {
        float value;
        memcpy(&value, &wanted[i], sizeof value);
        value = fabsf(values[i] - value);
        if (!(value <= found)) found = value;
        if (found != found) break; /* NaN stays */
    }
    return found;
}

int main(void) {
    static ortilo half, resumed;
    static ortilo_inputs inputs;
    static ortilo_outputs outputs, again;
    int differ = 0, stopped = 0;
    float metres = 0.0f, radians = 0.0f;
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
        const float far = largest(outputs.estimate, golden_estimate[k], 0, 3);
        const float turned = largest(outputs.estimate, golden_estimate[k], 3, 6);
        differ += !(far <= 1e-3f) || !(turned <= 1.745329e-3f);
        if (!(far <= metres)) metres = far;
        if (!(turned <= radians)) radians = turned;
    }
    printf("%d of %d ticks differ; at most %d um, %d urad\n", differ, TICKS, (int)(metres * 1e6f), (int)(radians * 1e6f));
    if (stopped != 0) printf("functions stopped %d times: is ORTILO_ROOM too small?\n", stopped);
    return differ != 0;
}
