/* Prints the version if the library does what it should. */
#include <elliptude.h>
#include <stdio.h>

static elliptude_body filter;

int main(void) {
  const elliptude_direction axes[2] = {{{1, 0, 0}, {0, 1, 0}, 0.01}, {{0, 1, 0}, {-1, 0, 0}, 0.01}};
  const elliptude_rate rest = {{0, 0, 0}, {0.01, 0.01, 0.01}};
  const elliptude_measurements measured = {axes, 2, &rest, NULL};
  elliptude_body_parameters parameters;
  elliptude_set set;
  if (elliptude_body_defaults(&parameters) != ELLIPTUDE_OK ||
      elliptude_body_init(&filter, sizeof filter, &parameters, 0) != ELLIPTUDE_OK ||
      elliptude_body_update(&filter, &measured, NULL) != ELLIPTUDE_OK ||
      elliptude_body_predict(&filter, 0.1, NULL, NULL, NULL) != ELLIPTUDE_OK ||
      elliptude_body_set(&filter, &set) != ELLIPTUDE_OK) {
    return 1;
  }
  /* The body is turned by a quarter about the third axis: its second axis points along the first of the reference. It is known within
   * some 0.02 rad: two directions within 0.01 each, and 0.001 for the turn of 0.1 s. */
  if (!(set.attitude[1] > 0.999 && set.half_widths[0] > 0.01 && set.half_widths[0] < 0.025)) {
    return 1;
  }
  puts(elliptude_version());
  return 0;
}
