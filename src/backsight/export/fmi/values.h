/* Values by their references. Part of fmu.c. */
FMI3_Export fmi3Status fmi3GetFloat64(
    fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
    fmi3Float64 values[], size_t nValues)
{
    const Instance *it = instance;
    size_t i;
    if (nValues != nValueReferences)
        return failed(it, "fmi3GetFloat64: every variable is one number");
    for (i = 0; i < nValueReferences; ++i) {
        const fmi3ValueReference r = valueReferences[i];
        if (r >= MODEL_VALUES || r == MODEL_STATUS)
            return wrong(it, "fmi3GetFloat64: no such variable", r);
        values[i] = r == 0 ? it->state.time : it->state.values[r];
    }
    return fmi3OK;
}

FMI3_Export fmi3Status fmi3GetInt32(
    fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
    fmi3Int32 values[], size_t nValues)
{
    const Instance *it = instance;
    size_t i;
    if (nValues != nValueReferences)
        return failed(it, "fmi3GetInt32: every variable is one number");
    for (i = 0; i < nValueReferences; ++i) {
        if (valueReferences[i] != MODEL_STATUS)
            return wrong(it, "fmi3GetInt32: no such variable", valueReferences[i]);
        values[i] = (fmi3Int32)it->state.values[MODEL_STATUS];
    }
    return fmi3OK;
}

FMI3_Export fmi3Status fmi3SetFloat64(
    fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
    const fmi3Float64 values[], size_t nValues)
{
    Instance *it = instance;
    size_t i;
    if (nValues != nValueReferences)
        return failed(it, "fmi3SetFloat64: every variable is one number");
    for (i = 0; i < nValueReferences; ++i) { /* all or nothing */
        const fmi3ValueReference r = valueReferences[i];
        if (r < MODEL_FIRST_SET || r >= MODEL_FIRST_OUTPUT)
            return wrong(it, "fmi3SetFloat64: no input or parameter", r);
        if (r < MODEL_FIRST_SET + MODEL_FIXED && it->state.mode == STEPPING)
            return wrong(it, "fmi3SetFloat64: the prior is set before the first step", r);
    }
    for (i = 0; i < nValueReferences; ++i)
        it->state.values[valueReferences[i]] = values[i];
    return fmi3OK;
}
