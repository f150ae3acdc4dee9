"""What the problem of a varying window and its motion cost at most, see `cs_window_stages.c`."""

from backsight.kernels._work import KernelWork, dots, products


def stages_effort(nx: int, ny: int, p: int, steps: int, N: int, _: int) -> KernelWork:
    """The same of its problem, ``cs_window_stages``."""
    d = p * steps
    noise = p * (products(ny, nx) + products(nx, p) + products(ny, p))
    noise += (nx + ny) * (products(nx, p) + products(ny, p)) + 2 * ny * products(nx, nx)
    noise += nx * products(ny, nx) + ny * products(ny, nx)
    outputs = (nx + d + N * ny + nx + ny) * products(ny, nx) + KernelWork(2 * p * ny)
    ahead = (2 * nx + d + nx + ny) * products(nx, nx) + KernelWork(2 * p * nx)
    ahead += KernelWork(2 * nx * nx * N * ny)
    after = (N + 1) * nx * (products(ny, nx) + products(nx, nx))
    return (N + 1) * (noise + outputs + ahead) + 2 * after


def motion_effort(nx: int, ny: int, p: int, steps: int, N: int, _: int) -> KernelWork:
    """The same of the motion of its solution, ``cs_window_motion``."""
    del steps
    back = nx * (dots(nx) + dots(ny) + KernelWork(1))
    forces = (
        nx * (dots(ny) + KernelWork(1)) + p * (dots(nx) + dots(ny) + KernelWork(1)) + products(p, p)
    )
    ahead = 2 * products(nx, nx) + products(nx, p) + KernelWork(p)
    return (N + 1) * (back + forces + ahead)
