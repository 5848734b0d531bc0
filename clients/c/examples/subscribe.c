/* Prints what may be used of each estimate. Ctrl-C ends it; the optional arguments are the domain, the robot, and after how many estimates it ends. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <thetabus.h>

int main(int count, char **arguments) {
    const char *domain = count > 1 ? arguments[1] : "default";
    const char *robot = count > 2 ? arguments[2] : "arm";
    long left = count > 3 ? atol(arguments[3]) : -1;
    static thetabus_description_t names;
    thetabus_descriptions_t *descriptions;
    thetabus_estimates_t *estimates;
    if (thetabus_descriptions_open(domain, robot, &descriptions) != THETABUS_OK ||
        thetabus_estimates_open(domain, robot, &estimates) != THETABUS_OK) {
        fprintf(stderr, "%s\n", thetabus_last_error());
        return 1;
    }
    memset(&names, 0, sizeof names);
    while (left != 0) {
        thetabus_estimate_t e;
        int32_t code = thetabus_estimates_next(estimates, &e, NULL, -1);
        if (code != THETABUS_OK) {
            fprintf(stderr, "%s\n", thetabus_last_error());
            return 1;
        }
        /* The identifier sends its names before its first estimate, and again when it starts anew. */
        while (thetabus_descriptions_next(descriptions, &names, NULL, names.model_hash == e.model_hash ? 0 : 1000) == THETABUS_OK) {
        }
        printf("block %llu at %.3f s:", (unsigned long long)e.block, 1e-9 * (double)e.t_last_ns);
        for (uint32_t i = 0; i < e.params; i++)
            if (thetabus_is_usable(&e, i) && names.model_hash == e.model_hash)
                printf("  %s = %.17g +- %.2g %s", names.parameter[i].name, e.theta[i], e.theta_std[i], names.parameter[i].unit);
        printf("\n");
        fflush(stdout);
        left -= left > 0;
    }
    thetabus_estimates_close(estimates);
    thetabus_descriptions_close(descriptions);
    return 0;
}
