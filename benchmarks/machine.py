"""What the numbers were measured on: processor, versions, load; no names of people or places."""

import datetime
import importlib.metadata
import os
import platform
import shutil
import subprocess
from pathlib import Path

import llvmlite.binding as llvm

from backsight.engine.parallel import cores
from benchmarks.flops import Peak

PACKAGES = (
    "backsight",
    "casadi",
    "llvmlite",
    "numpy",
    "scipy",
    "do-mpc",
    "filterpy",
    "dynamax",
    "jax",
    "control",
    "cvxpy",
    "clarabel",
    "osqp",
)


def machine(peak: Peak) -> dict[str, str]:
    """Names and values for the page and the files."""
    load = f"{os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "unknown"
    return {
        "date": datetime.date.today().isoformat(),
        "processor": f"{_processor()} (LLVM: {llvm.get_host_cpu_name()})",
        "cores": str(cores()),
        "load average at the start": load,
        "peak of one core, single numbers": f"{peak.scalar:.1f} GFlop/s",
        "peak of one core, vectors of 8": f"{peak.vector:.1f} GFlop/s",
        "system": f"{platform.system()} {platform.machine()}",
        "Python": platform.python_version(),
        "gcc": _gcc(),
        **{name: _version(name) for name in PACKAGES},
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or "unknown"
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else "unknown"


def _gcc() -> str:
    compiler = shutil.which("gcc")
    if compiler is None:
        return "not installed"
    answer = subprocess.run([compiler, "-dumpfullversion"], capture_output=True, text=True)
    return answer.stdout.strip() or "unknown"


def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "not installed"
