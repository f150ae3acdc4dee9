/* An estimator as an FMU for co-simulation and scheduled execution, FMI 3.0.
 *
 * One communication step is one sample: the inputs that are set before fmi3DoStep(t, h) are the
 * sample at t, and the outputs after it are what the estimator says of that sample. So it is with a
 * tick of the clock, fmi3ActivateModelPartition(clock, t). A measurement that is NaN was not made, as
 * one whose mask is 0.
 *
 * What depends on the estimator is in model.h; values are numbered by their value references.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifndef fmi3Functions_h
#include "fmi3.h"
#endif

#include "model.h"

typedef enum { INSTANTIATED, INITIALISING, STEPPING, TERMINATED } Mode;

/* All that changes; a copy of it is the state of the FMU. */
typedef struct {
    char token[sizeof MODEL_TOKEN];
    int mode;
    double time;                          /* of the coming sample [s] */
    double values[MODEL_VALUES];          /* by value reference */
    double masks[MODEL_LAG + 1][MODEL_NY + 1]; /* newest first */
    model_memory memory;
} State;

typedef struct {
    State state;
    model_workspace work;
    double tables[MODEL_TABLES + 1];
    bool scheduled; /* a sample is a tick of the clock, not a step */
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
    bool logging;
} Instance;

static fmi3Status failed(const Instance *it, const char *message)
{
    if (it != NULL && it->log != NULL)
        it->log(it->environment, fmi3Error, "logStatusError", message);
    return fmi3Error;
}

static fmi3Status missing(fmi3Instance instance, const char *function)
{
    char message[160];
    (void)snprintf(message, sizeof message, "%s is not for an estimator, which has neither events nor such values", function);
    return failed((const Instance *)instance, message);
}

static fmi3Status wrong(const Instance *it, const char *what, fmi3ValueReference reference)
{
    char message[160];
    (void)snprintf(message, sizeof message, "%s (value reference %lu)", what,
                   (unsigned long)reference);
    return failed(it, message);
}

static void restart(State *state)
{
    int i, k;
    memset(state, 0, sizeof *state); /* the bytes between the fields are part of a state, too */
    memcpy(state->token, MODEL_TOKEN, sizeof MODEL_TOKEN);
    state->mode = INSTANTIATED;
    for (i = 0; i < MODEL_VALUES; ++i)
        state->values[i] = model_start[i];
    for (k = 0; k <= MODEL_LAG; ++k)
        for (i = 0; i < MODEL_NY; ++i)
            state->masks[k][i] = 0.0;
    model_init(&state->memory, state->values);
}

#include "innovation.h"
#include "tables.h"

/* --- Samples ---------------------------------------------------------------------------------- */

/* What was measured, checked: y and weights as the estimator takes them. */
static fmi3Status measured(const Instance *it, double *y, double *mask)
{
    const double *values = it->state.values;
    int i;
    for (i = 0; i < MODEL_NU; ++i)
        if (!isfinite(values[MODEL_U + i]))
            return wrong(it, "an input is not finite", (fmi3ValueReference)(MODEL_U + i));
    for (i = 0; i < MODEL_SIGMAS; ++i)
        if (!(values[MODEL_SIGMA + i] > 0.0) || !isfinite(values[MODEL_SIGMA + i]))
            return wrong(it, "a standard deviation is not larger than 0",
                         (fmi3ValueReference)(MODEL_SIGMA + i));
    for (i = MODEL_FIRST_SET; i < MODEL_U; ++i)
        if (!isfinite(values[i]))
            return wrong(it, "a parameter is not finite", (fmi3ValueReference)i);
    for (i = 0; i < MODEL_NY; ++i) {
        const double weight = values[MODEL_MASK + i], value = values[MODEL_Y + i];
        if (!(weight >= 0.0) || !isfinite(weight))
            return wrong(it, "a mask is negative or not finite",
                         (fmi3ValueReference)(MODEL_MASK + i));
        if (!MODEL_WEIGHS && weight != 0.0 && weight != 1.0)
            return wrong(it, "a mask is neither 0 nor 1, and the estimator does not weigh samples",
                         (fmi3ValueReference)(MODEL_MASK + i));
        if (isinf(value) && weight > 0.0)
            return wrong(it, "a measurement is infinite; NaN means not measured",
                         (fmi3ValueReference)(MODEL_Y + i));
        mask[i] = isnan(value) ? 0.0 : weight;
        y[i] = mask[i] > 0.0 ? value : 0.0;
    }
    return fmi3OK;
}

