/* SPDX-License-Identifier: MIT */

/*
 * The guaranteed filters in C (C99, or C++): of a rigid body, and of a body of which nothing is known but what its gyro says. They use no
 * heap, no exceptions and no threads; each is a structure that the caller owns, of a size that is known when the caller is compiled.
 *
 *     static elliptude_gyro filter;
 *     elliptude_gyro_parameters parameters;
 *     elliptude_gyro_defaults(&parameters);
 *     parameters.noise[0] = parameters.noise[1] = parameters.noise[2] = 0.01;
 *     parameters.bias_bound[0] = parameters.bias_bound[1] = parameters.bias_bound[2] = 0.002;
 *     elliptude_status status = elliptude_gyro_init(&filter, sizeof filter, &parameters, 0.0);
 *
 * Then `predict` to the time of each row of measurements and `update` with them. What is promised, and what a bound is: docs/flight.md.
 *
 * - Units are SI and radians. Vectors are of body axes unless they are called reference; matrices are row by row; an attitude is the matrix
 *   that takes body axes to reference axes.
 * - A function that does not return ELLIPTUDE_OK has changed neither the filter nor what it would have written, except a report, which is
 *   always written.
 * - A bound of three numbers is an ellipsoid's half-axes along the body axes. A box of errors is in the ellipsoid with √3 times
 *   half its sides.
 * - A filter may be copied with `=` or memcpy, and needs no function at its end. One thread at a time may use it.
 * - Each function that changes a filter leaves a seal in it, and each function looks first whether the memory is as it was left. If one or
 *   two bits were flipped since, or anything within two words of 32 bits, it always returns ELLIPTUDE_CORRUPTED, or NOT_INITIALIZED of
 *   the first eight bytes, and does nothing; so it does after other changes but for one in 2³², or fewer. Take a copy that was kept,
 *   or `init` it again.
 *
 * All parts of a program must be compiled with the same ELLIPTUDE_SINGLE_PRECISION and ELLIPTUDE_MOST_*. A part with another precision does
 * not link, and one with other sizes is told ELLIPTUDE_WRONG_SIZE.
 */

#ifndef ELLIPTUDE_H
#define ELLIPTUDE_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* --- precision and limits ------------------------------------------------------------------------------------------- */

#ifdef ELLIPTUDE_SINGLE_PRECISION
typedef float elliptude_number;
/* Other names for the linker, so that a program in double is not linked with a library in float. */
#define elliptude_message elliptude_single_message
#define elliptude_version elliptude_single_version
#define elliptude_self_test elliptude_single_self_test
#define elliptude_body_defaults elliptude_single_body_defaults
#define elliptude_body_init elliptude_single_body_init
#define elliptude_body_init_at_stamp elliptude_single_body_init_at_stamp
#define elliptude_body_predict elliptude_single_body_predict
#define elliptude_body_predict_to_stamp elliptude_single_body_predict_to_stamp
#define elliptude_body_update elliptude_single_body_update
#define elliptude_body_forget elliptude_single_body_forget
#define elliptude_body_check elliptude_single_body_check
#define elliptude_body_set elliptude_single_body_set
#define elliptude_body_bounds elliptude_single_body_bounds
#define elliptude_gyro_defaults elliptude_single_gyro_defaults
#define elliptude_gyro_init elliptude_single_gyro_init
#define elliptude_gyro_init_at_stamp elliptude_single_gyro_init_at_stamp
#define elliptude_gyro_predict elliptude_single_gyro_predict
#define elliptude_gyro_predict_to_stamp elliptude_single_gyro_predict_to_stamp
#define elliptude_gyro_update elliptude_single_gyro_update
#define elliptude_gyro_forget elliptude_single_gyro_forget
#define elliptude_gyro_check elliptude_single_gyro_check
#define elliptude_gyro_set elliptude_single_gyro_set
#define elliptude_gyro_bounds elliptude_single_gyro_bounds
#else
typedef double elliptude_number;
#endif

/* Directions of one update, 1 to 32. */
#ifndef ELLIPTUDE_MOST_DIRECTIONS
#define ELLIPTUDE_MOST_DIRECTIONS 32
#endif

