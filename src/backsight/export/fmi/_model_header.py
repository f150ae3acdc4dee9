"""``model.h``: what of an FMU depends on the estimator, in C."""

from collections.abc import Mapping, Sequence

from backsight.engine.c99 import Precision
from backsight.estimators.outliers import DOUBTED
from backsight.export._followed import MEAN, PRIOR, SPREAD
from backsight.export._written import Written
from backsight.export.fmi._variables import Z95, Variable, clock_reference, structured

DOUBLE = Precision("double")


def model_header(code: Written, found: Sequence[Variable], token: str) -> str:
    """Sizes, value references, start values, and the call of the step."""
    at = {v.name: v.reference for v in found}
    first_output = next(v.reference for v in found if v.causality == "output")
    counts = {field: len(signals) for field, signals in code.open.signals.items()}
    # The order of the fields: the mean of the prior, standard deviations (its own first), others.
    sigmas = sum(n for field, n in counts.items() if field.startswith("sigma_"))
    model, channels = code.model, [c.name for c in code.recursion.channels]
    u = 1 + sum(counts.values())
    e = next(v.reference for v in found if v.source == "e[0]")
    weight = next((v.reference for v in found if v.source == "weight[0]"), 0)
    sizes = {
        "VALUES": len(found),
        "CLOCK": clock_reference(found),
        "NU": model.nu,
        "NY": model.ny,
        "LAG": code.recursion.lag,
        "SIGMAS": sigmas,
        "FIXED": sum(counts.get(field, 0) for field in PRIOR),
        "FIRST_SET": 1,
        "SIGMA": 1 + counts.get(MEAN, 0),
        "U": u,
        "Y": u + model.nu,
        "MASK": u + model.nu + model.ny,
        "FIRST_OUTPUT": first_output,
        "E": e,
        "NIS": at["nis"],
        "STATUS": at["status"],
        "WEIGHT": weight,
        "WEIGHS": int(code.estimator.weighs),
        "TABLES": len(code.source.tables),
    }
    start = ",\n    ".join(DOUBLE.number(0.0 if v.reference == 0 else v.start) for v in found)
    n = model.ny
    copied = [
        "        innovation->e[i] = e[i];",
        f"        innovation->weight[i] = {'weight[i]' if 'weight' in channels else '1.0'};",
    ]
    name = code.name
    return "\n".join(
        [
            "/* What of the FMU depends on the estimator. */",
            f'#include "{name}.h"',
            "",
            f'#define MODEL_TOKEN "{token}"',
            f"#define MODEL_DT {DOUBLE.number(code.recursion.dt)} /* s */",
            f"#define MODEL_DOUBTED {DOUBLE.number(DOUBTED)} /* weight of an outlier, at most */",
            *(f"#define MODEL_{key} {value}" for key, value in sizes.items()),
            "",
            f"typedef {name}_memory model_memory;",
            f"typedef {name}_workspace model_workspace;",
            "",
            "/* Innovation, its covariance (lower triangle), and weights of the outputs. */",
            "typedef struct {",
            f"    double e[{n + 1}], S[{n * (n + 1) // 2 + 1}], weight[{n + 1}];",
            "} model_innovation;",
            "",
            "/* Values before the first sample. */",
            f"static const double model_start[{len(found)}] = {{\n    {start}}};",
            "",
            "static void model_init(model_memory *memory, double *values)",
            "{",
            *_beginning(code, at),
            "}",
            "",
            "/* Standard deviation of a variance, which rounding may have made negative. */",
            "static double deviation(double variance)",
            "{",
            "    return sqrt(variance < 0.0 ? 0.0 : variance);",
            "}",
            "",
            "static void model_sample(",
            "    model_memory *memory, model_workspace *work, const double *tables,",
            "    double *values, const double *y, const double *mask,",
            "    model_innovation *innovation)",
            "{",
            *_locals(code),
            "    int i;",
            *_settings(code),
            *([] if code.source.tables else ["    (void)tables;"]),
            f"    {name}_step(memory, work, {_arguments(code)});",
            f"    for (i = 0; i < {n}; ++i) {{",
            *copied,
            "    }",
            f"    for (i = 0; i < {n * (n + 1) // 2}; ++i)",
            "        innovation->S[i] = S[i];",
            *(f"    values[{v.reference}] = {v.source};" for v in found if v.source),
            *_unread(code, found),
            "}",
            "",
        ]
    )


def _beginning(code: Written, at: Mapping[str, int]) -> list[str]:
    """Set the memory, and the outputs before the first sample, by the prior."""
    if not code.open.start:
        return [f"    {code.name}_init(memory);", "    (void)values;"]
    lines = [f"    {code.name}_settings settings;", *_settings(code)]
    lines.append(f"    {code.name}_init(memory, &settings);")
    for field, output in ((MEAN, "x_hat"), (SPREAD, "x_std")):
        for s in code.open.signals.get(field, ()):
            given, shown = at[structured(field, s.name)], at[structured(output, s.name)]
            lines.append(f"    values[{shown}] = values[{given}];")
    for s in code.model.states:
        x, sd = at[structured("x_hat", s.name)], at[structured("x_std", s.name)]
        for end, sign in (("x_lower", "-"), ("x_upper", "+")):
            shown = at[structured(end, s.name)]
            lines.append(f"    values[{shown}] = values[{x}] {sign} {Z95!r} * values[{sd}];")
    return lines


def _locals(code: Written) -> list[str]:
    sizes = zip(code.recursion.channels, code.recursion.output_sizes, strict=True)
    lines = [f"    double {channel.name}[{max(size, 1)}];" for channel, size in sizes]
    return [*lines, f"    {code.name}_settings settings;"] if code.open.fields else lines


def _settings(code: Written) -> list[str]:
    """Settings are the first values after the time, in the order of the fields."""
    lines, reference = [], 1
    for field in code.open.fields:
        for i in range(len(field.values)):
            lines.append(f"    settings.{field.name}[{i}] = values[{reference}];")
            reference += 1
    return lines


def _arguments(code: Written) -> str:
    settings = ["tables"] if code.source.tables else []
    settings += ["&settings"] if code.open.fields else []
    outputs = [c.name for c in code.recursion.channels]
    return ", ".join([*settings, "values + MODEL_U", "y", "mask", *outputs])


def _unread(code: Written, found: Sequence[Variable]) -> list[str]:
    """Outputs of the step that no variable shows."""
    shown = " ".join(v.source for v in found)
    names = [c.name for c in code.recursion.channels if c.name not in ("e", "S", "weight")]
    return [f"    (void){n};" for n in names if f"{n}[" not in shown]