static fmi3Status sample(Instance *it)
{
    State *state = &it->state;
    double y[MODEL_NY + 1], mask[MODEL_NY + 1];
    model_innovation innovation;
    bool seen[MODEL_NY + 1];
    int i, k;
    const fmi3Status status = measured(it, y, mask);
    if (status != fmi3OK)
        return status;
    model_sample(&state->memory, &it->work, it->tables, state->values, y, mask, &innovation);
    for (k = MODEL_LAG; k > 0; --k)
        for (i = 0; i < MODEL_NY; ++i)
            state->masks[k][i] = state->masks[k - 1][i];
    for (i = 0; i < MODEL_NY; ++i) {
        state->masks[0][i] = mask[i];
        /* An outlier counts as not measured. */
        seen[i] = state->masks[MODEL_LAG][i] > 0.0 && !(innovation.weight[i] < MODEL_DOUBTED);
    }
    for (i = 0; i < MODEL_NY; ++i)
        if (!(state->masks[MODEL_LAG][i] > 0.0)) {
            state->values[MODEL_E + i] = NAN;
            if (MODEL_WEIGHT > 0)
                state->values[MODEL_WEIGHT + i] = NAN;
        }
    state->values[MODEL_NIS] = nis(innovation.e, innovation.S, seen);
    return fmi3OK;
}

/* --- Life of an instance ------------------------------------------------------------------------ */

FMI3_Export const char *fmi3GetVersion(void)
{
    return "3.0";
}

FMI3_Export fmi3Status fmi3SetDebugLogging(
    fmi3Instance instance, fmi3Boolean loggingOn, size_t nCategories, const fmi3String categories[])
{
    ((Instance *)instance)->logging = loggingOn;
    return fmi3OK;
}

static Instance *instantiate(
    bool scheduled, fmi3String instantiationToken, fmi3String resourcePath, fmi3Boolean loggingOn,
    fmi3InstanceEnvironment instanceEnvironment, fmi3LogMessageCallback logMessage)
{
    Instance *it;
    if (instantiationToken == NULL || strcmp(instantiationToken, MODEL_TOKEN) != 0) {
        if (logMessage != NULL)
            logMessage(instanceEnvironment, fmi3Error, "logStatusError",
                       "the instantiation token is that of another FMU");
        return NULL;
    }
    it = calloc(1, sizeof *it);
    if (it == NULL)
        return NULL;
    it->scheduled = scheduled;
    it->environment = instanceEnvironment;
    it->log = logMessage;
    it->logging = loggingOn;
    if (MODEL_TABLES > 0 && !read_tables(resourcePath, it->tables)) {
        (void)failed(it, "the folder of resources has no file 'tables.bin', or another one");
        free(it);
        return NULL;
    }
    restart(&it->state);
    return it;
}

FMI3_Export fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String instanceName, fmi3String instantiationToken, fmi3String resourcePath,
    fmi3Boolean visible, fmi3Boolean loggingOn, fmi3Boolean eventModeUsed,
    fmi3Boolean earlyReturnAllowed, const fmi3ValueReference requiredIntermediateVariables[],
    size_t nRequiredIntermediateVariables, fmi3InstanceEnvironment instanceEnvironment,
    fmi3LogMessageCallback logMessage, fmi3IntermediateUpdateCallback intermediateUpdate)
{
    return instantiate(
        false, instantiationToken, resourcePath, loggingOn, instanceEnvironment, logMessage);
}

FMI3_Export fmi3Instance fmi3InstantiateModelExchange(
    fmi3String instanceName, fmi3String instantiationToken, fmi3String resourcePath,
    fmi3Boolean visible, fmi3Boolean loggingOn, fmi3InstanceEnvironment instanceEnvironment,
    fmi3LogMessageCallback logMessage)
{
    return NULL;
}

