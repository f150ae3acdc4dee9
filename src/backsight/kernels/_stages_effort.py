"""What the problem of a varying window and its motion cost at most, see `cs_window_stages.c`."""

from backsight.kernels._work import KernelWork, dot, product


def stages_effort(nx: int, ny: int, p: int, steps: int, N: int, _: int) -> KernelWork:
    """The same of its problem, ``cs_window_stages``."""
    d = p * steps
    noise = p * (product(ny, nx) + product(nx, p) + product(ny, p))
    noise += (nx + ny) * (product(nx, p) + product(ny, p)) + 2 * ny * product(nx, nx)
    noise += nx * product(ny, nx) + ny * product(ny, nx)
    outputs = (nx + d + N * ny + nx + ny) * product(ny, nx) + KernelWork(2 * p * ny)
    ahead = (2 * nx + d + nx + ny) * product(nx, nx) + KernelWork(2 * p * nx)
    ahead += KernelWork(2 * nx * nx * N * ny)
    after = (N + 1) * nx * (product(ny, nx) + product(nx, nx))
    return (N + 1) * (noise + outputs + ahead) + 2 * after


def motion_effort(nx: int, ny: int, p: int, steps: int, N: int, _: int) -> KernelWork:
    """The same of the motion of its solution, ``cs_window_motion``."""
    del steps
    back = nx * (dot(nx) + dot(ny) + KernelWork(1))
    forces = (
        nx * (dot(ny) + KernelWork(1)) + p * (dot(nx) + dot(ny) + KernelWork(1)) + product(p, p)
    )
    ahead = 2 * product(nx, nx) + product(nx, p) + KernelWork(p)
    return (N + 1) * (back + forces + ahead)
