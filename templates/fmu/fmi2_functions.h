/* The functions of FMI 2.0. With FMI2_FUNCTION_PREFIX defined, as for static linking, names begin with it. */
#ifndef FMU_FMI2_FUNCTIONS_H
#define FMU_FMI2_FUNCTIONS_H
#include "fmi2.h"
#include "fmu.h"

#include <stdlib.h>
#include <string.h>

#ifdef FMI2_FUNCTION_PREFIX
#define FMI2_PASTE(a, b) a##b
#define FMI2_JOIN(a, b) FMI2_PASTE(a, b)
#define FMI2(name) FMI2_JOIN(FMI2_FUNCTION_PREFIX, name)
#else
#define FMI2(name) name
#endif

#define FMI2_FUNCTION(name) FMU_EXPORT fmi2Status FMI2(name)

/* Begin a function that may be called in these modes. */
#define FMI2_BEGIN(name, modes)                                       \
  fmu_instance *instance = (fmu_instance *)c;                         \
  if (fmu_check_mode(instance, (modes), #name) != FMU_OK) {           \
    return fmi2Error;                                                 \
  }

#define FMI2_NEED(condition, name)                                                              \
  if (!(condition)) {                                                                           \
    fmu_report(instance, FMU_ERROR, "logStatusError", "%s: an argument is NULL or wrong", name); \
    return fmi2Error;                                                                           \
  }

enum {
  FMI2_READY = FMU_EVENT | FMU_CONTINUOUS | FMU_STEP,
  FMI2_ANY = FMU_INSTANTIATED | FMU_INITIALIZATION | FMI2_READY | FMU_TERMINATED
};

static void fmi2_report(fmu_instance *instance, int status, const char *category, const char *text)
{
  const fmi2CallbackFunctions *callbacks = (const fmi2CallbackFunctions *)instance->logger;
  if (callbacks->logger != NULL) {
    /* The message is a format; importers that take it as a text show this one right, too. */
    const char *format = strchr(text, '%') == NULL ? text : "%s";
    callbacks->logger(instance->environment, instance->name, (fmi2Status)status, category, format, text);
  }
}

FMU_EXPORT const char *FMI2(fmi2GetTypesPlatform)(void)
{
  return "default";
}

FMU_EXPORT const char *FMI2(fmi2GetVersion)(void)
{
  return "2.0";
}

FMI2_FUNCTION(fmi2SetDebugLogging)(
    fmi2Component c, fmi2Boolean loggingOn, size_t nCategories, const fmi2String categories[])
{
  FMI2_BEGIN(fmi2SetDebugLogging, FMI2_ANY)
  (void)nCategories;
  (void)categories;
  instance->is_logging = loggingOn != 0;
  return fmi2OK;
}

FMU_EXPORT fmi2Component FMI2(fmi2Instantiate)(
    fmi2String instanceName, fmi2Type fmuType, fmi2String fmuGUID, fmi2String fmuResourceLocation,
    const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean loggingOn)
{
  void *(*allocate)(size_t, size_t) = calloc;
  void (*release)(void *) = free;
  fmu_instance *instance;
  (void)fmuResourceLocation;
  (void)visible;
  if (functions == NULL || instanceName == NULL || instanceName[0] == 0) {
    return NULL;
  }
  if (fmuGUID == NULL || strcmp(fmuGUID, FMU_TOKEN) != 0) {
    if (functions->logger != NULL) {
      functions->logger(
          functions->componentEnvironment, instanceName, fmi2Error, "logStatusError",
          "the GUID is not that of this unit: " FMU_TOKEN);
    }
    return NULL;
  }
  if (!(fmuType == fmi2ModelExchange ? FMU_WITH_EXCHANGE : FMU_WITH_STEPS)) {
    if (functions->logger != NULL) {
      functions->logger(
          functions->componentEnvironment, instanceName, fmi2Error, "logStatusError",
          "the unit was exported without this interface");
    }
    return NULL;
  }
  if (functions->allocateMemory != NULL && functions->freeMemory != NULL) {
    allocate = functions->allocateMemory;
    release = functions->freeMemory;
  }
  instance = (fmu_instance *)allocate(1, sizeof *instance);
  if (instance == NULL) {
    return NULL;
  }
  memset(instance, 0, sizeof *instance);
  strncpy(instance->name, instanceName, sizeof instance->name - 1);
  instance->allocate = allocate;
  instance->release = release;
  instance->environment = functions->componentEnvironment;
  instance->logger = (void *)(size_t)functions;
  instance->report = fmi2_report;
  instance->is_logging = loggingOn != 0;
  instance->now.is_exchange = fmuType == fmi2ModelExchange;
  fmu_reset(instance);
  return instance;
}

FMU_EXPORT void FMI2(fmi2FreeInstance)(fmi2Component c)
{
  if (c != NULL) {
    ((fmu_instance *)c)->release(c);
  }
}

FMI2_FUNCTION(fmi2SetupExperiment)(
    fmi2Component c, fmi2Boolean toleranceDefined, fmi2Real tolerance, fmi2Real startTime, fmi2Boolean stopTimeDefined,
    fmi2Real stopTime)
{
  FMI2_BEGIN(fmi2SetupExperiment, FMU_INSTANTIATED)
  (void)stopTimeDefined;
  (void)stopTime;
  FMI2_NEED(startTime - startTime == 0.0, "fmi2SetupExperiment")
  FMI2_NEED(!toleranceDefined || (tolerance > 0.0 && tolerance < 1.0), "fmi2SetupExperiment")
  instance->now.time = startTime;
  instance->now.rtol = toleranceDefined ? tolerance : FMU_RTOL;
  return fmi2OK;
}

FMI2_FUNCTION(fmi2EnterInitializationMode)(fmi2Component c)
{
  FMI2_BEGIN(fmi2EnterInitializationMode, FMU_INSTANTIATED)
  instance->now.mode = FMU_INITIALIZATION;
  return fmi2OK;
}

FMI2_FUNCTION(fmi2ExitInitializationMode)(fmi2Component c)
{
  FMI2_BEGIN(fmi2ExitInitializationMode, FMU_INITIALIZATION)
  return (fmi2Status)fmu_leave_initialization(instance);
}

FMI2_FUNCTION(fmi2Terminate)(fmi2Component c)
{
  FMI2_BEGIN(fmi2Terminate, FMI2_READY)
  instance->now.mode = FMU_TERMINATED;
  return fmi2OK;
}

FMI2_FUNCTION(fmi2Reset)(fmi2Component c)
{
  FMI2_BEGIN(fmi2Reset, FMI2_ANY | FMU_FAILED)
  fmu_reset(instance);
  return fmi2OK;
}

FMI2_FUNCTION(fmi2GetReal)(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Real value[])
{
  size_t k;
  int status = FMU_OK;
  FMI2_BEGIN(fmi2GetReal, FMI2_ANY)
  FMI2_NEED(nvr == 0 || (vr != NULL && value != NULL), "fmi2GetReal")
  for (k = 0; status == FMU_OK && k < nvr; ++k) {
    status = fmu_get_number(instance, vr[k], value + k);
  }
  return (fmi2Status)status;
}

FMI2_FUNCTION(fmi2SetReal)(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Real value[])
{
  size_t k;
  int status = FMU_OK;
  FMI2_BEGIN(fmi2SetReal, FMU_INSTANTIATED | FMU_INITIALIZATION | FMI2_READY)
  FMI2_NEED(nvr == 0 || (vr != NULL && value != NULL), "fmi2SetReal")
  for (k = 0; status == FMU_OK && k < nvr; ++k) {
    status = fmu_set_number(instance, vr[k], value[k]);
  }
  return (fmi2Status)status;
}

FMI2_FUNCTION(fmi2GetInteger)(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Integer value[])
{
  size_t k;
  int status = FMU_OK;
  FMI2_BEGIN(fmi2GetInteger, FMI2_ANY)
  FMI2_NEED(nvr == 0 || (vr != NULL && value != NULL), "fmi2GetInteger")
  for (k = 0; status == FMU_OK && k < nvr; ++k) {
    status = fmu_get_count(instance, vr[k], value + k);
  }
  return (fmi2Status)status;
}

FMI2_FUNCTION(fmi2GetBoolean)(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Boolean value[])
{
  size_t k;
  int status = FMU_OK;
  FMI2_BEGIN(fmi2GetBoolean, FMI2_ANY)
  FMI2_NEED(nvr == 0 || (vr != NULL && value != NULL), "fmi2GetBoolean")
  for (k = 0; status == FMU_OK && k < nvr; ++k) {
    status = fmu_get_flag(instance, vr[k], value + k);
  }
  return (fmi2Status)status;
}

/* Functions for what this unit does not have: fine for no variables, an error for any. */
static fmi2Status fmi2_refuse(fmi2Component c, size_t count, const char *name)
{
  fmu_instance *instance = (fmu_instance *)c;
  if (instance == NULL || count != 0) {
    if (instance != NULL) {
      fmu_report(instance, FMU_ERROR, "logStatusError", "%s: the unit has none of these", name);
    }
    return fmi2Error;
  }
  return fmi2OK;
}

FMI2_FUNCTION(fmi2GetString)(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2String value[])
{
  (void)vr;
  (void)value;
  return fmi2_refuse(c, nvr, "fmi2GetString");
}

FMI2_FUNCTION(fmi2SetInteger)(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Integer value[])
{
  (void)vr;
  (void)value;
  return fmi2_refuse(c, nvr, "fmi2SetInteger");
}

FMI2_FUNCTION(fmi2SetBoolean)(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Boolean value[])
{
  (void)vr;
  (void)value;
  return fmi2_refuse(c, nvr, "fmi2SetBoolean");
}

FMI2_FUNCTION(fmi2SetString)(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2String value[])
{
  (void)vr;
  (void)value;
  return fmi2_refuse(c, nvr, "fmi2SetString");
}

FMI2_FUNCTION(fmi2GetFMUstate)(fmi2Component c, fmi2FMUstate *state)
{
  FMI2_BEGIN(fmi2GetFMUstate, FMI2_ANY)
  FMI2_NEED(state != NULL, "fmi2GetFMUstate")
  return (fmi2Status)fmu_store(instance, state);
}

FMI2_FUNCTION(fmi2SetFMUstate)(fmi2Component c, fmi2FMUstate state)
{
  FMI2_BEGIN(fmi2SetFMUstate, FMI2_ANY)
  return (fmi2Status)fmu_restore(instance, state);
}

FMI2_FUNCTION(fmi2FreeFMUstate)(fmi2Component c, fmi2FMUstate *state)
{
  FMI2_BEGIN(fmi2FreeFMUstate, FMI2_ANY)
  if (state != NULL && *state != NULL) {
    instance->release(*state);
    *state = NULL;
  }
  return fmi2OK;
}

FMI2_FUNCTION(fmi2SerializedFMUstateSize)(fmi2Component c, fmi2FMUstate state, size_t *size)
{
  FMI2_BEGIN(fmi2SerializedFMUstateSize, FMI2_ANY)
  FMI2_NEED(state != NULL && size != NULL, "fmi2SerializedFMUstateSize")
  *size = sizeof(fmu_memory);
  return fmi2OK;
}

FMI2_FUNCTION(fmi2SerializeFMUstate)(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
  FMI2_BEGIN(fmi2SerializeFMUstate, FMI2_ANY)
  FMI2_NEED(state != NULL && bytes != NULL && size >= sizeof(fmu_memory), "fmi2SerializeFMUstate")
  memcpy(bytes, state, sizeof(fmu_memory));
  return fmi2OK;
}

FMI2_FUNCTION(fmi2DeSerializeFMUstate)(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
{
  FMI2_BEGIN(fmi2DeSerializeFMUstate, FMI2_ANY)
  FMI2_NEED(state != NULL, "fmi2DeSerializeFMUstate")
  if (fmu_check_stored(instance, bytes, size) != FMU_OK || fmu_store(instance, state) != FMU_OK) {
    return fmi2Error;
  }
  memcpy(*state, bytes, sizeof(fmu_memory));
  return fmi2OK;
}

FMI2_FUNCTION(fmi2GetDirectionalDerivative)(
    fmi2Component c, const fmi2ValueReference unknown[], size_t nUnknown, const fmi2ValueReference known[],
    size_t nKnown, const fmi2Real seed[], fmi2Real sensitivity[])
{
  FMI2_BEGIN(fmi2GetDirectionalDerivative, FMU_INITIALIZATION | FMI2_READY)
  FMI2_NEED(
      (nUnknown == 0 || (unknown != NULL && sensitivity != NULL)) && (nKnown == 0 || (known != NULL && seed != NULL)),
      "fmi2GetDirectionalDerivative")
  return (fmi2Status)fmu_find_derivative(instance, unknown, nUnknown, known, nKnown, seed, sensitivity);
}

FMI2_FUNCTION(fmi2EnterEventMode)(fmi2Component c)
{
  FMI2_BEGIN(fmi2EnterEventMode, FMU_CONTINUOUS | FMU_EVENT)
  instance->now.mode = FMU_EVENT;
  return fmi2OK;
}

FMI2_FUNCTION(fmi2NewDiscreteStates)(fmi2Component c, fmi2EventInfo *info)
{
  FMI2_BEGIN(fmi2NewDiscreteStates, FMU_EVENT)
  FMI2_NEED(info != NULL, "fmi2NewDiscreteStates")
  memset(info, 0, sizeof *info);
  return (fmi2Status)fmu_update_slack(instance, 1);
}

FMI2_FUNCTION(fmi2EnterContinuousTimeMode)(fmi2Component c)
{
  FMI2_BEGIN(fmi2EnterContinuousTimeMode, FMU_EVENT)
  instance->now.mode = FMU_CONTINUOUS;
  return fmi2OK;
}

FMI2_FUNCTION(fmi2CompletedIntegratorStep)(
    fmi2Component c, fmi2Boolean noSetFMUStatePriorToCurrentPoint, fmi2Boolean *enterEventMode,
    fmi2Boolean *terminateSimulation)
{
  FMI2_BEGIN(fmi2CompletedIntegratorStep, FMU_CONTINUOUS)
  FMI2_NEED(enterEventMode != NULL && terminateSimulation != NULL, "fmi2CompletedIntegratorStep")
  (void)noSetFMUStatePriorToCurrentPoint;
  *enterEventMode = 0;
  *terminateSimulation = 0;
  return fmi2OK;
}

FMI2_FUNCTION(fmi2SetTime)(fmi2Component c, fmi2Real time)
{
  FMI2_BEGIN(fmi2SetTime, FMU_EVENT | FMU_CONTINUOUS)
  FMI2_NEED(time - time == 0.0, "fmi2SetTime")
  instance->now.time = time; /* nothing depends on it */
  return fmi2OK;
}

FMI2_FUNCTION(fmi2SetContinuousStates)(fmi2Component c, const fmi2Real x[], size_t nx)
{
  FMI2_BEGIN(fmi2SetContinuousStates, FMU_EVENT | FMU_CONTINUOUS)
  FMI2_NEED(nx == FMU_N_STATES && x != NULL, "fmi2SetContinuousStates")
  return (fmi2Status)fmu_set_states(instance, x);
}

FMI2_FUNCTION(fmi2GetDerivatives)(fmi2Component c, fmi2Real derivatives[], size_t nx)
{
  FMI2_BEGIN(fmi2GetDerivatives, FMU_INITIALIZATION | FMU_EVENT | FMU_CONTINUOUS | FMU_TERMINATED)
  FMI2_NEED(nx == FMU_N_STATES && derivatives != NULL, "fmi2GetDerivatives")
  return (fmi2Status)fmu_get_rates(instance, derivatives);
}

FMI2_FUNCTION(fmi2GetEventIndicators)(fmi2Component c, fmi2Real indicators[], size_t ni)
{
  FMI2_BEGIN(fmi2GetEventIndicators, FMU_INITIALIZATION | FMU_EVENT | FMU_CONTINUOUS | FMU_TERMINATED)
  FMI2_NEED(ni == FMU_N_MARGINS && (ni == 0 || indicators != NULL), "fmi2GetEventIndicators")
  return (fmi2Status)fmu_get_indicators(instance, indicators);
}

FMI2_FUNCTION(fmi2GetContinuousStates)(fmi2Component c, fmi2Real x[], size_t nx)
{
  FMI2_BEGIN(fmi2GetContinuousStates, FMU_INITIALIZATION | FMU_EVENT | FMU_CONTINUOUS | FMU_TERMINATED)
  FMI2_NEED(nx == FMU_N_STATES && x != NULL, "fmi2GetContinuousStates")
  memcpy(x, instance->now.state, sizeof instance->now.state);
  return fmi2OK;
}

FMI2_FUNCTION(fmi2GetNominalsOfContinuousStates)(fmi2Component c, fmi2Real nominals[], size_t nx)
{
  size_t k;
  FMI2_BEGIN(fmi2GetNominalsOfContinuousStates, FMI2_ANY)
  FMI2_NEED(nx == FMU_N_STATES && nominals != NULL, "fmi2GetNominalsOfContinuousStates")
  for (k = 0; k < nx; ++k) {
    nominals[k] = FMU_NOMINAL;
  }
  return fmi2OK;
}

FMI2_FUNCTION(fmi2SetRealInputDerivatives)(
    fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Integer order[], const fmi2Real value[])
{
  (void)vr;
  (void)order;
  (void)value;
  return fmi2_refuse(c, nvr, "fmi2SetRealInputDerivatives");
}

FMI2_FUNCTION(fmi2GetRealOutputDerivatives)(
    fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Integer order[], fmi2Real value[])
{
  (void)vr;
  (void)order;
  (void)value;
  return fmi2_refuse(c, nvr, "fmi2GetRealOutputDerivatives");
}

FMI2_FUNCTION(fmi2DoStep)(
    fmi2Component c, fmi2Real currentCommunicationPoint, fmi2Real communicationStepSize,
    fmi2Boolean noSetFMUStatePriorToCurrentPoint)
{
  FMI2_BEGIN(fmi2DoStep, FMU_STEP)
  (void)noSetFMUStatePriorToCurrentPoint;
  return (fmi2Status)fmu_do_step(instance, currentCommunicationPoint, communicationStepSize);
}

FMI2_FUNCTION(fmi2CancelStep)(fmi2Component c)
{
  FMI2_BEGIN(fmi2CancelStep, FMU_STEP)
  fmu_report(instance, FMU_ERROR, "logStatusError", "fmi2CancelStep: steps are not asynchronous");
  return fmi2Error;
}

FMI2_FUNCTION(fmi2GetStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value)
{
  (void)kind;
  (void)value;
  (void)c;
  return fmi2Discard;
}

FMI2_FUNCTION(fmi2GetRealStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
  FMI2_BEGIN(fmi2GetRealStatus, FMI2_ANY)
  FMI2_NEED(value != NULL, "fmi2GetRealStatus")
  if (kind != fmi2LastSuccessfulTime) {
    return fmi2Discard;
  }
  *value = instance->now.time;
  return fmi2OK;
}

FMI2_FUNCTION(fmi2GetIntegerStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value)
{
  (void)c;
  (void)kind;
  (void)value;
  return fmi2Discard;
}

FMI2_FUNCTION(fmi2GetBooleanStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value)
{
  FMI2_BEGIN(fmi2GetBooleanStatus, FMI2_ANY)
  FMI2_NEED(value != NULL, "fmi2GetBooleanStatus")
  if (kind != fmi2Terminated) {
    return fmi2Discard;
  }
  *value = 0;
  return fmi2OK;
}

FMI2_FUNCTION(fmi2GetStringStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2String *value)
{
  (void)c;
  (void)kind;
  (void)value;
  return fmi2Discard;
}

#endif