FMI3_Export fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String instanceName, fmi3String instantiationToken, fmi3String resourcePath,
    fmi3Boolean visible, fmi3Boolean loggingOn, fmi3InstanceEnvironment instanceEnvironment,
    fmi3LogMessageCallback logMessage, fmi3ClockUpdateCallback clockUpdate,
    fmi3LockPreemptionCallback lockPreemption, fmi3UnlockPreemptionCallback unlockPreemption)
{
    return instantiate( /* one partition: there is nothing that it could be locked against */
        true, instantiationToken, resourcePath, loggingOn, instanceEnvironment, logMessage);
}

FMI3_Export void fmi3FreeInstance(fmi3Instance instance)
{
    free(instance);
}

FMI3_Export fmi3Status fmi3EnterInitializationMode(
    fmi3Instance instance, fmi3Boolean toleranceDefined, fmi3Float64 tolerance,
    fmi3Float64 startTime, fmi3Boolean stopTimeDefined, fmi3Float64 stopTime)
{
    Instance *it = instance;
    if (it->state.mode != INSTANTIATED)
        return failed(it, "fmi3EnterInitializationMode: initialised already");
    it->state.time = startTime;
    it->state.mode = INITIALISING;
    return fmi3OK;
}

FMI3_Export fmi3Status fmi3ExitInitializationMode(fmi3Instance instance)
{
    Instance *it = instance;
    if (it->state.mode != INITIALISING)
        return failed(it, "fmi3ExitInitializationMode: not in initialisation mode");
    model_init(&it->state.memory, it->state.values); /* by the prior that was set meanwhile */
    it->state.mode = STEPPING;
    return fmi3OK;
}

FMI3_Export fmi3Status fmi3Terminate(fmi3Instance instance)
{
    ((Instance *)instance)->state.mode = TERMINATED;
    return fmi3OK;
}

FMI3_Export fmi3Status fmi3Reset(fmi3Instance instance)
{
    restart(&((Instance *)instance)->state);
    return fmi3OK;
}

/* The sample at a time, which must be the one that is due. */
static fmi3Status sample_at(Instance *it, const char *function, double time)
{
    State *state = &it->state;
    fmi3Status status;
    char message[160];
    if (state->mode != STEPPING) {
        (void)snprintf(message, sizeof message, "%s: initialise first", function);
        return failed(it, message);
    }
    if (!(fabs(time - state->time) <= 1e-3 * MODEL_DT)) {
        (void)snprintf(message, sizeof message, "%s: it is %.9g s, but the next sample is at %.9g s",
                       function, time, state->time);
        return failed(it, message);
    }
    status = sample(it);
    if (status == fmi3OK)
        state->time = time + MODEL_DT;
    return status;
}

FMI3_Export fmi3Status fmi3DoStep(
    fmi3Instance instance, fmi3Float64 currentCommunicationPoint,
    fmi3Float64 communicationStepSize, fmi3Boolean noSetFMUStatePriorToCurrentPoint,
    fmi3Boolean *eventHandlingNeeded, fmi3Boolean *terminateSimulation, fmi3Boolean *earlyReturn,
    fmi3Float64 *lastSuccessfulTime)
{
    Instance *it = instance;
    fmi3Status status;
    char message[160];
    *eventHandlingNeeded = false;
    *terminateSimulation = false;
    *earlyReturn = false;
    *lastSuccessfulTime = it->state.time;
    if (it->scheduled)
        return failed(it, "fmi3DoStep: this instance is scheduled; activate its partition");
    if (!(fabs(communicationStepSize - MODEL_DT) <= 1e-6 * MODEL_DT)) {
        (void)snprintf(message, sizeof message,
                       "fmi3DoStep: the step is %g s, but a sample is taken every %g s",
                       communicationStepSize, MODEL_DT);
        return failed(it, message);
    }
    status = sample_at(it, "fmi3DoStep", currentCommunicationPoint);
    if (status == fmi3OK)
        it->state.time = currentCommunicationPoint + communicationStepSize;
    *lastSuccessfulTime = it->state.time;
    return status;
}

#include "clock.h"
#include "values.h"
#include "state.h"
#include "absent.h"
