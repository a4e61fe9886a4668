"""Broadcast messages beside LNAV: what their frames carry, as receivers log them. One module a system."""
