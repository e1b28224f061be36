/* What the C interface refuses: each gives the status that is stated for it, and leaves the filter as it was, byte for byte. */
#include <elliptude.h>
#include <fenv.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

static int checks = 0;
static int failures = 0;

static void check(int holds, const char* what, int line) {
  ++checks;
  if (!holds) {
    ++failures;
    printf("refusals.c:%d: does not hold: %s\n", line, what);
  }
}
#define CHECK(condition) check((condition) != 0, #condition, __LINE__)

static elliptude_body body, body_before;
static elliptude_gyro gyro, gyro_before;
static elliptude_report report;

/* Refused with this status, which the report has too, and nothing has changed. */
#define REFUSES_BODY(call, expected)                      \
  do {                                                    \
    body_before = body;                                   \
    memset(&report, 0x5A, sizeof report);                 \
    CHECK((call) == (expected));                          \
    CHECK(memcmp(&body, &body_before, sizeof body) == 0); \
  } while (0)
#define REFUSES_GYRO(call, expected)                      \
  do {                                                    \
    gyro_before = gyro;                                   \
    memset(&report, 0x5A, sizeof report);                 \
    CHECK((call) == (expected));                          \
    CHECK(memcmp(&gyro, &gyro_before, sizeof gyro) == 0); \
  } while (0)

/* A number whose square vanishes. */
static elliptude_number tiny(void) { return (elliptude_number)(sizeof(elliptude_number) == 4 ? 1e-30 : 1e-200); }

static const elliptude_number vertical[3] = {0, 0, 1};

static const elliptude_direction axes[3] = {{{1, 0, 0}, {1, 0, 0}, (elliptude_number)0.01},
                                            {{0, 1, 0}, {0, 1, 0}, (elliptude_number)0.01},
                                            {{0, 0, 1}, {0, 0, 1}, (elliptude_number)0.01}};
static const elliptude_rate rest = {{0, 0, 0},
                                    {(elliptude_number)0.01, (elliptude_number)0.01, (elliptude_number)0.01}};
static const elliptude_attitude upright = {{1, 0, 0, 0, 1, 0, 0, 0, 1},
                                           {(elliptude_number)0.1, (elliptude_number)0.1, (elliptude_number)0.1}};

static elliptude_body_parameters body_parameters(void) {
  elliptude_body_parameters parameters;
  CHECK(elliptude_body_defaults(&parameters) == ELLIPTUDE_OK);
  return parameters;
}

static elliptude_gyro_parameters gyro_parameters(void) {
  elliptude_gyro_parameters parameters;
  int i;
  CHECK(elliptude_gyro_defaults(&parameters) == ELLIPTUDE_OK);
  for (i = 0; i < 3; ++i) {
    parameters.noise[i] = (elliptude_number)0.01;
    parameters.bias_bound[i] = (elliptude_number)0.01;
  }
  return parameters;
}

static elliptude_measurements all_measurements(void) {
  elliptude_measurements measured = {NULL, 3, NULL, NULL};
  measured.directions = axes;
  measured.attitude = &upright;
  return measured;
}

/* Filters that know an attitude. */
static void start(void) {
  const elliptude_body_parameters of_body = body_parameters();
  const elliptude_gyro_parameters of_gyro = gyro_parameters();
  elliptude_measurements measured = all_measurements();
  CHECK(elliptude_body_init(&body, sizeof body, &of_body, 1) == ELLIPTUDE_OK);
  CHECK(elliptude_gyro_init(&gyro, sizeof gyro, &of_gyro, 1) == ELLIPTUDE_OK);
  CHECK(elliptude_gyro_update(&gyro, &measured, &report) == ELLIPTUDE_OK);
  CHECK(report.status == ELLIPTUDE_OK && report.claim == ELLIPTUDE_UNCONDITIONAL && report.time == 1);
  CHECK(report.dropped == 0 && report.limits_hit == 0 && report.margin > 0 && report.fusions == 1);
  CHECK(report.iterations > 0);
  measured.rate = &rest;
  CHECK(elliptude_body_update(&body, &measured, &report) == ELLIPTUDE_OK);
  CHECK(report.claim == ELLIPTUDE_UNCONDITIONAL && report.lacks == ELLIPTUDE_LACKS_NOTHING);
}

/* Filters that were told the same, wherever they are: copies may be compared byte by byte. */
static void same_bytes(void) {
  const elliptude_body_parameters of_body = body_parameters();
  const elliptude_gyro_parameters of_gyro = gyro_parameters();
  elliptude_body bodies[2];
  elliptude_gyro gyros[2];
  int i;
  for (i = 0; i < 2; ++i) {
    memset(&bodies[i], i == 0 ? 0xA5 : 0x5A, sizeof bodies[i]);
    memset(&gyros[i], i == 0 ? 0xA5 : 0x5A, sizeof gyros[i]);
    CHECK(elliptude_body_init(&bodies[i], sizeof bodies[i], &of_body, 1) == ELLIPTUDE_OK);
    CHECK(elliptude_gyro_init(&gyros[i], sizeof gyros[i], &of_gyro, 1) == ELLIPTUDE_OK);
  }
  CHECK(memcmp(&bodies[0], &bodies[1], sizeof bodies[0]) == 0);
  CHECK(memcmp(&gyros[0], &gyros[1], sizeof gyros[0]) == 0);
}

