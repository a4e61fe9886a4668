"""Signals of one satellite within a chip: what their correlation looks like, and how it is taken apart."""
