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
    EXPECTED = "expected"
    CHANGES = "changes"

    @property
    def tier(self) -> int:
        """Return when in a window it is there: 0 at once, 1 once other tests have looked at it, 2 after those."""
        return {Need.FINDINGS: 1, Need.EXPECTED: 2}.get(self, 0)