static void null_pointers(void) {
  const elliptude_body_parameters of_body = body_parameters();
  const elliptude_gyro_parameters of_gyro = gyro_parameters();
  const elliptude_measurements measured = all_measurements();
  elliptude_measurements no_directions = {NULL, 1, NULL, NULL};
  elliptude_set set;
  elliptude_bounds bounds;
  start();
  CHECK(elliptude_body_defaults(NULL) == ELLIPTUDE_NULL_POINTER);
  CHECK(elliptude_gyro_defaults(NULL) == ELLIPTUDE_NULL_POINTER);
  CHECK(elliptude_body_init(NULL, sizeof body, &of_body, 0) == ELLIPTUDE_NULL_POINTER);
  CHECK(elliptude_gyro_init(NULL, sizeof gyro, &of_gyro, 0) == ELLIPTUDE_NULL_POINTER);
  REFUSES_BODY(elliptude_body_init(&body, sizeof body, NULL, 0), ELLIPTUDE_NULL_POINTER);
  REFUSES_GYRO(elliptude_gyro_init(&gyro, sizeof gyro, NULL, 0), ELLIPTUDE_NULL_POINTER);
  CHECK(elliptude_body_predict(NULL, 2, NULL, NULL, &report) == ELLIPTUDE_NULL_POINTER);
  CHECK(report.status == ELLIPTUDE_NULL_POINTER && report.claim == ELLIPTUDE_NO_CLAIM);
  CHECK(elliptude_gyro_predict(NULL, 2, vertical, NULL) == ELLIPTUDE_NULL_POINTER);
  CHECK(elliptude_body_update(NULL, &measured, NULL) == ELLIPTUDE_NULL_POINTER);
  CHECK(elliptude_gyro_update(NULL, &measured, &report) == ELLIPTUDE_NULL_POINTER);
  REFUSES_BODY(elliptude_body_update(&body, NULL, &report), ELLIPTUDE_NULL_POINTER);
  CHECK(report.status == ELLIPTUDE_NULL_POINTER && report.claim == ELLIPTUDE_UNCONDITIONAL && report.time == 1);
  REFUSES_BODY(elliptude_body_update(&body, &no_directions, &report), ELLIPTUDE_NULL_POINTER);
  REFUSES_GYRO(elliptude_gyro_update(&gyro, &no_directions, NULL), ELLIPTUDE_NULL_POINTER);
  CHECK(elliptude_body_forget(NULL) == ELLIPTUDE_NULL_POINTER);
  CHECK(elliptude_gyro_forget(NULL) == ELLIPTUDE_NULL_POINTER);
  CHECK(elliptude_body_set(NULL, &set) == ELLIPTUDE_NULL_POINTER);
  CHECK(elliptude_body_set(&body, NULL) == ELLIPTUDE_NULL_POINTER);
  CHECK(elliptude_gyro_set(&gyro, NULL) == ELLIPTUDE_NULL_POINTER);
  CHECK(elliptude_body_bounds(&body, NULL, &bounds) == ELLIPTUDE_NULL_POINTER);
  CHECK(elliptude_gyro_bounds(&gyro, vertical, NULL) == ELLIPTUDE_NULL_POINTER);
}

/* Memory that holds no filter of this kind. */
static void not_initialized(unsigned char byte) {
  const elliptude_measurements measured = all_measurements();
  elliptude_set set;
  elliptude_bounds bounds;
  memset(&body, byte, sizeof body);
  memset(&gyro, byte, sizeof gyro);
  REFUSES_BODY(elliptude_body_predict(&body, 2, NULL, NULL, &report), ELLIPTUDE_NOT_INITIALIZED);
  REFUSES_BODY(elliptude_body_update(&body, &measured, &report), ELLIPTUDE_NOT_INITIALIZED);
  CHECK(report.status == ELLIPTUDE_NOT_INITIALIZED && report.claim == ELLIPTUDE_NO_CLAIM && report.time == 0);
  REFUSES_BODY(elliptude_body_forget(&body), ELLIPTUDE_NOT_INITIALIZED);
  REFUSES_BODY(elliptude_body_set(&body, &set), ELLIPTUDE_NOT_INITIALIZED);
  REFUSES_BODY(elliptude_body_bounds(&body, vertical, &bounds), ELLIPTUDE_NOT_INITIALIZED);
  REFUSES_GYRO(elliptude_gyro_predict(&gyro, 2, vertical, &report), ELLIPTUDE_NOT_INITIALIZED);
  REFUSES_GYRO(elliptude_gyro_update(&gyro, &measured, &report), ELLIPTUDE_NOT_INITIALIZED);
  REFUSES_GYRO(elliptude_gyro_forget(&gyro), ELLIPTUDE_NOT_INITIALIZED);
  REFUSES_GYRO(elliptude_gyro_set(&gyro, &set), ELLIPTUDE_NOT_INITIALIZED);
  REFUSES_GYRO(elliptude_gyro_bounds(&gyro, vertical, &bounds), ELLIPTUDE_NOT_INITIALIZED);
}

