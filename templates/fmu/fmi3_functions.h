/* The functions of FMI 3.0. With FMI3_FUNCTION_PREFIX defined, as for static linking, names begin with it. */
#ifndef FMU_FMI3_FUNCTIONS_H
#define FMU_FMI3_FUNCTIONS_H
#include "fmi3.h"
#include "fmu.h"

#include <stdlib.h>
#include <string.h>

#ifndef FMI3_FUNCTION_PREFIX
#define FMI3_FUNCTION_PREFIX
#endif
#define FMI3_PASTE(a, b) a##b
#define FMI3_JOIN(a, b) FMI3_PASTE(a, b)
#define FMI3(name) FMI3_JOIN(FMI3_FUNCTION_PREFIX, name)
#define FMI3_FUNCTION(name) FMU_EXPORT fmi3Status FMI3(name)

/* Begin a function that may be called in these modes. */
#define FMI3_BEGIN(name, modes)                             \
  fmu_instance *instance = (fmu_instance *)c;               \
  if (fmu_check_mode(instance, (modes), #name) != FMU_OK) { \
    return fmi3Error;                                       \
  }

#define FMI3_NEED(condition, name)                                                               \
  if (!(condition)) {                                                                            \
    fmu_report(instance, FMU_ERROR, "logStatusError", "%s: an argument is NULL or wrong", name); \
    return fmi3Error;                                                                            \
  }

enum {
  FMI3_READY = FMU_EVENT | FMU_CONTINUOUS | FMU_STEP,
  FMI3_ANY = FMU_INSTANTIATED | FMU_INITIALIZATION | FMI3_READY | FMU_TERMINATED
};

/* The callback for messages; a pointer to a function cannot be kept as a pointer to data. */
typedef struct {
  fmu_instance instance;
  fmi3LogMessageCallback log;
} fmi3_instance;

static void fmi3_report(fmu_instance *instance, int status, const char *category, const char *text)
{
  const fmi3_instance *whole = (const fmi3_instance *)(const void *)instance;
  if (whole->log != NULL) {
    whole->log(instance->environment, (fmi3Status)status, category, text);
  }
}

static fmi3Instance fmi3_instantiate(
    fmi3String name, fmi3String token, fmi3Boolean is_logging, fmi3InstanceEnvironment environment,
    fmi3LogMessageCallback log, int is_exchange)
{
  fmi3_instance *whole;
  fmu_instance *instance;
  const char *problem = NULL;
  if (token == NULL || strcmp(token, FMU_TOKEN) != 0) {
    problem = "the instantiation token is not that of this unit: " FMU_TOKEN;
  } else if (!(is_exchange ? FMU_WITH_EXCHANGE : FMU_WITH_STEPS)) {
    problem = "the unit was exported without this interface";
  } else if (name == NULL || name[0] == 0) {
    problem = "the instance has no name";
  }
  if (problem != NULL) {
    if (log != NULL) {
      log(environment, fmi3Error, "logStatusError", problem);
    }
    return NULL;
  }
  whole = (fmi3_instance *)calloc(1, sizeof *whole);
  if (whole == NULL) {
    return NULL;
  }
  instance = &whole->instance;
  strncpy(instance->name, name, sizeof instance->name - 1);
  whole->log = log;
  instance->allocate = calloc;
  instance->release = free;
  instance->environment = environment;
  instance->report = fmi3_report;
  instance->is_logging = is_logging;
  instance->now.is_exchange = is_exchange;
  fmu_reset(instance);
  return instance;
}

FMU_EXPORT const char *FMI3(fmi3GetVersion)(void)
{
  return "3.0";
}

FMI3_FUNCTION(fmi3SetDebugLogging)(
    fmi3Instance c, fmi3Boolean loggingOn, size_t nCategories, const fmi3String categories[])
{
  FMI3_BEGIN(fmi3SetDebugLogging, FMI3_ANY)
  (void)nCategories;
  (void)categories;
  instance->is_logging = loggingOn;
  return fmi3OK;
}

FMU_EXPORT fmi3Instance FMI3(fmi3InstantiateModelExchange)(
    fmi3String instanceName, fmi3String instantiationToken, fmi3String resourcePath, fmi3Boolean visible,
    fmi3Boolean loggingOn, fmi3InstanceEnvironment environment, fmi3LogMessageCallback logMessage)
{
  (void)resourcePath;
  (void)visible;
  return fmi3_instantiate(instanceName, instantiationToken, loggingOn, environment, logMessage, 1);
}

FMU_EXPORT fmi3Instance FMI3(fmi3InstantiateCoSimulation)(
    fmi3String instanceName, fmi3String instantiationToken, fmi3String resourcePath, fmi3Boolean visible,
    fmi3Boolean loggingOn, fmi3Boolean eventModeUsed, fmi3Boolean earlyReturnAllowed,
    const fmi3ValueReference requiredIntermediateVariables[], size_t nRequiredIntermediateVariables,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback logMessage,
    fmi3IntermediateUpdateCallback intermediateUpdate)
{
  (void)resourcePath;
  (void)visible;
  (void)eventModeUsed;
  (void)earlyReturnAllowed;
  (void)requiredIntermediateVariables;
  (void)nRequiredIntermediateVariables;
  (void)intermediateUpdate;
  return fmi3_instantiate(instanceName, instantiationToken, loggingOn, environment, logMessage, 0);
}

FMU_EXPORT fmi3Instance FMI3(fmi3InstantiateScheduledExecution)(
    fmi3String instanceName, fmi3String instantiationToken, fmi3String resourcePath, fmi3Boolean visible,
    fmi3Boolean loggingOn, fmi3InstanceEnvironment environment, fmi3LogMessageCallback logMessage,
    fmi3ClockUpdateCallback clockUpdate, fmi3LockPreemptionCallback lockPreemption,
    fmi3UnlockPreemptionCallback unlockPreemption)
{
  (void)instanceName;
  (void)instantiationToken;
  (void)resourcePath;
  (void)visible;
  (void)loggingOn;
  (void)clockUpdate;
  (void)lockPreemption;
  (void)unlockPreemption;
  if (logMessage != NULL) {
    logMessage(environment, fmi3Error, "logStatusError", "the unit has no scheduled execution");
  }
  return NULL;
}

FMU_EXPORT void FMI3(fmi3FreeInstance)(fmi3Instance c)
{
  free(c);
}

FMI3_FUNCTION(fmi3EnterInitializationMode)(
    fmi3Instance c, fmi3Boolean toleranceDefined, fmi3Float64 tolerance, fmi3Float64 startTime,
    fmi3Boolean stopTimeDefined, fmi3Float64 stopTime)
{
  FMI3_BEGIN(fmi3EnterInitializationMode, FMU_INSTANTIATED)
  (void)stopTimeDefined;
  (void)stopTime;
  FMI3_NEED(startTime - startTime == 0.0, "fmi3EnterInitializationMode")
  FMI3_NEED(!toleranceDefined || (tolerance > 0.0 && tolerance < 1.0), "fmi3EnterInitializationMode")
  instance->now.time = startTime;
  instance->now.rtol = toleranceDefined ? tolerance : FMU_RTOL;
  instance->now.mode = FMU_INITIALIZATION;
  return fmi3OK;
}

FMI3_FUNCTION(fmi3ExitInitializationMode)(fmi3Instance c)
{
  FMI3_BEGIN(fmi3ExitInitializationMode, FMU_INITIALIZATION)
  return (fmi3Status)fmu_leave_initialization(instance);
}

FMI3_FUNCTION(fmi3EnterEventMode)(fmi3Instance c)
{
  FMI3_BEGIN(fmi3EnterEventMode, FMU_CONTINUOUS | FMU_EVENT)
  instance->now.mode = FMU_EVENT;
  return fmi3OK;
}

FMI3_FUNCTION(fmi3Terminate)(fmi3Instance c)
{
  FMI3_BEGIN(fmi3Terminate, FMI3_READY)
  instance->now.mode = FMU_TERMINATED;
  return fmi3OK;
}

FMI3_FUNCTION(fmi3Reset)(fmi3Instance c)
{
  FMI3_BEGIN(fmi3Reset, FMI3_ANY | FMU_FAILED)
  fmu_reset(instance);
  return fmi3OK;
}

FMI3_FUNCTION(fmi3GetFloat64)(
    fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, fmi3Float64 value[], size_t nValues)
{
  size_t k;
  int status = FMU_OK;
  FMI3_BEGIN(fmi3GetFloat64, FMI3_ANY)
  FMI3_NEED(nValues == nvr && (nvr == 0 || (vr != NULL && value != NULL)), "fmi3GetFloat64")
  for (k = 0; status == FMU_OK && k < nvr; ++k) {
    status = fmu_get_number(instance, vr[k], value + k);
  }
  return (fmi3Status)status;
}

FMI3_FUNCTION(fmi3SetFloat64)(
    fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, const fmi3Float64 value[], size_t nValues)
{
  size_t k;
  int status = FMU_OK;
  FMI3_BEGIN(fmi3SetFloat64, FMU_INSTANTIATED | FMU_INITIALIZATION | FMI3_READY)
  FMI3_NEED(nValues == nvr && (nvr == 0 || (vr != NULL && value != NULL)), "fmi3SetFloat64")
  for (k = 0; status == FMU_OK && k < nvr; ++k) {
    status = fmu_set_number(instance, vr[k], value[k]);
  }
  return (fmi3Status)status;
}

FMI3_FUNCTION(fmi3GetBoolean)(
    fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, fmi3Boolean value[], size_t nValues)
{
  size_t k;
  int status = FMU_OK, flag = 0;
  FMI3_BEGIN(fmi3GetBoolean, FMI3_ANY)
  FMI3_NEED(nValues == nvr && (nvr == 0 || (vr != NULL && value != NULL)), "fmi3GetBoolean")
  for (k = 0; status == FMU_OK && k < nvr; ++k) {
    status = fmu_get_flag(instance, vr[k], &flag);
    value[k] = flag != 0;
  }
  return (fmi3Status)status;
}

FMI3_FUNCTION(fmi3GetInt32)(
    fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, fmi3Int32 value[], size_t nValues)
{
  size_t k;
  int status = FMU_OK, count = 0;
  FMI3_BEGIN(fmi3GetInt32, FMI3_ANY)
  FMI3_NEED(nValues == nvr && (nvr == 0 || (vr != NULL && value != NULL)), "fmi3GetInt32")
  for (k = 0; status == FMU_OK && k < nvr; ++k) {
    status = fmu_get_count(instance, vr[k], &count);
    value[k] = (fmi3Int32)count;
  }
  return (fmi3Status)status;
}

/* Functions for what this unit does not have: fine for no variables, an error for any. */
static fmi3Status fmi3_refuse(fmi3Instance c, size_t count, const char *name)
{
  fmu_instance *instance = (fmu_instance *)c;
  if (instance == NULL || count != 0) {
    if (instance != NULL) {
      fmu_report(instance, FMU_ERROR, "logStatusError", "%s: the unit has none of these", name);
    }
    return fmi3Error;
  }
  return fmi3OK;
}

#define FMI3_NO_GETTER(name, type)                                                                 \
  FMI3_FUNCTION(name)(                                                                             \
      fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, type value[], size_t nValues)     \
  {                                                                                                \
    (void)vr;                                                                                      \
    (void)value;                                                                                   \
    (void)nValues;                                                                                 \
    return fmi3_refuse(c, nvr, #name);                                                             \
  }
#define FMI3_NO_SETTER(name, type)                                                                   \
  FMI3_FUNCTION(name)(                                                                               \
      fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, const type value[], size_t nValues) \
  {                                                                                                  \
    (void)vr;                                                                                        \
    (void)value;                                                                                     \
    (void)nValues;                                                                                   \
    return fmi3_refuse(c, nvr, #name);                                                               \
  }

FMI3_NO_GETTER(fmi3GetFloat32, fmi3Float32)
FMI3_NO_GETTER(fmi3GetInt8, fmi3Int8)
FMI3_NO_GETTER(fmi3GetUInt8, fmi3UInt8)
FMI3_NO_GETTER(fmi3GetInt16, fmi3Int16)
FMI3_NO_GETTER(fmi3GetUInt16, fmi3UInt16)
FMI3_NO_GETTER(fmi3GetUInt32, fmi3UInt32)
FMI3_NO_GETTER(fmi3GetInt64, fmi3Int64)
FMI3_NO_GETTER(fmi3GetUInt64, fmi3UInt64)
FMI3_NO_GETTER(fmi3GetString, fmi3String)
FMI3_NO_SETTER(fmi3SetFloat32, fmi3Float32)
FMI3_NO_SETTER(fmi3SetInt8, fmi3Int8)
FMI3_NO_SETTER(fmi3SetUInt8, fmi3UInt8)
FMI3_NO_SETTER(fmi3SetInt16, fmi3Int16)
FMI3_NO_SETTER(fmi3SetUInt16, fmi3UInt16)
FMI3_NO_SETTER(fmi3SetInt32, fmi3Int32)
FMI3_NO_SETTER(fmi3SetUInt32, fmi3UInt32)
FMI3_NO_SETTER(fmi3SetInt64, fmi3Int64)
FMI3_NO_SETTER(fmi3SetUInt64, fmi3UInt64)
FMI3_NO_SETTER(fmi3SetBoolean, fmi3Boolean)
FMI3_NO_SETTER(fmi3SetString, fmi3String)

FMI3_FUNCTION(fmi3GetBinary)(
    fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, size_t sizes[], fmi3Binary value[], size_t nValues)
{
  (void)vr;
  (void)sizes;
  (void)value;
  (void)nValues;
  return fmi3_refuse(c, nvr, "fmi3GetBinary");
}

FMI3_FUNCTION(fmi3SetBinary)(
    fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, const size_t sizes[], const fmi3Binary value[],
    size_t nValues)
{
  (void)vr;
  (void)sizes;
  (void)value;
  (void)nValues;
  return fmi3_refuse(c, nvr, "fmi3SetBinary");
}

FMI3_FUNCTION(fmi3GetClock)(fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, fmi3Clock value[])
{
  (void)vr;
  (void)value;
  return fmi3_refuse(c, nvr, "fmi3GetClock");
}

FMI3_FUNCTION(fmi3SetClock)(fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, const fmi3Clock value[])
{
  (void)vr;
  (void)value;
  return fmi3_refuse(c, nvr, "fmi3SetClock");
}

FMI3_FUNCTION(fmi3GetNumberOfVariableDependencies)(fmi3Instance c, fmi3ValueReference vr, size_t *count)
{
  (void)vr;
  (void)count;
  return fmi3_refuse(c, 1, "fmi3GetNumberOfVariableDependencies");
}

FMI3_FUNCTION(fmi3GetVariableDependencies)(
    fmi3Instance c, fmi3ValueReference dependent, size_t elementsOfDependent[], fmi3ValueReference independents[],
    size_t elementsOfIndependents[], fmi3DependencyKind kinds[], size_t count)
{
  (void)dependent;
  (void)elementsOfDependent;
  (void)independents;
  (void)elementsOfIndependents;
  (void)kinds;
  return fmi3_refuse(c, count + 1, "fmi3GetVariableDependencies");
}

FMI3_FUNCTION(fmi3GetFMUState)(fmi3Instance c, fmi3FMUState *state)
{
  FMI3_BEGIN(fmi3GetFMUState, FMI3_ANY)
  FMI3_NEED(state != NULL, "fmi3GetFMUState")
  return (fmi3Status)fmu_store(instance, state);
}

FMI3_FUNCTION(fmi3SetFMUState)(fmi3Instance c, fmi3FMUState state)
{
  FMI3_BEGIN(fmi3SetFMUState, FMI3_ANY)
  return (fmi3Status)fmu_restore(instance, state);
}

FMI3_FUNCTION(fmi3FreeFMUState)(fmi3Instance c, fmi3FMUState *state)
{
  FMI3_BEGIN(fmi3FreeFMUState, FMI3_ANY)
  if (state != NULL && *state != NULL) {
    instance->release(*state);
    *state = NULL;
  }
  return fmi3OK;
}

FMI3_FUNCTION(fmi3SerializedFMUStateSize)(fmi3Instance c, fmi3FMUState state, size_t *size)
{
  FMI3_BEGIN(fmi3SerializedFMUStateSize, FMI3_ANY)
  FMI3_NEED(state != NULL && size != NULL, "fmi3SerializedFMUStateSize")
  *size = sizeof(fmu_memory);
  return fmi3OK;
}

FMI3_FUNCTION(fmi3SerializeFMUState)(fmi3Instance c, fmi3FMUState state, fmi3Byte bytes[], size_t size)
{
  FMI3_BEGIN(fmi3SerializeFMUState, FMI3_ANY)
  FMI3_NEED(state != NULL && bytes != NULL && size >= sizeof(fmu_memory), "fmi3SerializeFMUState")
  memcpy(bytes, state, sizeof(fmu_memory));
  return fmi3OK;
}

FMI3_FUNCTION(fmi3DeserializeFMUState)(fmi3Instance c, const fmi3Byte bytes[], size_t size, fmi3FMUState *state)
{
  FMI3_BEGIN(fmi3DeserializeFMUState, FMI3_ANY)
  FMI3_NEED(state != NULL, "fmi3DeserializeFMUState")
  if (fmu_check_stored(instance, bytes, size) != FMU_OK || fmu_store(instance, state) != FMU_OK) {
    return fmi3Error;
  }
  memcpy(*state, bytes, sizeof(fmu_memory));
  return fmi3OK;
}

FMI3_FUNCTION(fmi3GetDirectionalDerivative)(
    fmi3Instance c, const fmi3ValueReference unknowns[], size_t nUnknowns, const fmi3ValueReference knowns[],
    size_t nKnowns, const fmi3Float64 seed[], size_t nSeed, fmi3Float64 sensitivity[], size_t nSensitivity)
{
  FMI3_BEGIN(fmi3GetDirectionalDerivative, FMU_INITIALIZATION | FMI3_READY)
  FMI3_NEED(
      nSeed == nKnowns && nSensitivity == nUnknowns && (nUnknowns == 0 || (unknowns != NULL && sensitivity != NULL))
          && (nKnowns == 0 || (knowns != NULL && seed != NULL)),
      "fmi3GetDirectionalDerivative")
  return (fmi3Status)fmu_find_derivative(instance, unknowns, nUnknowns, knowns, nKnowns, seed, sensitivity);
}

FMI3_FUNCTION(fmi3GetAdjointDerivative)(
    fmi3Instance c, const fmi3ValueReference unknowns[], size_t nUnknowns, const fmi3ValueReference knowns[],
    size_t nKnowns, const fmi3Float64 seed[], size_t nSeed, fmi3Float64 sensitivity[], size_t nSensitivity)
{
  const double one = 1.0;
  double change = 0.0;
  size_t j, k;
  int status = FMU_OK;
  FMI3_BEGIN(fmi3GetAdjointDerivative, FMU_INITIALIZATION | FMI3_READY)
  FMI3_NEED(
      nSeed == nUnknowns && nSensitivity == nKnowns && (nUnknowns == 0 || (unknowns != NULL && seed != NULL))
          && (nKnowns == 0 || (knowns != NULL && sensitivity != NULL)),
      "fmi3GetAdjointDerivative")
  for (j = 0; status == FMU_OK && j < nKnowns; ++j) {
    sensitivity[j] = 0.0;
    for (k = 0; status == FMU_OK && k < nUnknowns; ++k) {
      status = fmu_find_derivative(instance, unknowns + k, 1, knowns + j, 1, &one, &change);
      sensitivity[j] += change * seed[k];
    }
  }
  return (fmi3Status)status;
}

FMI3_FUNCTION(fmi3EnterConfigurationMode)(fmi3Instance c)
{
  return fmi3_refuse(c, 1, "fmi3EnterConfigurationMode");
}

FMI3_FUNCTION(fmi3ExitConfigurationMode)(fmi3Instance c)
{
  return fmi3_refuse(c, 1, "fmi3ExitConfigurationMode");
}

FMI3_FUNCTION(fmi3GetIntervalDecimal)(
    fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, fmi3Float64 intervals[],
    fmi3IntervalQualifier qualifiers[])
{
  (void)vr;
  (void)intervals;
  (void)qualifiers;
  return fmi3_refuse(c, nvr, "fmi3GetIntervalDecimal");
}

FMI3_FUNCTION(fmi3GetIntervalFraction)(
    fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, fmi3UInt64 counters[], fmi3UInt64 resolutions[],
    fmi3IntervalQualifier qualifiers[])
{
  (void)vr;
  (void)counters;
  (void)resolutions;
  (void)qualifiers;
  return fmi3_refuse(c, nvr, "fmi3GetIntervalFraction");
}

FMI3_FUNCTION(fmi3GetShiftDecimal)(
    fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, fmi3Float64 shifts[])
{
  (void)vr;
  (void)shifts;
  return fmi3_refuse(c, nvr, "fmi3GetShiftDecimal");
}

FMI3_FUNCTION(fmi3GetShiftFraction)(
    fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, fmi3UInt64 counters[], fmi3UInt64 resolutions[])
{
  (void)vr;
  (void)counters;
  (void)resolutions;
  return fmi3_refuse(c, nvr, "fmi3GetShiftFraction");
}

FMI3_FUNCTION(fmi3SetIntervalDecimal)(
    fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, const fmi3Float64 intervals[])
{
  (void)vr;
  (void)intervals;
  return fmi3_refuse(c, nvr, "fmi3SetIntervalDecimal");
}

FMI3_FUNCTION(fmi3SetIntervalFraction)(
    fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, const fmi3UInt64 counters[],
    const fmi3UInt64 resolutions[])
{
  (void)vr;
  (void)counters;
  (void)resolutions;
  return fmi3_refuse(c, nvr, "fmi3SetIntervalFraction");
}

FMI3_FUNCTION(fmi3SetShiftDecimal)(
    fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, const fmi3Float64 shifts[])
{
  (void)vr;
  (void)shifts;
  return fmi3_refuse(c, nvr, "fmi3SetShiftDecimal");
}

FMI3_FUNCTION(fmi3SetShiftFraction)(
    fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, const fmi3UInt64 counters[],
    const fmi3UInt64 resolutions[])
{
  (void)vr;
  (void)counters;
  (void)resolutions;
  return fmi3_refuse(c, nvr, "fmi3SetShiftFraction");
}

FMI3_FUNCTION(fmi3EvaluateDiscreteStates)(fmi3Instance c)
{
  FMI3_BEGIN(fmi3EvaluateDiscreteStates, FMU_INITIALIZATION | FMU_EVENT)
  return fmi3OK;
}

FMI3_FUNCTION(fmi3UpdateDiscreteStates)(
    fmi3Instance c, fmi3Boolean *discreteStatesNeedUpdate, fmi3Boolean *terminateSimulation,
    fmi3Boolean *nominalsOfContinuousStatesChanged, fmi3Boolean *valuesOfContinuousStatesChanged,
    fmi3Boolean *nextEventTimeDefined, fmi3Float64 *nextEventTime)
{
  FMI3_BEGIN(fmi3UpdateDiscreteStates, FMU_EVENT)
  FMI3_NEED(
      discreteStatesNeedUpdate && terminateSimulation && nominalsOfContinuousStatesChanged
          && valuesOfContinuousStatesChanged && nextEventTimeDefined && nextEventTime,
      "fmi3UpdateDiscreteStates")
  *discreteStatesNeedUpdate = false;
  *terminateSimulation = false;
  *nominalsOfContinuousStatesChanged = false;
  *valuesOfContinuousStatesChanged = false;
  *nextEventTimeDefined = false;
  *nextEventTime = 0.0;
  return (fmi3Status)fmu_update_slack(instance, 1);
}

FMI3_FUNCTION(fmi3EnterContinuousTimeMode)(fmi3Instance c)
{
  FMI3_BEGIN(fmi3EnterContinuousTimeMode, FMU_EVENT)
  instance->now.mode = FMU_CONTINUOUS;
  return fmi3OK;
}

FMI3_FUNCTION(fmi3CompletedIntegratorStep)(
    fmi3Instance c, fmi3Boolean noSetFMUStatePriorToCurrentPoint, fmi3Boolean *enterEventMode,
    fmi3Boolean *terminateSimulation)
{
  FMI3_BEGIN(fmi3CompletedIntegratorStep, FMU_CONTINUOUS)
  FMI3_NEED(enterEventMode != NULL && terminateSimulation != NULL, "fmi3CompletedIntegratorStep")
  (void)noSetFMUStatePriorToCurrentPoint;
  *enterEventMode = false;
  *terminateSimulation = false;
  return fmi3OK;
}

FMI3_FUNCTION(fmi3SetTime)(fmi3Instance c, fmi3Float64 time)
{
  FMI3_BEGIN(fmi3SetTime, FMU_EVENT | FMU_CONTINUOUS)
  FMI3_NEED(time - time == 0.0, "fmi3SetTime")
  instance->now.time = time; /* nothing depends on it */
  return fmi3OK;
}

FMI3_FUNCTION(fmi3SetContinuousStates)(fmi3Instance c, const fmi3Float64 states[], size_t count)
{
  FMI3_BEGIN(fmi3SetContinuousStates, FMU_EVENT | FMU_CONTINUOUS)
  FMI3_NEED(count == FMU_N_STATES && states != NULL, "fmi3SetContinuousStates")
  return (fmi3Status)fmu_set_states(instance, states);
}

FMI3_FUNCTION(fmi3GetContinuousStateDerivatives)(fmi3Instance c, fmi3Float64 derivatives[], size_t count)
{
  FMI3_BEGIN(fmi3GetContinuousStateDerivatives, FMU_INITIALIZATION | FMU_EVENT | FMU_CONTINUOUS | FMU_TERMINATED)
  FMI3_NEED(count == FMU_N_STATES && derivatives != NULL, "fmi3GetContinuousStateDerivatives")
  return (fmi3Status)fmu_get_rates(instance, derivatives);
}

FMI3_FUNCTION(fmi3GetEventIndicators)(fmi3Instance c, fmi3Float64 indicators[], size_t count)
{
  FMI3_BEGIN(fmi3GetEventIndicators, FMU_INITIALIZATION | FMU_EVENT | FMU_CONTINUOUS | FMU_TERMINATED)
  FMI3_NEED(count == FMU_N_MARGINS && (count == 0 || indicators != NULL), "fmi3GetEventIndicators")
  return (fmi3Status)fmu_get_indicators(instance, indicators);
}

FMI3_FUNCTION(fmi3GetContinuousStates)(fmi3Instance c, fmi3Float64 states[], size_t count)
{
  FMI3_BEGIN(fmi3GetContinuousStates, FMU_INITIALIZATION | FMU_EVENT | FMU_CONTINUOUS | FMU_TERMINATED)
  FMI3_NEED(count == FMU_N_STATES && states != NULL, "fmi3GetContinuousStates")
  memcpy(states, instance->now.state, sizeof instance->now.state);
  return fmi3OK;
}

FMI3_FUNCTION(fmi3GetNominalsOfContinuousStates)(fmi3Instance c, fmi3Float64 nominals[], size_t count)
{
  size_t k;
  FMI3_BEGIN(fmi3GetNominalsOfContinuousStates, FMI3_ANY)
  FMI3_NEED(count == FMU_N_STATES && nominals != NULL, "fmi3GetNominalsOfContinuousStates")
  for (k = 0; k < count; ++k) {
    nominals[k] = FMU_NOMINAL;
  }
  return fmi3OK;
}

FMI3_FUNCTION(fmi3GetNumberOfEventIndicators)(fmi3Instance c, size_t *count)
{
  FMI3_BEGIN(fmi3GetNumberOfEventIndicators, FMI3_ANY)
  FMI3_NEED(count != NULL, "fmi3GetNumberOfEventIndicators")
  *count = FMU_N_MARGINS;
  return fmi3OK;
}

FMI3_FUNCTION(fmi3GetNumberOfContinuousStates)(fmi3Instance c, size_t *count)
{
  FMI3_BEGIN(fmi3GetNumberOfContinuousStates, FMI3_ANY)
  FMI3_NEED(count != NULL, "fmi3GetNumberOfContinuousStates")
  *count = FMU_N_STATES;
  return fmi3OK;
}

FMI3_FUNCTION(fmi3EnterStepMode)(fmi3Instance c)
{
  FMI3_BEGIN(fmi3EnterStepMode, FMU_STEP)
  return fmi3OK;
}

FMI3_FUNCTION(fmi3GetOutputDerivatives)(
    fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, const fmi3Int32 orders[], fmi3Float64 values[],
    size_t nValues)
{
  (void)vr;
  (void)orders;
  (void)values;
  (void)nValues;
  return fmi3_refuse(c, nvr, "fmi3GetOutputDerivatives");
}

FMI3_FUNCTION(fmi3DoStep)(
    fmi3Instance c, fmi3Float64 currentCommunicationPoint, fmi3Float64 communicationStepSize,
    fmi3Boolean noSetFMUStatePriorToCurrentPoint, fmi3Boolean *eventHandlingNeeded, fmi3Boolean *terminateSimulation,
    fmi3Boolean *earlyReturn, fmi3Float64 *lastSuccessfulTime)
{
  int status;
  FMI3_BEGIN(fmi3DoStep, FMU_STEP)
  FMI3_NEED(
      eventHandlingNeeded != NULL && terminateSimulation != NULL && earlyReturn != NULL && lastSuccessfulTime != NULL,
      "fmi3DoStep")
  (void)noSetFMUStatePriorToCurrentPoint;
  status = fmu_do_step(instance, currentCommunicationPoint, communicationStepSize);
  *eventHandlingNeeded = false;
  *terminateSimulation = false;
  *earlyReturn = false;
  *lastSuccessfulTime = instance->now.time;
  return (fmi3Status)status;
}

FMI3_FUNCTION(fmi3ActivateModelPartition)(fmi3Instance c, fmi3ValueReference clock, fmi3Float64 time)
{
  (void)clock;
  (void)time;
  return fmi3_refuse(c, 1, "fmi3ActivateModelPartition");
}

#endif
