"""Run all benchmarks: ``python -m benchmarks``; with ``--quick`` a look that takes a minute."""

import argparse
import os
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parent.parent

ENVIRONMENT = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1",
    "JAX_PLATFORMS": "cpu",
}
"""One thread for all: the problems are small, and threads on busy cores only cost time."""


def main() -> None:
    """Measure, print, and write results and the page of the documentation."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=main.__doc__)
    parser.add_argument("--quick", action="store_true", help="few rounds and sizes; writes nothing")
    parser.add_argument(
        "--only", metavar="WORDS", help="tables with these words in the title; writes nothing"
    )
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as cache:
        # The libraries read these when they are imported; everything is compiled anew.
        os.environ.update(ENVIRONMENT, BACKSIGHT_CACHE=cache)
        from benchmarks import measure

        began = time.perf_counter()
        if arguments.only:
            measure.some(arguments.only, quick=arguments.quick)
        else:
            run = measure.everything(quick=arguments.quick)
            run.tell()
            if not arguments.quick:
                run.keep(ROOT)
    print(f"\ntook {time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main()