/* Constraints that `bounds` takes into account where `keeps_constraints` is set, 1 or more. */
#ifndef ELLIPTUDE_MOST_QUESTIONED
#define ELLIPTUDE_MOST_QUESTIONED 8
#endif

/* --- statuses ------------------------------------------------------------------------------------------------------- */

typedef int32_t elliptude_status;
enum {
  ELLIPTUDE_OK = 0,
  ELLIPTUDE_NOT_FINITE = 1,            /* an input holds NaN or an infinity */
  ELLIPTUDE_OUT_OF_RANGE = 2,          /* an input is outside the range that is stated for it */
  ELLIPTUDE_NOT_A_ROTATION = 3,        /* a matrix is not orthogonal with determinant 1 */
  ELLIPTUDE_NOT_SYMMETRIC = 4,         /* the inertia is not symmetric */
  ELLIPTUDE_NOT_POSITIVE_DEFINITE = 5, /* an inertia that is not, or a bound without a width that must have one */
  ELLIPTUDE_INVALID_INERTIA = 6,       /* no mass distribution has these principal moments */
  ELLIPTUDE_ZERO_DIRECTION = 7,        /* a direction has no length */
  ELLIPTUDE_ATTITUDE_UNDETERMINED = 8, /* the directions leave a rotation free */
  ELLIPTUDE_IMPROPER_PROFILE = 9,      /* not returned by these filters */
  ELLIPTUDE_STEP_TOO_LONG = 10,        /* shorten the longest step */
  ELLIPTUDE_NOT_CONVERGED = 11,        /* a bounded iteration ended before its tolerance */
  ELLIPTUDE_EMPTY_INTERSECTION = 12,   /* the measurements contradict the set, or each other: some bound is wrong */
  ELLIPTUDE_UNBOUNDED = 13,            /* no set is known */
  ELLIPTUDE_CALLBACK_FAILED = 14,      /* not returned by these filters */
  ELLIPTUDE_BEYOND_DOMAIN = 15,        /* a number is too large or too small for this precision */
  ELLIPTUDE_TOO_MANY_STEPS = 16,       /* the interval takes more steps than `most_steps` */
  ELLIPTUDE_INTERRUPTED = 17,          /* not returned by these filters */
  ELLIPTUDE_CORRUPTED = 18,            /* the filter's memory was changed since the last call */
  /* Those above are the statuses of the C++ library, those below are of this interface alone. */
  ELLIPTUDE_NULL_POINTER = 100,    /* an argument that is needed is NULL */
  ELLIPTUDE_NOT_INITIALIZED = 101, /* `init` has not made this filter, or its beginning was overwritten */
  ELLIPTUDE_WRONG_SIZE = 102,      /* the filter or the parameters have another size here; or without `defaults` */
  ELLIPTUDE_WRONG_ARITHMETIC = 103 /* the processor or the compiler does not round as the guarantee needs it */
};

/* One line for a log, in English; never NULL, whatever the status. */
const char* elliptude_message(elliptude_status status);

/* The version, "major.minor.patch". */
const char* elliptude_version(void);

/*
 * Whether the library calculates as it must: rounds each operation to nearest, to this precision, keeps subnormal numbers, and does not
 * contract a product and a sum. `init` does this, too. Call it again if something may have changed the processor's modes.
 * Returns ELLIPTUDE_OK or ELLIPTUDE_WRONG_ARITHMETIC.
 */
elliptude_status elliptude_self_test(void);

/* --- settings that both filters have -------------------------------------------------------------------------------- */

/* What to do with measurements that no predicted state can have caused: some bound is then wrong. */
typedef int32_t elliptude_policy;
enum {
  ELLIPTUDE_RAISE = 0,            /* return ELLIPTUDE_EMPTY_INTERSECTION */
  ELLIPTUDE_DROP_MEASUREMENT = 1, /* leave out as few as make the rest agree with the prediction */
  ELLIPTUDE_RESTART = 2,          /* forget the prediction, and start again from the measurements */
  ELLIPTUDE_RELAXED = 3           /* let up to `most_wrong` of an update be wrong, whether that shows or not */
};

