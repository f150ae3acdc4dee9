"""Write the recording of the example: a pendulum that a motor swings, with gaps."""

from pathlib import Path

import numpy as np
from backsight_example.logger import write_blk
from backsight_example.pendulum import pendulum

import backsight as bs

N, DT = 600, 0.02


def main(path: Path) -> None:
    t = np.arange(N) * DT
    motor = 3 * np.sin(2.5 * t) * (t < 6)
    swing = bs.simulate(pendulum(0.4), u=motor, dt=DT, x0={"angle": 0.5}, sigma_y=2e-3, seed=1)
    aside = swing["y"].to_numpy()[:, 0]
    aside[200:220] = np.nan
    columns = {"t_ms": 1e3 * t, "motor": motor, "aside_mm": 1e3 * aside}
    write_blk(path, columns, {"t_ms": 1.0, "motor": 1e-4, "aside_mm": 0.01})
    print(f"wrote {path}")


if __name__ == "__main__":
    main(Path(__file__).with_name("swing.blk"))
