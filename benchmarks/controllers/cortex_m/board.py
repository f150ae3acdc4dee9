"""Compile exported code for a Cortex-M4F or M7, and run it in QEMU, which counts instructions."""

import dataclasses
import shutil
import subprocess
from pathlib import Path

from backsight.engine.recursion import Recursion
from backsight.types import Array

HERE = Path(__file__).parent

STRICT = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Wshadow", "-Wconversion", "-Wdouble-promotion"]

PATIENCE = 300
"""Seconds for a program in the emulator."""


@dataclasses.dataclass(frozen=True)
class Counted:
    """What a step takes.

    Parameters
    ----------
    code, constants : int
        Bytes of instructions and of tables, without the C library.
    mean, most : int
        Instructions of a step.
    """

    code: int
    constants: int
    mean: int
    most: int


@dataclasses.dataclass(frozen=True)
class Board:
    """A processor with its emulator.

    Parameters
    ----------
    title, machine, processor, unit : str
        For people; QEMU's names of board and processor; the unit for floating point.
    """

    title: str
    machine: str
    processor: str
    unit: str

    @property
    def there(self) -> bool:
        """Whether compiler and emulator are installed."""
        return all(map(shutil.which, ("arm-none-eabi-gcc", "qemu-system-arm")))

    def selftest(self, folder: Path, name: str) -> subprocess.CompletedProcess[str]:
        """Compile an export with its self-test, warnings are errors, and run it."""
        sources = [folder / f"{name}.c", folder / f"{name}_selftest.c"]
        self._build(folder, sources, "selftest.elf", ["-Werror"])
        return self._run(folder / "selftest.elf")

    def count(self, folder: Path, name: str, recursion: Recursion, data: list[Array]) -> Counted:
        """Count the instructions of every step on data, u, y and mask (n, m) each."""
        (folder / "data.h").write_text(_tables(name, data), encoding="utf-8")
        program = _filled((HERE / "count.c").read_text("utf-8"), folder, name, recursion)
        (folder / "count.c").write_text(program, encoding="utf-8")
        code = folder / f"{name}.c"
        self._compile(folder, [code], ["-c", "-o", "alone.o"])
        told = _output(["arm-none-eabi-size", "-A", "alone.o"], folder)
        sizes = dict.fromkeys(("text", "rodata"), 0)
        for line in told.splitlines():
            for kind in sizes:
                if line.startswith(f".{kind}"):
                    sizes[kind] += int(line.split()[1])
        self._build(folder, [code, folder / "count.c"], "count.elf", [])
        ran = self._run(folder / "count.elf")
        mean, most = map(int, ran.stdout.split())
        return Counted(sizes["text"], sizes["rodata"], mean, most)

    def _flags(self) -> list[str]:
        return [f"-mcpu={self.processor}", "-mthumb", "-mfloat-abi=hard", f"-mfpu={self.unit}"]

    def _build(self, folder: Path, sources: list[Path], out: str, options: list[str]) -> None:
        board = [HERE / "startup.c", "--specs=rdimon.specs", "-T", HERE / "mps2.ld"]
        self._compile(folder, [*sources, *board], [*options, "-o", out, "-lm"])

    def _compile(self, folder: Path, what: list[Path | str], options: list[str]) -> None:
        given = [str(w) for w in what]
        _output(["arm-none-eabi-gcc", *STRICT, *self._flags(), *given, *options], folder)

    def _run(self, program: Path) -> subprocess.CompletedProcess[str]:
        """Run a program; an instruction takes a nanosecond of its time."""
        command = ["qemu-system-arm", "-M", self.machine, "-cpu", self.processor, "-nographic"]
        command += ["-semihosting-config", "enable=on,target=native", "-icount", "shift=0"]
        command += ["-kernel", str(program)]
        return subprocess.run(
            command, capture_output=True, text=True, check=False, timeout=PATIENCE,
            stdin=subprocess.DEVNULL,
        )  # fmt: skip


BOARDS = {
    "float": Board("Cortex-M4F", "mps2-an386", "cortex-m4", "fpv4-sp-d16"),
    "double": Board("Cortex-M7", "mps2-an500", "cortex-m7", "fpv5-d16"),
}
"""By the precision that their unit computes."""


def _output(command: list[str], folder: Path) -> str:
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(done.stderr)
    return done.stdout


def _tables(name: str, data: list[Array]) -> str:
    lines = [f"enum {{ SAMPLES = {len(data[0])} }};"]
    for word, values in zip(("u", "y", "mask"), data, strict=True):
        numbers = ", ".join(f"({name}_real){v!r}" for v in map(float, values.ravel())) or "0"
        size = max(values.size, 1)
        lines.append(f"static const {name}_real {word}[{size}] = {{{numbers}}};")
    return "\n".join(lines) + "\n"


def _filled(template: str, folder: Path, name: str, recursion: Recursion) -> str:
    settings = f"{name}_settings" in (folder / f"{name}.h").read_text("utf-8")
    sizes = list(zip(recursion.channels, recursion.output_sizes, strict=True))
    given = zip(("u", "y", "mask"), recursion.input_sizes, strict=True)
    arguments = ["&memory", "&work", *["&settings"] * settings]
    arguments += [f"{word} + k * {n}" for word, n in given] + [c.name for c, _ in sizes]
    replaced = {
        "SETTINGS": f"{name}_settings settings;\n    {name}_defaults(&settings);" * settings,
        "RESULTS": " ".join(f"static {name}_real {c.name}[{max(n, 1)}];" for c, n in sizes),
        "ARGUMENTS": ", ".join(arguments),
        "KEY": name,
    }
    for word, text in replaced.items():
        template = template.replace(word, text)
    return template
