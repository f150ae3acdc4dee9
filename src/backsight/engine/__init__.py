"""How a recursion is described and executed."""
