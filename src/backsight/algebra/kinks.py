"""Whether expressions have kinks or jumps: by operations, since derivatives do not show it."""

import casadi as ca

_KINKED = {
    ca.OP_FMIN, ca.OP_FMAX, ca.OP_FABS, ca.OP_SIGN, ca.OP_IF_ELSE_ZERO, ca.OP_LT, ca.OP_LE,
    ca.OP_EQ, ca.OP_NE,
}  # fmt: skip


def kinked(rows: ca.Function) -> bool:
    """Whether a kink or a jump of the results lies somewhere in the first argument."""
    depends = [False] * rows.sz_w()
    for k in range(rows.n_instructions()):
        operation = rows.instruction_id(k)
        sources, targets = rows.instruction_input(k), rows.instruction_output(k)
        if operation == ca.OP_INPUT:
            depends[targets[0]] = sources[0] == 0
        elif operation == ca.OP_CONST:
            depends[targets[0]] = False
        elif operation != ca.OP_OUTPUT:
            depends[targets[0]] = any(depends[i] for i in sources)
            if operation in _KINKED and depends[targets[0]]:
                return True
    return False
