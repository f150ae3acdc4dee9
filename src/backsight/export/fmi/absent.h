/* Functions of FMI 3.0 that an estimator has no use for: events, other types, derivatives.
 * They are there, and say so. Part of fmu.c.
 */
#define ABSENT_ALONE(name) \
    FMI3_Export fmi3Status name(fmi3Instance instance) { return missing(instance, #name); }
#define ABSENT(name, ...) \
    FMI3_Export fmi3Status name(fmi3Instance instance, __VA_ARGS__) \
    { return missing(instance, #name); }
#define REFERENCES const fmi3ValueReference valueReferences[], size_t nValueReferences
#define ABSENT_TYPE(type) \
    ABSENT(fmi3Get##type, REFERENCES, fmi3##type values[], size_t nValues) \
    ABSENT(fmi3Set##type, REFERENCES, const fmi3##type values[], size_t nValues)

ABSENT_TYPE(Float32)
ABSENT_TYPE(Int8)
ABSENT_TYPE(UInt8)
ABSENT_TYPE(Int16)
ABSENT_TYPE(UInt16)
ABSENT(fmi3SetInt32, REFERENCES, const fmi3Int32 values[], size_t nValues)
ABSENT_TYPE(UInt32)
ABSENT_TYPE(Int64)
ABSENT_TYPE(UInt64)
ABSENT_TYPE(Boolean)
ABSENT_TYPE(String)
ABSENT(fmi3GetBinary, REFERENCES, size_t valueSizes[], fmi3Binary values[], size_t nValues)
ABSENT(fmi3SetBinary, REFERENCES, const size_t valueSizes[], const fmi3Binary values[],
       size_t nValues)
ABSENT(fmi3GetClock, REFERENCES, fmi3Clock values[])
ABSENT(fmi3SetClock, REFERENCES, const fmi3Clock values[])
ABSENT(fmi3GetNumberOfVariableDependencies, fmi3ValueReference valueReference,
       size_t *nDependencies)
ABSENT(fmi3GetVariableDependencies, fmi3ValueReference dependent,
       size_t elementIndicesOfDependent[], fmi3ValueReference independents[],
       size_t elementIndicesOfIndependents[], fmi3DependencyKind dependencyKinds[],
       size_t nDependencies)
ABSENT(fmi3GetDirectionalDerivative, const fmi3ValueReference unknowns[], size_t nUnknowns,
       const fmi3ValueReference knowns[], size_t nKnowns, const fmi3Float64 seed[], size_t nSeed,
       fmi3Float64 sensitivity[], size_t nSensitivity)
ABSENT(fmi3GetAdjointDerivative, const fmi3ValueReference unknowns[], size_t nUnknowns,
       const fmi3ValueReference knowns[], size_t nKnowns, const fmi3Float64 seed[], size_t nSeed,
       fmi3Float64 sensitivity[], size_t nSensitivity)
ABSENT_ALONE(fmi3EnterEventMode)
ABSENT_ALONE(fmi3EnterConfigurationMode)
ABSENT_ALONE(fmi3ExitConfigurationMode)
ABSENT_ALONE(fmi3EnterContinuousTimeMode)
ABSENT_ALONE(fmi3EnterStepMode)
ABSENT_ALONE(fmi3EvaluateDiscreteStates)
ABSENT(fmi3GetIntervalFraction, REFERENCES, fmi3UInt64 counters[], fmi3UInt64 resolutions[],
       fmi3IntervalQualifier qualifiers[])
ABSENT(fmi3GetShiftFraction, REFERENCES, fmi3UInt64 counters[], fmi3UInt64 resolutions[])
ABSENT(fmi3SetIntervalDecimal, REFERENCES, const fmi3Float64 intervals[])
ABSENT(fmi3SetIntervalFraction, REFERENCES, const fmi3UInt64 counters[],
       const fmi3UInt64 resolutions[])
ABSENT(fmi3SetShiftDecimal, REFERENCES, const fmi3Float64 shifts[])
ABSENT(fmi3SetShiftFraction, REFERENCES, const fmi3UInt64 counters[],
       const fmi3UInt64 resolutions[])
ABSENT(fmi3UpdateDiscreteStates, fmi3Boolean *discreteStatesNeedUpdate,
       fmi3Boolean *terminateSimulation, fmi3Boolean *nominalsOfContinuousStatesChanged,
       fmi3Boolean *valuesOfContinuousStatesChanged, fmi3Boolean *nextEventTimeDefined,
       fmi3Float64 *nextEventTime)
ABSENT(fmi3CompletedIntegratorStep, fmi3Boolean noSetFMUStatePriorToCurrentPoint,
       fmi3Boolean *enterEventMode, fmi3Boolean *terminateSimulation)
ABSENT(fmi3SetTime, fmi3Float64 time)
ABSENT(fmi3SetContinuousStates, const fmi3Float64 continuousStates[], size_t nContinuousStates)
ABSENT(fmi3GetContinuousStateDerivatives, fmi3Float64 derivatives[], size_t nContinuousStates)
ABSENT(fmi3GetEventIndicators, fmi3Float64 eventIndicators[], size_t nEventIndicators)
ABSENT(fmi3GetContinuousStates, fmi3Float64 continuousStates[], size_t nContinuousStates)
ABSENT(fmi3GetNominalsOfContinuousStates, fmi3Float64 nominals[], size_t nContinuousStates)
ABSENT(fmi3GetNumberOfEventIndicators, size_t *nEventIndicators)
ABSENT(fmi3GetNumberOfContinuousStates, size_t *nContinuousStates)
ABSENT(fmi3GetOutputDerivatives, REFERENCES, const fmi3Int32 orders[], fmi3Float64 values[],
       size_t nValues)
