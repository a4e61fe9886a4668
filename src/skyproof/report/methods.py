"""The detectors that come with the package in plain words, for people who know none of them."""

__all__ = ["about", "reason", "title"]

_ABOUT = {
    "array_common": ("Directions on an antenna array", "Do signals of several satellites come from one direction?"),
    "common_change": ("What changes alike", "Do all satellites change together as neither sky nor receiver does?"),
    "continuity": ("What goes on", "Do position, velocity, clock and time go on as a platform and an oscillator can?"),
    "dccaf": ("Two skies in the correlation", "Do overlapping signals hold two consistent sets of ranges?"),
    "decision": ("What failed together", "Does a benign cause, or two, explain every test that failed in a window?"),
    "ins_array": ("Directions against attitude", "Does each signal come from where its satellite stands?"),
    "multi_receiver": (
        "Receivers compared",
        "Do signals reach several receivers as from one transmit antenna, or as from the sky?",
    ),
    "second_signals": ("Second signals", "Is a satellite received more than once, farther apart than echoes are?"),
    "prediction": ("What was to be expected", "Which of two skies goes on from the time before the attack?"),
    "residual": ("One position or two", "Do all measurements of a receiver fit one position and time?"),
    "spin": ("A turning antenna", "Do the signals swing as those of one direction do, or of many?"),
    "sqm": ("Shape of the correlation peak", "Does a second signal of the same satellite overlap the tracked one?"),
    "vector_sqm": ("Peaks against the common position", "Are signals displaced from where the position puts them?"),
}

_REASONS = {
    ("multi_receiver", "authentic"): "reaches the receivers as from the sky, not from one antenna",
    ("multi_receiver", "spoofed"): "reaches the receivers as from one antenna",
    ("array_common", "authentic"): "comes from a direction of its own",
    ("array_common", "spoofed"): "comes from the same direction as others",
    ("ins_array", "authentic"): "comes from where its satellite stands",
    ("ins_array", "spoofed"): "does not come from where its satellite stands",
    ("spin", "authentic"): "swings as from a direction of its own",
    ("spin", "spoofed"): "swings as from the same direction as others",
    ("prediction", "authentic"): "belongs to the sky that was to be expected",
    ("prediction", "spoofed"): "belongs to a sky that was not to be expected, beside one that was",
}


def title(detector: str) -> str:
    """A heading for a detector; its own name where it is somebody else's."""
    return _ABOUT[detector][0] if detector in _ABOUT else detector.replace("_", " ")


def about(detector: str) -> str:
    """The question that it asks; empty where that is not known."""
    return _ABOUT[detector][1] if detector in _ABOUT else ""


def reason(detector: str, label: str) -> str:
    """What it means that a detector speaks for the label of one signal."""
    return _REASONS.get((detector, label), f"evidence of {title(detector).lower()}")
