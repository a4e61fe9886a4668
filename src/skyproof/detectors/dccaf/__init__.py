"""Two consistent skies in overlapping signals, by the decomposed ambiguity function, and which of them is true."""
