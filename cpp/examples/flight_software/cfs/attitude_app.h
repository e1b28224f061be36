/* The messages of the attitude application: what it takes from the software bus, and what it sends. */
#ifndef ATTITUDE_APP_H
#define ATTITUDE_APP_H

#include <cfe.h>
#include <elliptude.h>

/* A mission gives these out. */
#define ATTITUDE_APP_CMD_MID 0x18A0
#define ATTITUDE_APP_SENSORS_MID 0x08A1
#define ATTITUDE_APP_TLM_MID 0x08A0

#define ATTITUDE_APP_NOOP_CC 0
#define ATTITUDE_APP_FORGET_CC 1

enum {
  ATTITUDE_APP_STARTED_EID = 1,
  ATTITUDE_APP_FAILED_EID = 2,
  ATTITUDE_APP_MESSAGE_EID = 3,
  ATTITUDE_APP_STATUS_EID = 4,
  ATTITUDE_APP_DROPPED_EID = 5
};

enum { ATTITUDE_APP_MOST_STARS = 4 };

/* The sensors of one moment, from the application that reads them. */
typedef struct {
  CFE_MSG_TelemetryHeader_t Header;
  CFE_TIME_SysTime_t Time; /* of the samples */
  uint32 StarCount;
  elliptude_number Rate[3]; /* of the gyro at that time, rad/s */
  elliptude_direction Stars[ATTITUDE_APP_MOST_STARS];
} ATTITUDE_APP_Sensors_t;

typedef struct {
  CFE_MSG_TelemetryHeader_t Header;
  uint32 Cycles;   /* sensor messages */
  uint32 Refusals; /* calls that did not return ELLIPTUDE_OK */
  uint32 Knows;    /* whether the three below mean something */
  elliptude_number Attitude[9];
  elliptude_number Bias[3];       /* rad/s */
  elliptude_number HalfWidths[3]; /* of the attitude, about the body axes, rad */
  elliptude_report Last;          /* what the last call did */
} ATTITUDE_APP_Tlm_t;

void ATTITUDE_APP_Main(void);

#endif
