"""From LLVM's language to machine code, and into this process."""

import ctypes
import dataclasses
import functools
import os
from collections.abc import Callable, Mapping, Sequence

import llvmlite.binding as llvm
import numpy as np

from backsight.engine.llvm._leaf import LIBRARY


@functools.cache
def processor() -> str:
    """Return the kind of this computer's processor with the instructions that it knows."""
    features = llvm.get_host_cpu_features().flatten()
    return f"{llvm.get_process_triple()} {llvm.get_host_cpu_name()} {features}"


@functools.cache
def widest() -> int:
    """Return how many lanes run well on this processor."""
    return 8 if llvm.get_host_cpu_features().get("avx512f") else 4


def assemble_code(text: str) -> bytes:
    """Compile a module for this processor to an object file."""
    target = _target()
    module = llvm.parse_assembly(text)
    module.triple, module.data_layout = target.triple, str(target.target_data)
    tuning = llvm.create_pipeline_tuning_options(speed_level=2)
    # Pairing straight-line operations to vectors takes longer than all the rest and gains nothing.
    tuning.slp_vectorization = False
    builder = llvm.create_pass_builder(target, tuning)
    builder.getModulePassManager().run(module, builder)
    return target.emit_object(module)


@dataclasses.dataclass(frozen=True)
class Code:
    """Machine code in this process.

    Parameters
    ----------
    function : callable
        ``run(n, pointers)`` of `backsight.engine.llvm.module.write`.
    owner : object
        Holds the memory of the code.
    """

    function: Callable[[int, "ctypes.Array[ctypes.c_void_p] | int"], None]
    owner: object

    def __call__(self, samples: int, arrays: Sequence[np.ndarray]) -> None:
        """Run on the memory of the arrays; other threads run meanwhile."""
        self.bound(samples, arrays)()

    def at(self, samples: int, addresses: np.ndarray) -> None:
        """Run on memory at these addresses, whose owner must be kept meanwhile."""
        self.function(samples, addresses.ctypes.data)

    def bound(self, samples: int, arrays: Sequence[np.ndarray]) -> Callable[[], None]:
        """Return a call that runs on the memory of these arrays again and again."""
        # Not `ctypes.data`, which takes several times as long.
        places = [a.__array_interface__["data"][0] for a in arrays]
        addresses = (ctypes.c_void_p * len(arrays))(*places)
        kept = (addresses, *arrays)

        def call() -> None:
            self.function(samples, kept[0])

        return call


def load_code(content: bytes, symbols: Mapping[str, int]) -> Code:
    """Load an object file into this process; `symbols` are addresses of what else it calls."""
    _provide_library()
    for name, address in symbols.items():
        llvm.add_symbol(name, address)
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), _target())
    engine.add_object_file(llvm.ObjectFileRef.from_data(content))
    engine.finalize_object()
    kind = ctypes.CFUNCTYPE(None, ctypes.c_int64, ctypes.c_void_p)
    return Code(kind(engine.get_function_address("run")), engine)


def _target() -> llvm.TargetMachine:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm.Target.from_default_triple().create_target_machine(
        cpu=llvm.get_host_cpu_name(),
        features=llvm.get_host_cpu_features().flatten(),
        opt=2,
        jit=True,
        codemodel="jitdefault",
    )


@functools.cache
def _provide_library() -> None:
    """Tell where the functions of the C library are, which Windows does not do by itself."""
    if os.name != "nt":
        return
    library = ctypes.CDLL("ucrtbase")
    for name in (*LIBRARY, "exp2", "fma", "fmod", "memcpy", "memmove", "memset", "pow"):
        address = ctypes.cast(getattr(library, name), ctypes.c_void_p).value
        if address is not None:
            llvm.add_symbol(name, address)
    check = ctypes.cast(ctypes.CDLL("ntdll").__chkstk, ctypes.c_void_p).value
    if check is not None:
        llvm.add_symbol("__chkstk", check)
