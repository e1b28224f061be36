/* The recording that is replayed, in C or C++: what its sensors and their bounds are. `record.cpp` makes it. */

#ifndef FLIGHT_RECORDING_H
#define FLIGHT_RECORDING_H

#ifdef __cplusplus
#define FLIGHT_CONSTANT constexpr
namespace flight {
#else
#define FLIGHT_CONSTANT static const
#endif

/* What was measured at one moment. */
typedef struct Row {
  double time;             /* s */
  double directions[4][3]; /* of `references`, in body axes */
  double rate[3];          /* rad/s */
} Row;

enum { rows = 201 };
FLIGHT_CONSTANT double interval = 0.1;           /* s */
FLIGHT_CONSTANT double moments[3] = {1, 2.8, 2}; /* of inertia, kg m² */
/* Of the gravity gradient, rad/s, as if the orbit were a low one; the frame's axes are those of the reference. */
FLIGHT_CONSTANT double orbit_rate = 0.0011;
FLIGHT_CONSTANT double direction_bound = 0.01; /* rad */
FLIGHT_CONSTANT double rate_bound = 0.01;      /* rad/s */
FLIGHT_CONSTANT double references[4][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0.6, 0, -0.8}};

#ifdef __cplusplus
}
#endif

#endif
