"""Whether the signals of a snapshot stay what they are."""