/* Which of the ellipsoids about what is possible is taken. */
typedef int32_t elliptude_criterion;
enum {
  ELLIPTUDE_LEAST_VOLUME = 0,
  ELLIPTUDE_LEAST_TRACE = 1 /* the least sum of squared half-axes, rad² + (rad/s)² */
};

typedef struct {
  elliptude_policy policy;       /* default: ELLIPTUDE_RAISE */
  int32_t most_wrong;            /* 0 to 2, of at most eight measurements; default: 0 */
  int32_t regain_after;          /* a conditional claim ends after so many updates that agree, 1 or more; default: 10 */
  elliptude_criterion criterion; /* default: ELLIPTUDE_LEAST_VOLUME */
  int32_t keeps_constraints;     /* not 0: `bounds` is sharper directly after an update; default: 0 */
} elliptude_settings;

/* --- measurements and results --------------------------------------------------------------------------------------- */

/* A direction that is known in reference axes, measured in body axes. Neither need be of unit length. */
typedef struct {
  elliptude_number reference[3];
  elliptude_number body[3];
  elliptude_number bound; /* the largest angle between what is measured and what is, rad, positive */
} elliptude_direction;

/* An angular velocity. */
typedef struct {
  elliptude_number value[3]; /* rad/s */
  elliptude_number bound[3]; /* rad/s, each positive */
} elliptude_rate;

/* A whole attitude, as from a star tracker. */
typedef struct {
  elliptude_number value[9]; /* body axes to reference axes */
  elliptude_number bound[3]; /* rotation vector of the error about the body axes, rad, each positive */
} elliptude_attitude;

/* The measurements of one moment. Without directions the count is 0; what was not measured is NULL. */
typedef struct {
  const elliptude_direction* directions;
  size_t direction_count;     /* at most ELLIPTUDE_MOST_DIRECTIONS */
  const elliptude_rate* rate; /* of a rigid body alone; a gyro's filter is told rates by `predict` */
  const elliptude_attitude* attitude;
} elliptude_measurements;

/* What the guarantee of a set rests on. A stronger claim is the larger, and memory that is all zero claims nothing. */
typedef int32_t elliptude_claim;
enum {
  ELLIPTUDE_NO_CLAIM = 0,     /* no set: the attitude is not known */
  ELLIPTUDE_CONDITIONAL = 1,  /* on the stated bounds, and on the dropped measurements having been the wrong ones */
  ELLIPTUDE_UNCONDITIONAL = 2 /* on the stated bounds of everything that was used */
};

/* What a filter that has no set lacks. */
typedef int32_t elliptude_lacks;
enum {
  ELLIPTUDE_LACKS_NOTHING = 0,  /* there is a set */
  ELLIPTUDE_LACKS_ATTITUDE = 1, /* two directions that are not parallel, or an attitude, in one update */
  ELLIPTUDE_LACKS_VECTOR = 2    /* any bound of the angular velocity or the gyro's bias: a measured angular velocity,
                                   a bound among the parameters */
};

/* Bits of `dropped` and `contradicting`; direction i has bit i. */
#define ELLIPTUDE_DIRECTION_BIT(i) (UINT64_C(1) << (i))
#define ELLIPTUDE_RATE_BIT (UINT64_C(1) << 32)
#define ELLIPTUDE_ATTITUDE_BIT (UINT64_C(1) << 33)

/* Bits of `limits_hit`. */
#define ELLIPTUDE_LIMIT_DIRECTIONS UINT32_C(1) /* more directions than ELLIPTUDE_MOST_DIRECTIONS; nothing was done */
#define ELLIPTUDE_LIMIT_STEPS UINT32_C(2)      /* more steps than `most_steps`; nothing was done */
/* A search ended at its bound: the set holds, and may be larger than need be. */
#define ELLIPTUDE_LIMIT_SEARCH UINT32_C(4)
/* The set became too large to be bounded: `predict` has forgotten the attitude. */
#define ELLIPTUDE_LIMIT_SET UINT32_C(8)