static void another_kind(void) {
  start();
  memcpy(&gyro, &body, sizeof gyro);
  CHECK(elliptude_gyro_predict(&gyro, 2, vertical, &report) == ELLIPTUDE_NOT_INITIALIZED);
}

/* Memory that was changed between two calls, by any one bit. */
static void flipped_bits(void) {
  const elliptude_measurements measured = all_measurements();
  elliptude_set set;
  elliptude_bounds bounds;
  size_t bit;
  int seen = 0;
  unsigned char* const bytes = (unsigned char*)&body;
  start();
  CHECK(elliptude_body_check(&body) == ELLIPTUDE_OK && elliptude_gyro_check(&gyro) == ELLIPTUDE_OK);
  for (bit = 0; bit < 8 * sizeof body; ++bit) {
    bytes[bit / 8] ^= (unsigned char)(1U << bit % 8);
    seen += elliptude_body_check(&body) == (bit < 64 ? ELLIPTUDE_NOT_INITIALIZED : ELLIPTUDE_CORRUPTED);
    bytes[bit / 8] ^= (unsigned char)(1U << bit % 8);
  }
  CHECK(seen == (int)(8 * sizeof body));
  CHECK(elliptude_body_check(&body) == ELLIPTUDE_OK);
  bytes[sizeof body / 2] ^= 4;
  ((unsigned char*)&gyro)[sizeof gyro - 1] ^= 0x80;
  REFUSES_BODY(elliptude_body_predict(&body, 2, NULL, NULL, &report), ELLIPTUDE_CORRUPTED);
  REFUSES_BODY(elliptude_body_update(&body, &measured, &report), ELLIPTUDE_CORRUPTED);
  CHECK(report.status == ELLIPTUDE_CORRUPTED && report.claim == ELLIPTUDE_NO_CLAIM && report.time == 0);
  REFUSES_BODY(elliptude_body_forget(&body), ELLIPTUDE_CORRUPTED);
  REFUSES_BODY(elliptude_body_set(&body, &set), ELLIPTUDE_CORRUPTED);
  REFUSES_BODY(elliptude_body_bounds(&body, vertical, &bounds), ELLIPTUDE_CORRUPTED);
  REFUSES_GYRO(elliptude_gyro_predict(&gyro, 2, vertical, &report), ELLIPTUDE_CORRUPTED);
  REFUSES_GYRO(elliptude_gyro_update(&gyro, &measured, &report), ELLIPTUDE_CORRUPTED);
  REFUSES_GYRO(elliptude_gyro_forget(&gyro), ELLIPTUDE_CORRUPTED);
  REFUSES_GYRO(elliptude_gyro_set(&gyro, &set), ELLIPTUDE_CORRUPTED);
  REFUSES_GYRO(elliptude_gyro_bounds(&gyro, vertical, &bounds), ELLIPTUDE_CORRUPTED);
  REFUSES_GYRO(elliptude_gyro_check(&gyro), ELLIPTUDE_CORRUPTED);
  CHECK(elliptude_body_check(NULL) == ELLIPTUDE_NULL_POINTER && elliptude_gyro_check(NULL) == ELLIPTUDE_NULL_POINTER);
  start(); /* makes both again */
  CHECK(elliptude_body_check(&body) == ELLIPTUDE_OK && elliptude_gyro_check(&gyro) == ELLIPTUDE_OK);
}

static void wrong_sizes(void) {
  elliptude_body_parameters of_body = body_parameters();
  elliptude_gyro_parameters of_gyro = gyro_parameters();
  start();
  REFUSES_BODY(elliptude_body_init(&body, sizeof body - 8, &of_body, 0), ELLIPTUDE_WRONG_SIZE);
  REFUSES_BODY(elliptude_body_init(&body, sizeof body + 8, &of_body, 0), ELLIPTUDE_WRONG_SIZE);
  REFUSES_GYRO(elliptude_gyro_init(&gyro, sizeof body, &of_gyro, 0), ELLIPTUDE_WRONG_SIZE);
  of_body.size = 0;
  of_gyro.size += 8;
  REFUSES_BODY(elliptude_body_init(&body, sizeof body, &of_body, 0), ELLIPTUDE_WRONG_SIZE);
  REFUSES_GYRO(elliptude_gyro_init(&gyro, sizeof gyro, &of_gyro, 0), ELLIPTUDE_WRONG_SIZE);
}

