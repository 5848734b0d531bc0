/* Processor time per message in C: `cost publish|read COUNT DOMAIN` prints nanoseconds. See cost.py. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <thetabus.h>

/* Time that this thread has run in ns, proc_pid_schedstat. */
static double used_ns(void) {
    double used = 0.0;
    FILE *file = fopen("/proc/self/schedstat", "r");
    if (file == NULL || fscanf(file, "%lf", &used) != 1)
        exit(2);
    fclose(file);
    return used;
}

static void check(int32_t code) {
    if (code != THETABUS_OK) {
        fprintf(stderr, "%s\n", thetabus_last_error());
        exit(1);
    }
}

int main(int count, char **arguments) {
    if (count != 4)
        return 2;
    const long messages = atol(arguments[2]);
    thetabus_sample_t sample;
    double begun, used, sum = 0.0;
    if (strcmp(arguments[1], "publish") == 0) {
        thetabus_machine_t *machine;
        check(thetabus_machine_open(arguments[3], NULL, 2, 1, 20000, &machine));
        begun = used_ns();
        for (long k = 0; k < messages; k++) {
            memset(&sample, 0, sizeof sample);
            sample.signals = THETABUS_Q | THETABUS_INPUT;
            sample.t_ns = (uint64_t)k * 1000000u;
            sample.q[0] = sample.q[1] = 1e-3 * (double)k;
            check(thetabus_machine_publish(machine, &sample));
        }
        used = used_ns() - begun;
        thetabus_machine_close(machine);
    } else {
        thetabus_samples_t *samples;
        check(thetabus_samples_open(arguments[3], NULL, &samples));
        check(thetabus_samples_next(samples, &sample, NULL, -1));
        begun = used_ns();
        for (long k = 1; k < messages; k++) {
            check(thetabus_samples_next(samples, &sample, NULL, -1));
            sum += sample.q[0];
        }
        used = used_ns() - begun;
        thetabus_samples_close(samples);
        if (!(sum > 0.0))
            return 1;
    }
    printf("%g\n", used / (double)messages);
    return 0;
}