/* Telemetry: what a call of `predict` or `update` did. It is written whatever the status is. */
typedef struct {
  elliptude_number time; /* of the filter after the call, s */
  /* Of an update: how far the constraints are from having no common point; negative if they had none. */
  elliptude_number margin;
  uint64_t dropped;        /* of an update: which measurements were left out, or are proved wrong */
  uint64_t contradicting;  /* if the margin is negative: the measurement that weighs most against the rest */
  elliptude_status status; /* that the call returned */
  elliptude_claim claim;   /* after the call */
  elliptude_lacks lacks;   /* after the call */
  uint32_t limits_hit;
  int32_t fusions;          /* of an update: how many choices of measurements were tried */
  int32_t iterations;       /* of an update: steps of the searches for all these */
  int32_t prediction_used;  /* of an update: 1 if the prediction made the set smaller than the measurements alone */
  int32_t agreeing_updates; /* updates in a row without contradiction */
  int32_t disputed_updates; /* updates since the first contradiction, or since the past was last given up for one */
} elliptude_report;

/* The set: all states whose error y = [γ; δ] about the center has yᵀP⁻¹y ≤ 1, with C = Ĉ (the turn of Gibbs vector γ, 2 tan(angle/2) long)
 * and δ the vector's difference. P is the shape of a set, not a covariance. */
typedef struct {
  elliptude_number time;        /* s */
  elliptude_number attitude[9]; /* of the center: body axes to reference axes */
  elliptude_number vector[3];   /* of the center: angular velocity, or the gyro's bias, rad/s */
  elliptude_number shape[36];   /* P, symmetric; rad², rad²/s, rad²/s² */
  /* Of γ about each body axis, which is no less than the angle in rad; of the vector, rad/s. */
  elliptude_number half_widths[6];
  elliptude_claim claim;
} elliptude_set;

/* How far the attitude of the set's center may be off at most, rad, up to π. */
typedef struct {
  elliptude_number tilt;         /* of the vertical */
  elliptude_number heading_from; /* of the turn about the vertical that is left then, from the center's to the others */
  elliptude_number heading_to;
  elliptude_number angle; /* in all */
} elliptude_bounds;

/* --- the filter of a rigid body -------------------------------------------------------------------------------------- */

/* A function that takes a filter returns ELLIPTUDE_CORRUPTED, too: see above. */

/* A rigid body, free or under the gravity gradient of a circular orbit, with a torque and an inertia that are not fully known. */
typedef struct {
  size_t size; /* set by `defaults`: leave it */
  elliptude_settings settings;
  int32_t most_steps;          /* of one prediction, 1 or more; default: ELLIPTUDE_MOST_STEPS of the library, 1000000 */
  elliptude_number inertia[9]; /* kg m²; default: the identity */
  elliptude_number inertia_error;   /* the largest, in the spectral norm, kg m²; default: 0 */
  elliptude_number torque_bound[3]; /* of the unknown torque at every time, N m; default: 0 */
  elliptude_number orbit_rate;      /* rad/s; default: 0, a free body */
  /* A rotation whose columns are, in reference axes, the direction from the attracting body at time 0, that of the motion and the orbit's
   * normal; default: the identity. */
  elliptude_number orbit[9];
  elliptude_number longest_step; /* of a prediction, s, positive; default: 0.1 */
  /* The angular velocity never exceeds this, rad/s: all positive, or all 0 if nothing is known (the default). */
  elliptude_number rate_bound[3];
} elliptude_body_parameters;

/* How many words of eight bytes hold a filter of so many numbers. */
#define ELLIPTUDE_WORDS(numbers) (((numbers) * sizeof(elliptude_number) + 192) / 8)
typedef union {
  uint64_t bits;
  double number;
  void* pointer;
} elliptude_word;

/* A filter: memory that only the library reads. Its names are of no use to a program. */
typedef struct {
  elliptude_word memory[ELLIPTUDE_WORDS(210 + 13 * ELLIPTUDE_MOST_QUESTIONED)];
} elliptude_body;

/* Returns ELLIPTUDE_NULL_POINTER. */
elliptude_status elliptude_body_defaults(elliptude_body_parameters* parameters);

