"""From the numbers of a recursion to a result: what is kept, by name, and what it is worth."""
