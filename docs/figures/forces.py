"""Draw `docs/images/forces.png`: the hits of `examples/beam` as two estimators see them."""

import runpy
from pathlib import Path

import backsight as bs
from backsight import plot
from backsight.problem import load
from backsight.problem.recorded import recording

EXAMPLE = Path(__file__).parents[2] / "examples" / "beam"


def draw(path: Path) -> Path:
    """A map above the other; crosses are the true hits."""
    truth = runpy.run_path(str(EXAMPLE / "make_recording.py"))
    problem = load(EXAMPLE / "problem.toml")
    results = bs.compare(problem.estimators, problem.model, recording(problem))
    names = [name for name, result in results.items() if "d_hat" in result]
    made = plot.figure(len(names), width=9.0, height=2.6)
    for axes, name in zip(made.axes, names, strict=False):
        plot.force_map(axes, results[name], name=name)
        places = [str(n) for n in results[name]["force"].values]
        hits = [(k, n) for k, (n, _) in truth["HITS"].items() if n in places]
        time = [(k + 0.5) * truth["DT"] for k, _ in hits]
        axes.plot(time, [places.index(n) for _, n in hits], "x", color="#1d2126", markersize=5)
    made.axes[len(names) - 1].set_xlabel("time [s]", fontsize=8)
    return plot.save(made, path, dpi=110)


if __name__ == "__main__":
    print(draw(Path(__file__).parents[1] / "images" / "forces.png"))