/*
 * A filter that knows nothing at `time`, and starts from the first measurements that determine an attitude.
 * size: sizeof *filter, so that the library can compare it with its own.
 * Returns NULL_POINTER, WRONG_SIZE, WRONG_ARITHMETIC, NOT_FINITE, OUT_OF_RANGE, NOT_SYMMETRIC, NOT_POSITIVE_DEFINITE, INVALID_INERTIA,
 * NOT_A_ROTATION, BEYOND_DOMAIN.
 */
elliptude_status elliptude_body_init(elliptude_body* filter, size_t size, const elliptude_body_parameters* parameters,
                                     elliptude_number time);

/*
 * The same, to be predicted to time stamps: whole nanoseconds of any clock, however long it has been running.
 * epoch: the stamp of time 0, at which `orbit` is what it says. Reports and sets have the seconds since then. In float let it be no more than
 * some hundred orbits ago: the set grows with the rounding of time.
 * stamp: that of the filter. With 0 for both this is `init` at time 0.
 */
elliptude_status elliptude_body_init_at_stamp(elliptude_body* filter, size_t size,
                                              const elliptude_body_parameters* parameters, int64_t epoch,
                                              int64_t stamp);

/*
 * Moves the set to a later time. If it becomes too large to be bounded, the attitude is forgotten and the status is ELLIPTUDE_OK: look at the
 * claim.
 * control_torque: N m, constant since the filter's time; NULL for none.
 * wheel_momentum: N m s, constant; NULL for none.
 * report: NULL if it is not wanted.
 * Returns NULL_POINTER, NOT_INITIALIZED, NOT_FINITE, OUT_OF_RANGE of an earlier time, TOO_MANY_STEPS; under ELLIPTUDE_RAISE STEP_TOO_LONG.
 */
elliptude_status elliptude_body_predict(elliptude_body* filter, elliptude_number time,
                                        const elliptude_number control_torque[3],
                                        const elliptude_number wheel_momentum[3], elliptude_report* report);

/*
 * The same to a later stamp, over the difference of both, which is right to rounding. In float seconds lose a millisecond after 10000 s.
 * Returns as above, and OUT_OF_RANGE of a filter whose time is not that of its stamp, as it was made or predicted by seconds.
 */
elliptude_status elliptude_body_predict_to_stamp(elliptude_body* filter, int64_t stamp,
                                                 const elliptude_number control_torque[3],
                                                 const elliptude_number wheel_momentum[3], elliptude_report* report);

/*
 * Fuses the measurements of the filter's time with the prediction.
 * Returns NULL_POINTER, also of directions where the count is not 0; NOT_INITIALIZED; OUT_OF_RANGE of too many directions, of a bound that is
 * not positive, of more than eight measurements where some may be wrong, or, where nothing may be left out, of a rate or a bound of it above
 * 1e9 rad/s (1e6 in float); NOT_FINITE, ZERO_DIRECTION, NOT_A_ROTATION,
 * NOT_POSITIVE_DEFINITE, BEYOND_DOMAIN of a measurement; EMPTY_INTERSECTION if they contradict what is known and the policy is to say so.
 */
elliptude_status elliptude_body_update(elliptude_body* filter, const elliptude_measurements* measurements,
                                       elliptude_report* report);

/* Forgets all but the parameters and the time. Returns NULL_POINTER, NOT_INITIALIZED. */
elliptude_status elliptude_body_forget(elliptude_body* filter);

/* Whether the memory is as the last call left it. Every other function looks, too: this one is for a task that looks more often, and
 * for choosing among copies. Returns ELLIPTUDE_OK, NULL_POINTER, NOT_INITIALIZED, CORRUPTED. */
elliptude_status elliptude_body_check(const elliptude_body* filter);

/* Returns NULL_POINTER, NOT_INITIALIZED, UNBOUNDED if the attitude is not known. */
elliptude_status elliptude_body_set(const elliptude_body* filter, elliptude_set* set);

