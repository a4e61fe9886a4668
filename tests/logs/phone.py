"""GnssLogger texts made from the description of their columns, for tests of what reads them."""

from dataclasses import dataclass, replace

import numpy as np

__all__ = ["COLUMNS", "HEADER", "Measured", "make_raw_line"]

COLUMNS = [
    "utcTimeMillis",
    "TimeNanos",
    "LeapSecond",
    "TimeUncertaintyNanos",
    "FullBiasNanos",
    "BiasNanos",
    "BiasUncertaintyNanos",
    "DriftNanosPerSecond",
    "DriftUncertaintyNanosPerSecond",
    "HardwareClockDiscontinuityCount",
    "Svid",
    "TimeOffsetNanos",
    "State",
    "ReceivedSvTimeNanos",
    "ReceivedSvTimeUncertaintyNanos",
    "Cn0DbHz",
    "PseudorangeRateMetersPerSecond",
    "PseudorangeRateUncertaintyMetersPerSecond",
    "AccumulatedDeltaRangeState",
    "AccumulatedDeltaRangeMeters",
    "AccumulatedDeltaRangeUncertaintyMeters",
    "CarrierFrequencyHz",
    "CarrierCycles",
    "CarrierPhase",
    "CarrierPhaseUncertainty",
    "MultipathIndicator",
    "SnrInDb",
    "ConstellationType",
    "AgcDb",
    "BasebandCn0DbHz",
    "CodeType",
]
HEADER = (
    "# \n# Header Description:\n# \n# Version: v3.0.6.4 Platform: 14 Manufacturer: A Model: B\n# \n"
    f"# Raw,{','.join(COLUMNS)}\n# \n"
    "# Fix,Provider,LatitudeDegrees,LongitudeDegrees,AltitudeMeters,SpeedMps,AccuracyMeters,BearingDegrees,"
    "UnixTimeMillis,SpeedAccuracyMps,BearingAccuracyDegrees,elapsedRealtimeNanos,VerticalAccuracyMeters,MockLocation\n"
    "# \n# Nav,Svid,Type,Status,MessageId,Sub-messageId,Data(Bytes)\n# \n"
    "# Agc,utcTimeMillis,TimeNanos,LeapSecond,TimeUncertaintyNanos,FullBiasNanos,BiasNanos,BiasUncertaintyNanos,"
    "DriftNanosPerSecond,DriftUncertaintyNanosPerSecond,HardwareClockDiscontinuityCount,AgcDb,CarrierFrequencyHz,"
    "ConstellationType\n# \n"
)
WEEK_NS = 604_800 * 10**9
FULL_BIAS_NS = -1_400_000_000_123_456_789


@dataclass(frozen=True)
class Measured:
    """A Raw row, of GPS 5 on L1 with everything decoded.

    travel_ns : from the time of transmission to what the clock shows.
    """

    time_ns: int = 10**12
    travel_ns: int = 75_000_000
    full_bias_ns: int = FULL_BIAS_NS
    bias_ns: float = 0.0
    breaks: int = 0
    svid: int = 5
    constellation: int = 1
    state: int = 0b1111
    ahead_ns: int = 0  # of the system's time, before GPS time
    modulus_ns: int = WEEK_NS
    offset_ns: float = 0.0
    rate_m_s: float = -321.5
    cn0_dbhz: float = 31.5
    adr_state: int = 0
    adr_m: float = 0.0
    carrier_hz: float | None = 1575.42e6
    code: str = "C"
    agc_db: float | None = None

    @property
    def shown_ns(self) -> int:
        """Return what the clock shows by the bias of the row itself, nanoseconds of GPS time."""
        return self.time_ns - self.full_bias_ns - round(self.bias_ns)

    @property
    def sent_ns(self) -> int:
        return (self.shown_ns - self.travel_ns + self.ahead_ns) % self.modulus_ns

    def at(self, second: float, **given: object) -> "Measured":
        """Return the row so much later by the phone's clock."""
        return replace(self, time_ns=self.time_ns + round(second * 1e9), **given)


def make_raw_line(m: Measured, columns: list[str] = COLUMNS) -> str:
    """Return a row with the fields in the order of these columns; fields of other names are empty."""
    values = {
        "utcTimeMillis": 1_700_000_000_000,
        "TimeNanos": m.time_ns,
        "FullBiasNanos": m.full_bias_ns,
        "BiasNanos": m.bias_ns,
        "BiasUncertaintyNanos": 25.5,
        "HardwareClockDiscontinuityCount": m.breaks,
        "Svid": m.svid,
        "TimeOffsetNanos": m.offset_ns,
        "State": m.state,
        "ReceivedSvTimeNanos": m.sent_ns,
        "ReceivedSvTimeUncertaintyNanos": 14,
        "Cn0DbHz": m.cn0_dbhz,
        "PseudorangeRateMetersPerSecond": m.rate_m_s,
        "PseudorangeRateUncertaintyMetersPerSecond": 0.125,
        "AccumulatedDeltaRangeState": m.adr_state,
        "AccumulatedDeltaRangeMeters": m.adr_m,
        "AccumulatedDeltaRangeUncertaintyMeters": 0.01,
        "CarrierFrequencyHz": m.carrier_hz,
        "ConstellationType": m.constellation,
        "AgcDb": m.agc_db,
        "CodeType": m.code,
    }
    fields = (values.get(name) for name in columns)
    return ",".join(["Raw", *("" if v is None else repr(v) if isinstance(v, float) else str(v) for v in fields)]) + "\n"


def sign_bytes(octets: np.ndarray) -> str:
    """Return bytes as Java writes them."""
    return ",".join(str(v) for v in octets.astype(np.int8).tolist())
