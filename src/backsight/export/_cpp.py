"""A header for C++ around exported C: memory that a class owns, data whose sizes are checked."""

from backsight.export._written import Written


def cpp_header(code: Written) -> str:
    """Write ``name.hpp``; C++11 and later."""
    name = code.name
    sizes = zip(("u", "y", "mask"), code.open.plain.input_sizes, strict=True)
    given = [f"        std::array<real, {size}> {field}{{}};" for field, size in sizes]
    outputs = list(zip(code.recursion.channels, code.recursion.output_sizes, strict=True))
    made = [f"        std::array<real, {size}> {channel.name}{{}};" for channel, size in outputs]
    settings = ["&settings"] if code.open.fields else []
    data = [f"given.{field}.data()" for field in ("u", "y", "mask")]
    results = [f"made.{channel.name}.data()" for channel, _ in outputs]
    arguments = ",\n            ".join(["&memory_", "&work_", *settings, *data, *results])
    return f"""// {name}.c as a class: an object is an estimator with its memory.
// Copies go on by themselves.
#ifndef {name.upper()}_HPP
#define {name.upper()}_HPP

#include <array>

extern "C" {{
#include "{name}.h"
}}

namespace backsight {{

class {name}_estimator {{
public:
    using real = {name}_real;

    // What is known of a sample, physical units; mask is 1 where y was measured, else 0.
    struct sample {{
{chr(10).join(given)}
    }};

    // What is estimated; symmetric matrices are lower triangles, column by column.
    struct result {{
{chr(10).join(made)}
    }};
{_settings_member(code)}
    {name}_estimator() noexcept
    {{
{f"        {name}_defaults(&settings);" if code.open.fields else ""}
        reset();
    }}

    // Forget all samples; settings stay.
    void reset() noexcept {{ {name}_init(&memory_{", &settings" if code.open.start else ""}); }}

    // Process one sample.
    result step(const sample &given) noexcept
    {{
        result made;
        {name}_step(
            {arguments});
        return made;
    }}

private:
    {name}_memory memory_{{}};
    {name}_workspace work_{{}};
}};

}} // namespace backsight

#endif
"""


def _settings_member(code: Written) -> str:
    if not code.open.fields:
        return ""
    return f"\n    // May be changed between two samples.\n    {code.name}_settings settings{{}};\n"