/* vertical: in reference axes, of any length.
 * Returns NULL_POINTER, NOT_INITIALIZED, NOT_FINITE, ZERO_DIRECTION, UNBOUNDED if the attitude is not known. */
elliptude_status elliptude_body_bounds(const elliptude_body* filter, const elliptude_number vertical[3],
                                       elliptude_bounds* bounds);

/* --- the filter of a gyro -------------------------------------------------------------------------------------------- */

/* What the rate of an interval is. */
typedef int32_t elliptude_interval_rate;
enum {
  ELLIPTUDE_FIRST_SAMPLE = 0, /* the sample at its beginning */
  ELLIPTUDE_MEAN_OF_ENDS = 1, /* the mean of the samples at both ends */
  ELLIPTUDE_MEAN = 2,         /* the mean over the interval, of a gyro that integrates */
  ELLIPTUDE_LAST_SAMPLE = 3   /* the sample at its end */
};

/* A body of which nothing is known but what its gyro says: a sample is the angular velocity + bias + an error. */
typedef struct {
  size_t size; /* set by `defaults`: leave it */
  elliptude_settings settings;
  elliptude_interval_rate interval_rate; /* default: ELLIPTUDE_FIRST_SAMPLE */
  int32_t estimates_bias;    /* 0: the bias is left to its bound, and the attitude is estimated alone; default: 1 */
  elliptude_number noise[3]; /* of a sample's error, rad/s; default: 0 */
  elliptude_number drift[3]; /* of the bias's change, rad/s²; default: 0 */
  elliptude_number bias_bound[3];        /* rad/s: all positive, or all 0 if nothing is known (the default) */
  elliptude_number scale;                /* largest relative error of a rate; default: 0 */
  elliptude_number angular_acceleration; /* largest, rad/s²: how the body turns between samples; default: 0 */
  elliptude_number longest_interval;     /* that a rate stands for, s; negative for any (the default) */
  elliptude_number largest_rate; /* of the body at any time, rad/s; negative if not known (the default); not 0 */
} elliptude_gyro_parameters;

typedef struct {
  elliptude_word memory[ELLIPTUDE_WORDS(135 + 13 * ELLIPTUDE_MOST_QUESTIONED)];
} elliptude_gyro;

/* As those of a rigid body. */
elliptude_status elliptude_gyro_defaults(elliptude_gyro_parameters* parameters);
elliptude_status elliptude_gyro_init(elliptude_gyro* filter, size_t size, const elliptude_gyro_parameters* parameters,
                                     elliptude_number time);
elliptude_status elliptude_gyro_init_at_stamp(elliptude_gyro* filter, size_t size,
                                              const elliptude_gyro_parameters* parameters, int64_t epoch,
                                              int64_t stamp);

/* rate: rad/s, for the interval since the filter's time; NULL if there is none, as if the interval were longer than the longest.
 * Both return as those of a rigid body, but neither TOO_MANY_STEPS nor STEP_TOO_LONG; under ELLIPTUDE_RAISE OUT_OF_RANGE also of a turn
 * above 1e9 rad (1e6 in float) about a body axis. */
elliptude_status elliptude_gyro_predict(elliptude_gyro* filter, elliptude_number time, const elliptude_number rate[3],
                                        elliptude_report* report);
elliptude_status elliptude_gyro_predict_to_stamp(elliptude_gyro* filter, int64_t stamp, const elliptude_number rate[3],
                                                 elliptude_report* report);

/* As that of a rigid body, and OUT_OF_RANGE of a rate among the measurements. */
elliptude_status elliptude_gyro_update(elliptude_gyro* filter, const elliptude_measurements* measurements,
                                       elliptude_report* report);
elliptude_status elliptude_gyro_forget(elliptude_gyro* filter);
elliptude_status elliptude_gyro_check(const elliptude_gyro* filter);
elliptude_status elliptude_gyro_set(const elliptude_gyro* filter, elliptude_set* set);
elliptude_status elliptude_gyro_bounds(const elliptude_gyro* filter, const elliptude_number vertical[3],
                                       elliptude_bounds* bounds);

#ifdef __cplusplus
}
#endif

#endif /* ELLIPTUDE_H */
