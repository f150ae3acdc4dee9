"""Parts that several methods share: halves of a filter, memory, windows, linear systems."""
