/* Replays a recording through the filters of the C interface and prints all that they say, to the last bit. `replay.cpp` does the same with
 * the C++ filters, and a test compares what both print. */
#include <elliptude.h>
#include <stdio.h>
#include <string.h>

#include "recording.h"

static const Row recording[rows] = {
#include "recording.inc"
};

enum { liar = 50 };    /* the row in which the fourth direction is that of another star */
enum { copied = 100 }; /* the row before which the filter is moved to other memory */

static const int64_t epoch = INT64_C(1700000000123456789); /* of stamps, ns */
static const int64_t cycle = 100000000;                    /* ns, as the interval of the recording */

static void fill(double number, elliptude_number* numbers) {
  int i;
  for (i = 0; i < 3; ++i) {
    numbers[i] = (elliptude_number)number;
  }
}

static void read_vector(const double* from, elliptude_number* to) {
  int i;
  for (i = 0; i < 3; ++i) {
    to[i] = (elliptude_number)from[i];
  }
}

static void read_directions(int row, elliptude_direction* directions) {
  int i;
  for (i = 0; i < 4; ++i) {
    read_vector(references[i], directions[i].reference);
    read_vector(recording[row].directions[row == liar && i == 3 ? 0 : i], directions[i].body);
    directions[i].bound = (elliptude_number)direction_bound;
  }
}

static void print_numbers(const char* what, const elliptude_number* numbers, int count) {
  int i;
  printf(" %s", what);
  for (i = 0; i < count; ++i) {
    printf(" %a", (double)numbers[i]);
  }
}

static void print_row(const char* filter, int row, elliptude_status predicted, const elliptude_report* report,
                      elliptude_status asked, const elliptude_set* set, const elliptude_bounds* bounds) {
  const elliptude_number angles[4] = {bounds->tilt, bounds->heading_from, bounds->heading_to, bounds->angle};
  printf("%s %d: %s, %s, %s,", filter, row, elliptude_message(predicted), elliptude_message(report->status),
         elliptude_message(asked));
  printf(
      " claim %d, lacks %d, dropped %llx, contradicting %llx, fusions %d, iterations %d, prediction %d, limits %u, "
      "trust %d %d,",
      (int)report->claim, (int)report->lacks, (unsigned long long)report->dropped,
      (unsigned long long)report->contradicting, (int)report->fusions, (int)report->iterations,
      (int)report->prediction_used, (unsigned)report->limits_hit, (int)report->agreeing_updates,
      (int)report->disputed_updates);
  print_numbers("margin", &report->margin, 1);
  print_numbers("time", &set->time, 1);
  print_numbers("attitude", set->attitude, 9);
  print_numbers("vector", set->vector, 3);
  print_numbers("shape", set->shape, 36);
  print_numbers("widths", set->half_widths, 6);
  print_numbers("angles", angles, 4);
  printf("\n");
}

/* \return 0 if all calls that must succeed did. */
static int replay_body(const char* name, double orbit, elliptude_policy policy, elliptude_criterion criterion) {
  static elliptude_body memory[2];
  elliptude_body* filter = &memory[0];
  elliptude_body_parameters parameters;
  int row;
  if (elliptude_body_defaults(&parameters) != ELLIPTUDE_OK) {
    return 1;
  }
  parameters.settings.policy = policy;
  parameters.settings.criterion = criterion;
  parameters.settings.keeps_constraints = policy == ELLIPTUDE_DROP_MEASUREMENT;
  for (row = 0; row < 3; ++row) {
    parameters.inertia[4 * row] = (elliptude_number)moments[row];
  }
  parameters.orbit_rate = (elliptude_number)orbit;
  fill(1e-4, parameters.torque_bound);
  if (elliptude_body_init(filter, sizeof *filter, &parameters, (elliptude_number)recording[0].time) != ELLIPTUDE_OK) {
    return 1;
  }
  for (row = 0; row < rows; ++row) {
    const elliptude_number vertical[3] = {0, 0, 2};
    const elliptude_number torque[3] = {(elliptude_number)1e-5, 0, 0};
    const elliptude_number momentum[3] = {0, (elliptude_number)1e-3, 0};
    elliptude_direction directions[4];
    elliptude_rate rate;
    elliptude_measurements measured = {NULL, 4, NULL, NULL};
    elliptude_report report;
    elliptude_status predicted;
    elliptude_status asked;
    elliptude_set set;
    elliptude_bounds bounds;
    measured.directions = directions;
    measured.rate = &rate;
    read_directions(row, directions);
    read_vector(recording[row].rate, rate.value);
    fill(rate_bound, rate.bound);
    if (row == copied) {
      memory[1] = memory[0];
      memset(&memory[0], 0xA5, sizeof memory[0]);
      filter = &memory[1];
    }
    /* For two rows with a torque and a wheel that the recording does not have: the numbers count, not the truth. */
    predicted = row == 20 || row == 21
                    ? elliptude_body_predict(filter, (elliptude_number)recording[row].time, torque, momentum, NULL)
                    : elliptude_body_predict(filter, (elliptude_number)recording[row].time, NULL, NULL, NULL);
    (void)elliptude_body_update(filter, &measured, &report);
    if (elliptude_body_set(filter, &set) != ELLIPTUDE_OK) {
      return 1;
    }
    asked = elliptude_body_bounds(filter, vertical, &bounds);
    print_row(name, row, predicted, &report, asked, &set, &bounds);
  }
  return 0;
}

