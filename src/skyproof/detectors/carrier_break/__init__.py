"""Compare the phases of carriers that broke together, before and after."""
