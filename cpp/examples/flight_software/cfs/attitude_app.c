/* A skeleton of a cFS application around the guaranteed filter of a gyro: it takes sensor messages from the software bus, and sends the attitude,
 * how far it may be off, and what the filter reports. It is compiled here against a stub of cFE's interface, and has never run under cFE. */
#include "attitude_app.h"

#include <math.h>
#include <string.h>

static struct {
  CFE_SB_PipeId_t Pipe;
  elliptude_gyro Filter;
  elliptude_number Rate[3]; /* of the sample before, which stands for the interval that it begins */
  bool HasRate;             /* whether it is a number: else the interval has no rate */
  ATTITUDE_APP_Tlm_t Tlm;
} App;

/* Seconds since the time stamps began; exact to 2⁻²³ s in a double for 2³⁰ s. */
static double seconds(CFE_TIME_SysTime_t time) { return (double)time.Seconds + (double)time.Subseconds / 4294967296.0; }

/* What the datasheets of this mission state. */
static elliptude_status start_filter(double time) {
  elliptude_gyro_parameters parameters;
  int i;
  (void)elliptude_gyro_defaults(&parameters);
  parameters.settings.policy = ELLIPTUDE_DROP_MEASUREMENT;
  parameters.angular_acceleration = 0.01; /* rad/s² */
  parameters.longest_interval = 1.0;      /* s: after a longer gap the rate says nothing */
  parameters.largest_rate = 0.2;          /* rad/s */
  for (i = 0; i < 3; ++i) {
    parameters.noise[i] = 1e-3;      /* rad/s */
    parameters.bias_bound[i] = 1e-3; /* rad/s */
  }
  return elliptude_gyro_init(&App.Filter, sizeof App.Filter, &parameters, time);
}

/* Counts a call, and says why it was refused, or what it has left out. */
static void note(const char* what, const elliptude_report* report) {
  App.Tlm.Last = *report;
  if (report->status != ELLIPTUDE_OK) {
    ++App.Tlm.Refusals;
    (void)CFE_EVS_SendEvent(ATTITUDE_APP_STATUS_EID, CFE_EVS_EventType_ERROR, "%s: %s", what,
                            elliptude_message(report->status));
  } else if (report->dropped != 0) {
    (void)CFE_EVS_SendEvent(ATTITUDE_APP_DROPPED_EID, CFE_EVS_EventType_INFORMATION, "%s: left out stars %08lx", what,
                            (unsigned long)(report->dropped & 0xFFFFFFFFU));
  }
}

static void send_telemetry(void) {
  elliptude_set set;
  App.Tlm.Knows = elliptude_gyro_set(&App.Filter, &set) == ELLIPTUDE_OK;
  if (App.Tlm.Knows) {
    memcpy(App.Tlm.Attitude, set.attitude, sizeof App.Tlm.Attitude);
    memcpy(App.Tlm.Bias, set.vector, sizeof App.Tlm.Bias);
    memcpy(App.Tlm.HalfWidths, set.half_widths, sizeof App.Tlm.HalfWidths);
  }
  CFE_SB_TimeStampMsg(CFE_MSG_PTR(App.Tlm.Header));
  (void)CFE_SB_TransmitMsg(CFE_MSG_PTR(App.Tlm.Header), true);
}

static void take_sensors(const ATTITUDE_APP_Sensors_t* sensors) {
  elliptude_measurements measured = {NULL, 0, NULL, NULL};
  elliptude_report report;
  const double time = seconds(sensors->Time);
  ++App.Tlm.Cycles;
  if (sensors->StarCount > ATTITUDE_APP_MOST_STARS) {
    (void)CFE_EVS_SendEvent(ATTITUDE_APP_MESSAGE_EID, CFE_EVS_EventType_ERROR,
                            "%lu stars in a message with room for %d", (unsigned long)sensors->StarCount,
                            (int)ATTITUDE_APP_MOST_STARS);
    return;
  }
  measured.directions = sensors->Stars;
  measured.direction_count = sensors->StarCount;
  (void)elliptude_gyro_predict(&App.Filter, time, App.HasRate ? App.Rate : NULL, &report);
  if (report.status == ELLIPTUDE_CORRUPTED) {
    note("predict", &report); /* the memory was changed by something else */
  }
  if (report.status == ELLIPTUDE_NOT_INITIALIZED || report.status == ELLIPTUDE_CORRUPTED) {
    report.status = start_filter(time); /* the first message is one, too */
  }
  note("predict", &report);
  if (report.status == ELLIPTUDE_OK) {
    memcpy(App.Rate, sensors->Rate, sizeof App.Rate);
    App.HasRate = isfinite(App.Rate[0]) && isfinite(App.Rate[1]) && isfinite(App.Rate[2]);
    (void)elliptude_gyro_update(&App.Filter, &measured, &report);
    note("update", &report);
  }
  send_telemetry();
}