/* by_stamps: not 0: its times are nanoseconds, of a clock that has been running for long. */
static int replay_gyro(const char* name, int by_stamps) {
  static elliptude_gyro memory[2];
  elliptude_gyro* filter = &memory[0];
  elliptude_gyro_parameters parameters;
  elliptude_set set;
  int row;
  if (elliptude_gyro_defaults(&parameters) != ELLIPTUDE_OK) {
    return 1;
  }
  parameters.settings.policy = ELLIPTUDE_RELAXED;
  parameters.settings.most_wrong = 1;
  fill(rate_bound, parameters.noise);
  fill(1e-6, parameters.drift);
  fill(0.01, parameters.bias_bound);
  parameters.angular_acceleration = (elliptude_number)0.2;
  if ((by_stamps ? elliptude_gyro_init_at_stamp(filter, sizeof *filter, &parameters, epoch, epoch)
                 : elliptude_gyro_init(filter, sizeof *filter, &parameters, (elliptude_number)recording[0].time)) !=
      ELLIPTUDE_OK) {
    return 1;
  }
  for (row = 0; row < rows; ++row) {
    const elliptude_number vertical[3] = {0, 0, 2};
    elliptude_direction directions[4];
    elliptude_attitude attitude;
    elliptude_number rate[3];
    elliptude_measurements measured = {NULL, 4, NULL, NULL};
    elliptude_report report;
    elliptude_status predicted;
    elliptude_status asked;
    elliptude_bounds bounds;
    measured.directions = directions;
    read_directions(row, directions);
    if (row % 20 == 19) {
      /* As from a star tracker: the center of the set, which is no further from the truth than this. */
      memcpy(attitude.value, set.attitude, sizeof attitude.value);
      fill(0.05, attitude.bound);
      measured.attitude = &attitude;
    }
    if (row == copied) {
      memory[1] = memory[0];
      memset(&memory[0], 0xA5, sizeof memory[0]);
      filter = &memory[1];
    }
    read_vector(recording[row > 0 ? row - 1 : 0].rate, rate);
    predicted = by_stamps ? elliptude_gyro_predict_to_stamp(filter, epoch + row * cycle, rate, NULL)
                          : elliptude_gyro_predict(filter, (elliptude_number)recording[row].time, rate, NULL);
    (void)elliptude_gyro_update(filter, &measured, &report);
    if (elliptude_gyro_set(filter, &set) != ELLIPTUDE_OK) {
      return 1;
    }
    asked = elliptude_gyro_bounds(filter, vertical, &bounds);
    print_row(name, row, predicted, &report, asked, &set, &bounds);
  }
  return 0;
}

int main(void) {
  (void)interval;
  return replay_body("free", 0, ELLIPTUDE_RAISE, ELLIPTUDE_LEAST_VOLUME) ||
         replay_body("gravity gradient", orbit_rate, ELLIPTUDE_DROP_MEASUREMENT, ELLIPTUDE_LEAST_TRACE) ||
         replay_gyro("gyro", 0) || replay_gyro("gyro by stamps", 1);
}
