"""Calls of kernels in LLVM's language.

Each kernel with its sizes becomes a function of slices, like a leaf. With several lanes it calls
the kernel once for every lane that is active, on copies of that lane's numbers.
"""

from collections.abc import Sequence

from backsight.engine.llvm._text import Text
from backsight.engine.llvm.width import Width
from backsight.engine.program import Buffer, Foreign, Program

SPACE = "%.space"
"""Address of the memory in which all kernels work."""


def kernel_symbol(kernel: str) -> str:
    """Name under which machine code finds a kernel."""
    return f"backsight.{kernel}"


def space(program: Program, width: Width) -> Buffer:
    """Return the memory in which all kernels work, one after the other."""
    numbers = [_before_copies(call) + _copied(call, width) for call in program.foreign]
    return Buffer(SPACE.removeprefix("%"), -(-max(numbers, default=0) // width.lanes))


def called(call: Foreign) -> str:
    """Name of the function that calls the kernel."""
    sizes = "_".join(map(str, (*call.kernel.sizes, *_sizes(call))))
    return f"@foreign.{call.kernel.name}.{sizes}"


def write_foreign(program: Program, width: Width) -> list[str]:
    """Write all that a module needs to call its kernels."""
    declarations = [
        f"declare void @{kernel_symbol(kernel)}(ptr, ptr, ptr, ptr, ptr) nounwind"
        for kernel in program.kernels
    ]
    distinct = {called(call): call for call in program.foreign}
    return [*declarations, *(_function(call, width) for call in distinct.values())]


def _function(call: Foreign, width: Width) -> str:
    text = Text()
    inputs = [f"%.i{k}" for k in range(len(call.inputs))]
    outputs = [f"%.o{k}" for k in range(len(call.outputs))]
    for table, entries in (("%.args", inputs), ("%.results", outputs)):
        text.add(f"{table} = alloca [{len(entries)} x ptr], align 8")
    parameters = ", ".join(f"ptr {p}" for p in (*inputs, *outputs, SPACE))
    if width.lanes == 1:
        _call(call, text, inputs, outputs)
    else:
        _each_lane(call, text, width, (*inputs, *outputs))
        parameters += f", i{width.lanes} %.active"
    sizes = call.kernel.sizes or (0,)
    values = ", ".join(f"i32 {size}" for size in sizes)
    table = f"@sizes.{called(call)[1:]} = private unnamed_addr constant"
    function = text.function(f"define internal void {called(call)}({parameters}) noinline nounwind")
    return f"{table} [{len(sizes)} x i32] [{values}]\n\n{function}"


def _call(call: Foreign, text: Text, inputs: Sequence[str], outputs: Sequence[str]) -> None:
    for table, entries in (("%.args", inputs), ("%.results", outputs)):
        for k, entry in enumerate(entries):
            text.add(f"store ptr {entry}, ptr {text.address('ptr', table, k)}, align 8")
    ints = text.address("double", SPACE, call.reals)
    arguments = f"@sizes.{called(call)[1:]}", "%.args", "%.results", SPACE, ints
    text.add(
        f"call void @{kernel_symbol(call.kernel.name)}({', '.join(f'ptr {a}' for a in arguments)})"
    )


def _each_lane(call: Foreign, text: Text, width: Width, vectors: Sequence[str]) -> None:
    """Call the kernel on copies of each active lane's numbers."""
    n, first, copies = width.lanes, _before_copies(call), []
    for size in _sizes(call):
        copies.append(text.address("double", SPACE, first))
        first += size
    inputs = len(call.inputs)

    def move(source: str, target: str) -> None:
        number = text.new(f"load double, ptr {source}, align 8")
        text.add(f"store double {number}, ptr {target}, align 8")

    def places(i: int, k: int | str) -> tuple[str, str]:
        """Addresses of number k of an argument, in its vector and in the copy."""
        index = k if isinstance(k, int) else f"%{k}"
        row = text.new(f"mul nuw nsw i64 {index}, {n}")
        mine = text.new(f"add nuw nsw i64 {row}, %.lane")
        return text.address("double", vectors[i], mine), text.address("double", copies[i], index)

    def body() -> None:
        for i, size in enumerate(_sizes(call)[:inputs]):
            text.each(size, lambda k, i=i: move(*places(i, k)))
        _call(call, text, copies[:inputs], copies[inputs:])
        for i, size in enumerate(_sizes(call)[inputs:], inputs):
            text.each(size, lambda k, i=i: move(*reversed(places(i, k))))

    def lane() -> None:
        number = text.new(f"trunc i64 %.lane to i{n}")
        bits = text.new(f"lshr i{n} %.active, {number}")
        active = text.new(f"trunc i{n} {bits} to i1")
        text.repeat_while(1, lambda: active, body)

    text.repeat(".lane", str(n), lane)


def _sizes(call: Foreign) -> list[int]:
    return [place.size for place in (*call.inputs, *call.outputs)]


def _before_copies(call: Foreign) -> int:
    """Numbers of work space; two ints fit into the place of one."""
    return call.reals + -(-call.ints // 2)


def _copied(call: Foreign, width: Width) -> int:
    return 0 if width.lanes == 1 else sum(_sizes(call))
