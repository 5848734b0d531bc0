/* Prints the version of the library, and fails if it is not the header's or if the bus does not work. */
#include <stdio.h>
#include <thetabus.h>

int main(int count, char **arguments) {
    thetabus_statuses_t *statuses;
    thetabus_status_t status;
    if (thetabus_schema_version() != THETABUS_SCHEMA_VERSION) {
        fprintf(stderr, "schema %u, but the header has %u\n", thetabus_schema_version(), THETABUS_SCHEMA_VERSION);
        return 1;
    }
    if (count != 2 || thetabus_statuses_open(arguments[1], NULL, &statuses) != THETABUS_OK) {
        fprintf(stderr, "%s\n", thetabus_last_error());
        return 1;
    }
    if (thetabus_statuses_next(statuses, &status, NULL, 10) != THETABUS_TIMEOUT)
        return 1;
    thetabus_statuses_close(statuses);
    printf("%s\n", thetabus_version());
    return 0;
}
