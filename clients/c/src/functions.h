/* ---- codes ---- */

#define THETABUS_OK 0
#define THETABUS_TIMEOUT 1 /* nothing came within the limit */
#define THETABUS_ERROR 2   /* the bus failed: thetabus_last_error() says what to do */
#define THETABUS_INVALID 3 /* a wrong argument */
#define THETABUS_REFUSED 4 /* the identifier refused a command, or could not do it */

/* Words of the last error of this thread, never NULL; they stay until the next error. */
const char *thetabus_last_error(void);
/* "0.2.0" */
const char *thetabus_version(void);
uint32_t thetabus_schema_version(void);
/* CLOCK_MONOTONIC in ns. */
uint64_t thetabus_monotonic_ns(void);

/* ---- readers ----
 *
 * `domain` and `robot` may be NULL: "default" and "arm". Programs may start in any order. `next` waits `timeout_ms`
 * at most, for ever if it is below 0, and gives a copy of the message; `sent_ns`, the clock at sending, may be NULL. The last
 * estimate, status and description before a reader joined come first. A handle belongs to one thread at a time. */

typedef struct thetabus_estimates thetabus_estimates_t;
int32_t thetabus_estimates_open(const char *domain, const char *robot, thetabus_estimates_t **out);
int32_t thetabus_estimates_next(thetabus_estimates_t *reader, thetabus_estimate_t *out, uint64_t *sent_ns, int32_t timeout_ms);
void thetabus_estimates_close(thetabus_estimates_t *reader);

typedef struct thetabus_statuses thetabus_statuses_t;
int32_t thetabus_statuses_open(const char *domain, const char *robot, thetabus_statuses_t **out);
int32_t thetabus_statuses_next(thetabus_statuses_t *reader, thetabus_status_t *out, uint64_t *sent_ns, int32_t timeout_ms);
void thetabus_statuses_close(thetabus_statuses_t *reader);

typedef struct thetabus_descriptions thetabus_descriptions_t;
int32_t thetabus_descriptions_open(const char *domain, const char *robot, thetabus_descriptions_t **out);
int32_t thetabus_descriptions_next(thetabus_descriptions_t *reader, thetabus_description_t *out, uint64_t *sent_ns, int32_t timeout_ms);
void thetabus_descriptions_close(thetabus_descriptions_t *reader);

typedef struct thetabus_samples thetabus_samples_t;
int32_t thetabus_samples_open(const char *domain, const char *robot, thetabus_samples_t **out);
int32_t thetabus_samples_next(thetabus_samples_t *reader, thetabus_sample_t *out, uint64_t *sent_ns, int32_t timeout_ms);
void thetabus_samples_close(thetabus_samples_t *reader);

typedef struct thetabus_commands thetabus_commands_t;
int32_t thetabus_commands_open(const char *domain, const char *robot, thetabus_commands_t **out);
int32_t thetabus_commands_next(thetabus_commands_t *reader, thetabus_machine_command_t *out, uint64_t *sent_ns, int32_t timeout_ms);
void thetabus_commands_close(thetabus_commands_t *reader);

/* 1 if parameter `index`, from 0, may be used, else 0: the rule for taking a value by itself. */
int32_t thetabus_is_usable(const thetabus_estimate_t *estimate, uint32_t index);
/* Index of the parameter of this name, from 0, or -1. */
int32_t thetabus_find_parameter(const thetabus_description_t *description, const char *name);

/* ---- a machine ----
 *
 * Takes the place of the plant of a robot, with 1 to 8 joints; there is one per robot and domain. With `consumers` above 0, for
 * a simulation, it waits until so many programs listen, and for the slowest of them at each sample, `timeout_ms` at most; 0, for a
 * real machine: never. */

typedef struct thetabus_machine thetabus_machine_t;
int32_t thetabus_machine_open(const char *domain, const char *robot, uint32_t joints, uint32_t consumers, int32_t timeout_ms, thetabus_machine_t **out);
/* Sends a sample. Set `signals`, their arrays, `t_ns` (UINT64_MAX: now) and `flags`; the rest is filled in. Bits of `signals`: */
#define THETABUS_Q 1u
#define THETABUS_DQ 2u
#define THETABUS_DDQ 4u
#define THETABUS_DDDQ 8u
#define THETABUS_SETPOINT 16u
#define THETABUS_INPUT 32u
/* The flag of the last sample of a stream. */
#define THETABUS_END 1u
int32_t thetabus_machine_publish(thetabus_machine_t *machine, thetabus_sample_t *sample);
/* Counts samples that could not be measured, so that readers know. */
int32_t thetabus_machine_skip(thetabus_machine_t *machine, uint64_t samples);
/* Gives consumers a moment to take what was sent, then leaves. */
void thetabus_machine_close(thetabus_machine_t *machine);

/* ---- a controller ----
 *
 * Sends feed-forward to the machine in answer to its samples; there is one per robot and domain. Set `stream_id`, `seq` and `joints` as in the
 * sample, `until_ns` a few sample periods behind its `t_ns`, and `feed_forward` within the input's limits. */

typedef struct thetabus_controller thetabus_controller_t;
int32_t thetabus_controller_open(const char *domain, const char *robot, thetabus_controller_t **out);
int32_t thetabus_controller_send(thetabus_controller_t *controller, const thetabus_machine_command_t *command);
void thetabus_controller_close(thetabus_controller_t *controller);

/* ---- commands to the identifier ---- */

#define THETABUS_PAUSE 1u
#define THETABUS_RESUME 2u
#define THETABUS_RESET 3u
#define THETABUS_SET 4u
#define THETABUS_FIX 5u
#define THETABUS_FREE 6u
#define THETABUS_SAVE 7u
#define THETABUS_DESCRIBE 8u

typedef struct thetabus_control thetabus_control_t;
/* Finds the identifier of a robot. */
int32_t thetabus_control_open(const char *domain, const char *robot, thetabus_control_t **out);
/* Sends a command and waits for its answer. `name`: tunable or parameter, may be NULL. `value`: NAN for none. `from_seq`: not
 * before this sample, 0 for the next border between two blocks. `out` may be NULL. THETABUS_REFUSED: its words are in
 * thetabus_last_error(). */
int32_t thetabus_control_ask(thetabus_control_t *control, uint32_t command, const char *name, double value, uint64_t from_seq, thetabus_response_t *out, int32_t timeout_ms);
/* Says what the flange of a robot carries, instead of letting it be found; a mass of 0 is an empty flange. `center_m`: centre of
 * mass in the flange's frame, NULL for its origin. `inertia_kg_m2`: about the centre of mass in the flange's axes, xx, xy, yy, xz,
 * yz, zz, NULL for that of a ball of light metal. THETABUS_REFUSED if no body can have these values, or the model has no payload. */
int32_t thetabus_control_payload(thetabus_control_t *control, double mass_kg, const double center_m[3], const double inertia_kg_m2[6], thetabus_response_t *out, int32_t timeout_ms);
void thetabus_control_close(thetabus_control_t *control);