/* Each of these numbers that is not finite makes `call` return ELLIPTUDE_NOT_FINITE. */
#define REFUSES_EACH_NOT_FINITE(refuses, numbers, count, call) \
  do {                                                         \
    size_t which;                                              \
    for (which = 0; which < (count); ++which) {                \
      const elliptude_number kept = (numbers)[which];          \
      (numbers)[which] = (elliptude_number)NAN;                \
      refuses(call, ELLIPTUDE_NOT_FINITE);                     \
      (numbers)[which] = -(elliptude_number)INFINITY;          \
      refuses(call, ELLIPTUDE_NOT_FINITE);                     \
      (numbers)[which] = kept;                                 \
    }                                                          \
  } while (0)

static void parameters_of_body(void) {
  elliptude_body_parameters p = body_parameters();
  start();
#define INIT elliptude_body_init(&body, sizeof body, &p, 0)
  REFUSES_EACH_NOT_FINITE(REFUSES_BODY, p.inertia, 9, INIT);
  REFUSES_EACH_NOT_FINITE(REFUSES_BODY, &p.inertia_error, 1, INIT);
  REFUSES_EACH_NOT_FINITE(REFUSES_BODY, p.torque_bound, 3, INIT);
  REFUSES_EACH_NOT_FINITE(REFUSES_BODY, &p.orbit_rate, 1, INIT);
  REFUSES_EACH_NOT_FINITE(REFUSES_BODY, p.orbit, 9, INIT);
  REFUSES_EACH_NOT_FINITE(REFUSES_BODY, &p.longest_step, 1, INIT);
  REFUSES_EACH_NOT_FINITE(REFUSES_BODY, p.rate_bound, 3, INIT);
  REFUSES_BODY(elliptude_body_init(&body, sizeof body, &p, (elliptude_number)NAN), ELLIPTUDE_NOT_FINITE);
#define REFUSES_AS(member, value, expected) \
  do {                                      \
    p = body_parameters();                  \
    p.member = value;                       \
    REFUSES_BODY(INIT, expected);           \
  } while (0)
  REFUSES_AS(inertia[1], 1, ELLIPTUDE_NOT_SYMMETRIC);
  REFUSES_AS(inertia[8], -1, ELLIPTUDE_NOT_POSITIVE_DEFINITE);
  REFUSES_AS(inertia[8], 3, ELLIPTUDE_INVALID_INERTIA);
  REFUSES_AS(inertia_error, 1, ELLIPTUDE_INVALID_INERTIA);
  REFUSES_AS(inertia_error, -1, ELLIPTUDE_OUT_OF_RANGE);
  REFUSES_AS(torque_bound[2], -1, ELLIPTUDE_OUT_OF_RANGE);
  REFUSES_AS(torque_bound[2], tiny(), ELLIPTUDE_BEYOND_DOMAIN);
  REFUSES_AS(orbit_rate, -1, ELLIPTUDE_OUT_OF_RANGE);
  REFUSES_AS(orbit[0], 2, ELLIPTUDE_NOT_A_ROTATION);
  REFUSES_AS(longest_step, 0, ELLIPTUDE_OUT_OF_RANGE);
  REFUSES_AS(rate_bound[0], 1, ELLIPTUDE_NOT_POSITIVE_DEFINITE); /* and 0 about the other axes */
  REFUSES_AS(rate_bound[0], -1, ELLIPTUDE_OUT_OF_RANGE);
  REFUSES_AS(most_steps, 0, ELLIPTUDE_OUT_OF_RANGE);
  REFUSES_AS(settings.policy, 4, ELLIPTUDE_OUT_OF_RANGE);
  REFUSES_AS(settings.policy, -1, ELLIPTUDE_OUT_OF_RANGE);
  REFUSES_AS(settings.criterion, 2, ELLIPTUDE_OUT_OF_RANGE);
  REFUSES_AS(settings.criterion, -1, ELLIPTUDE_OUT_OF_RANGE);
  REFUSES_AS(settings.most_wrong, 3, ELLIPTUDE_OUT_OF_RANGE);
  REFUSES_AS(settings.regain_after, 0, ELLIPTUDE_OUT_OF_RANGE);
#undef REFUSES_AS
#undef INIT
}

