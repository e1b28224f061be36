/* A stub of what attitude_app.c uses of NASA's core Flight Executive (cFE 7): declarations of the same form, as far as that, so that the
 * application compiles and runs here without cFE. Not cFE, and no part of a flight build. */
#ifndef CFE_H
#define CFE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef int32_t int32;
typedef uint8_t uint8;
typedef uint16_t uint16;
typedef uint32_t uint32;

typedef int32 CFE_Status_t;
#define CFE_SUCCESS ((CFE_Status_t)0)

/* executive services */
#define CFE_ES_RunStatus_APP_RUN 1
#define CFE_ES_RunStatus_APP_EXIT 2
#define CFE_ES_RunStatus_APP_ERROR 3
bool CFE_ES_RunLoop(uint32* RunStatus);
void CFE_ES_ExitApp(uint32 ExitStatus);

/* time */
typedef struct {
  uint32 Seconds;
  uint32 Subseconds; /* of 2⁻³² s */
} CFE_TIME_SysTime_t;

/* messages */
typedef uint32 CFE_SB_MsgId_t;
typedef uint16 CFE_MSG_FcnCode_t;
typedef size_t CFE_MSG_Size_t;
typedef struct {
  CFE_SB_MsgId_t Id;
  CFE_MSG_Size_t Size;
  CFE_MSG_FcnCode_t FcnCode;
} CFE_MSG_Message_t;
typedef struct {
  CFE_MSG_Message_t Msg;
} CFE_MSG_CommandHeader_t;
typedef struct {
  CFE_MSG_Message_t Msg;
  CFE_TIME_SysTime_t Time;
} CFE_MSG_TelemetryHeader_t;
#define CFE_MSG_PTR(shdr) (&((shdr).Msg))
#define CFE_SB_ValueToMsgId(value) ((CFE_SB_MsgId_t)(value))
#define CFE_SB_MsgIdToValue(id) ((uint32)(id))
CFE_Status_t CFE_MSG_Init(CFE_MSG_Message_t* MsgPtr, CFE_SB_MsgId_t MsgId, CFE_MSG_Size_t Size);
CFE_Status_t CFE_MSG_GetMsgId(const CFE_MSG_Message_t* MsgPtr, CFE_SB_MsgId_t* MsgId);
CFE_Status_t CFE_MSG_GetSize(const CFE_MSG_Message_t* MsgPtr, CFE_MSG_Size_t* Size);
CFE_Status_t CFE_MSG_GetFcnCode(const CFE_MSG_Message_t* MsgPtr, CFE_MSG_FcnCode_t* FcnCode);

/* software bus */
typedef uint32 CFE_SB_PipeId_t;
typedef union {
  CFE_MSG_Message_t Msg;
  uint64_t Aligned;
} CFE_SB_Buffer_t;
#define CFE_SB_PEND_FOREVER (-1)
CFE_Status_t CFE_SB_CreatePipe(CFE_SB_PipeId_t* PipeIdPtr, uint16 Depth, const char* PipeName);
CFE_Status_t CFE_SB_Subscribe(CFE_SB_MsgId_t MsgId, CFE_SB_PipeId_t PipeId);
CFE_Status_t CFE_SB_ReceiveBuffer(CFE_SB_Buffer_t** BufPtr, CFE_SB_PipeId_t PipeId, int32 TimeOut);
CFE_Status_t CFE_SB_TransmitMsg(const CFE_MSG_Message_t* MsgPtr, bool IsOrigination);
void CFE_SB_TimeStampMsg(CFE_MSG_Message_t* MsgPtr);

/* events */
#define CFE_EVS_EventFilter_BINARY 0
typedef enum { CFE_EVS_EventType_INFORMATION = 2, CFE_EVS_EventType_ERROR = 3 } CFE_EVS_EventType_Enum_t;
CFE_Status_t CFE_EVS_Register(const void* Filters, uint16 NumEventFilters, uint16 FilterScheme);
CFE_Status_t CFE_EVS_SendEvent(uint16 EventID, CFE_EVS_EventType_Enum_t EventType, const char* Spec, ...);

#endif
