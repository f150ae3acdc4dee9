"""The same plant in increments: unknown constant inputs and offsets drop out."""

import numpy as np

from backsight.description import checked
from backsight.errors import ModelError
from backsight.models.lti import lti, state_space
from backsight.models.model import Model
from backsight.models.signals import Signal
from backsight.schema import CHANGE


@checked(ModelError)
def incremental(model: Model) -> Model:
    r"""Replace the state x of a linear discrete-time model by its increments and the outputs.

    .. math::
        \begin{bmatrix} \Delta x_{k+1} \\ y_{k+1} \end{bmatrix} =
        \begin{bmatrix} A & 0 \\ C A & I \end{bmatrix}
        \begin{bmatrix} \Delta x_k \\ y_k \end{bmatrix} +
        \begin{bmatrix} B \\ C B \end{bmatrix} \Delta u_k, \qquad
        \Delta x_k = x_k - x_{k-1}, \; \Delta u_k = u_k - u_{k-1}

    A constant that acts on the states (an unknown load, a wrong zero of the input) has no
    increment, so that nothing about it needs to be known; when it changes, the estimate is wrong
    until the change has left the window.

    Parameters
    ----------
    model : Model
        Linear, in discrete time, without feedthrough; see `backsight.discrete.exact.zoh` for
        continuous ones.

    Returns
    -------
    Model
        States ``d_x`` for every state x, and the outputs under their names; inputs ``d_u`` for
        every input u, to be differenced in the recording by `backsight.data.increments`.

    Raises
    ------
    ModelError
        If the model is continuous or nonlinear, or an input acts directly on an output.

    Notes
    -----
    Source: Ling, Wu, Lim (1996), "State observers for single rate and multirate controllers",
    doi:10.1016/S1474-6670(17)57849-0.

    Examples
    --------
    >>> import numpy as np
    >>> [
    ...     s.name
    ...     for s in bs.models.incremental(
    ...         bs.lti(
    ...             [[0.5]],
    ...             [[1.0]],
    ...             [[1.0]],
    ...             states={"x": ""},
    ...             inputs={"u": ""},
    ...             outputs={"y": ""},
    ...             dt=0.1,
    ...         )
    ...     ).states
    ... ]
    ['d_x', 'y']
    """
    if model.continuous:
        raise ModelError(
            f"model '{model.name}' is continuous; the incremental form needs a discrete-time one: "
            "discretise its matrices with zoh"
        )
    A, B, C, D = state_space(model)
    if D.any():
        row, column = np.argwhere(D)[0]
        raise ModelError(
            f"model '{model.name}' has no incremental form: the input "
            f"'{model.inputs[column].name}' acts directly on the output "
            f"'{model.outputs[row].name}'; delay it by a sample"
        )
    ny, nx = C.shape
    measured = [Signal(unit=y.unit, scale=y.scale, name=y.name) for y in model.outputs]
    return lti(
        np.block([[A, np.zeros((nx, ny))], [C @ A, np.eye(ny)]]),
        np.vstack([B, C @ B]),
        np.hstack([np.zeros((ny, nx)), np.eye(ny)]),
        states=[*map(_increment, model.states), *measured],
        inputs=[_increment(u) for u in model.inputs],
        outputs=model.outputs,
        dt=model.dt,
        name=f"{model.name}, incremental",
    )


def _increment(s: Signal) -> Signal:
    return Signal(unit=s.unit, scale=s.scale, name=f"{CHANGE}{s.name}")