static void parameters_of_gyro(void) {
  elliptude_gyro_parameters p = gyro_parameters();
  start();
#define INIT elliptude_gyro_init(&gyro, sizeof gyro, &p, 0)
  REFUSES_EACH_NOT_FINITE(REFUSES_GYRO, p.noise, 3, INIT);
  REFUSES_EACH_NOT_FINITE(REFUSES_GYRO, p.drift, 3, INIT);
  REFUSES_EACH_NOT_FINITE(REFUSES_GYRO, p.bias_bound, 3, INIT);
  REFUSES_EACH_NOT_FINITE(REFUSES_GYRO, &p.scale, 1, INIT);
  REFUSES_EACH_NOT_FINITE(REFUSES_GYRO, &p.angular_acceleration, 1, INIT);
  REFUSES_EACH_NOT_FINITE(REFUSES_GYRO, &p.longest_interval, 1, INIT);
  REFUSES_EACH_NOT_FINITE(REFUSES_GYRO, &p.largest_rate, 1, INIT);
#define REFUSES_AS(member, value, expected) \
  do {                                      \
    p = gyro_parameters();                  \
    p.member = value;                       \
    REFUSES_GYRO(INIT, expected);           \
  } while (0)
  REFUSES_AS(noise[0], -1, ELLIPTUDE_OUT_OF_RANGE);
  REFUSES_AS(drift[1], tiny(), ELLIPTUDE_BEYOND_DOMAIN);
  REFUSES_AS(bias_bound[2], 0, ELLIPTUDE_NOT_POSITIVE_DEFINITE);
  REFUSES_AS(scale, -1, ELLIPTUDE_OUT_OF_RANGE);
  REFUSES_AS(angular_acceleration, -1, ELLIPTUDE_OUT_OF_RANGE);
  REFUSES_AS(largest_rate, 0, ELLIPTUDE_OUT_OF_RANGE);
  REFUSES_AS(interval_rate, 4, ELLIPTUDE_OUT_OF_RANGE);
  REFUSES_AS(interval_rate, -1, ELLIPTUDE_OUT_OF_RANGE);
  REFUSES_AS(settings.policy, 9, ELLIPTUDE_OUT_OF_RANGE);
#undef REFUSES_AS
#undef INIT
}

static void predictions(void) {
  const elliptude_body_parameters of_body = body_parameters();
  elliptude_number torque[3] = {0, 0, 0};
  elliptude_number rate[3] = {0, 0, 0};
  int knows;
  for (knows = 1; knows >= 0; --knows) { /* also while the attitude is not known, and no number of the input counts */
    start();
    if (!knows) {
      CHECK(elliptude_body_forget(&body) == ELLIPTUDE_OK);
      CHECK(elliptude_gyro_forget(&gyro) == ELLIPTUDE_OK);
    }
    REFUSES_EACH_NOT_FINITE(REFUSES_BODY, torque, 3, elliptude_body_predict(&body, 2, torque, NULL, &report));
    CHECK(report.status == ELLIPTUDE_NOT_FINITE);
    REFUSES_EACH_NOT_FINITE(REFUSES_BODY, torque, 3, elliptude_body_predict(&body, 2, NULL, torque, &report));
    REFUSES_EACH_NOT_FINITE(REFUSES_GYRO, rate, 3, elliptude_gyro_predict(&gyro, 2, rate, &report));
    REFUSES_BODY(elliptude_body_predict(&body, (elliptude_number)NAN, NULL, NULL, &report), ELLIPTUDE_NOT_FINITE);
    REFUSES_GYRO(elliptude_gyro_predict(&gyro, (elliptude_number)INFINITY, rate, &report), ELLIPTUDE_NOT_FINITE);
    REFUSES_BODY(elliptude_body_predict(&body, 0, NULL, NULL, &report), ELLIPTUDE_OUT_OF_RANGE);
    REFUSES_GYRO(elliptude_gyro_predict(&gyro, 0, rate, &report), ELLIPTUDE_OUT_OF_RANGE);
  }
  start();
  rate[1] = (elliptude_number)-1.5e9;
  REFUSES_GYRO(elliptude_gyro_predict(&gyro, 2, rate, &report), ELLIPTUDE_OUT_OF_RANGE);
  REFUSES_BODY(elliptude_body_predict(&body, 1000000, NULL, NULL, &report), ELLIPTUDE_TOO_MANY_STEPS);
  CHECK(report.status == ELLIPTUDE_TOO_MANY_STEPS && report.limits_hit == ELLIPTUDE_LIMIT_STEPS && report.time == 1);
  CHECK(elliptude_gyro_predict(&gyro, 1000000, NULL, &report) == ELLIPTUDE_OK); /* without a rate: forgotten */
  CHECK(report.limits_hit == ELLIPTUDE_LIMIT_SET && report.claim == ELLIPTUDE_NO_CLAIM && report.time == 1000000);
  CHECK(report.lacks == ELLIPTUDE_LACKS_ATTITUDE);
  /* A filter that knows nothing is not moved to where no later time could be told. */
  REFUSES_GYRO(elliptude_gyro_predict(&gyro, (elliptude_number)1e30, NULL, &report), ELLIPTUDE_OUT_OF_RANGE);
  CHECK(elliptude_gyro_predict(&gyro, 1000001, NULL, &report) == ELLIPTUDE_OK);
  CHECK(elliptude_body_init(&body, sizeof body, &of_body, 1) == ELLIPTUDE_OK);
  CHECK(elliptude_body_predict(&body, 2, NULL, NULL, &report) == ELLIPTUDE_OK);
  CHECK(report.claim == ELLIPTUDE_NO_CLAIM && report.lacks == ELLIPTUDE_LACKS_VECTOR);
  memset(&report, 0, sizeof report);
  CHECK(report.claim == ELLIPTUDE_NO_CLAIM); /* of a report that nobody wrote */
}

