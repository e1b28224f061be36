/* Runs the application on stubs of cFE's functions: some messages in, and whether what comes out is as it should be. */
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "attitude_app.h"

enum { cycles = 20, no_rate = 9, liar = 12, wrong_size = 15, clock_ahead = 16, forget = 17 };

static ATTITUDE_APP_Sensors_t sensors;
static CFE_MSG_CommandHeader_t command;
static ATTITUDE_APP_Tlm_t last;
static int received = 0;
static int sent = 0;
static int events = 0;
static int failures = 0;
static uint32 ended_with = 0;

#define CHECK(condition) \
  (void)((condition) || (printf("run_on_stubs.c:%d: does not hold: %s\n", __LINE__, #condition), ++failures))

bool CFE_ES_RunLoop(uint32* RunStatus) { return *RunStatus == CFE_ES_RunStatus_APP_RUN; }
void CFE_ES_ExitApp(uint32 ExitStatus) { ended_with = ExitStatus; }

CFE_Status_t CFE_MSG_Init(CFE_MSG_Message_t* MsgPtr, CFE_SB_MsgId_t MsgId, CFE_MSG_Size_t Size) {
  memset(MsgPtr, 0, Size);
  MsgPtr->Id = MsgId;
  MsgPtr->Size = Size;
  return CFE_SUCCESS;
}
CFE_Status_t CFE_MSG_GetMsgId(const CFE_MSG_Message_t* MsgPtr, CFE_SB_MsgId_t* MsgId) {
  *MsgId = MsgPtr->Id;
  return CFE_SUCCESS;
}
CFE_Status_t CFE_MSG_GetSize(const CFE_MSG_Message_t* MsgPtr, CFE_MSG_Size_t* Size) {
  *Size = MsgPtr->Size;
  return CFE_SUCCESS;
}
CFE_Status_t CFE_MSG_GetFcnCode(const CFE_MSG_Message_t* MsgPtr, CFE_MSG_FcnCode_t* FcnCode) {
  *FcnCode = MsgPtr->FcnCode;
  return CFE_SUCCESS;
}
CFE_Status_t CFE_SB_CreatePipe(CFE_SB_PipeId_t* PipeIdPtr, uint16 Depth, const char* PipeName) {
  *PipeIdPtr = 7;
  return Depth > 0 && PipeName != NULL ? CFE_SUCCESS : -1;
}
CFE_Status_t CFE_SB_Subscribe(CFE_SB_MsgId_t MsgId, CFE_SB_PipeId_t PipeId) {
  return MsgId != 0 && PipeId == 7 ? CFE_SUCCESS : -1;
}
CFE_Status_t CFE_EVS_Register(const void* Filters, uint16 NumEventFilters, uint16 FilterScheme) {
  return Filters == NULL && NumEventFilters == 0 && FilterScheme == CFE_EVS_EventFilter_BINARY ? CFE_SUCCESS : -1;
}
CFE_Status_t CFE_EVS_SendEvent(uint16 EventID, CFE_EVS_EventType_Enum_t EventType, const char* Spec, ...) {
  va_list arguments;
  printf("event %u (%s): ", (unsigned)EventID, EventType == CFE_EVS_EventType_ERROR ? "error" : "information");
  va_start(arguments, Spec);
  vprintf(Spec, arguments);
  va_end(arguments);
  printf("\n");
  ++events;
  return CFE_SUCCESS;
}
void CFE_SB_TimeStampMsg(CFE_MSG_Message_t* MsgPtr) { (void)MsgPtr; }

/* A body that turns about its third axis by 0.05 rad/s, with a star along the first axis of the reference and one along the second. */
CFE_Status_t CFE_SB_ReceiveBuffer(CFE_SB_Buffer_t** BufPtr, CFE_SB_PipeId_t PipeId, int32 TimeOut) {
  const double angle = 0.05 * 0.25 * received;
  const elliptude_number directions[2][2][3] = {{{1, 0, 0}, {cos(angle), -sin(angle), 0}},
                                                {{0, 1, 0}, {sin(angle), cos(angle), 0}}};
  int i;
  if (received == cycles || PipeId != 7 || TimeOut != CFE_SB_PEND_FOREVER) {
    return -1;
  }
  (void)CFE_MSG_Init(CFE_MSG_PTR(sensors.Header), CFE_SB_ValueToMsgId(ATTITUDE_APP_SENSORS_MID), sizeof sensors);
  sensors.Time.Seconds = 1000U + (uint32)received / 4;
  sensors.Time.Subseconds = (uint32)(received % 4) << 30;
  sensors.StarCount = 2;
  sensors.Rate[2] = 0.05;
  for (i = 0; i < 2; ++i) {
    memcpy(sensors.Stars[i].reference, directions[i][0], sizeof sensors.Stars[i].reference);
    memcpy(sensors.Stars[i].body, directions[i][1], sizeof sensors.Stars[i].body);
    sensors.Stars[i].bound = 1e-3;
  }
  *BufPtr = (CFE_SB_Buffer_t*)(void*)&sensors;
  if (received == no_rate) {
    sensors.Rate[2] = NAN;
  } else if (received == liar) {
    sensors.Stars[1].body[2] = 0.5;
  } else if (received == wrong_size) {
    sensors.Header.Msg.Size -= 1;
  } else if (received == clock_ahead) {
    sensors.Time.Seconds += 1000000;
  } else if (received == forget) {
    (void)CFE_MSG_Init(CFE_MSG_PTR(command), CFE_SB_ValueToMsgId(ATTITUDE_APP_CMD_MID), sizeof command);
    command.Msg.FcnCode = ATTITUDE_APP_FORGET_CC;
    *BufPtr = (CFE_SB_Buffer_t*)(void*)&command;
  }
  ++received;
  return CFE_SUCCESS;
}

CFE_Status_t CFE_SB_TransmitMsg(const CFE_MSG_Message_t* MsgPtr, bool IsOrigination) {
  const int row = received - 1;
  const double angle = 0.05 * 0.25 * row;
  CHECK(IsOrigination && MsgPtr->Id == ATTITUDE_APP_TLM_MID && MsgPtr->Size == sizeof last);
  memcpy(&last, MsgPtr, sizeof last);
  CHECK(last.Knows == 1 && last.Last.status == ELLIPTUDE_OK);
  CHECK(last.Last.time == 1000 + 0.25 * row + (row == clock_ahead ? 1000000 : 0));
  /* The center is within the set's half-width of the truth, which is in the set. */
  CHECK(fabs(atan2(last.Attitude[3], last.Attitude[0]) - angle) <= 2 * last.HalfWidths[2]);
  CHECK(last.HalfWidths[2] > 0 && last.HalfWidths[2] < 0.01);
  CHECK(last.Last.dropped == (row == liar ? ELLIPTUDE_DIRECTION_BIT(1) : 0));
  CHECK(last.Last.claim == (row == liar ? ELLIPTUDE_CONDITIONAL : last.Last.claim));
  ++sent;
  return CFE_SUCCESS;
}

int main(void) {
  ATTITUDE_APP_Main();
  CHECK(ended_with == CFE_ES_RunStatus_APP_ERROR); /* the stub's pipe ended */
  CHECK(received == cycles && sent == cycles - 2);
  CHECK(last.Cycles == cycles - 2 && last.Refusals == 0);
  CHECK(events == 3); /* started, left out a star, a message of the wrong size */
  printf("%d telemetry messages, %d failures\n", sent, failures);
  return failures != 0;
}
