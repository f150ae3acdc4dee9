/* States of the FMU: kept, set again, written down. Part of fmu.c. */
FMI3_Export fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *FMUState)
{
    const Instance *it = instance;
    if (*FMUState == NULL)
        *FMUState = malloc(sizeof(State));
    if (*FMUState == NULL)
        return failed(it, "fmi3GetFMUState: no memory");
    memcpy(*FMUState, &it->state, sizeof(State));
    return fmi3OK;
}

FMI3_Export fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState FMUState)
{
    Instance *it = instance;
    if (FMUState == NULL)
        return failed(it, "fmi3SetFMUState: there is no state");
    memcpy(&it->state, FMUState, sizeof(State));
    return fmi3OK;
}

FMI3_Export fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *FMUState)
{
    if (FMUState != NULL) {
        free(*FMUState);
        *FMUState = NULL;
    }
    return fmi3OK;
}

FMI3_Export fmi3Status fmi3SerializedFMUStateSize(
    fmi3Instance instance, fmi3FMUState FMUState, size_t *size)
{
    *size = sizeof(State);
    return fmi3OK;
}

FMI3_Export fmi3Status fmi3SerializeFMUState(
    fmi3Instance instance, fmi3FMUState FMUState, fmi3Byte serializedState[], size_t size)
{
    if (FMUState == NULL || size < sizeof(State))
        return failed(instance, "fmi3SerializeFMUState: no state, or not enough room for it");
    memcpy(serializedState, FMUState, sizeof(State));
    return fmi3OK;
}

FMI3_Export fmi3Status fmi3DeserializeFMUState(
    fmi3Instance instance, const fmi3Byte serializedState[], size_t size, fmi3FMUState *FMUState)
{
    if (size != sizeof(State) ||
        memcmp(serializedState, MODEL_TOKEN, sizeof MODEL_TOKEN) != 0)
        return failed(instance, "fmi3DeserializeFMUState: the state is that of another FMU");
    if (*FMUState == NULL)
        *FMUState = malloc(sizeof(State));
    if (*FMUState == NULL)
        return failed(instance, "fmi3DeserializeFMUState: no memory");
    memcpy(*FMUState, serializedState, sizeof(State));
    return fmi3OK;
}