/* By stamps: however large they are, their difference counts; and a filter goes by stamps or by seconds. */
static void stamps(void) {
  const elliptude_body_parameters of_body = body_parameters();
  const elliptude_gyro_parameters of_gyro = gyro_parameters();
  const elliptude_number rate[3] = {0, 0, 0};
  const elliptude_number no_number[3] = {0, (elliptude_number)NAN, 0};
  const int64_t now = INT64_C(1700000000000000000);
  const int64_t cycle = 10000000;
  elliptude_measurements measured = all_measurements();
  start();
  CHECK(elliptude_body_init_at_stamp(NULL, sizeof body, &of_body, 0, 0) == ELLIPTUDE_NULL_POINTER);
  CHECK(elliptude_gyro_init_at_stamp(NULL, sizeof gyro, &of_gyro, 0, 0) == ELLIPTUDE_NULL_POINTER);
  REFUSES_BODY(elliptude_body_init_at_stamp(&body, sizeof body + 8, &of_body, 0, 0), ELLIPTUDE_WRONG_SIZE);
  REFUSES_GYRO(elliptude_gyro_init_at_stamp(&gyro, sizeof gyro, NULL, 0, 0), ELLIPTUDE_NULL_POINTER);
  CHECK(elliptude_body_predict_to_stamp(NULL, now, NULL, NULL, &report) == ELLIPTUDE_NULL_POINTER);
  CHECK(elliptude_gyro_predict_to_stamp(NULL, now, rate, NULL) == ELLIPTUDE_NULL_POINTER);
  /* Both are at 1 s, and were made by seconds. */
  REFUSES_BODY(elliptude_body_predict_to_stamp(&body, now, NULL, NULL, &report), ELLIPTUDE_OUT_OF_RANGE);
  REFUSES_GYRO(elliptude_gyro_predict_to_stamp(&gyro, now, rate, &report), ELLIPTUDE_OUT_OF_RANGE);

  CHECK(elliptude_body_init_at_stamp(&body, sizeof body, &of_body, now, now) == ELLIPTUDE_OK);
  CHECK(elliptude_gyro_init_at_stamp(&gyro, sizeof gyro, &of_gyro, now - 10 * cycle, now) == ELLIPTUDE_OK);
  CHECK(elliptude_gyro_update(&gyro, &measured, &report) == ELLIPTUDE_OK);
  CHECK(report.time == (elliptude_number)0.1);
  measured.rate = &rest;
  CHECK(elliptude_body_update(&body, &measured, &report) == ELLIPTUDE_OK);
  CHECK(report.time == 0);
  CHECK(elliptude_body_predict_to_stamp(&body, now + cycle, NULL, NULL, &report) == ELLIPTUDE_OK);
  CHECK(report.time == (elliptude_number)0.01 && report.claim == ELLIPTUDE_UNCONDITIONAL);
  CHECK(elliptude_gyro_predict_to_stamp(&gyro, now + cycle, rate, &report) == ELLIPTUDE_OK);
  CHECK(report.time == (elliptude_number)0.11 && report.claim == ELLIPTUDE_UNCONDITIONAL);
  REFUSES_BODY(elliptude_body_predict_to_stamp(&body, now + cycle - 1, NULL, NULL, &report), ELLIPTUDE_OUT_OF_RANGE);
  REFUSES_GYRO(elliptude_gyro_predict_to_stamp(&gyro, INT64_MIN, rate, &report), ELLIPTUDE_OUT_OF_RANGE);
  CHECK(report.status == ELLIPTUDE_OUT_OF_RANGE && report.time == (elliptude_number)0.11);
  REFUSES_BODY(elliptude_body_predict_to_stamp(&body, INT64_MAX, NULL, NULL, &report), ELLIPTUDE_TOO_MANY_STEPS);
  REFUSES_BODY(elliptude_body_predict_to_stamp(&body, now + 2 * cycle, no_number, NULL, &report), ELLIPTUDE_NOT_FINITE);
  REFUSES_GYRO(elliptude_gyro_predict_to_stamp(&gyro, now + 2 * cycle, no_number, &report), ELLIPTUDE_NOT_FINITE);
  CHECK(elliptude_gyro_predict(&gyro, 1, rate, NULL) == ELLIPTUDE_OK);
  REFUSES_GYRO(elliptude_gyro_predict_to_stamp(&gyro, now + 200 * cycle, rate, &report), ELLIPTUDE_OUT_OF_RANGE);
  ((unsigned char*)&body)[sizeof body / 2] ^= 4;
  REFUSES_BODY(elliptude_body_predict_to_stamp(&body, now + 2 * cycle, NULL, NULL, &report), ELLIPTUDE_CORRUPTED);
  memset(&gyro, 0, sizeof gyro);
  REFUSES_GYRO(elliptude_gyro_predict_to_stamp(&gyro, now, rate, &report), ELLIPTUDE_NOT_INITIALIZED);

  /* The difference of any two stamps. */
  CHECK(elliptude_gyro_init_at_stamp(&gyro, sizeof gyro, &of_gyro, INT64_MIN, INT64_MIN) == ELLIPTUDE_OK);
  CHECK(elliptude_gyro_predict_to_stamp(&gyro, INT64_MAX, rate, &report) == ELLIPTUDE_OK);
  CHECK(report.time == (elliptude_number)18446744073.709551615);
}

