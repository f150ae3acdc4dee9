"""What the problem of a varying window and its motion cost at most, see `cs_window_stages.c`."""

from backsight.kernels._work import KernelWork, of_dot, of_product


def stages_effort(nx: int, ny: int, p: int, steps: int, N: int, _: int) -> KernelWork:
    """The same of its problem, ``cs_window_stages``."""
    d = p * steps
    noise = p * (of_product(ny, nx) + of_product(nx, p) + of_product(ny, p))
    noise += (nx + ny) * (of_product(nx, p) + of_product(ny, p)) + 2 * ny * of_product(nx, nx)
    noise += nx * of_product(ny, nx) + ny * of_product(ny, nx)
    outputs = (nx + d + N * ny + nx + ny) * of_product(ny, nx) + KernelWork(2 * p * ny)
    ahead = (2 * nx + d + nx + ny) * of_product(nx, nx) + KernelWork(2 * p * nx)
    ahead += KernelWork(2 * nx * nx * N * ny)
    after = (N + 1) * nx * (of_product(ny, nx) + of_product(nx, nx))
    return (N + 1) * (noise + outputs + ahead) + 2 * after


def motion_effort(nx: int, ny: int, p: int, steps: int, N: int, _: int) -> KernelWork:
    """The same of the motion of its solution, ``cs_window_motion``."""
    del steps
    back = nx * (of_dot(nx) + of_dot(ny) + KernelWork(1))
    forces = (
        nx * (of_dot(ny) + KernelWork(1))
        + p * (of_dot(nx) + of_dot(ny) + KernelWork(1))
        + of_product(p, p)
    )
    ahead = 2 * of_product(nx, nx) + of_product(nx, p) + KernelWork(p)
    return (N + 1) * (back + forces + ahead)
