"""A loop program in LLVM's language."""

from backsight.engine.llvm._lanes import Lanes
from backsight.engine.llvm._leaf import declarations, write_llvm_leaf
from backsight.engine.llvm._shared import SharedLoops
from backsight.engine.llvm._statements import Statements
from backsight.engine.llvm._text import LARGEST_UNROLLED, Text
from backsight.engine.llvm.foreign import space, write_foreign
from backsight.engine.llvm.width import Width
from backsight.engine.program import Buffer, Call, Copy, Leaf, Loop, Program, Table, While, flat

LARGEST_INLINE = 250
"""Operations of a leaf that becomes part of its caller even where it is used only once a step."""

LARGEST_LOCAL = 1024
"""Numbers, of all lanes, in a buffer that is a local variable; larger ones are the caller's."""


MOST_COPIED = 2000
"""Numbers that a step may copy one by one in straight-line code, which compilers look through."""

SHORT = 8
"""Numbers of a copy that is always written out."""


def write_llvm(program: Program, width: Width) -> str:
    """Write a module with ``void run(int64 n, void **pointers)``, which makes n > 0 steps.

    ``pointers`` holds the addresses of the memory (numbers of the lanes side by side), of the
    buffers of `given`, and for every data and result buffer of the rows of each lane's recording.
    """
    constants = [b for b in program.buffers if b.values is not None and b.size <= LARGEST_LOCAL]
    shared = SharedLoops(width)
    steps = _steps(program, width, shared)
    parts = [
        declarations(program.leaves, width),
        *(_constant(b, width) for b in constants),
        *(_table(t) for t in program.tables),
        *(write_llvm_leaf(f, width, inline=_inline(f, program)) for f in program.leaves),
        *write_foreign(program, width),
        *shared.functions,
        steps,
        _run(program, width),
    ]
    return "\n\n".join(parts) + "\n"


def given(program: Program, width: Width) -> tuple[Buffer, ...]:
    """Return the buffers that the caller provides.

    Those in which the step works, if they are too large to be local variables, and large tables of
    constants: as text in the module they would take longer to read than all the rest to compile.
    """
    largest = LARGEST_LOCAL // width.lanes
    tables = [b for b in program.buffers if b.values is not None and b.size > LARGEST_LOCAL]
    return (*(b for b in _working(program, width) if b.size > largest), *tables)


def _working(program: Program, width: Width) -> tuple[Buffer, ...]:
    """Return all buffers that hold nothing between two samples."""
    return (*(b for b in program.buffers if b.values is None), space(program, width))


def _inline(leaf: Leaf, program: Program) -> bool:
    """Large leaves are only worth their time of compilation inside loops."""
    loops = (s for s in program.body if isinstance(s, Loop | While))
    repeated = any(isinstance(s, Call) and s.leaf is leaf for s in flat(loops))
    return repeated or len(leaf.operations) <= LARGEST_INLINE


def _constant(buffer: Buffer, width: Width) -> str:
    values = ", ".join(f"{width.number} {width.constant(v)}" for v in buffer.values or ())
    kind = f"[{buffer.size} x {width.number}]"
    return f"@data.{buffer.name} = private unnamed_addr constant {kind} [{values}], align 64"


def _table(table: Table) -> str:
    values = ", ".join(f"i64 {v}" for v in table.values)
    kind = f"[{len(table.values)} x i64]"
    return f"@table.{table.name} = private unnamed_addr constant {kind} [{values}]"


def _run(program: Program, width: Width) -> str:
    text = Text()
    own = [program.carry, *given(program, width)]
    pointers = [text.pointer("%.pointers", k) for k in range(len(own))]
    pointers.append(text.address("ptr", "%.pointers", len(own)))
    arguments = ", ".join(["i64 %.n", *(f"ptr {p}" for p in pointers)])
    text.add(f"call void @.steps({arguments})")
    return text.function("define void @run(i64 %.n, ptr %.pointers) nounwind")


def _steps(program: Program, width: Width, shared: SharedLoops) -> str:
    """The loop over the samples, in a function that knows that the buffers are distinct."""
    text = Text()
    own = [program.carry, *given(program, width)]
    data = [*program.inputs, *program.outputs]
    working = _working(program, width)
    base = {b: f"@data.{b.name}" for b in program.buffers if b.values is not None}
    base |= {b: f"%{b.name}" for b in (*program.interface, *working, *own)}
    for buffer in working:
        if buffer not in own:
            kind = f"[{max(buffer.size, 1)} x {width.number}]"
            text.add(f"{base[buffer]} = alloca {kind}, align 64")
    n = width.lanes
    rows = {
        b: [text.pointer("%.rows", n * i + lane) for lane in range(n)] for i, b in enumerate(data)
    }
    statements = Statements(text, width, base, shared, _longest_copy(program))
    if n == 1:
        text.repeat(".sample", "%.n", lambda: _sample(program, text, statements, rows))
    else:
        lanes = Lanes(program, text, width, rows)
        text.repeat(".sample", "%.n", lambda: lanes.write(statements))
    parameters = ", ".join(["i64 %.n", *(f"ptr noalias {base[b]}" for b in own), "ptr %.rows"])
    attributes = f"noinline nounwind {width.attribute}"
    return text.function(f"define internal void @.steps({parameters}) {attributes}")


def _longest_copy(program: Program) -> int:
    """Numbers of a copy that is written out: none but short ones, if that would be very many."""
    copies = [c.source.size for c in flat((*program.body, *program.update)) if isinstance(c, Copy)]
    written = sum(size for size in copies if size <= LARGEST_UNROLLED)
    return LARGEST_UNROLLED if written <= MOST_COPIED else SHORT


def _sample(
    program: Program, text: Text, statements: Statements, rows: dict[Buffer, list[str]]
) -> None:
    for buffer, (first,) in rows.items():
        start = text.new(f"mul nuw nsw i64 %.sample, {buffer.size}")
        text.add(f"%{buffer.name} = getelementptr inbounds double, ptr {first}, i64 {start}")
    statements.write(program.body)
    statements.update(program.update, None)