/* Measurements that are refused by the filter of a body, and those but the rate by that of a gyro. */
static void measurements(void) {
  static elliptude_direction directions[ELLIPTUDE_MOST_DIRECTIONS + 1];
  elliptude_rate rate = rest;
  elliptude_attitude attitude = upright;
  elliptude_measurements m = all_measurements();
  int i;
  for (i = 0; i <= ELLIPTUDE_MOST_DIRECTIONS; ++i) {
    directions[i] = axes[i % 3];
  }
  start();
  m.directions = directions;
  m.rate = &rate;
  m.attitude = &attitude;
#define UPDATE elliptude_body_update(&body, &m, &report)
  REFUSES_EACH_NOT_FINITE(REFUSES_BODY, directions[1].reference, 3, UPDATE);
  REFUSES_EACH_NOT_FINITE(REFUSES_BODY, directions[1].body, 3, UPDATE);
  REFUSES_EACH_NOT_FINITE(REFUSES_BODY, &directions[1].bound, 1, UPDATE);
  REFUSES_EACH_NOT_FINITE(REFUSES_BODY, rate.value, 3, UPDATE);
  REFUSES_EACH_NOT_FINITE(REFUSES_BODY, rate.bound, 3, UPDATE);
  REFUSES_EACH_NOT_FINITE(REFUSES_BODY, attitude.value, 9, UPDATE);
  REFUSES_EACH_NOT_FINITE(REFUSES_BODY, attitude.bound, 3, UPDATE);
  CHECK(report.status == ELLIPTUDE_NOT_FINITE);
#define REFUSES_WITH(place, value, kept, expected) \
  do {                                             \
    place = value;                                 \
    REFUSES_BODY(UPDATE, expected);                \
    place = kept;                                  \
  } while (0)
  REFUSES_WITH(directions[0].body[0], 0, 1, ELLIPTUDE_ZERO_DIRECTION);
  REFUSES_WITH(directions[0].reference[0], 0, 1, ELLIPTUDE_ZERO_DIRECTION);
  REFUSES_WITH(directions[0].bound, 0, axes[0].bound, ELLIPTUDE_OUT_OF_RANGE);
  REFUSES_WITH(directions[0].bound, -1, axes[0].bound, ELLIPTUDE_OUT_OF_RANGE);
  REFUSES_WITH(directions[0].bound, tiny(), axes[0].bound, ELLIPTUDE_NOT_POSITIVE_DEFINITE);
  REFUSES_WITH(rate.bound[0], -1, rest.bound[0], ELLIPTUDE_OUT_OF_RANGE);
  REFUSES_WITH(rate.bound[0], 0, rest.bound[0], ELLIPTUDE_NOT_POSITIVE_DEFINITE);
  REFUSES_WITH(attitude.value[0], 2, 1, ELLIPTUDE_NOT_A_ROTATION);
  REFUSES_WITH(attitude.bound[0], 0, upright.bound[0], ELLIPTUDE_NOT_POSITIVE_DEFINITE);
  REFUSES_WITH(m.direction_count, ELLIPTUDE_MOST_DIRECTIONS + 1, 3, ELLIPTUDE_OUT_OF_RANGE);
  CHECK(report.limits_hit == ELLIPTUDE_LIMIT_DIRECTIONS && report.status == ELLIPTUDE_OUT_OF_RANGE);
  REFUSES_WITH(m.direction_count, SIZE_MAX, 3, ELLIPTUDE_OUT_OF_RANGE);
#undef REFUSES_WITH
#undef UPDATE
  REFUSES_GYRO(elliptude_gyro_update(&gyro, &m, &report), ELLIPTUDE_OUT_OF_RANGE); /* a rate is no measurement there */
}

