"""Whether expressions are linear: by their operations, since a step has a derivative of zero."""

import casadi as ca

_SUMS = {ca.OP_ADD, ca.OP_SUB}
_KEPT = {ca.OP_NEG, ca.OP_TWICE, ca.OP_ASSIGN}


def degrees(rows: ca.Function) -> list[int]:
    """Of every result its degree in the first argument: 0, 1, or 2 for anything else."""
    found, work = [0] * rows.nnz_out(0), [0] * rows.sz_w()
    for k in range(rows.n_instructions()):
        operation = rows.instruction_id(k)
        sources, targets = rows.instruction_input(k), rows.instruction_output(k)
        if operation == ca.OP_INPUT:
            work[targets[0]] = 1 if sources[0] == 0 else 0
        elif operation == ca.OP_CONST:
            work[targets[0]] = 0
        elif operation == ca.OP_OUTPUT:
            found[targets[1]] = work[sources[0]]
        else:
            work[targets[0]] = _degree(operation, [work[i] for i in sources])
    return found


def _degree(operation: int, of: list[int]) -> int:
    if not any(of):
        return 0
    if operation in _SUMS | _KEPT:
        return max(of)
    if operation == ca.OP_MUL:
        return min(sum(of), 2)
    # A quotient, and a value where a condition holds, are linear in one of the two only.
    if (operation == ca.OP_DIV and not of[1]) or (operation == ca.OP_IF_ELSE_ZERO and not of[0]):
        return max(of)
    return 2
