"""One file for each peer; each imports its library only when it is built."""