/* A contradiction is reported, with what contradicts; and dropped, if the policy says so. */
static void contradictions(void) {
  elliptude_body_parameters parameters = body_parameters();
  elliptude_direction directions[3];
  elliptude_measurements measured = {NULL, 3, NULL, NULL};
  memcpy(directions, axes, sizeof directions);
  measured.directions = directions;
  start();
  directions[2].body[0] = 1; /* 45° away */
  REFUSES_BODY(elliptude_body_update(&body, &measured, &report), ELLIPTUDE_EMPTY_INTERSECTION);
  CHECK(report.status == ELLIPTUDE_EMPTY_INTERSECTION && report.margin < 0 && report.dropped == 0);
  CHECK(report.contradicting == ELLIPTUDE_DIRECTION_BIT(2) && report.claim == ELLIPTUDE_UNCONDITIONAL);
  CHECK(report.fusions == 1 && report.agreeing_updates == 1 && report.disputed_updates == 0);

  parameters.settings.policy = ELLIPTUDE_DROP_MEASUREMENT;
  memcpy(directions, axes, sizeof directions);
  measured.rate = &rest;
  CHECK(elliptude_body_init(&body, sizeof body, &parameters, 1) == ELLIPTUDE_OK);
  CHECK(elliptude_body_update(&body, &measured, &report) == ELLIPTUDE_OK);
  directions[2].body[0] = 1;
  CHECK(elliptude_body_update(&body, &measured, &report) == ELLIPTUDE_OK);
  CHECK(report.margin < 0 && report.dropped == ELLIPTUDE_DIRECTION_BIT(2));
  CHECK(report.claim == ELLIPTUDE_CONDITIONAL && report.prediction_used == 1);
  CHECK(report.fusions == 5); /* all four, and each once left out */
}

static void without_a_set(void) {
  elliptude_set set, set_before;
  elliptude_bounds bounds, bounds_before;
  const elliptude_number zero[3] = {0, 0, 0};
  const elliptude_number no_number[3] = {0, (elliptude_number)NAN, 0};
  start();
  memset(&bounds, 0x11, sizeof bounds);
  bounds_before = bounds;
  CHECK(elliptude_body_bounds(&body, zero, &bounds) == ELLIPTUDE_ZERO_DIRECTION);
  CHECK(elliptude_body_bounds(&body, no_number, &bounds) == ELLIPTUDE_NOT_FINITE);
  CHECK(elliptude_gyro_bounds(&gyro, zero, &bounds) == ELLIPTUDE_ZERO_DIRECTION);
  CHECK(elliptude_body_forget(&body) == ELLIPTUDE_OK);
  CHECK(elliptude_gyro_forget(&gyro) == ELLIPTUDE_OK);
  memset(&set, 0x11, sizeof set);
  set_before = set;
  CHECK(elliptude_body_set(&body, &set) == ELLIPTUDE_UNBOUNDED);
  CHECK(elliptude_gyro_set(&gyro, &set) == ELLIPTUDE_UNBOUNDED);
  CHECK(elliptude_body_bounds(&body, vertical, &bounds) == ELLIPTUDE_UNBOUNDED);
  CHECK(elliptude_gyro_bounds(&gyro, vertical, &bounds) == ELLIPTUDE_UNBOUNDED);
  CHECK(memcmp(&set, &set_before, sizeof set) == 0);
  CHECK(memcmp(&bounds, &bounds_before, sizeof bounds) == 0);
}

/* Where the processor rounds in another direction, no bound would hold. */
static void arithmetic(void) {
  const int modes[3] = {FE_UPWARD, FE_DOWNWARD, FE_TOWARDZERO};
  const elliptude_body_parameters parameters = body_parameters();
  int i;
  start();
  CHECK(elliptude_self_test() == ELLIPTUDE_OK);
  for (i = 0; i < 3; ++i) {
    elliptude_status tested;
    elliptude_status made;
    CHECK(fesetround(modes[i]) == 0);
    body_before = body;
    tested = elliptude_self_test();
    made = elliptude_body_init(&body, sizeof body, &parameters, 0);
    CHECK(fesetround(FE_TONEAREST) == 0);
    CHECK(tested == ELLIPTUDE_WRONG_ARITHMETIC);
    CHECK(made == ELLIPTUDE_WRONG_ARITHMETIC);
    CHECK(memcmp(&body, &body_before, sizeof body) == 0);
  }
  CHECK(elliptude_self_test() == ELLIPTUDE_OK);
}

static void messages(void) {
  const char* unknown = elliptude_message(-1);
  int one;
  int other;
  int known = 0;
  for (one = -2; one < 200; ++one) {
    known += strcmp(elliptude_message(one), unknown) != 0;
    for (other = one + 1; other < 200; ++other) {
      CHECK(strcmp(elliptude_message(one), elliptude_message(other)) != 0 ||
            strcmp(elliptude_message(one), unknown) == 0);
    }
  }
  CHECK(known == 23);
  CHECK(elliptude_message(INT32_MIN) == unknown && elliptude_message(INT32_MAX) == unknown);
  CHECK(strcmp(elliptude_message(ELLIPTUDE_OK), "ok") == 0);
  CHECK(strchr(elliptude_version(), '.') != NULL);
}

int main(void) {
  same_bytes();
  null_pointers();
  not_initialized(0);
  not_initialized(0x5A);
  not_initialized(0xFF);
  another_kind();
  flipped_bits();
  wrong_sizes();
  parameters_of_body();
  parameters_of_gyro();
  predictions();
  stamps();
  measurements();
  contradictions();
  without_a_set();
  arithmetic();
  messages();
  printf("%d checks, %d failures\n", checks, failures);
  return failures != 0;
}
