"""One module a paper: its figures, and ours beside them (none yet)."""
