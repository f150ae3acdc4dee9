"""Compiles the kernels; everything else is said in pyproject.toml."""

import runpy
from pathlib import Path

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext

KERNELS = Path("src/backsight/kernels")
SOURCES = runpy.run_path(str(KERNELS / "sources.py"))

# Sums may be reordered and divisions become products, but NaN and infinity keep their meaning.
# Python's own flags let integers wrap around, which nothing here does and loops are slower by.
FLAGS = [
    "-std=c99",
    "-O3",
    "-fno-wrapv",
    "-funroll-loops",
    "-fipa-pta",
    "-fno-plt",
    "-fno-math-errno",
    "-fno-trapping-math",
    "-fno-signed-zeros",
    "-fassociative-math",
    "-freciprocal-math",
]


class BuildKernels(build_ext):
    """Takes the flags that the compiler at hand understands."""

    def build_extension(self, ext: Extension) -> None:
        """Compile one library."""
        ext.extra_compile_args = ["/O2"] if self.compiler.compiler_type == "msvc" else FLAGS
        super().build_extension(ext)


setup(
    cmdclass={"build_ext": BuildKernels},
    ext_modules=[
        Extension(
            "backsight.kernels._backsight",
            sources=[
                # The build wants paths relative to this folder.
                (KERNELS / file.relative_to(SOURCES["FOLDER"])).as_posix()
                for file in (SOURCES["FOLDER"] / "bridge.c", *SOURCES["kernel_files"]())
            ],
            include_dirs=[KERNELS.as_posix()],
            depends=[file.as_posix() for file in sorted(KERNELS.rglob("*.h"))],
            define_macros=[
                ("KERNELS", " ".join(f"X({name})" for name in SOURCES["names"]())),
                ("SOURCES", SOURCES["fingerprint"]()),
                ("BACKSIGHT_BLAS", None),
            ],
            py_limited_api=True,  # it uses nothing of Python, so one build serves all versions
            optional=True,  # without a compiler all that needs no kernel still works
        )
    ],
)
