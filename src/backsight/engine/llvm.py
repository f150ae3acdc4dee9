"""A loop program in LLVM's language."""

from backsight.engine.llvm_lanes import Lanes
from backsight.engine.llvm_leaf import Width, declarations, write_leaf
from backsight.engine.llvm_statements import Statements
from backsight.engine.llvm_text import Text
from backsight.engine.program import Buffer, Program

LARGEST_LOCAL = 1024
"""Numbers in a buffer that is a local variable; larger ones belong to the caller."""


def write(program: Program, width: Width) -> str:
    """Write a module with ``void run(int64 n, void **pointers)``, which makes n > 0 steps.

    ``pointers`` holds the addresses of the memory (numbers of the lanes side by side), of the
    buffers of `given`, for every data and result buffer of the rows of each lane's recording, and,
    with more than one lane, of the lengths of the recordings (int64 each).
    """
    constants = [b for b in program.buffers if b.values is not None]
    parts = [
        declarations(width),
        *(_constant(b, width) for b in constants),
        *(write_leaf(leaf, width) for leaf in program.leaves),
        _steps(program, width),
        _run(program),
    ]
    return "\n\n".join(parts) + "\n"


def given(program: Program) -> tuple[Buffer, ...]:
    """Return the working buffers that are too large to be local variables."""
    return tuple(b for b in program.buffers if b.values is None and b.size > LARGEST_LOCAL)


def _constant(buffer: Buffer, width: Width) -> str:
    values = ", ".join(f"{width.number} {width.constant(v)}" for v in buffer.values or ())
    kind = f"[{buffer.size} x {width.number}]"
    return f"@{buffer.name} = private unnamed_addr constant {kind} [{values}], align 64"


def _run(program: Program) -> str:
    text = Text()
    own = [program.carry, *given(program)]
    pointers = [text.pointer("%pointers", k) for k in range(len(own))]
    pointers.append(text.address("ptr", "%pointers", len(own)))
    arguments = ", ".join(["i64 %n", *(f"ptr {p}" for p in pointers)])
    text.add(f"call void @steps({arguments})")
    return text.function("define void @run(i64 %n, ptr %pointers) nounwind")


def _steps(program: Program, width: Width) -> str:
    """The loop over the samples, in a function that knows that the buffers are distinct."""
    text = Text()
    own = [program.carry, *given(program)]
    data = [*program.inputs, *program.outputs]
    base = {b: f"%{b.name}" for b in (*program.interface, *program.buffers)}
    base |= {b: f"@{b.name}" for b in program.buffers if b.values is not None}
    for buffer in program.buffers:
        if buffer.values is None and buffer not in own:
            kind = f"[{max(buffer.size, 1)} x {width.number}]"
            text.add(f"{base[buffer]} = alloca {kind}, align 64")
    n = width.lanes
    rows = {
        b: [text.pointer("%rows", n * i + lane) for lane in range(n)] for i, b in enumerate(data)
    }
    statements = Statements(text, width, base)
    if n == 1:
        text.repeat("sample", "%n", lambda: _sample(program, text, statements, rows))
    else:
        lanes = Lanes(program, text, width, rows, text.pointer("%rows", n * len(data)))
        text.repeat("sample", "%n", lambda: lanes.write(statements))
    parameters = ", ".join(["i64 %n", *(f"ptr noalias {base[b]}" for b in own), "ptr %rows"])
    # Without the attribute some processors have vectors of 8 numbers cut in two.
    wide = f'"min-legal-vector-width"="{64 * n}"'
    return text.function(f"define internal void @steps({parameters}) noinline nounwind {wide}")


def _sample(
    program: Program, text: Text, statements: Statements, rows: dict[Buffer, list[str]]
) -> None:
    for buffer, (first,) in rows.items():
        start = text.new(f"mul nuw nsw i64 %sample, {buffer.size}")
        text.add(f"%{buffer.name} = getelementptr inbounds double, ptr {first}, i64 {start}")
    statements.write(program.body)
    statements.update(program.update, None)
