"""Name what a detector may need of a window."""

from enum import StrEnum

__all__ = ["Need"]


class Need(StrEnum):
    """What a detector may need of a window. All but `TWO_RECEIVERS` are fields of `Records`."""

    OBSERVATIONS = "observations"
    TWO_RECEIVERS = "two_receivers"
    NAVIGATION = "navigation"
    SETS = "sets"
    TAPS = "taps"
    VECTOR_TAPS = "vector_taps"
    CCAF = "ccaf"
    ARRAY_PHASES = "array_phases"
    NAV_STATE = "nav_state"
    SPIN_ARMS = "spin_arms"
    OWN_FIXES = "own_fixes"
    STANDING = "standing"
    INERTIAL = "inertial"
    FINDINGS = "findings"
