"""The detectors that come with the package in plain words, for people who know none of them."""

__all__ = ["about", "reason", "title"]

_ABOUT = {
    "array_common": ("Directions on an antenna array", "Do signals of several satellites come from one direction?"),
    "bands": ("Bands compared", "Do the codes of a satellite's bands differ by no more than the ionosphere explains?"),
    "beats": ("Beats of the signals' power", "Do signals beat as with a second sky that overlaps the tracked one?"),
    "carrier_break": ("Carriers that break together", "Do carriers that break at one moment go on together?"),
    "code_carrier": ("Code against carrier", "Does the code of each signal move with its carrier?"),
    "code_doppler": ("Code against Doppler", "Does the code of each tracked signal move as its Doppler says?"),
    "code_motion": (
        "Motion by codes",
        "Do position and clock from codes alone change only as a platform and a clock can?",
    ),
    "common_change": (
        "Common changes",
        "Do all satellites change together in a way that neither sky nor receiver explains?",
    ),
    "continuity": (
        "Continuity",
        "Do position, velocity, clock and time change only as a platform and an oscillator can?",
    ),
    "dccaf": ("Two skies in the correlation", "Do overlapping signals hold two consistent sets of ranges?"),
    "decision": ("Failed tests together", "Does a benign cause, or two, explain every test that failed in a window?"),
    "inertia": ("Inertial prediction", "Do position and velocity follow what the inertial unit predicts?"),
    "ins_array": ("Directions against attitude", "Does each signal come from where its satellite stands?"),
    "known_place": (
        "Ranges at a known place",
        "Do the few satellites received fit the place of the receiver?",
    ),
    "levels": ("Signal levels", "Do C/N0 and noise change only as sky and interference explain?"),
    "messages": ("Broadcast messages", "Do broadcast orbits, clocks and UTC agree with the day and with each other?"),
    "multi_receiver": (
        "Receivers compared",
        "Do the signals reach several receivers from one transmit antenna, or from the sky?",
    ),
    "own_fixes": ("The receiver's own fixes", "Do the fixes that the receiver computed itself continue?"),
    "place": ("Stated position", "Do the signals put the receiver where it stands?"),
    "second_signals": ("Second signals", "Is a satellite received more than once, farther apart than echoes are?"),
    "prediction": ("Prediction", "Which of two skies continues the time before the attack?"),
    "residual": ("One position or two", "Do all measurements of a receiver fit one position and time?"),
    "snapshot": ("Changes within a snapshot", "Do the signals change during a short recording?"),
    "spin": ("A turning antenna", "Do the signals come from one direction, or from many?"),
    "sqm": ("Shape of the correlation peak", "Does a second signal of the same satellite overlap the tracked one?"),
    "torn": ("Torn tracking", "Do more codes at once disagree with the orbits than satellites fail at once?"),
    "vector_sqm": ("Peaks against the common position", "Do correlation peaks agree with one common position?"),
}

_REASONS = {
    ("multi_receiver", "authentic"): "reaches the receivers from the sky, not from one antenna",
    ("multi_receiver", "spoofed"): "reaches the receivers from one antenna",
    ("array_common", "authentic"): "comes from a direction of its own",
    ("array_common", "spoofed"): "comes from the same direction as others",
    ("ins_array", "authentic"): "comes from where its satellite stands",
    ("ins_array", "spoofed"): "does not come from where its satellite stands",
    ("spin", "authentic"): "comes from a direction of its own",
    ("spin", "spoofed"): "comes from the same direction as others",
    ("prediction", "authentic"): "belongs to the predicted sky",
    ("prediction", "spoofed"): "belongs to a sky that the prediction excludes",
}


def title(detector: str) -> str:
    """Return a detector's heading; its own name where it is not of this package."""
    return _ABOUT[detector][0] if detector in _ABOUT else detector.replace("_", " ")


def about(detector: str) -> str:
    """Return the question that a detector asks; empty where that is not known."""
    return _ABOUT[detector][1] if detector in _ABOUT else ""


def reason(detector: str, label: str) -> str:
    """Describe what it means that a detector supports the label of a signal."""
    return _REASONS.get((detector, label), f"evidence of {title(detector).lower()}")
