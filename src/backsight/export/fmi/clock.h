/* The clock of the samples, and what it starts. Part of fmu.c. */

FMI3_Export fmi3Status fmi3ActivateModelPartition(
    fmi3Instance instance, fmi3ValueReference clockReference, fmi3Float64 activationTime)
{
    Instance *it = instance;
    if (!it->scheduled)
        return failed(it, "fmi3ActivateModelPartition: this instance is for co-simulation");
    if (clockReference != MODEL_CLOCK)
        return wrong(it, "fmi3ActivateModelPartition: no such clock", clockReference);
    return sample_at(it, "fmi3ActivateModelPartition", activationTime);
}

FMI3_Export fmi3Status fmi3GetIntervalDecimal(
    fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
    fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[])
{
    size_t i;
    for (i = 0; i < nValueReferences; ++i) {
        if (valueReferences[i] != MODEL_CLOCK)
            return wrong(instance, "fmi3GetIntervalDecimal: no such clock", valueReferences[i]);
        intervals[i] = MODEL_DT;
        qualifiers[i] = fmi3IntervalUnchanged;
    }
    return fmi3OK;
}

FMI3_Export fmi3Status fmi3GetShiftDecimal(
    fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
    fmi3Float64 shifts[])
{
    size_t i;
    for (i = 0; i < nValueReferences; ++i) {
        if (valueReferences[i] != MODEL_CLOCK)
            return wrong(instance, "fmi3GetShiftDecimal: no such clock", valueReferences[i]);
        shifts[i] = 0.0; /* the first tick is at the start */
    }
    return fmi3OK;
}
