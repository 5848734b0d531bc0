/* A machine of one's own on the bus, in place of the simulator: a pendulum, J = 2.5 kg m^2, d = 0.8 N m s/rad, w = 12 N m, pushed by a
 * torque that is held from sample to sample, its angle read from an encoder of 16 bits. On a real machine, read the drive where this one
 * computes, and leave `consumers` at 0. The optional arguments are the seconds, the domain, the robot, and `fast` for a simulation that waits for one
 * consumer instead of the clock. */
#define _POSIX_C_SOURCE 200112L /* clock_nanosleep, also with -std=c11 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <thetabus.h>
#include <time.h>

int main(int count, char **arguments) {
    const double seconds = count > 1 ? atof(arguments[1]) : 30.0;
    const char *domain = count > 2 ? arguments[2] : "default";
    const char *robot = count > 3 ? arguments[3] : "arm";
    const int fast = count > 4 && strcmp(arguments[4], "fast") == 0;
    const double tau = 6.283185307179586;
    thetabus_machine_t *machine;
    if (thetabus_machine_open(domain, robot, 1, fast ? 1 : 0, 10000, &machine) != THETABUS_OK) {
        fprintf(stderr, "%s\n", thetabus_last_error());
        return 1;
    }
    double q = 0.3, dq = 0.0;
    struct timespec due;
    clock_gettime(CLOCK_MONOTONIC, &due);
    const long samples = (long)(seconds * 1e3);
    for (long k = 0; k < samples; k++) {
        const double t = 1e-3 * (double)k;
        const double torque = 6.0 * sin(1.3 * t) + 4.0 * sin(7.1 * t) + 2.0 * cos(17.0 * t);
        thetabus_sample_t sample;
        memset(&sample, 0, sizeof sample);
        sample.t_ns = (uint64_t)k * 1000000u;
        sample.signals = THETABUS_Q | THETABUS_INPUT;
        sample.q[0] = round(q * 65536.0 / tau) * tau / 65536.0;
        sample.input[0] = torque;
        if (k + 1 == samples)
            sample.flags = THETABUS_END;
        if (!fast) {
            clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, NULL);
            due.tv_nsec += 1000000;
            if (due.tv_nsec >= 1000000000) {
                due.tv_nsec -= 1000000000;
                due.tv_sec += 1;
            }
        }
        if (thetabus_machine_publish(machine, &sample) != THETABUS_OK) {
            fprintf(stderr, "%s\n", thetabus_last_error());
            return 1;
        }
        for (int i = 0; i < 100; i++) {
            dq += 1e-5 * (torque - 0.8 * dq - 12.0 * sin(q)) / 2.5;
            q += 1e-5 * dq;
        }
    }
    thetabus_machine_close(machine);
    return 0;
}
