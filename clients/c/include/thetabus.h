/* thetabus for C: read estimates, publish samples, send commands.
 *
 * Generated from the tables of fields: THETABUS_WRITE=1 cargo test -p thetabus-c --test header
 * Units are SI and radians; {position}, {input}, {parameter}, {derived} stand for what the description tells. */
#ifndef THETABUS_H
#define THETABUS_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
#define THETABUS_CHECK(condition, words) static_assert(condition, words)
extern "C" {
#else
#define THETABUS_CHECK(condition, words) _Static_assert(condition, words)
#endif

#define THETABUS_SCHEMA_VERSION 3

/* ---- messages ---- */

typedef struct thetabus_header {
    uint32_t schema; /* Schema version of the sender */
    uint32_t flags; /* Bit 0: sent before, and may have reached this reader then */
    uint64_t sent_ns; /* CLOCK_MONOTONIC at sending; latency is measured from it [ns] */
} thetabus_header_t;
THETABUS_CHECK(sizeof(thetabus_header_t) == 16, "thetabus_header_t has another size");
THETABUS_CHECK(offsetof(thetabus_header_t, schema) == 0, "thetabus_header_t.schema has another place");
THETABUS_CHECK(offsetof(thetabus_header_t, flags) == 4, "thetabus_header_t.flags has another place");
THETABUS_CHECK(offsetof(thetabus_header_t, sent_ns) == 8, "thetabus_header_t.sent_ns has another place");

typedef struct thetabus_sample {
    uint64_t stream_id; /* Random number drawn at each start of the publisher, never 0 */
    uint64_t seq; /* Counts from 0, one per sample period */
    uint64_t t_ns; /* Stream time: simulated time, or CLOCK_MONOTONIC on a machine [ns] */
    uint32_t flags; /* Bit 0: last sample of the stream; bit 1: of a replay */
    uint32_t joints; /* Number of joints, 1 to 8 */
    uint32_t signals; /* Which arrays hold data: bits 0 to 5 are q, dq, ddq, dddq, setpoint, input */
    uint32_t pad; /* Zero */
    double q[8]; /* Position [{position}] */
    double dq[8]; /* Velocity [{position}/s] */
    double ddq[8]; /* Acceleration [{position}/s^2] */
    double dddq[8]; /* Jerk [{position}/s^3] */
    double setpoint[8]; /* Commanded position [{position}] */
    double input[8]; /* Drive's input: voltage, current, torque or force, as the description says [{input}] */
} thetabus_sample_t;
THETABUS_CHECK(sizeof(thetabus_sample_t) == 424, "thetabus_sample_t has another size");
THETABUS_CHECK(offsetof(thetabus_sample_t, stream_id) == 0, "thetabus_sample_t.stream_id has another place");
THETABUS_CHECK(offsetof(thetabus_sample_t, seq) == 8, "thetabus_sample_t.seq has another place");
THETABUS_CHECK(offsetof(thetabus_sample_t, t_ns) == 16, "thetabus_sample_t.t_ns has another place");
THETABUS_CHECK(offsetof(thetabus_sample_t, flags) == 24, "thetabus_sample_t.flags has another place");
THETABUS_CHECK(offsetof(thetabus_sample_t, joints) == 28, "thetabus_sample_t.joints has another place");
THETABUS_CHECK(offsetof(thetabus_sample_t, signals) == 32, "thetabus_sample_t.signals has another place");
THETABUS_CHECK(offsetof(thetabus_sample_t, pad) == 36, "thetabus_sample_t.pad has another place");
THETABUS_CHECK(offsetof(thetabus_sample_t, q) == 40, "thetabus_sample_t.q has another place");
THETABUS_CHECK(offsetof(thetabus_sample_t, dq) == 104, "thetabus_sample_t.dq has another place");
THETABUS_CHECK(offsetof(thetabus_sample_t, ddq) == 168, "thetabus_sample_t.ddq has another place");
THETABUS_CHECK(offsetof(thetabus_sample_t, dddq) == 232, "thetabus_sample_t.dddq has another place");
THETABUS_CHECK(offsetof(thetabus_sample_t, setpoint) == 296, "thetabus_sample_t.setpoint has another place");
THETABUS_CHECK(offsetof(thetabus_sample_t, input) == 360, "thetabus_sample_t.input has another place");

typedef struct thetabus_estimate {
    uint64_t stream_id; /* stream_id of the samples */
    uint64_t block; /* Number of the block, the paper's m: seq div N + 1 */
    uint64_t t_first_ns; /* Stream time of the first sample of the block [ns] */
    uint64_t t_last_ns; /* Stream time of the last sample of the block [ns] */
    uint64_t model_hash; /* Identifies the model: name, parameters, equations */
    uint64_t config_hash; /* Identifies the configuration that determines estimates */
    uint64_t accepted; /* Samples used since the start of the stream */
    uint64_t missing; /* Samples lost since the start of the stream, gaps in seq */
    uint64_t rejected; /* Samples refused since the start of the stream: not finite, out of range, out of order */
    uint64_t excited[2]; /* Parameters about which the block's data are informative */
    uint64_t usable[2]; /* Parameters known from data well enough to be used, if use_ok is 1, too */
    uint64_t fixed[2]; /* Parameters held by configuration or command */
    uint64_t t_change_ns; /* Located stream time of the last change, 0 if none was found [ns] */
    uint32_t state; /* 0 collecting, 1 converging, 2 converged, 3 paused, 4 poorly excited, 5 changing, 6 degraded, 7 invalid, 9 misfit */
    uint32_t use_ok; /* 1 if controllers may use what is marked in usable, else 0 */
    uint32_t flags; /* Bits: 0 changed, 1 incomplete, 2 held, 3 warm, 4 commanded, 5 sensor */
    uint32_t params; /* Number of parameters, at most 128 */
    uint32_t equations; /* Number of equations, at most 8 */
    uint32_t derived_len; /* Number of derived values, at most 32 */
    uint32_t iterations; /* Gauss-Newton iterations of this block */
    uint32_t outliers; /* Rows of this block treated as outliers, and samples replaced because they were spikes */
    double condition; /* Condition number of the column-scaled information, inf if singular */
    double innovation_rms[8]; /* Root mean square of the innovation f(theta before the update) */
    double residual_rms[8]; /* Root mean square of the residual f(theta after the update) */
    double fit[8]; /* chi^2 of the whitened residuals over their number: 1 on average if the block fits */
    double explained[8]; /* Share of the signal's power that the model explains, in the last block in which the signal stood out of the noise */
    double fit_probability; /* Probability of residuals as large as these, in the block or in its last part, if the model is right: below 2e-4 it is a misfit */
    double theta[128]; /* Estimate [{parameter}] */
    double theta_std[128]; /* Standard deviation of the estimate, NaN if the estimator gives none [{parameter}] */
    double derived[32]; /* Value computed from the estimate [{derived}] */
    double derived_std[32]; /* Its standard deviation, NaN if it is not known [{derived}] */
} thetabus_estimate_t;
THETABUS_CHECK(sizeof(thetabus_estimate_t) == 2992, "thetabus_estimate_t has another size");
THETABUS_CHECK(offsetof(thetabus_estimate_t, stream_id) == 0, "thetabus_estimate_t.stream_id has another place");
THETABUS_CHECK(offsetof(thetabus_estimate_t, block) == 8, "thetabus_estimate_t.block has another place");
THETABUS_CHECK(offsetof(thetabus_estimate_t, t_first_ns) == 16, "thetabus_estimate_t.t_first_ns has another place");
THETABUS_CHECK(offsetof(thetabus_estimate_t, t_last_ns) == 24, "thetabus_estimate_t.t_last_ns has another place");
THETABUS_CHECK(offsetof(thetabus_estimate_t, model_hash) == 32, "thetabus_estimate_t.model_hash has another place");
THETABUS_CHECK(offsetof(thetabus_estimate_t, config_hash) == 40, "thetabus_estimate_t.config_hash has another place");
THETABUS_CHECK(offsetof(thetabus_estimate_t, accepted) == 48, "thetabus_estimate_t.accepted has another place");
THETABUS_CHECK(offsetof(thetabus_estimate_t, missing) == 56, "thetabus_estimate_t.missing has another place");
THETABUS_CHECK(offsetof(thetabus_estimate_t, rejected) == 64, "thetabus_estimate_t.rejected has another place");
THETABUS_CHECK(offsetof(thetabus_estimate_t, excited) == 72, "thetabus_estimate_t.excited has another place");
THETABUS_CHECK(offsetof(thetabus_estimate_t, usable) == 88, "thetabus_estimate_t.usable has another place");
THETABUS_CHECK(offsetof(thetabus_estimate_t, fixed) == 104, "thetabus_estimate_t.fixed has another place");
THETABUS_CHECK(offsetof(thetabus_estimate_t, t_change_ns) == 120, "thetabus_estimate_t.t_change_ns has another place");
THETABUS_CHECK(offsetof(thetabus_estimate_t, state) == 128, "thetabus_estimate_t.state has another place");
THETABUS_CHECK(offsetof(thetabus_estimate_t, use_ok) == 132, "thetabus_estimate_t.use_ok has another place");
THETABUS_CHECK(offsetof(thetabus_estimate_t, flags) == 136, "thetabus_estimate_t.flags has another place");
THETABUS_CHECK(offsetof(thetabus_estimate_t, params) == 140, "thetabus_estimate_t.params has another place");
THETABUS_CHECK(offsetof(thetabus_estimate_t, equations) == 144, "thetabus_estimate_t.equations has another place");
THETABUS_CHECK(offsetof(thetabus_estimate_t, derived_len) == 148, "thetabus_estimate_t.derived_len has another place");
THETABUS_CHECK(offsetof(thetabus_estimate_t, iterations) == 152, "thetabus_estimate_t.iterations has another place");
THETABUS_CHECK(offsetof(thetabus_estimate_t, outliers) == 156, "thetabus_estimate_t.outliers has another place");
THETABUS_CHECK(offsetof(thetabus_estimate_t, condition) == 160, "thetabus_estimate_t.condition has another place");
THETABUS_CHECK(offsetof(thetabus_estimate_t, innovation_rms) == 168, "thetabus_estimate_t.innovation_rms has another place");
THETABUS_CHECK(offsetof(thetabus_estimate_t, residual_rms) == 232, "thetabus_estimate_t.residual_rms has another place");
THETABUS_CHECK(offsetof(thetabus_estimate_t, fit) == 296, "thetabus_estimate_t.fit has another place");
THETABUS_CHECK(offsetof(thetabus_estimate_t, explained) == 360, "thetabus_estimate_t.explained has another place");
THETABUS_CHECK(offsetof(thetabus_estimate_t, fit_probability) == 424, "thetabus_estimate_t.fit_probability has another place");
THETABUS_CHECK(offsetof(thetabus_estimate_t, theta) == 432, "thetabus_estimate_t.theta has another place");
THETABUS_CHECK(offsetof(thetabus_estimate_t, theta_std) == 1456, "thetabus_estimate_t.theta_std has another place");
THETABUS_CHECK(offsetof(thetabus_estimate_t, derived) == 2480, "thetabus_estimate_t.derived has another place");
THETABUS_CHECK(offsetof(thetabus_estimate_t, derived_std) == 2736, "thetabus_estimate_t.derived_std has another place");

typedef struct thetabus_stream_faults {
    uint64_t gaps; /* Holes in seq; missing counts the samples in them */
    uint64_t duplicates; /* Samples that came twice */
    uint64_t reordered; /* Samples that came after their successor */
    uint64_t clock_jumps; /* Samples whose time does not follow from the one before */
    uint64_t wrong_joints; /* Samples with another number of joints */
    uint64_t wrong_signals; /* Samples without a signal that is needed */
    uint64_t not_finite; /* Samples with NaN, infinity, or a number that no machine has */
    uint64_t saturated; /* Samples whose input lies at the limit of its measurement */
    uint64_t frozen; /* Samples of a signal that does not move although it must */
    uint64_t blocks_held; /* Blocks left out because of saturated or frozen signals */
} thetabus_stream_faults_t;
THETABUS_CHECK(sizeof(thetabus_stream_faults_t) == 80, "thetabus_stream_faults_t has another size");
THETABUS_CHECK(offsetof(thetabus_stream_faults_t, gaps) == 0, "thetabus_stream_faults_t.gaps has another place");
THETABUS_CHECK(offsetof(thetabus_stream_faults_t, duplicates) == 8, "thetabus_stream_faults_t.duplicates has another place");
THETABUS_CHECK(offsetof(thetabus_stream_faults_t, reordered) == 16, "thetabus_stream_faults_t.reordered has another place");
THETABUS_CHECK(offsetof(thetabus_stream_faults_t, clock_jumps) == 24, "thetabus_stream_faults_t.clock_jumps has another place");
THETABUS_CHECK(offsetof(thetabus_stream_faults_t, wrong_joints) == 32, "thetabus_stream_faults_t.wrong_joints has another place");
THETABUS_CHECK(offsetof(thetabus_stream_faults_t, wrong_signals) == 40, "thetabus_stream_faults_t.wrong_signals has another place");
THETABUS_CHECK(offsetof(thetabus_stream_faults_t, not_finite) == 48, "thetabus_stream_faults_t.not_finite has another place");
THETABUS_CHECK(offsetof(thetabus_stream_faults_t, saturated) == 56, "thetabus_stream_faults_t.saturated has another place");
THETABUS_CHECK(offsetof(thetabus_stream_faults_t, frozen) == 64, "thetabus_stream_faults_t.frozen has another place");
THETABUS_CHECK(offsetof(thetabus_stream_faults_t, blocks_held) == 72, "thetabus_stream_faults_t.blocks_held has another place");

typedef struct thetabus_timing {
    uint64_t count; /* How often */
    uint64_t mean_ns; /* Mean [ns] */
    uint64_t p99_ns; /* 99 of 100 took at most this, to 1/16 [ns] */
    uint64_t max_ns; /* Longest [ns] */
} thetabus_timing_t;
THETABUS_CHECK(sizeof(thetabus_timing_t) == 32, "thetabus_timing_t has another size");
THETABUS_CHECK(offsetof(thetabus_timing_t, count) == 0, "thetabus_timing_t.count has another place");
THETABUS_CHECK(offsetof(thetabus_timing_t, mean_ns) == 8, "thetabus_timing_t.mean_ns has another place");
THETABUS_CHECK(offsetof(thetabus_timing_t, p99_ns) == 16, "thetabus_timing_t.p99_ns has another place");
THETABUS_CHECK(offsetof(thetabus_timing_t, max_ns) == 24, "thetabus_timing_t.max_ns has another place");

typedef struct thetabus_process_status {
    uint64_t started_ns; /* When the program began [ns] */
    uint64_t first_sample_ns; /* When its first sample had been processed; 0 before [ns] */
    uint64_t resident_bytes; /* Memory in use (resident set); 0 if it is not known [bytes] */
    uint64_t silent_ns; /* For how long no sample has come, while a stream is open [ns] */
    uint64_t pauses; /* How often a stream was silent for a second or more */
    uint64_t commands; /* Commands that took effect */
    uint64_t refused; /* Requests that were refused */
    uint64_t checkpoints; /* Checkpoints written */
    uint64_t checkpoints_failed; /* Checkpoints that could not be written, or were found unusable */
    uint64_t recorder_missing; /* Samples lost by recorders, as reported by them */
} thetabus_process_status_t;
THETABUS_CHECK(sizeof(thetabus_process_status_t) == 80, "thetabus_process_status_t has another size");
THETABUS_CHECK(offsetof(thetabus_process_status_t, started_ns) == 0, "thetabus_process_status_t.started_ns has another place");
THETABUS_CHECK(offsetof(thetabus_process_status_t, first_sample_ns) == 8, "thetabus_process_status_t.first_sample_ns has another place");
THETABUS_CHECK(offsetof(thetabus_process_status_t, resident_bytes) == 16, "thetabus_process_status_t.resident_bytes has another place");
THETABUS_CHECK(offsetof(thetabus_process_status_t, silent_ns) == 24, "thetabus_process_status_t.silent_ns has another place");
THETABUS_CHECK(offsetof(thetabus_process_status_t, pauses) == 32, "thetabus_process_status_t.pauses has another place");
THETABUS_CHECK(offsetof(thetabus_process_status_t, commands) == 40, "thetabus_process_status_t.commands has another place");
THETABUS_CHECK(offsetof(thetabus_process_status_t, refused) == 48, "thetabus_process_status_t.refused has another place");
THETABUS_CHECK(offsetof(thetabus_process_status_t, checkpoints) == 56, "thetabus_process_status_t.checkpoints has another place");
THETABUS_CHECK(offsetof(thetabus_process_status_t, checkpoints_failed) == 64, "thetabus_process_status_t.checkpoints_failed has another place");
THETABUS_CHECK(offsetof(thetabus_process_status_t, recorder_missing) == 72, "thetabus_process_status_t.recorder_missing has another place");

typedef struct thetabus_realtime_status {
    uint32_t policy; /* Scheduling policy: 0 the system's default, 1 SCHED_FIFO, 2 SCHED_RR */
    uint32_t priority; /* Priority of SCHED_FIFO and SCHED_RR, 1 to 99 */
    uint64_t affinity; /* Bit i: may run on CPU i of the first 64; 0 if no choice was made */
    uint32_t memory_locked; /* 1 if memory is locked */
    uint32_t refused; /* What was asked for and refused: bit 0 priority, 1 affinity, 2 memory */
} thetabus_realtime_status_t;
THETABUS_CHECK(sizeof(thetabus_realtime_status_t) == 24, "thetabus_realtime_status_t has another size");
THETABUS_CHECK(offsetof(thetabus_realtime_status_t, policy) == 0, "thetabus_realtime_status_t.policy has another place");
THETABUS_CHECK(offsetof(thetabus_realtime_status_t, priority) == 4, "thetabus_realtime_status_t.priority has another place");
THETABUS_CHECK(offsetof(thetabus_realtime_status_t, affinity) == 8, "thetabus_realtime_status_t.affinity has another place");
THETABUS_CHECK(offsetof(thetabus_realtime_status_t, memory_locked) == 16, "thetabus_realtime_status_t.memory_locked has another place");
THETABUS_CHECK(offsetof(thetabus_realtime_status_t, refused) == 20, "thetabus_realtime_status_t.refused has another place");

typedef struct thetabus_last_error {
    uint32_t code; /* What went wrong, 0 nothing */
    uint32_t pad; /* Zero */
    uint64_t seq; /* seq of the sample that it happened at */
    char text[112]; /* The same in words */
} thetabus_last_error_t;
THETABUS_CHECK(sizeof(thetabus_last_error_t) == 128, "thetabus_last_error_t has another size");
THETABUS_CHECK(offsetof(thetabus_last_error_t, code) == 0, "thetabus_last_error_t.code has another place");
THETABUS_CHECK(offsetof(thetabus_last_error_t, pad) == 4, "thetabus_last_error_t.pad has another place");
THETABUS_CHECK(offsetof(thetabus_last_error_t, seq) == 8, "thetabus_last_error_t.seq has another place");
THETABUS_CHECK(offsetof(thetabus_last_error_t, text) == 16, "thetabus_last_error_t.text has another place");

typedef struct thetabus_status {
    uint64_t stream_id; /* stream_id of the samples, 0 before the first sample */
    uint64_t accepted; /* Samples used since the start of the stream */
    uint64_t missing; /* Samples lost since the start of the stream */
    uint64_t rejected; /* Samples refused since the start of the stream */
    uint64_t last_seq; /* seq of the last sample received */
    uint64_t last_t_ns; /* Stream time of the last sample used [ns] */
    uint64_t estimates; /* Estimates published since the start of the stream */
    uint64_t last_block; /* Block of the last estimate published, 0 before the first */
    uint64_t streams; /* Streams seen since this process started; one more than the publisher was restarted */
    uint32_t state; /* As in the estimate; 8 ended */
    uint32_t pid; /* Process id of the identifier */
    uint32_t flags; /* Bits: 0 warm, 1 paused, 2 silent, 3 commanded, 4 checkpoints, 5 replay */
    uint32_t pad; /* Zero */
    thetabus_stream_faults_t faults; /* What was wrong with the stream */
    thetabus_timing_t step; /* Computing time of a sample that completes no block */
    thetabus_timing_t block; /* Computing time of a sample that completes a block */
    thetabus_process_status_t process; /* The process */
    thetabus_realtime_status_t realtime; /* Real-time settings */
    double fit; /* chi^2 of the whitened residuals of the last block over their number, the largest of any equation: 1 on average if the block fits */
    double fit_probability; /* Probability of residuals as large as these if the model is right; below 2e-4 it is a misfit */
    double condition; /* Condition number of the column-scaled information after the last block */
    double information_ln; /* Sum of the logarithms of its diagonal over the free parameters: constant, but for noise, once as much is forgotten as is learnt */
    double asymmetry; /* Largest difference across its diagonal, relative to the diagonal: 0, or the recursion loses its symmetry */
    thetabus_last_error_t error; /* What went wrong last */
} thetabus_status_t;
THETABUS_CHECK(sizeof(thetabus_status_t) == 504, "thetabus_status_t has another size");
THETABUS_CHECK(offsetof(thetabus_status_t, stream_id) == 0, "thetabus_status_t.stream_id has another place");
THETABUS_CHECK(offsetof(thetabus_status_t, accepted) == 8, "thetabus_status_t.accepted has another place");
THETABUS_CHECK(offsetof(thetabus_status_t, missing) == 16, "thetabus_status_t.missing has another place");
THETABUS_CHECK(offsetof(thetabus_status_t, rejected) == 24, "thetabus_status_t.rejected has another place");
THETABUS_CHECK(offsetof(thetabus_status_t, last_seq) == 32, "thetabus_status_t.last_seq has another place");
THETABUS_CHECK(offsetof(thetabus_status_t, last_t_ns) == 40, "thetabus_status_t.last_t_ns has another place");
THETABUS_CHECK(offsetof(thetabus_status_t, estimates) == 48, "thetabus_status_t.estimates has another place");
THETABUS_CHECK(offsetof(thetabus_status_t, last_block) == 56, "thetabus_status_t.last_block has another place");
THETABUS_CHECK(offsetof(thetabus_status_t, streams) == 64, "thetabus_status_t.streams has another place");
THETABUS_CHECK(offsetof(thetabus_status_t, state) == 72, "thetabus_status_t.state has another place");
THETABUS_CHECK(offsetof(thetabus_status_t, pid) == 76, "thetabus_status_t.pid has another place");
THETABUS_CHECK(offsetof(thetabus_status_t, flags) == 80, "thetabus_status_t.flags has another place");
THETABUS_CHECK(offsetof(thetabus_status_t, pad) == 84, "thetabus_status_t.pad has another place");
THETABUS_CHECK(offsetof(thetabus_status_t, faults) == 88, "thetabus_status_t.faults has another place");
THETABUS_CHECK(offsetof(thetabus_status_t, step) == 168, "thetabus_status_t.step has another place");
THETABUS_CHECK(offsetof(thetabus_status_t, block) == 200, "thetabus_status_t.block has another place");
THETABUS_CHECK(offsetof(thetabus_status_t, process) == 232, "thetabus_status_t.process has another place");
THETABUS_CHECK(offsetof(thetabus_status_t, realtime) == 312, "thetabus_status_t.realtime has another place");
THETABUS_CHECK(offsetof(thetabus_status_t, fit) == 336, "thetabus_status_t.fit has another place");
THETABUS_CHECK(offsetof(thetabus_status_t, fit_probability) == 344, "thetabus_status_t.fit_probability has another place");
THETABUS_CHECK(offsetof(thetabus_status_t, condition) == 352, "thetabus_status_t.condition has another place");
THETABUS_CHECK(offsetof(thetabus_status_t, information_ln) == 360, "thetabus_status_t.information_ln has another place");
THETABUS_CHECK(offsetof(thetabus_status_t, asymmetry) == 368, "thetabus_status_t.asymmetry has another place");
THETABUS_CHECK(offsetof(thetabus_status_t, error) == 376, "thetabus_status_t.error has another place");

typedef struct thetabus_joint_info {
    char name[64]; /* Name */
    char position_unit[32]; /* Unit of the position: rad or m */
    char input_unit[32]; /* Unit of the input: V, A, N m or N */
} thetabus_joint_info_t;
THETABUS_CHECK(sizeof(thetabus_joint_info_t) == 128, "thetabus_joint_info_t has another size");
THETABUS_CHECK(offsetof(thetabus_joint_info_t, name) == 0, "thetabus_joint_info_t.name has another place");
THETABUS_CHECK(offsetof(thetabus_joint_info_t, position_unit) == 64, "thetabus_joint_info_t.position_unit has another place");
THETABUS_CHECK(offsetof(thetabus_joint_info_t, input_unit) == 96, "thetabus_joint_info_t.input_unit has another place");

typedef struct thetabus_parameter_info {
    char name[64]; /* Short name, as in files and tables */
    char unit[32]; /* SI unit, 1 if there is none */
    char meaning[128]; /* What it is, in a few words */
    double start; /* Value that the identifier starts from [{parameter}] */
    double lower; /* Lower bound, -inf for none [{parameter}] */
    double upper; /* Upper bound, inf for none [{parameter}] */
} thetabus_parameter_info_t;
THETABUS_CHECK(sizeof(thetabus_parameter_info_t) == 248, "thetabus_parameter_info_t has another size");
THETABUS_CHECK(offsetof(thetabus_parameter_info_t, name) == 0, "thetabus_parameter_info_t.name has another place");
THETABUS_CHECK(offsetof(thetabus_parameter_info_t, unit) == 64, "thetabus_parameter_info_t.unit has another place");
THETABUS_CHECK(offsetof(thetabus_parameter_info_t, meaning) == 96, "thetabus_parameter_info_t.meaning has another place");
THETABUS_CHECK(offsetof(thetabus_parameter_info_t, start) == 224, "thetabus_parameter_info_t.start has another place");
THETABUS_CHECK(offsetof(thetabus_parameter_info_t, lower) == 232, "thetabus_parameter_info_t.lower has another place");
THETABUS_CHECK(offsetof(thetabus_parameter_info_t, upper) == 240, "thetabus_parameter_info_t.upper has another place");

typedef struct thetabus_derived_info {
    char name[64]; /* Short name, as in files and tables */
    char unit[32]; /* SI unit, 1 if there is none */
    char meaning[128]; /* What it is, in a few words */
} thetabus_derived_info_t;
THETABUS_CHECK(sizeof(thetabus_derived_info_t) == 224, "thetabus_derived_info_t has another size");
THETABUS_CHECK(offsetof(thetabus_derived_info_t, name) == 0, "thetabus_derived_info_t.name has another place");
THETABUS_CHECK(offsetof(thetabus_derived_info_t, unit) == 64, "thetabus_derived_info_t.unit has another place");
THETABUS_CHECK(offsetof(thetabus_derived_info_t, meaning) == 96, "thetabus_derived_info_t.meaning has another place");

typedef struct thetabus_description {
    char model[64]; /* Name of the model */
    char input_kind[32]; /* Kind of the input: voltage, current, torque or force */
    uint64_t model_hash; /* Identifies the model: name, parameters, equations */
    uint64_t config_hash; /* Identifies the configuration that determines estimates, as the identifier was started with it */
    uint64_t block_len; /* Samples in a block, N, as the identifier was started with it */
    uint64_t sample_period_ns; /* Time from one sample to the next [ns] */
    uint32_t joints; /* Number of joints, 1 to 8 */
    uint32_t equations; /* Number of equations, at most 8 */
    uint32_t params; /* Number of parameters, at most 128 */
    uint32_t derived_len; /* Number of derived values, at most 32 */
    thetabus_joint_info_t joint[8]; /* Joints */
    thetabus_parameter_info_t parameter[128]; /* Parameters, in the order of theta */
    thetabus_derived_info_t derived[32]; /* Derived values, in the order of the estimate */
} thetabus_description_t;
THETABUS_CHECK(sizeof(thetabus_description_t) == 40080, "thetabus_description_t has another size");
THETABUS_CHECK(offsetof(thetabus_description_t, model) == 0, "thetabus_description_t.model has another place");
THETABUS_CHECK(offsetof(thetabus_description_t, input_kind) == 64, "thetabus_description_t.input_kind has another place");
THETABUS_CHECK(offsetof(thetabus_description_t, model_hash) == 96, "thetabus_description_t.model_hash has another place");
THETABUS_CHECK(offsetof(thetabus_description_t, config_hash) == 104, "thetabus_description_t.config_hash has another place");
THETABUS_CHECK(offsetof(thetabus_description_t, block_len) == 112, "thetabus_description_t.block_len has another place");
THETABUS_CHECK(offsetof(thetabus_description_t, sample_period_ns) == 120, "thetabus_description_t.sample_period_ns has another place");
THETABUS_CHECK(offsetof(thetabus_description_t, joints) == 128, "thetabus_description_t.joints has another place");
THETABUS_CHECK(offsetof(thetabus_description_t, equations) == 132, "thetabus_description_t.equations has another place");
THETABUS_CHECK(offsetof(thetabus_description_t, params) == 136, "thetabus_description_t.params has another place");
THETABUS_CHECK(offsetof(thetabus_description_t, derived_len) == 140, "thetabus_description_t.derived_len has another place");
THETABUS_CHECK(offsetof(thetabus_description_t, joint) == 144, "thetabus_description_t.joint has another place");
THETABUS_CHECK(offsetof(thetabus_description_t, parameter) == 1168, "thetabus_description_t.parameter has another place");
THETABUS_CHECK(offsetof(thetabus_description_t, derived) == 32912, "thetabus_description_t.derived has another place");

typedef struct thetabus_machine_command {
    uint64_t stream_id; /* stream_id of the sample that is answered; a command for another stream does not count */
    uint64_t seq; /* seq of that sample; the command holds from the next one on */
    uint64_t until_ns; /* Stream time at which the command expires; the machine then runs on its own loop alone [ns] */
    uint32_t joints; /* Number of joints, 1 to 8 */
    uint32_t pad; /* Zero */
    double feed_forward[8]; /* Input that is added to what the machine's own loop gives [{input}] */
} thetabus_machine_command_t;
THETABUS_CHECK(sizeof(thetabus_machine_command_t) == 96, "thetabus_machine_command_t has another size");
THETABUS_CHECK(offsetof(thetabus_machine_command_t, stream_id) == 0, "thetabus_machine_command_t.stream_id has another place");
THETABUS_CHECK(offsetof(thetabus_machine_command_t, seq) == 8, "thetabus_machine_command_t.seq has another place");
THETABUS_CHECK(offsetof(thetabus_machine_command_t, until_ns) == 16, "thetabus_machine_command_t.until_ns has another place");
THETABUS_CHECK(offsetof(thetabus_machine_command_t, joints) == 24, "thetabus_machine_command_t.joints has another place");
THETABUS_CHECK(offsetof(thetabus_machine_command_t, pad) == 28, "thetabus_machine_command_t.pad has another place");
THETABUS_CHECK(offsetof(thetabus_machine_command_t, feed_forward) == 32, "thetabus_machine_command_t.feed_forward has another place");

typedef struct thetabus_request {
    uint32_t command; /* 1 pause, 2 resume, 3 reset, 4 set, 5 fix, 6 free, 7 save, 8 describe, 9 restore, 10 recorder, 11 payload */
    uint32_t flags; /* Bit 0: `value` is set */
    uint64_t from_seq; /* Not before this sample of the stream; 0: at the next border between two blocks */
    double value; /* Value of a tunable or parameter, in its unit; lost samples of a recorder */
    char name[64]; /* Tunable or parameter */
    uint32_t part; /* Number of this part of a state, from 0 */
    uint32_t parts; /* Parts of the state */
    uint32_t data_len; /* Length of this part; of a payload 80, or 0 for none [bytes] */
    uint32_t stream; /* Tag of the only stream that this is for; 0: for whichever is open, and to stay */
    uint8_t data[1024]; /* The part; of a payload m, hx, hy, hz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz about the flange as float64 */
} thetabus_request_t;
THETABUS_CHECK(sizeof(thetabus_request_t) == 1128, "thetabus_request_t has another size");
THETABUS_CHECK(offsetof(thetabus_request_t, command) == 0, "thetabus_request_t.command has another place");
THETABUS_CHECK(offsetof(thetabus_request_t, flags) == 4, "thetabus_request_t.flags has another place");
THETABUS_CHECK(offsetof(thetabus_request_t, from_seq) == 8, "thetabus_request_t.from_seq has another place");
THETABUS_CHECK(offsetof(thetabus_request_t, value) == 16, "thetabus_request_t.value has another place");
THETABUS_CHECK(offsetof(thetabus_request_t, name) == 24, "thetabus_request_t.name has another place");
THETABUS_CHECK(offsetof(thetabus_request_t, part) == 88, "thetabus_request_t.part has another place");
THETABUS_CHECK(offsetof(thetabus_request_t, parts) == 92, "thetabus_request_t.parts has another place");
THETABUS_CHECK(offsetof(thetabus_request_t, data_len) == 96, "thetabus_request_t.data_len has another place");
THETABUS_CHECK(offsetof(thetabus_request_t, stream) == 100, "thetabus_request_t.stream has another place");
THETABUS_CHECK(offsetof(thetabus_request_t, data) == 104, "thetabus_request_t.data has another place");

typedef struct thetabus_item {
    uint32_t kind; /* 1 parameter, 2 tunable, 3 position, 4 input, 5 figure */
    uint32_t pad; /* Zero */
    double value; /* Value of a tunable; start value of a parameter [{item}] */
    double lower; /* Lower bound, -inf for none [{item}] */
    double upper; /* Upper bound, inf for none [{item}] */
    char name[64]; /* Name */
    char unit[32]; /* Unit */
} thetabus_item_t;
THETABUS_CHECK(sizeof(thetabus_item_t) == 128, "thetabus_item_t has another size");
THETABUS_CHECK(offsetof(thetabus_item_t, kind) == 0, "thetabus_item_t.kind has another place");
THETABUS_CHECK(offsetof(thetabus_item_t, pad) == 4, "thetabus_item_t.pad has another place");
THETABUS_CHECK(offsetof(thetabus_item_t, value) == 8, "thetabus_item_t.value has another place");
THETABUS_CHECK(offsetof(thetabus_item_t, lower) == 16, "thetabus_item_t.lower has another place");
THETABUS_CHECK(offsetof(thetabus_item_t, upper) == 24, "thetabus_item_t.upper has another place");
THETABUS_CHECK(offsetof(thetabus_item_t, name) == 32, "thetabus_item_t.name has another place");
THETABUS_CHECK(offsetof(thetabus_item_t, unit) == 96, "thetabus_item_t.unit has another place");

typedef struct thetabus_response {
    uint32_t code; /* 0 done, 1 refused, 2 failed */
    uint32_t items_len; /* Items in use */
    uint64_t from_seq; /* First sample to which the command applies; 0 if not known */
    uint64_t block; /* Block that begins there; 0 if not known */
    char text[256]; /* What was done, or why not */
    thetabus_item_t items[160]; /* Items listed by `describe` */
} thetabus_response_t;
THETABUS_CHECK(sizeof(thetabus_response_t) == 20760, "thetabus_response_t has another size");
THETABUS_CHECK(offsetof(thetabus_response_t, code) == 0, "thetabus_response_t.code has another place");
THETABUS_CHECK(offsetof(thetabus_response_t, items_len) == 4, "thetabus_response_t.items_len has another place");
THETABUS_CHECK(offsetof(thetabus_response_t, from_seq) == 8, "thetabus_response_t.from_seq has another place");
THETABUS_CHECK(offsetof(thetabus_response_t, block) == 16, "thetabus_response_t.block has another place");
THETABUS_CHECK(offsetof(thetabus_response_t, text) == 24, "thetabus_response_t.text has another place");
THETABUS_CHECK(offsetof(thetabus_response_t, items) == 280, "thetabus_response_t.items has another place");

typedef struct thetabus_journal {
    uint64_t stream_id; /* The sample stream; 0 before the first one */
    uint64_t block; /* Number of the first block to which the command applies */
    thetabus_request_t request; /* The request; from_seq is the first sample to which it applies */
} thetabus_journal_t;
THETABUS_CHECK(sizeof(thetabus_journal_t) == 1144, "thetabus_journal_t has another size");
THETABUS_CHECK(offsetof(thetabus_journal_t, stream_id) == 0, "thetabus_journal_t.stream_id has another place");
THETABUS_CHECK(offsetof(thetabus_journal_t, block) == 8, "thetabus_journal_t.block has another place");
THETABUS_CHECK(offsetof(thetabus_journal_t, request) == 16, "thetabus_journal_t.request has another place");

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

#ifdef __cplusplus
}
#endif
#endif