static void take_command(const CFE_MSG_Message_t* message) {
  CFE_MSG_FcnCode_t code = 0;
  (void)CFE_MSG_GetFcnCode(message, &code);
  if (code == ATTITUDE_APP_FORGET_CC) {
    /* Its time too: one message whose clock is ahead would else have all that follow refused. The next message starts it. */
    memset(&App.Filter, 0, sizeof App.Filter);
    App.HasRate = false;
  } else if (code != ATTITUDE_APP_NOOP_CC) {
    (void)CFE_EVS_SendEvent(ATTITUDE_APP_MESSAGE_EID, CFE_EVS_EventType_ERROR, "unknown command %u", (unsigned)code);
  }
}

static void take(const CFE_SB_Buffer_t* buffer) {
  CFE_SB_MsgId_t id = CFE_SB_ValueToMsgId(0);
  CFE_MSG_Size_t size = 0;
  (void)CFE_MSG_GetMsgId(&buffer->Msg, &id);
  (void)CFE_MSG_GetSize(&buffer->Msg, &size);
  if (CFE_SB_MsgIdToValue(id) == ATTITUDE_APP_SENSORS_MID && size == sizeof(ATTITUDE_APP_Sensors_t)) {
    take_sensors((const ATTITUDE_APP_Sensors_t*)(const void*)buffer);
  } else if (CFE_SB_MsgIdToValue(id) == ATTITUDE_APP_CMD_MID && size == sizeof(CFE_MSG_CommandHeader_t)) {
    take_command(&buffer->Msg);
  } else {
    (void)CFE_EVS_SendEvent(ATTITUDE_APP_MESSAGE_EID, CFE_EVS_EventType_ERROR, "message %08lx of %lu bytes",
                            (unsigned long)CFE_SB_MsgIdToValue(id), (unsigned long)size);
  }
}

static CFE_Status_t start(void) {
  CFE_Status_t status;
  memset(&App, 0, sizeof App); /* a filter of zeros is one that `init` has not made */
  status = CFE_EVS_Register(NULL, 0, CFE_EVS_EventFilter_BINARY);
  if (status == CFE_SUCCESS && elliptude_self_test() != ELLIPTUDE_OK) {
    (void)CFE_EVS_SendEvent(ATTITUDE_APP_FAILED_EID, CFE_EVS_EventType_ERROR, "%s",
                            elliptude_message(ELLIPTUDE_WRONG_ARITHMETIC));
    return -1;
  }
  if (status == CFE_SUCCESS) {
    status = CFE_MSG_Init(CFE_MSG_PTR(App.Tlm.Header), CFE_SB_ValueToMsgId(ATTITUDE_APP_TLM_MID), sizeof App.Tlm);
  }
  if (status == CFE_SUCCESS) {
    status = CFE_SB_CreatePipe(&App.Pipe, 8, "ATTITUDE_PIPE");
  }
  if (status == CFE_SUCCESS) {
    status = CFE_SB_Subscribe(CFE_SB_ValueToMsgId(ATTITUDE_APP_SENSORS_MID), App.Pipe);
  }
  if (status == CFE_SUCCESS) {
    status = CFE_SB_Subscribe(CFE_SB_ValueToMsgId(ATTITUDE_APP_CMD_MID), App.Pipe);
  }
  if (status == CFE_SUCCESS) {
    status =
        CFE_EVS_SendEvent(ATTITUDE_APP_STARTED_EID, CFE_EVS_EventType_INFORMATION, "elliptude %s", elliptude_version());
  }
  return status;
}

void ATTITUDE_APP_Main(void) {
  uint32 run = start() == CFE_SUCCESS ? CFE_ES_RunStatus_APP_RUN : CFE_ES_RunStatus_APP_ERROR;
  while (CFE_ES_RunLoop(&run)) {
    CFE_SB_Buffer_t* buffer = NULL;
    if (CFE_SB_ReceiveBuffer(&buffer, App.Pipe, CFE_SB_PEND_FOREVER) == CFE_SUCCESS) {
      take(buffer);
    } else {
      run = CFE_ES_RunStatus_APP_ERROR;
    }
  }
  CFE_ES_ExitApp(run);
}
