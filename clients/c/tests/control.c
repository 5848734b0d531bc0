/* Commands to an identifier, and a controller, as a C program sees them; beside a running identifier and plant of the paper's arm. */
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <thetabus.h>

#define CHECK(condition)                                                                                               \
    do {                                                                                                               \
        if (!(condition)) {                                                                                            \
            fprintf(stderr, "line %d: %s; last error: %s\n", __LINE__, #condition, thetabus_last_error());             \
            return 1;                                                                                                  \
        }                                                                                                              \
    } while (0)

static thetabus_response_t answer;

static int commands(const char *domain) {
    thetabus_control_t *control;
    CHECK(thetabus_control_open(domain, NULL, &control) == THETABUS_OK);
    CHECK(thetabus_control_ask(control, THETABUS_DESCRIBE, NULL, NAN, 0, &answer, 3000) == THETABUS_OK);
    CHECK(answer.items_len > 9 && strcmp(answer.items[0].name, "theta_1") == 0);
    CHECK(thetabus_control_ask(control, THETABUS_FIX, "theta_9", 1.0, 0, &answer, 3000) == THETABUS_OK);
    CHECK(thetabus_control_ask(control, THETABUS_FREE, "theta_9", NAN, 0, NULL, 3000) == THETABUS_OK);
    CHECK(thetabus_control_ask(control, THETABUS_SET, "forgetting_factor", 7.0, 0, NULL, 3000) == THETABUS_REFUSED);
    CHECK(strstr(thetabus_last_error(), "forgetting_factor") != NULL);
    CHECK(thetabus_control_ask(control, THETABUS_FIX, "theta_99", 1.0, 0, NULL, 3000) == THETABUS_REFUSED);
    CHECK(strstr(thetabus_last_error(), "theta_99") != NULL);
    const double center[3] = {0.0, 0.0, 0.1};
    CHECK(thetabus_control_payload(control, 2.0, center, NULL, &answer, 3000) == THETABUS_REFUSED);
    CHECK(strstr(thetabus_last_error(), "this model has none") != NULL);
    CHECK(thetabus_control_payload(NULL, 0.0, NULL, NULL, NULL, 3000) == THETABUS_INVALID);
    CHECK(thetabus_control_ask(control, 11 /* payload, which has a function of its own */, NULL, NAN, 0, NULL, 3000) == THETABUS_INVALID);
    CHECK(strstr(thetabus_last_error(), "thetabus_control_payload()") != NULL);
    CHECK(thetabus_control_ask(control, 77, NULL, NAN, 0, NULL, 3000) == THETABUS_INVALID);
    CHECK(thetabus_control_ask(NULL, THETABUS_PAUSE, NULL, NAN, 0, NULL, 3000) == THETABUS_INVALID);
    thetabus_control_close(control);
    return 0;
}

static int controller(const char *domain) {
    thetabus_controller_t *first, *second;
    thetabus_samples_t *samples;
    thetabus_commands_t *sent;
    thetabus_sample_t sample;
    thetabus_machine_command_t command, seen;
    CHECK(thetabus_commands_open(domain, NULL, &sent) == THETABUS_OK);
    CHECK(thetabus_controller_open(domain, NULL, &first) == THETABUS_OK);
    CHECK(thetabus_controller_open(domain, NULL, &second) == THETABUS_ERROR);
    CHECK(strstr(thetabus_last_error(), "controller") != NULL);
    CHECK(thetabus_controller_send(first, NULL) == THETABUS_INVALID);
    CHECK(thetabus_samples_open(domain, NULL, &samples) == THETABUS_OK);
    for (int k = 0; k < 50; k++) {
        CHECK(thetabus_samples_next(samples, &sample, NULL, 10000) == THETABUS_OK);
        memset(&command, 0, sizeof command);
        command.stream_id = sample.stream_id;
        command.seq = sample.seq;
        command.joints = sample.joints;
        command.until_ns = sample.t_ns + 10000000u;
        command.feed_forward[0] = 0.25 * k;
        command.feed_forward[1] = -1.5;
        CHECK(thetabus_controller_send(first, &command) == THETABUS_OK);
        CHECK(thetabus_commands_next(sent, &seen, NULL, 10000) == THETABUS_OK);
        CHECK(memcmp(&seen, &command, sizeof seen) == 0);
    }
    thetabus_samples_close(samples);
    thetabus_commands_close(sent);
    thetabus_controller_close(first);
    CHECK(thetabus_controller_open(domain, NULL, &second) == THETABUS_OK);
    thetabus_controller_close(second);
    return 0;
}

int main(int count, char **arguments) {
    const char *domain = count > 1 ? arguments[1] : "default";
    return commands(domain) || controller(domain);
}
